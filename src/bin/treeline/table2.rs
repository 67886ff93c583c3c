//! `treeline compare --table2`: the paper's Table 2. Fifty trees at four distances, as points and as meshes: points,
//! memory traffic and frame time in one run; and what selection and splatting cost for themselves.

use crate::{
    fly::headless::span,
    headless::{cpu_seconds, headless_app, render_target, step, target},
    options::ToolResult,
    scene,
    subject::z0,
};
use bevy::{camera::Projection, prelude::*};
use bevy_treeline::{
    Forest, SplatPath, TreeInstance, TreelineCounters, TreelineSettings, bake::Baked,
    lod::prefix_count,
};
use std::time::Instant;

const INSTANCES: usize = 50;
const SIZE: UVec2 = UVec2::new(1280, 720);

/// Medians of a scene's frames.
struct Cost {
    wall_ms: f64,
    cpu_ms: f64,
}

/// Draws `frames` frames after a warm-up. CPU time is counted in hundredths of a second, so it is averaged.
fn measure(app: &mut App, frames: u32) -> Cost {
    for _ in 0..5 {
        step(app);
    }
    let cpu = cpu_seconds();
    let mut walls = vec![];
    for _ in 0..frames {
        let start = Instant::now();
        step(app);
        walls.push(start.elapsed().as_secs_f64() * 1e3);
    }
    walls.sort_by(f64::total_cmp);
    let cpu_ms = (cpu_seconds() - cpu) * 1e3 / f64::from(frames);
    Cost { wall_ms: walls[walls.len() / 2], cpu_ms }
}

/// Fifty places at one distance from the origin, all in view.
fn places(distance: f32, center: Vec3) -> impl Iterator<Item = TreeInstance> {
    (0..INSTANCES).map(move |i| {
        let (column, row) = ((i % 10) as f32 - 4.5, (i / 10) as f32 - 2.0);
        let direction =
            Quat::from_euler(EulerRot::YXZ, column * 0.11, row * 0.12, 0.0) * Vec3::NEG_Z;
        let rotation = Quat::from_rotation_y(i as f32);
        TreeInstance { rotation, ..TreeInstance::at(direction * distance - rotation * center) }
    })
}

pub fn run(baked: &Baked, splat_path: SplatPath) -> ToolResult {
    let mut app = headless_app(splat_path)?;
    let world = app.world_mut();
    scene::add_light(world, 0.0);
    let center = baked.data.bounds.center();
    let d0 = prefix_count::d0(baked.data.pixel, z0());
    let points_only = scene::add_tree(world, baked, false);
    let mesh = scene::add_near_mesh(world, baked);
    let mesh_bytes = baked
        .model
        .meshes
        .iter()
        .map(|m| m.positions.len() * 32 + m.triangles.len() * 12)
        .sum::<usize>();
    let image = target(&mut app, SIZE.x, SIZE.y);
    let projection = PerspectiveProjection { near: d0 * 0.001, ..default() };
    let settings = TreelineSettings { quality: 1.0, ..default() };
    let camera = app.world_mut().spawn((
        scene::plain_camera(),
        render_target(&image),
        Projection::Perspective(projection),
        settings,
    ));
    let camera = camera.id();

    let empty = measure(&mut app, 20);
    println!(
        "{INSTANCES} instances, N0 {}, d0 {d0:.2}, mesh {:.1} MB; the empty frame takes {:.1} ms, {:.1} CPU ms",
        baked.data.point_count(),
        mesh_bytes as f64 / 1e6,
        empty.wall_ms,
        empty.cpu_ms
    );
    println!(
        "distance  points each      MB  points: ms  CPU ms  M points/CPU-s |  mesh: ms  CPU ms"
    );
    for distance in [d0, 2.0 * d0, 4.0 * d0, 8.0 * d0] {
        let forest = Forest::new([points_only.clone()]).with(places(distance, center));
        let forest = app.world_mut().spawn(forest).id();
        let points = measure(&mut app, 8);
        let counters = app.world().resource::<TreelineCounters>().of(camera).unwrap_or_default();
        let spans = ["select", "splat", "classify", "resolve"]
            .map(|pass| format!("{pass} {:.1}", span(&app, pass).unwrap_or(f64::NAN)));
        app.world_mut().despawn(forest);
        let mut meshes = vec![];
        for place in places(distance, center) {
            let transform = Transform {
                translation: place.position + place.rotation * center,
                rotation: place.rotation,
                scale: Vec3::ONE,
            };
            for part in &mesh.parts {
                let aabb = bevy::camera::primitives::Aabb {
                    center: part.center.into(),
                    half_extents: part.half_extents.into(),
                };
                let bundle = (
                    Mesh3d(part.mesh.clone()),
                    MeshMaterial3d(part.material.clone()),
                    transform,
                    aabb,
                );
                meshes.push(app.world_mut().spawn(bundle).id());
            }
        }
        let triangles = measure(&mut app, 3);
        for entity in meshes {
            app.world_mut().despawn(entity);
        }
        println!(
            "          GPU ms: {}; {} pixels show points",
            spans.join(", "),
            counters.covered_pixels
        );
        let each = counters.points as usize / INSTANCES;
        println!(
            "{distance:8.1}  {each:11}  {:6.2}  {:10.1}  {:6.1}  {:14.1} | {:9.1}  {:6.1}",
            each as f64 * 16.0 / 1e6,
            points.wall_ms,
            points.cpu_ms,
            f64::from(counters.points) / ((points.cpu_ms - empty.cpu_ms).max(0.1) * 1e3),
            triangles.wall_ms,
            triangles.cpu_ms
        );
    }
    // Behind the camera: seen and culled, nothing drawn.
    let behind = (0..10_000)
        .map(|i| TreeInstance::at(Vec3::new((i % 100) as f32, 0.0, 10.0 + (i / 100) as f32) * d0));
    let forest = Forest::new([points_only]).with(behind);
    app.world_mut().spawn(forest);
    let culled = measure(&mut app, 60);
    println!(
        "10,000 instances behind the camera: selection {:.2} GPU ms; the frame takes {:+.1} CPU ms against the empty one",
        span(&app, "select").unwrap_or(f64::NAN),
        culled.cpu_ms - empty.cpu_ms
    );
    Ok(())
}
