//! Streaming of a planted forest in an app without a renderer: tiles come and go with the camera, edits reach the scene.
#![cfg(feature = "landscape")]

use bevy::{prelude::*, transform::TransformPlugin};
use bevy_treeline::{
    Forest, TreeAsset,
    landscape::{
        BiomeSettings, Biomes, ForestTile, Heightfield, PlantedForest, Planting, PlantingCounters,
        PlantingPlugin, PlantingSettings, PlantingSpecies, Scatter, ScatterSettings,
        ScatterSpecies,
    },
};
use std::sync::Arc;

const TILE_M: f32 = 64.0;

fn planting() -> Planting {
    let ground = Arc::new(Heightfield::rolling(2000.0, 64, 3));
    let biomes = Arc::new(Biomes::new(&*ground, &BiomeSettings::default()));
    let species = [("oak", 20.0, 5.0), ("spruce", 25.0, 3.0), ("grass_tuft", 0.5, 0.3)]
        .map(|(name, height, radius)| ScatterSpecies::new(name, height, radius));
    let settings = ScatterSettings { tile_m: TILE_M, ..default() };
    let scatter = Scatter::new(ground, biomes, species.to_vec(), settings).expect("it fits");
    let handles = || vec![Handle::<TreeAsset>::default()];
    let kind = PlantingSpecies { summer: handles(), unit_scale: 2.0, ..default() };
    // Oaks have a second handle, so the species behind them count from 2.
    let oak = PlantingSpecies { autumn: handles(), ..kind.clone() };
    Planting::new(PlantedForest::new(Arc::new(scatter)), &[oak, kind.clone(), kind])
}

/// An app with a camera at the origin.
fn app(settings: PlantingSettings) -> (App, Entity) {
    let mut app = App::new();
    app.add_plugins((MinimalPlugins, TransformPlugin, PlantingPlugin))
        .insert_resource(settings)
        .insert_resource(planting());
    let camera = app.world_mut().spawn(Camera3d::default()).id();
    (app, camera)
}

fn waiting() -> PlantingSettings {
    PlantingSettings { tree_distance_m: 200.0, cover_distance_m: 40.0, wait: true, ..default() }
}

/// Tiles in the scene and their plants, by layer and number.
fn scene(app: &mut App) -> Vec<(bool, [i32; 2], usize)> {
    let world = app.world_mut();
    let mut query = world.query::<(&ForestTile, &Forest)>();
    let mut all: Vec<_> =
        query.iter(world).map(|(t, f)| (t.cover, t.tile.to_array(), f.len())).collect();
    all.sort_unstable();
    all
}

fn counters(app: &App) -> PlantingCounters {
    *app.world().resource::<PlantingCounters>()
}

#[test]
fn the_first_frame_has_every_tile_if_it_waits_and_tiles_follow_the_camera() {
    let (mut app, camera) = app(waiting());
    app.update();
    let first = scene(&mut app);
    let counted = counters(&app);
    assert_eq!(counted.pending, 0);
    assert!(counted.trees > 200 && counted.cover > 100, "{counted:?}");
    assert_eq!(first.iter().map(|t| t.2).sum::<usize>(), counted.trees + counted.cover);
    let distance = |tile: [i32; 2], eye: Vec2| {
        let low = IVec2::from_array(tile).as_vec2() * TILE_M;
        eye.distance(eye.clamp(low, low + TILE_M))
    };
    assert!(first.iter().all(|(_, tile, _)| distance(*tile, Vec2::ZERO) < 220.0));
    // Each tile holds what scattering says.
    let planting = app.world().resource::<Planting>();
    for (cover, tile, plants) in &first {
        let (scatter, tile) = (planting.forest().scatter(), IVec2::from_array(*tile));
        let made = if *cover { scatter.cover_tile(tile) } else { scatter.tile(tile) };
        assert_eq!(made.len(), *plants);
    }
    // Away and back: the same again; a small step changes nothing.
    let go = |x: f32, app: &mut App| {
        app.world_mut().get_mut::<Transform>(camera).expect("a camera").translation.x = x;
        app.update();
    };
    go(700.0, &mut app);
    let there = scene(&mut app);
    assert!(
        there
            .iter()
            .all(|(cover, tile, _)| *cover || distance(*tile, Vec2::new(700.0, 0.0)) < 264.0)
    );
    assert!(there.iter().all(|tile| !first.contains(tile)));
    go(0.0, &mut app);
    assert_eq!(scene(&mut app), first);
    go(0.5, &mut app);
    assert_eq!(scene(&mut app), first);
    app.world_mut().remove_resource::<Planting>();
    app.update();
    assert!(scene(&mut app).is_empty() && counters(&app) == PlantingCounters::default());
}

#[test]
fn without_waiting_the_same_tiles_come_over_several_frames() {
    let (mut app, _) = app(waiting());
    app.update();
    let all = scene(&mut app);
    let (mut app, _) = self::app(PlantingSettings { wait: false, ..waiting() });
    app.update();
    assert!(counters(&app).pending > 0);
    for _ in 0..5_000 {
        app.update();
        if counters(&app).pending == 0 {
            break;
        }
        std::thread::sleep(std::time::Duration::from_millis(2));
    }
    assert_eq!(scene(&mut app), all);
}

#[test]
fn edits_refresh_their_tiles_only() {
    let (mut app, _) = app(waiting());
    app.update();
    let before = scene(&mut app);
    let mut planting = app.world_mut().resource_mut::<Planting>();
    let found = planting.forest().nearest(Vec3::ZERO, 150.0).expect("a tree is near");
    let tile = planting.forest().tile_of(found.tree.position);
    planting.remove(found.id).expect("it stands");
    app.update();
    let changed: Vec<_> =
        scene(&mut app).into_iter().filter(|tile| !before.contains(tile)).collect();
    let was = before.iter().find(|t| !t.0 && t.1 == tile.to_array()).expect("its tile").2;
    assert_eq!(changed, [(false, tile.to_array(), was - 1)]);
    let mut planting = app.world_mut().resource_mut::<Planting>();
    planting.add(found.tree).expect("plantable");
    app.update();
    assert_eq!(scene(&mut app), before);
}

#[test]
fn the_bound_on_plants_keeps_the_nearest_tiles() {
    let (mut app, _) = app(PlantingSettings { max_trees: 600, ..waiting() });
    app.update();
    let counted = counters(&app);
    assert!(counted.trees + counted.cover <= 600 && counted.refused > 0, "{counted:?}");
    assert!(counted.cover > 0 || counted.trees > 0);
    assert_eq!(counted.pending, 0);
}

#[test]
fn late_in_the_year_oaks_wear_their_other_model() {
    let (mut app, _) = app(waiting());
    app.update();
    let species = |app: &mut App| {
        let world = app.world_mut();
        let mut query = world.query::<&Forest>();
        let mut all: Vec<u16> =
            query.iter(world).flat_map(|f| f.iter().map(|t| t.species)).collect();
        all.sort_unstable();
        all.dedup();
        all
    };
    assert_eq!(species(&mut app), [0, 2, 3]);
    app.world_mut().resource_mut::<Planting>().set_season(1.0);
    app.update();
    assert_eq!(species(&mut app), [1, 2, 3]);
}
