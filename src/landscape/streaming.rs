//! Keeps the tiles of a planting around the cameras: which are wanted, which are in work, which are in the scene.
//!
//! The list of wanted tiles, nearest first, is made again when a camera has moved by an eighth of a tile. Tasks make whole
//! `Forest` components; a frame starts a few, takes those that are done while its time lasts, and drops tiles that are
//! a tile beyond the distance. O(tiles) when the list is made, else O(tiles in work).

use super::planting::{ForestTile, Planting, PlantingCounters, PlantingSettings};
use crate::forest::Forest;
use bevy::{
    prelude::*,
    tasks::{AsyncComputeTaskPool, Task, TaskPool, block_on},
};
use std::{collections::BTreeMap, sync::Arc, time::Instant};

/// Tasks at one time for each thread of the pool: enough to keep it busy over a frame, few enough that nearer tiles need not wait long.
const TASKS_PER_THREAD: usize = 3;

/// Ground cover or not, and the number: order of all maps here.
type Key = (bool, [i32; 2]);

/// A tile that is wanted or in the scene.
#[derive(Default)]
struct Tile {
    /// In work.
    task: Option<Task<Forest>>,
    /// In the scene, with this many plants; no entity if there are none.
    planted: Option<(Option<Entity>, usize)>,
    /// The planted form is outdated.
    stale: bool,
    /// Left out for want of room until the list is made again.
    refused: bool,
    /// In the list of wanted tiles; others only stay until they are too far, or outdated.
    wanted: bool,
}

impl Tile {
    fn is_due(&self) -> bool {
        let missing = self.stale || self.planted.is_none();
        self.wanted && missing && !self.refused && self.task.is_none()
    }

    fn plants(&self) -> usize {
        self.planted.map_or(0, |(_, plants)| plants)
    }
}

/// Everything that is streamed.
#[derive(Resource, Default)]
pub(super) struct Tiles {
    tiles: BTreeMap<Key, Tile>,
    /// All wanted tiles, nearest first.
    wanted: Vec<(f32, Key)>,
    /// What the list was made for.
    made_for: Option<(Vec<Vec2>, PlantingSettings, u64)>,
    plants: usize,
    /// Of trees and cover, as the tiles have them.
    distances: [f32; 2],
    /// Nothing is left to do until a camera, a setting or the planting changes.
    settled: bool,
}

impl Tiles {
    fn remove(&mut self, key: Key, commands: &mut Commands) {
        let Some(tile) = self.tiles.remove(&key) else { return };
        self.plants -= tile.plants();
        if let Some((Some(entity), _)) = tile.planted {
            commands.entity(entity).try_despawn();
        }
    }

    fn clear(&mut self, commands: &mut Commands) {
        for key in self.tiles.keys().copied().collect::<Vec<_>>() {
            self.remove(key, commands);
        }
        *self = Self::default();
    }

    /// Makes the list of wanted tiles again, if it has to be, and drops those far beyond.
    fn update_wanted(
        &mut self,
        eyes: Vec<Vec2>,
        planting: &Planting,
        settings: &PlantingSettings,
        commands: &mut Commands,
    ) {
        let scatter = planting.forest().scatter();
        let step = scatter.tile_size_m().min(scatter.cover_tile_size_m()) / 8.0;
        let is_near = |(a, b): (&Vec2, &Vec2)| a.distance(*b) < step;
        if let Some((before, with, serial)) = &self.made_for {
            let moved = before.len() != eyes.len() || !std::iter::zip(before, &eyes).all(is_near);
            if *serial != planting.serial {
                self.clear(commands);
            } else if !moved && with == settings {
                return;
            }
        }
        let side = scatter.ground().side_m();
        let layers = [
            (false, settings.tree_distance_m, scatter.tile_size_m()),
            (true, settings.cover_distance_m, scatter.cover_tile_size_m()),
        ];
        let mut wanted: BTreeMap<Key, f32> = BTreeMap::new();
        for (cover, distance, size) in layers {
            // A step more, so that none is late.
            let reach = distance.max(0.0) + if distance > 0.0 { step } else { 0.0 };
            let last = (0.5 * side / size).ceil() as i32 - 1;
            let [first, last] = [IVec2::splat(-last - 1), IVec2::splat(last)];
            for eye in eyes.iter().filter(|_| reach > 0.0) {
                let low = ((eye - reach) / size).floor().as_ivec2().max(first);
                let high = ((eye + reach) / size).floor().as_ivec2().min(last);
                for (x, z) in (low.y..=high.y).flat_map(|z| (low.x..=high.x).map(move |x| (x, z))) {
                    let away = distance_to_tile(*eye, IVec2::new(x, z), size);
                    if away <= reach {
                        let nearest = wanted.entry((cover, [x, z])).or_insert(away);
                        *nearest = nearest.min(away);
                    }
                }
            }
        }
        let outside: Vec<Key> = self
            .tiles
            .keys()
            .filter(|key| !wanted.contains_key(key))
            .filter(|(cover, tile)| {
                let (_, distance, size) = layers[usize::from(*cover)];
                let away = |eye: &Vec2| distance_to_tile(*eye, IVec2::from_array(*tile), size);
                // Back and forth over a border costs nothing.
                let is_planted = self
                    .tiles
                    .get(&(*cover, *tile))
                    .is_some_and(|t| t.planted.is_some() && !t.stale);
                distance <= 0.0
                    || !is_planted
                    || !eyes.iter().any(|eye| away(eye) <= distance + size)
            })
            .copied()
            .collect();
        for key in outside {
            self.remove(key, commands);
        }
        for (key, tile) in &mut self.tiles {
            tile.refused = false;
            tile.wanted = wanted.contains_key(key);
        }
        self.wanted = wanted.into_iter().map(|(key, away)| (away, key)).collect();
        self.wanted.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        for (_, key) in &self.wanted {
            self.tiles.entry(*key).or_default().wanted = true;
        }
        self.settled = false;
        self.made_for = Some((eyes, settings.clone(), planting.serial));
    }

    fn mark_stale(&mut self, planting: &mut Planting, commands: &mut Commands) {
        self.settled = false;
        let all = std::mem::take(&mut planting.touched_all);
        let touched = std::mem::take(&mut planting.touched);
        for ((cover, at), tile) in &mut self.tiles {
            if all || (!cover && touched.contains(at)) {
                tile.stale |= tile.planted.is_some();
                // What is in work was begun before the edit.
                tile.task = None;
            }
        }
        let left = self.tiles.iter().filter(|(_, tile)| tile.stale && !tile.wanted);
        for key in left.map(|(key, _)| *key).collect::<Vec<_>>() {
            self.remove(key, commands);
        }
    }

    /// Starts tasks for the nearest tiles that are due.
    fn start(&mut self, planting: &Planting, settings: &PlantingSettings) {
        let pool = AsyncComputeTaskPool::get_or_init(TaskPool::default);
        let in_work = self.tiles.values().filter(|tile| tile.task.is_some()).count();
        let free = (pool.thread_num() * TASKS_PER_THREAD).saturating_sub(in_work);
        let tiles = &mut self.tiles;
        let due = self.wanted.iter().map(|(_, key)| *key).filter(|key| {
            // Made by `update_wanted`.
            tiles.get(key).is_some_and(Tile::is_due)
        });
        for key in due.take(free).collect::<Vec<_>>() {
            let (cover, at) = key;
            let at = IVec2::from_array(at);
            let plan = planting.forest().plan(at);
            let scatter = Arc::clone(planting.forest().scatter());
            let wardrobe = Arc::clone(&planting.wardrobe);
            let view_range = settings.view_range(cover);
            let task = pool.spawn(async move {
                let forest = Forest::new(wardrobe.handles.iter().cloned());
                let forest = forest.with_view_range(view_range);
                if cover {
                    let plants = scatter.cover_tile(at);
                    forest.with(plants.iter().filter_map(|tree| wardrobe.dress(tree)))
                } else {
                    let trees = plan.trees();
                    forest.with(trees.iter().filter_map(|(_, tree)| wardrobe.dress(tree)))
                }
            });
            if let Some(tile) = self.tiles.get_mut(&key) {
                tile.task = Some(task);
            }
        }
    }

    fn refuse(&mut self, key: Key) {
        self.tiles.insert(key, Tile { refused: true, wanted: true, ..Tile::default() });
    }

    /// Puts a finished tile into the scene, if there is room or can be made.
    fn plant(&mut self, key: Key, forest: Forest, most: usize, commands: &mut Commands) {
        let rank = |wanted: &[(f32, Key)], key: Key| wanted.iter().position(|(_, k)| *k == key);
        let before = self.tiles.get(&key).map_or(0, Tile::plants);
        while self.plants - before + forest.len() > most {
            // The farthest that has plants, if it is farther than this one; what is not wanted any more goes first.
            let here = rank(&self.wanted, key);
            let farthest = self
                .tiles
                .iter()
                .filter(|(other, tile)| **other != key && tile.plants() > 0)
                .map(|(other, _)| (rank(&self.wanted, *other).unwrap_or(usize::MAX), *other))
                .max();
            match farthest {
                Some((far, other)) if here.is_some_and(|here| here < far) => {
                    self.remove(other, commands);
                    if far != usize::MAX {
                        self.refuse(other);
                    }
                }
                _ => {
                    self.remove(key, commands);
                    self.refuse(key);
                    return;
                }
            }
        }
        let Some(tile) = self.tiles.get_mut(&key) else { return };
        let plants = forest.len();
        let entity = match tile.planted.take() {
            Some((Some(entity), _)) if plants > 0 => {
                // The same entity, so that near meshes and whoever follows it keep their hold.
                commands.entity(entity).insert(forest);
                Some(entity)
            }
            Some((Some(entity), _)) => {
                commands.entity(entity).try_despawn();
                None
            }
            _ if plants > 0 => {
                let (cover, at) = key;
                let marker = ForestTile { tile: IVec2::from_array(at), cover };
                Some(commands.spawn((forest, marker)).id())
            }
            _ => None,
        };
        self.plants = self.plants - before + plants;
        *tile = Tile { planted: Some((entity, plants)), wanted: true, ..Tile::default() };
    }

    /// Takes what is done, in order, until the time is over.
    fn collect(&mut self, settings: &PlantingSettings, start: Instant, commands: &mut Commands) {
        let in_work: Vec<Key> = {
            let working = self.tiles.iter().filter(|(_, tile)| tile.task.is_some());
            working.map(|(key, _)| *key).collect()
        };
        let mut taken = 0;
        for key in in_work {
            let late = start.elapsed().as_secs_f32() * 1e3 > settings.main_thread_ms;
            if !settings.wait && late && taken > 0 {
                break;
            }
            // Room for this one may have been made of others.
            let Some(tile) = self.tiles.get_mut(&key) else { continue };
            let Some(task) = tile.task.take_if(|task| settings.wait || task.is_finished()) else {
                continue;
            };
            let forest = block_on(task);
            self.plant(key, forest, settings.max_trees, commands);
            taken += 1;
        }
    }

    fn count(&self, counters: &mut PlantingCounters) {
        *counters = PlantingCounters { main_thread_ms: counters.main_thread_ms, ..default() };
        for ((cover, _), tile) in &self.tiles {
            if let Some((_, plants)) = tile.planted {
                let (tiles, sum) = if *cover {
                    (&mut counters.cover_tiles, &mut counters.cover)
                } else {
                    (&mut counters.tree_tiles, &mut counters.trees)
                };
                *tiles += 1;
                *sum += plants;
            }
            counters.pending += usize::from(tile.task.is_some() || tile.is_due());
            counters.refused += usize::from(tile.refused);
        }
    }
}

/// From a place to the nearest point of a tile's square.
fn distance_to_tile(eye: Vec2, tile: IVec2, size: f32) -> f32 {
    let low = tile.as_vec2() * size;
    eye.distance(eye.clamp(low, low + size))
}

pub(super) fn stream_tiles(
    mut commands: Commands,
    mut tiles: ResMut<Tiles>,
    mut counters: ResMut<PlantingCounters>,
    settings: Res<PlantingSettings>,
    planting: Option<ResMut<Planting>>,
    cameras: Query<(&Camera, &GlobalTransform), With<Camera3d>>,
) {
    let start = Instant::now();
    let Some(mut planting) = planting else {
        if !tiles.tiles.is_empty() {
            tiles.clear(&mut commands);
        }
        counters.set_if_neq(PlantingCounters::default());
        return;
    };
    let eyes = cameras.iter().filter(|(camera, _)| camera.is_active);
    let eyes: Vec<Vec2> =
        eyes.map(|(_, at)| at.translation().xz()).filter(|eye| eye.is_finite()).collect();
    let distances = [settings.tree_distance_m, settings.cover_distance_m];
    if tiles.distances != distances {
        // Plants thin out towards the distance, so it is part of every tile.
        planting.touched_all |= tiles.distances != [0.0; 2];
        tiles.distances = distances;
    }
    tiles.update_wanted(eyes, &planting, &settings, &mut commands);
    if planting.touched_all || !planting.touched.is_empty() {
        tiles.mark_stale(&mut planting, &mut commands);
    }
    while !tiles.settled {
        tiles.start(&planting, &settings);
        tiles.collect(&settings, start, &mut commands);
        tiles.count(&mut counters);
        tiles.settled = counters.pending == 0;
        if !settings.wait {
            break;
        }
    }
    counters.main_thread_ms = start.elapsed().as_secs_f32() * 1e3;
}
