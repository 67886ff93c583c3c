//! Forests that come, go and move over frames: what is on the GPU is what the world holds, and nothing else shows.

mod common;

use bevy::{camera::visibility::RenderLayers, prelude::*};
use bevy_treeline::{
    Forest, SplatPath, TreeAsset, TreeImpostor, TreeInstance, TreelineSettings, UploadBudget,
    math::hash::SplitMix64,
};
use common::{Stage, coverage};
use image::RgbaImage;

const SIZE: UVec2 = UVec2::new(128, 96);
/// Side of a tile, metres.
const TILE: f32 = 40.0;

fn camera_place() -> Transform {
    Transform::from_xyz(0.0, 14.0, 30.0).looking_at(Vec3::new(0.0, 2.0, -60.0), Vec3::Y)
}

/// Trees of a tile: the same for the same tile, 0 to 500 of them.
fn tile_trees(tile: IVec2, trees: usize) -> impl Iterator<Item = TreeInstance> {
    let mut random = SplitMix64((tile.x + 1000 * tile.y) as u64);
    (0..trees).map(move |_| {
        let at = Vec3::new(random.range(0.0, TILE), 0.0, random.range(0.0, TILE));
        TreeInstance::at(at)
            .with_yaw(random.range(-3.0, 3.0))
            .with_scale(random.range(0.12, 0.35))
            .with_species(random.below(2) as u16)
    })
}

fn place(tile: IVec2) -> Transform {
    Transform::from_xyz(tile.x as f32 * TILE, 0.0, tile.y as f32 * TILE)
}

fn tile(species: &[Handle<TreeAsset>; 2], tile: IVec2, trees: usize) -> (Forest, Transform) {
    (Forest::new(species.clone()).with(tile_trees(tile, trees)), place(tile))
}

fn species(stage: &mut Stage) -> [Handle<TreeAsset>; 2] {
    ["oak", "birch"].map(|name| stage.tree(name, false))
}

/// A fresh app with these tiles and nothing else.
fn fresh(test: &str, path: SplatPath, tiles: &[Placed]) -> Option<RgbaImage> {
    let mut stage = Stage::new(test, path)?;
    let species = species(&mut stage);
    for (at, trees, moved_to) in tiles {
        stage.world().spawn((tile(&species, *at, *trees).0, place(*moved_to)));
    }
    let (_, image) = stage.view(SIZE, camera_place());
    Some(stage.shoot(&image, 4))
}

/// Whose trees, how many, and where they stand.
type Placed = (IVec2, usize, IVec2);

/// Adds, removes, moves, empties, fills and hides tiles over frames; returns those that are left and the picture.
fn churned(path: SplatPath, budget: Option<usize>) -> Option<(Vec<Placed>, RgbaImage)> {
    let mut stage = Stage::new("churned", path)?;
    stage.world().insert_resource(UploadBudget { bytes_per_frame: budget });
    let species = species(&mut stage);
    let (_, image) = stage.view(SIZE, camera_place());
    let mut random = SplitMix64(11);
    let mut tiles: Vec<(Entity, IVec2, usize, IVec2)> = vec![];
    for _ in 0..60 {
        for _ in 0..3 {
            let at = IVec2::new(random.below(9) as i32 - 4, -(random.below(8) as i32));
            let trees = [0, 3, 40, 250, 256, 257, 500][random.below(7)];
            let i = random.below(tiles.len().max(1));
            match random.below(8) {
                0..4 => {
                    let entity = stage.world().spawn(tile(&species, at, trees)).id();
                    tiles.push((entity, at, trees, at));
                }
                4..6 if tiles.len() > 12 => {
                    let (entity, ..) = tiles.swap_remove(i);
                    stage.world().despawn(entity);
                }
                6 if !tiles.is_empty() => {
                    let (entity, _, _, place_now) = &mut tiles[i];
                    *place_now = at;
                    stage.world().entity_mut(*entity).insert(place(at));
                }
                7 if !tiles.is_empty() => {
                    let (entity, tile_now, trees_now, _) = &mut tiles[i];
                    (*tile_now, *trees_now) = (at, trees);
                    let forest = tile(&species, at, trees).0;
                    stage.world().entity_mut(*entity).insert(forest);
                }
                _ => {}
            }
        }
        stage.step(1);
    }
    // Gone and back: its slice is another one now.
    let (hidden, ..) = tiles[0];
    stage.world().entity_mut(hidden).insert(Visibility::Hidden);
    stage.step(1);
    stage.world().entity_mut(hidden).insert(Visibility::Inherited);
    let picture = stage.shoot(&image, 60);
    Some((tiles.into_iter().map(|(_, at, trees, moved)| (at, trees, moved)).collect(), picture))
}

#[test]
fn tiles_that_came_and_went_leave_the_picture_of_a_fresh_app() {
    for path in [SplatPath::Auto, SplatPath::U32] {
        let Some((tiles, picture)) = churned(path, None) else { return };
        assert!(coverage(&picture) > 500.0, "trees are in sight");
        let fresh = fresh("fresh", path, &tiles);
        assert!(fresh.is_some_and(|fresh| fresh == picture), "{path:?}");
    }
}

#[test]
fn tiles_that_had_to_wait_are_all_there_in_the_end() {
    let Some((tiles, picture)) = churned(SplatPath::Auto, Some(5_000)) else { return };
    assert!(fresh("waited", SplatPath::Auto, &tiles).is_some_and(|fresh| fresh == picture));
}

#[test]
fn a_budget_lets_forests_wait_for_their_turn() {
    let Some(mut stage) = Stage::new("a_budget", SplatPath::Auto) else { return };
    // 250 trees take 6,000 bytes: two tiles a frame.
    stage.world().insert_resource(UploadBudget { bytes_per_frame: Some(15_000) });
    let species = species(&mut stage);
    let (camera, _) = stage.view(SIZE, camera_place());
    for x in 0..5 {
        stage.world().spawn(tile(&species, IVec2::new(x, 0), 250));
    }
    stage.step(2);
    // The first ones do not wait.
    assert_eq!(stage.counters(camera).instances_seen, 1250);
    for x in 0..5 {
        stage.world().spawn(tile(&species, IVec2::new(x, -1), 250));
    }
    let mut seen = vec![];
    for _ in 0..5 {
        stage.step(1);
        let counters = stage.counters(camera);
        seen.push((counters.instances_seen, counters.waiting_forests));
    }
    seen.dedup();
    // Counters come back late.
    let late = seen.iter().position(|s| *s == (1750, 3)).expect("two came in the first frame");
    assert_eq!(seen[late..], [(1750, 3), (2250, 1), (2500, 0)]);
    // One larger than the budget arrives all the same.
    stage.world().spawn(tile(&species, IVec2::new(0, -2), 5000));
    stage.step(3);
    assert_eq!(stage.counters(camera).instances_seen, 7500);
}

#[test]
fn a_tree_looks_the_same_whatever_tiles_come_and_go_behind_the_camera() {
    let Some(mut stage) = Stage::new("behind_the_camera", SplatPath::Auto) else { return };
    let species = species(&mut stage);
    let (camera, image) = stage.view(SIZE, camera_place());
    // Less than a point each: who is drawn is decided by a hash.
    let settings = TreelineSettings { quality: 0.05, ..default() };
    stage.world().entity_mut(camera).insert(settings);
    let first = stage.world().spawn(tile(&species, IVec2::new(0, 4), 300)).id();
    let far = (0..3).flat_map(|i| tile_trees(IVec2::new(i, -40), 500));
    let far = far.map(|tree| TreeInstance { scale: 0.25, ..tree });
    let far = (Forest::new(species.clone()).with(far), Transform::from_xyz(-20.0, 0.0, -300.0));
    stage.world().spawn(far);
    let picture = stage.shoot(&image, 3);
    let drawn = stage.counters(camera);
    assert!(drawn.points > 50 && drawn.points < 1500, "{drawn:?}");
    stage.world().despawn(first);
    for y in 3..9 {
        stage.world().spawn(tile(&species, IVec2::new(y % 3, y), 400));
        assert!(stage.shoot(&image, 1) == picture, "tile {y}");
    }
    assert_eq!(stage.counters(camera).culled_tiles, 6);
}

#[test]
fn a_forest_beyond_its_view_range_is_not_drawn_and_a_nearer_one_fades_steadily() {
    let Some(mut stage) = Stage::new("beyond_its_view_range", SplatPath::Auto) else { return };
    let species = species(&mut stage);
    let (camera, image) = stage.view(SIZE, camera_place());
    let (forest, at) = tile(&species, IVec2::new(0, -3), 300);
    let forest = stage.world().spawn((forest.with_view_range(40.0..60.0), at)).id();
    // The nearest tree is 110 m away.
    assert_eq!(coverage(&stage.shoot(&image, 3)), 0.0);
    let counters = stage.counters(camera);
    assert_eq!((counters.instances_seen, counters.culled_tiles), (300, 1));
    assert_eq!((counters.culled_in_tiles, counters.items), (300, 0));
    let mut points = vec![];
    for end in [110, 125, 140, 160, 200, 300, 1000] {
        let mut forest = stage.world().get_mut::<Forest>(forest).expect("it is a forest");
        forest.set_view_range(Some(100.0..end as f32));
        stage.step(3);
        points.push(stage.counters(camera).points);
    }
    let mut trees = stage.world().get_mut::<Forest>(forest).expect("it is a forest");
    trees.set_view_range(None);
    stage.step(3);
    points.push(stage.counters(camera).points);
    assert!(points.is_sorted_by(|a, b| a < b) && points[0] < points[7] / 20, "{points:?}");
}

#[test]
fn cameras_see_the_trees_of_their_layers() {
    let Some(mut stage) = Stage::new("layers", SplatPath::Auto) else { return };
    let species = species(&mut stage);
    let (plain, _) = stage.view(SIZE, camera_place());
    let (both, _) = stage.view(SIZE, camera_place());
    let (other, other_image) = stage.view(SIZE, camera_place());
    stage.world().entity_mut(both).insert(RenderLayers::from_layers(&[0, 2]));
    stage.world().entity_mut(other).insert(RenderLayers::layer(1));
    stage.world().spawn(tile(&species, IVec2::new(0, -1), 30));
    let layered = (tile(&species, IVec2::new(-1, -1), 20), RenderLayers::layer(2));
    stage.world().spawn(layered);
    let lone = TreeImpostor::new(species[0].clone());
    stage.world().spawn((lone.clone(), RenderLayers::layer(2)));
    stage.world().spawn((lone, Transform::from_xyz(6.0, 0.0, 0.0)));
    stage.step(3);
    let seen = |camera| {
        let c = stage.counters(camera);
        c.instances_seen - c.culled_in_tiles
    };
    assert_eq!([plain, both, other].map(seen), [31, 52, 0]);
    assert_eq!(coverage(&stage.capture(&other_image)), 0.0);
}
