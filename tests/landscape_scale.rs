//! What thousands of forests cost: times of whole frames and of their parts, printed. Not a check: `--ignored` runs it.

mod common;

use bevy::{
    prelude::*,
    render::{RenderApp, render_resource::PollType, renderer::RenderDevice},
};
use bevy_treeline::{Forest, SplatPath, TreeAsset, TreeInstance, TreelineSettings};
use common::Stage;
use std::time::{Duration, Instant};

const SIZE: UVec2 = UVec2::new(320, 180);
/// Side of a forest, metres.
const TILE: f32 = 256.0;

fn forest(tree: &Handle<TreeAsset>, tile: IVec2, trees: u32) -> impl Bundle {
    let side = (trees as f32).sqrt();
    let at = |i: u32| {
        let cell = Vec2::new(i as f32 % side, (i as f32 / side).floor()) * (TILE / side);
        TreeInstance::at(Vec3::new(cell.x, 0.0, cell.y)).with_yaw(i as f32)
    };
    let corner = tile.as_vec2() * TILE;
    (
        Forest::new([tree.clone()]).with((0..trees).map(at)),
        Transform::from_xyz(corner.x, 0.0, corner.y),
    )
}

/// Times of the main world, extraction, the render world, and the GPU, of one frame.
fn timed_frame(app: &mut App) -> [Duration; 4] {
    let mut times = [Duration::ZERO; 4];
    let mut lap = Instant::now();
    let mut next = |slot: &mut Duration| {
        *slot = lap.elapsed();
        lap = Instant::now();
    };
    let subs = app.sub_apps_mut();
    subs.main.run_default_schedule();
    next(&mut times[0]);
    let render = subs.sub_apps.values_mut().next().expect("there is a renderer");
    render.extract(subs.main.world_mut());
    next(&mut times[1]);
    render.update();
    next(&mut times[2]);
    subs.main.world_mut().clear_trackers();
    let device = app.world().resource::<RenderDevice>();
    device.wgpu_device().poll(PollType::wait_indefinitely()).expect("the device works");
    next(&mut times[3]);
    times
}

/// Median of each part over frames, in milliseconds.
fn medians(stage: &mut Stage, frames: usize, mut change: impl FnMut(&mut Stage)) -> [f64; 4] {
    let mut all: Vec<[Duration; 4]> = vec![];
    for _ in 0..frames {
        change(stage);
        all.push(timed_frame(&mut stage.app));
    }
    std::array::from_fn(|part| {
        let mut times: Vec<Duration> = all.iter().map(|t| t[part]).collect();
        times.sort_unstable();
        times[times.len() / 2].as_secs_f64() * 1e3
    })
}

fn report(what: &str, [main, extract, render, gpu]: [f64; 4]) {
    println!(
        "{what}: main {main:.2} ms, extract {extract:.2} ms, render {render:.2} ms, GPU {gpu:.2} ms"
    );
}

#[test]
#[ignore = "measures, checks nothing"]
fn four_thousand_tiles_without_a_camera() {
    let Some(mut stage) = Stage::new("four_thousand_tiles", SplatPath::Auto) else { return };
    let tree = stage.tree("oak", true);
    assert_eq!(stage.app.sub_apps().sub_apps.len(), 1, "only the renderer");
    assert!(stage.app.get_sub_app(RenderApp).is_some());
    stage.step(3);
    report("no tile", medians(&mut stage, 60, |_| ()));
    let mut tiles: Vec<Entity> = (0..4000)
        .map(|i| stage.world().spawn(forest(&tree, IVec2::new(i % 64, i / 64), 256)).id())
        .collect();
    report("4,000 tiles arrive", medians(&mut stage, 1, |_| ()));
    stage.step(3);
    report("4,000 tiles", medians(&mut stage, 60, |_| ()));
    let mut next = 0;
    let changing = medians(&mut stage, 60, |stage| {
        for _ in 0..4 {
            let at = IVec2::new(next % 64, 70 + next / 64);
            let tile = &mut tiles[next as usize];
            stage.world().despawn(*tile);
            *tile = stage.world().spawn(forest(&tree, at, 256)).id();
            next += 1;
        }
    });
    report("4,000 tiles, 4 change a frame", changing);
}

#[test]
#[ignore = "measures, checks nothing"]
fn a_million_trees_with_a_sixth_in_sight() {
    let Some(mut stage) = Stage::new("a_million_trees", SplatPath::Auto) else { return };
    let tree = stage.tree("oak", true);
    let place = Transform::from_xyz(0.0, 40.0, 0.0).looking_to(Vec3::NEG_Z, Vec3::Y);
    let (camera, _) = stage.view(SIZE, place);
    let fov = std::f32::consts::FRAC_PI_3;
    let lens =
        PerspectiveProjection { fov: 2.0 * ((0.5 * fov).tan() / (16.0 / 9.0)).atan(), ..default() };
    let settings = TreelineSettings { quality: 0.05, ..default() };
    stage.world().entity_mut(camera).insert((Projection::Perspective(lens), settings));
    stage.step(3);
    report("no tree", medians(&mut stage, 20, |_| ()));
    for i in 0..4096 {
        stage.world().spawn(forest(&tree, IVec2::new(i % 64 - 32, i / 64 - 32), 256));
    }
    stage.step(4);
    report("1,048,576 trees, standing camera", medians(&mut stage, 20, |_| ()));
    let mut x = 0.0;
    let moving = medians(&mut stage, 20, |stage| {
        x += 0.5;
        let mut camera = stage.world().get_mut::<Transform>(camera).expect("it has a place");
        camera.translation.x = x;
    });
    report("1,048,576 trees, moving camera", moving);
    println!("{:?}", stage.counters(camera));
}
