//! Hidden trees are not drawn, and nothing lacks for it: pictures with occlusion culling against pictures without, frame
//! by frame, at rest and with a camera that jumps; and groves against trees looked at one by one.

mod common;

use bevy::{core_pipeline::prepass::DepthPrepass, prelude::*};
use bevy_treeline::{
    Forest, GroveSettings, Occlusion, SplatPath, TreeInstance, TreelineSettings, ViewCounters,
    math::hash::SplitMix64,
};
use common::Stage;
use image::RgbaImage;

const SIZE: UVec2 = UVec2::new(320, 200);

/// A dense forest of two species on a plain, 500 m deep.
fn plant(stage: &mut Stage, count: usize) -> Entity {
    let species = ["oak", "birch"].map(|name| stage.tree(name, false));
    let mut random = SplitMix64(7);
    let trees = (0..count).map(|i| {
        let at = Vec3::new(random.range(-200.0, 200.0), 0.0, random.range(-500.0, 0.0));
        TreeInstance { scale: random.range(0.7, 1.2), ..TreeInstance::at(at) }
            .with_yaw(random.range(-3.0, 3.0))
            .with_species((i % 2) as u16)
    });
    stage.world().spawn(Forest::new(species).with(trees)).id()
}

/// A camera and its picture.
type View = (Entity, Handle<Image>);

/// A stage with the forest and one camera for each of these, all at the same place.
fn planted(test: &str, count: usize, occlusion: &[Occlusion]) -> Option<(Stage, Vec<View>)> {
    let mut stage = Stage::new(test, SplatPath::Auto)?;
    let _ = plant(&mut stage, count);
    let views = occlusion.iter().map(|occlusion| {
        let view = stage.view(SIZE, Transform::from_xyz(0.0, 6.0, 10.0));
        let settings = TreelineSettings { occlusion: *occlusion, quality: 1.0, ..default() };
        stage.world().entity_mut(view.0).insert(settings);
        view
    });
    let views = views.collect();
    Some((stage, views))
}

/// Pixels that differ visibly.
fn different(a: &RgbaImage, b: &RgbaImage) -> usize {
    let differs = |(a, b): &(&image::Rgba<u8>, &image::Rgba<u8>)| {
        a.0.iter().zip(b.0).any(|(a, b)| a.abs_diff(b) > 2)
    };
    a.pixels().zip(b.pixels()).filter(differs).count()
}

fn look(stage: &mut Stage, views: &[View], place: Transform) {
    for (camera, _) in views {
        stage.world().entity_mut(*camera).insert(place);
    }
}

/// Places of a camera that moves so fast that no frame shows what the one before did.
fn jumps() -> Vec<Transform> {
    let at = |x: f32, y: f32, z: f32, yaw: f32| {
        Transform::from_xyz(x, y, z).with_rotation(Quat::from_rotation_y(yaw))
    };
    vec![
        at(0.0, 6.0, 10.0, 0.0),
        at(0.0, 6.0, 10.0, 0.5),
        at(-120.0, 15.0, -250.0, -1.2),
        at(150.0, 4.0, -400.0, 1.4),
        at(0.0, 60.0, 40.0, 0.2),
        at(-60.0, 3.0, -100.0, 3.0),
        at(-60.0, 3.0, -101.0, 2.7),
        at(0.0, 6.0, 10.0, 0.0),
    ]
}

#[test]
fn no_tree_lacks_for_a_frame_however_fast_the_camera_moves() {
    let modes = [Occlusion::Off, Occlusion::Exact, Occlusion::Closed];
    let Some((mut stage, views)) = planted("no_tree_lacks", 3000, &modes) else { return };
    stage.step(8);
    let mut second = 0;
    for place in jumps() {
        look(&mut stage, &views, place);
        // The very first frame there.
        stage.step(1);
        let [off, exact, closed] = [0, 1, 2].map(|i: usize| stage.capture(&views[i].1));
        let covered = stage.counters(views[0].0).covered_pixels.max(1);
        // At equal depth the later point wins, and the order is another: a handful of pixels.
        let wrong = different(&off, &exact);
        assert!(
            wrong <= 3 + SIZE.element_product() as usize / 20_000,
            "{wrong} pixels at {place:?}"
        );
        let wrong = different(&off, &closed);
        assert!(wrong <= 200, "closed: {wrong} of {covered} pixels at {place:?}");
        // Counters come back a frame or two later.
        for _ in 0..3 {
            second += stage.counters(views[1].0).second_points;
            stage.step(1);
        }
    }
    assert!(second > 0, "what came into view was drawn in the second phase");
}

#[test]
fn hidden_trees_and_clusters_are_not_drawn() {
    let modes = [Occlusion::Off, Occlusion::Exact, Occlusion::Closed];
    let Some((mut stage, views)) = planted("hidden_trees", 3000, &modes) else { return };
    stage.world().insert_resource(GroveSettings { samples_per_tree: 0 });
    stage.step(8);
    let [off, exact, closed]: [ViewCounters; 3] =
        [0, 1, 2].map(|i: usize| stage.counters(views[i].0));
    assert_eq!((off.culled_occluded, off.second_points), (0, 0));
    assert!(exact.culled_occluded > 0 && closed.culled_occluded > exact.culled_occluded);
    assert!(exact.points < off.points, "{} of {}", exact.points, off.points);
    assert!(closed.points < exact.points * 9 / 10, "{} of {}", closed.points, exact.points);
    assert_eq!([exact, closed].map(|c| c.instances_seen), [off.instances_seen; 2]);
    // At rest nothing is left for the second phase.
    assert!(exact.second_points * 50 < exact.points, "{exact:?}");
}

#[test]
fn a_wall_hides_the_forest_behind_it_from_cameras_with_a_prepass() {
    let Some((mut stage, views)) = planted("a_wall_hides", 2000, &[Occlusion::Exact; 2]) else {
        return;
    };
    let (bare, prepass) = (views[0].0, views[1].0);
    stage.world().entity_mut(prepass).insert(DepthPrepass);
    let mesh = stage.world().resource_mut::<Assets<Mesh>>().add(Cuboid::new(400.0, 90.0, 1.0));
    let material = stage.world().resource_mut::<Assets<StandardMaterial>>().add(Color::WHITE);
    let wall = (Mesh3d(mesh), MeshMaterial3d(material), Transform::from_xyz(0.0, 0.0, 36.0));
    let wall = stage.world().spawn(wall).id();
    look(&mut stage, &views, Transform::from_xyz(0.0, 6.0, 40.0));
    stage.step(8);
    let (seen, hidden) = (stage.counters(bare), stage.counters(prepass));
    assert!(seen.points > 100_000, "{seen:?}");
    assert!(hidden.points < seen.points / 100, "{hidden:?}");
    // Behind a wall that goes, all trees are there in the first frame.
    stage.world().entity_mut(wall).despawn();
    stage.step(1);
    let pictures = [0, 1].map(|i: usize| stage.capture(&views[i].1));
    let wrong = different(&pictures[0], &pictures[1]);
    assert!(wrong <= 6, "{wrong} pixels");
}

/// What a camera shows from far away, nearer and far away again, once all groves are made: counters and picture of each.
fn flown_by(stage: &mut Stage, (camera, image): &View) -> Vec<(ViewCounters, RgbaImage)> {
    let middle = Vec3::new(0.0, 0.0, -250.0);
    let distances = [9000.0, 2500.0, 900.0, 9000.0];
    let shown = distances.map(|distance| {
        let place = Transform::from_xyz(0.0, 0.12 * distance, distance);
        let place = place.looking_at(middle, Vec3::Y);
        stage.world().entity_mut(*camera).insert(place);
        // Counters come two frames late.
        stage.step(4);
        let made = (0..1000).any(|_| {
            stage.step(1);
            std::thread::sleep(std::time::Duration::from_millis(5));
            stage.find_counters(*camera).is_some_and(|counters| counters.pending_groves == 0)
        });
        assert!(made, "groves at {distance} m");
        stage.step(4);
        (stage.counters(*camera), stage.capture(image))
    });
    shown.into()
}

#[test]
fn groves_draw_what_their_trees_would_as_cameras_come_and_go() {
    let Some(mut stage) = Stage::new("groves_draw", SplatPath::Auto) else { return };
    let forest = plant(&mut stage, 4000);
    let view = stage.view(SIZE, Transform::IDENTITY);
    let settings = TreelineSettings { occlusion: Occlusion::Off, quality: 1.0, ..default() };
    stage.world().entity_mut(view.0).insert(settings);
    let with = flown_by(&mut stage, &view);
    // The same trees, without.
    stage.world().insert_resource(GroveSettings { samples_per_tree: 0 });
    stage.world().entity_mut(forest).despawn();
    plant(&mut stage, 4000);
    let without = flown_by(&mut stage, &view);
    for (i, ((with, picture), (without, expected))) in with.iter().zip(&without).enumerate() {
        assert!(with.groves >= 10 && without.groves == 0, "{i}: {with:?}");
        assert!(with.items * 4 < without.items, "{i}: {} of {}", with.items, without.items);
        let wrong = different(picture, expected);
        assert!(wrong <= 8, "{i}: {wrong} pixels of {}", without.covered_pixels);
    }
    // They keep what is seen of them, and no more.
    let bytes: Vec<u64> = (0..4).map(|i| with[i].0.tree_bytes - without[i].0.tree_bytes).collect();
    assert!(bytes[0] * 3 < bytes[1] && bytes[1] < bytes[2] && bytes[3] == bytes[0], "{bytes:?}");
}
