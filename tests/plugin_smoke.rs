//! The plugin in apps of every shape: nothing panics, and counters follow what the scene says.

mod common;

use bevy::{camera::RenderTarget, diagnostic::DiagnosticsStore, prelude::*};
use bevy_treeline::{
    CacheLocation, Forest, LodState, SplatPath, TreeAsset, TreeImpostor, TreeInstance,
    TreelineCounters, TreelineDiagnosticsPlugin, TreelinePlugin, TreelineSettings, ViewCounters,
    asset::NearMesh,
};
use common::{Stage, baked, before};

const SIZE: UVec2 = UVec2::new(64, 48);

/// `count` trees side by side, all before the camera of [`camera_place`].
fn rows(count: u32) -> impl Iterator<Item = TreeInstance> {
    (0..count).map(|i| {
        TreeInstance::at(Vec3::new((i % 6) as f32 * 5.0 - 12.5, 0.0, (i / 6) as f32 * -6.0))
    })
}

fn camera_place() -> Transform {
    before("oak", 60.0)
}

fn plugin() -> TreelinePlugin {
    TreelinePlugin { cache: CacheLocation::Off, ..default() }
}

/// An app without `RenderPlugin`, as servers and tests of game logic have.
fn logic_app(plugins: impl FnOnce(&mut App)) {
    let mut app = App::new();
    plugins(&mut app);
    app.add_plugins(plugin());
    app.finish();
    app.cleanup();
    let data = baked("oak").data.clone();
    let near = app.world_mut().resource_mut::<Assets<NearMesh>>().add(NearMesh::default());
    let asset = TreeAsset { data, near_mesh: Some(near) };
    let tree = app.world_mut().resource_mut::<Assets<TreeAsset>>().add(asset);
    let missing = app.world().resource::<AssetServer>().load("there is no such tree.glb");
    let world = app.world_mut();
    let forest = world.spawn(Forest::new([tree.clone(), missing.clone()]).with(rows(20))).id();
    let single = world.spawn(TreeImpostor::new(tree)).id();
    world.spawn(TreeImpostor::new(missing));
    world.spawn(Camera3d::default());
    for _ in 0..4 {
        app.update();
    }
    let world = app.world_mut();
    // No camera has a picture to draw, so nothing was chosen.
    assert_eq!(world.get::<LodState>(single), Some(&LodState::default()));
    assert_eq!(world.get::<Forest>(forest).map(Forest::len), Some(20));
    assert!(world.resource::<TreelineCounters>().all().is_empty());
    world.despawn(forest);
    world.despawn(single);
    app.update();
    let (ready, problems) = bevy_treeline::render::pipeline_states(app.world());
    assert_eq!((ready, problems.len()), (0, 1), "{problems:?}");
}

#[test]
fn without_a_renderer_nothing_panics() {
    logic_app(|app| {
        app.add_plugins((MinimalPlugins, AssetPlugin::default()));
    });
}

#[test]
fn without_a_renderer_the_assets_of_others_are_kept() {
    logic_app(|app| {
        app.add_plugins((MinimalPlugins, AssetPlugin::default(), TransformPlugin))
            .add_plugins((bevy::image::ImagePlugin::default(), bevy::mesh::MeshPlugin))
            .init_asset::<StandardMaterial>();
        let mesh = app.world_mut().resource_mut::<Assets<Mesh>>().add(Cuboid::default());
        app.insert_resource(Kept(mesh));
        app.add_systems(Last, |kept: Res<Kept>, meshes: Res<Assets<Mesh>>| {
            assert!(meshes.contains(&kept.0), "the plugin replaced the meshes of the app");
        });
    });
}

#[derive(Resource)]
struct Kept(Handle<Mesh>);

#[test]
fn an_empty_world_and_a_world_without_a_camera_draw() {
    let Some(mut stage) = Stage::new("an_empty_world", SplatPath::Auto) else { return };
    stage.step(2);
    let tree = stage.tree("oak", true);
    stage.world().spawn(Forest::new([tree.clone()]).with(rows(12)));
    stage.world().spawn(TreeImpostor::new(tree));
    stage.step(3);
    assert!(stage.world().resource::<TreelineCounters>().all().is_empty());
    // A camera without a tree in sight, then none of the trees either.
    let (camera, _) = stage.view(SIZE, camera_place().looking_to(Vec3::Z, Vec3::Y));
    stage.step(4);
    let counters = stage.counters(camera);
    // The single tree is looked at, the forest is not.
    assert_eq!((counters.instances_seen, counters.culled_frustum, counters.points), (13, 1, 0));
    assert_eq!((counters.culled_tiles, counters.culled_in_tiles), (1, 12));
    assert_eq!(counters.covered_pixels, 0);
}

#[test]
fn every_one_of_many_cameras_counts_its_own_trees() {
    let Some(mut stage) = Stage::new("every_one_of_many_cameras", SplatPath::Auto) else { return };
    let tree = stage.tree("oak", false);
    stage.world().spawn(Forest::new([tree]).with(rows(12)));
    let cameras: Vec<Entity> = (0..12)
        .map(|i| {
            let place = camera_place();
            let away = i % 2 == 1;
            let place = if away { place.looking_to(Vec3::Z, Vec3::Y) } else { place };
            stage.view(SIZE, place).0
        })
        .collect();
    stage.step(5);
    for (i, camera) in cameras.iter().enumerate() {
        let counters = stage.counters(*camera);
        let culled = if i % 2 == 1 { 12 } else { 0 };
        let found = (counters.instances_seen, counters.culled_in_tiles);
        assert_eq!(found, (12, culled), "camera {i}");
        assert_eq!(counters.points > 0, culled == 0, "camera {i}");
    }
}

#[test]
fn a_forest_of_missing_species_or_without_trees_is_not_drawn() {
    let Some(mut stage) = Stage::new("a_forest_of_missing_species", SplatPath::Auto) else {
        return;
    };
    let missing = stage.world().resource::<AssetServer>().load("there is no such tree.glb");
    let tree = stage.tree("oak", false);
    stage.world().spawn(Forest::new([missing.clone()]).with(rows(5)));
    stage.world().spawn(Forest::new([tree.clone()]));
    stage.world().spawn(Forest::new([]).with(rows(3)));
    stage.world().spawn(TreeImpostor::new(missing));
    let (camera, image) = stage.view(SIZE, camera_place());
    let picture = stage.shoot(&image, 4);
    assert_eq!(stage.counters(camera).instances_seen, 0);
    assert_eq!(common::coverage(&picture), 0.0);
    // One more whose first species is there and second is not.
    let both = [tree, Handle::default()];
    let trees = rows(6).enumerate().map(|(i, t)| t.with_species((i % 3) as u16));
    stage.world().spawn(Forest::new(both).with(trees));
    let picture = stage.shoot(&image, 3);
    assert_eq!(stage.counters(camera).instances_seen, 2);
    assert!(common::coverage(&picture) > 0.0);
}

#[test]
fn counters_follow_a_forest_that_changes() {
    let Some(mut stage) = Stage::new("counters_follow", SplatPath::Auto) else { return };
    let tree = stage.tree("oak", false);
    let forest = stage.world().spawn(Forest::new([tree.clone()]).with(rows(12))).id();
    let (camera, image) = stage.view(SIZE, camera_place());
    let seen = |stage: &mut Stage| {
        stage.step(4);
        let counters = stage.find_counters(camera).unwrap_or_default();
        (counters.instances_seen, counters.culled_frustum + counters.culled_in_tiles)
    };
    assert_eq!(seen(&mut stage), (12, 0));
    let behind = TreeInstance::at(Vec3::Z * 200.0);
    stage.world().get_mut::<Forest>(forest).expect("it is there").push(behind);
    assert_eq!(seen(&mut stage), (13, 1));
    assert!(stage.world().get_mut::<Forest>(forest).expect("it is there").set(0, behind));
    assert_eq!(seen(&mut stage), (13, 2));
    let gone = stage.world().get_mut::<Forest>(forest).expect("it is there").swap_remove(0);
    assert_eq!(gone.map(|t| t.position), Some(behind.position));
    assert_eq!(seen(&mut stage), (12, 1));
    // The forest moves out of sight as a whole, and hides.
    stage.world().entity_mut(forest).insert(Transform::from_xyz(0.0, 0.0, 500.0));
    assert_eq!(seen(&mut stage), (12, 12));
    stage.world().entity_mut(forest).insert((Transform::default(), Visibility::Hidden));
    assert_eq!(seen(&mut stage), (0, 0));
    stage.world().entity_mut(forest).insert(Visibility::Visible);
    assert_eq!(seen(&mut stage), (12, 1));
    let other = stage.world().spawn(Forest::new([tree]).with(rows(3))).id();
    assert_eq!(seen(&mut stage), (15, 1));
    stage.world().despawn(forest);
    assert_eq!(seen(&mut stage), (3, 0));
    stage.world().despawn(other);
    assert_eq!(seen(&mut stage), (0, 0));
    assert_eq!(common::coverage(&stage.capture(&image)), 0.0, "no point is left behind");
}

fn points_diagnostic(stage: &Stage) -> Option<f64> {
    let store = stage.app.world().resource::<DiagnosticsStore>();
    store.get(&TreelineDiagnosticsPlugin::POINTS).and_then(|d| d.value())
}

#[test]
fn a_camera_that_stops_drawing_trees_stops_counting_them() {
    let Some(mut stage) = Stage::new("a_camera_that_stops", SplatPath::Auto) else { return };
    let tree = stage.tree("oak", false);
    stage.world().spawn(Forest::new([tree]).with(rows(12)));
    let (first, image) = stage.view(SIZE, camera_place());
    let (second, _) = stage.view(SIZE, camera_place());
    stage.step(4);
    let points = stage.counters(first).points;
    assert!(points > 0);
    assert_eq!(points_diagnostic(&stage), Some(2.0 * f64::from(points)));

    let off = TreelineSettings { enabled: false, ..default() };
    stage.world().entity_mut(first).insert(off);
    let picture = stage.shoot(&image, 4);
    assert_eq!(common::coverage(&picture), 0.0);
    assert_eq!(stage.find_counters(first), None);
    assert_eq!(points_diagnostic(&stage), Some(f64::from(points)));

    stage.world().entity_mut(first).remove::<TreelineSettings>();
    stage.step(4);
    assert_eq!(stage.counters(first).points, points);

    stage.world().get_mut::<Camera>(first).expect("it is a camera").is_active = false;
    stage.world().despawn(second);
    stage.step(4);
    assert_eq!((stage.find_counters(first), stage.find_counters(second)), (None, None));
    assert_eq!(points_diagnostic(&stage), Some(0.0));
}

#[test]
fn single_trees_that_come_in_numbers_leave_the_forest_in_every_frame() {
    let Some(mut stage) = Stage::new("single_trees_in_numbers", SplatPath::Auto) else { return };
    let tree = stage.tree("oak", false);
    stage.world().spawn(Forest::new([tree.clone()]).with(rows(12)));
    let (camera, image) = stage.view(SIZE, camera_place());
    let picture = stage.shoot(&image, 3);
    assert!(common::coverage(&picture) > 50.0);
    // More than the room that buffers have to spare, behind the camera.
    for i in 0..2000 {
        let place = Transform::from_xyz(i as f32, 0.0, 300.0);
        stage.world().spawn((TreeImpostor::new(tree.clone()), place));
    }
    for frame in 0..3 {
        let now = stage.shoot(&image, 1);
        assert!(now == picture, "frame {frame} after the trees came differs");
    }
    let ViewCounters { instances_seen, culled_frustum, .. } = stage.counters(camera);
    assert_eq!((instances_seen, culled_frustum), (2012, 2000));
}

#[test]
fn cameras_without_pixels_or_with_absurd_settings_do_no_harm() {
    let Some(mut stage) = Stage::new("cameras_without_pixels", SplatPath::Auto) else { return };
    let tree = stage.tree("oak", false);
    let odd = [0.0, -1.0, f32::NAN, f32::INFINITY, 1e30];
    let trees = odd.map(|scale| TreeInstance::at(Vec3::ZERO).with_scale(scale));
    let places = odd.map(|x| TreeInstance::at(Vec3::splat(x)));
    stage.world().spawn(Forest::new([tree.clone()]).with(rows(6)).with(trees).with(places));
    let flat = Transform::from_scale(Vec3::ZERO);
    stage.world().spawn((TreeImpostor::new(tree), flat));
    let settings = TreelineSettings {
        quality: f32::NAN,
        min_mesh_distance: f32::INFINITY,
        fade_width: -3.0,
        point_capacity_millions: 0.0,
        ..default()
    };
    let (camera, image) = stage.view(SIZE, camera_place());
    stage.world().entity_mut(camera).insert(settings);
    let none = RenderTarget::None { size: UVec2::new(64, 48) };
    stage.world().spawn((common::plain_camera(), none, camera_place()));
    let (inside, _) = stage.view(UVec2::ONE, Transform::from_xyz(0.0, 5.0, 0.0));
    let picture = stage.shoot(&image, 4);
    assert!(common::coverage(&picture) > 0.0);
    assert!(stage.counters(inside).instances_seen >= 6);
}
