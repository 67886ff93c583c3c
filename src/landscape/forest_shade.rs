//! The shade that a forest throws on the ground: scattered trees in, crowns and cover for the ground's textures out.
//! A tile is scattered once and kept while it is among the newest.

use super::{Crown, Scatter, ShadeSource};
use bevy::math::{IVec2, Vec2};
use std::{
    collections::HashMap,
    sync::{Arc, Mutex, PoisonError},
};

/// Tiles kept; chunks are made around the camera, so few are asked for again.
const KEPT_TILES: usize = 512;

/// Shade of the trees and shrubs of a [`Scatter`], as they were planted: later edits do not move it.
pub struct ForestShade {
    scatter: Scatter,
    tiles: Mutex<Tiles>,
}

#[derive(Default)]
struct Tiles {
    crowns: HashMap<IVec2, (u64, Arc<Vec<Crown>>)>,
    clock: u64,
}

impl ForestShade {
    /// Shade of this forest.
    pub fn new(scatter: Scatter) -> Self {
        Self { scatter, tiles: Mutex::default() }
    }

    fn tile(&self, tile: IVec2) -> Arc<Vec<Crown>> {
        let lock = || self.tiles.lock().unwrap_or_else(PoisonError::into_inner);
        {
            let mut tiles = lock();
            tiles.clock += 1;
            let clock = tiles.clock;
            if let Some((used, crowns)) = tiles.crowns.get_mut(&tile) {
                *used = clock;
                return crowns.clone();
            }
        }
        // Not under the lock: two threads may do the same work, with the same result.
        let species = self.scatter.species();
        let crowns = self.scatter.tile(tile).into_iter().filter_map(|tree| {
            let species = species.get(usize::from(tree.species))?;
            Some(Crown {
                position: tree.position,
                radius_m: species.crown_radius_m * tree.scale,
                height_m: species.height_m * tree.scale,
            })
        });
        let crowns = Arc::new(crowns.collect::<Vec<_>>());
        let mut tiles = lock();
        if tiles.crowns.len() >= KEPT_TILES {
            let oldest = tiles.crowns.iter().min_by_key(|(_, (used, _))| *used).map(|(t, _)| *t);
            oldest.map(|tile| tiles.crowns.remove(&tile));
        }
        let clock = tiles.clock;
        tiles.crowns.insert(tile, (clock, crowns.clone()));
        crowns
    }
}

impl ShadeSource for ForestShade {
    fn crowns(&self, min: Vec2, max: Vec2, out: &mut Vec<Crown>) {
        let side = self.scatter.tile_size_m();
        let (first, last) = ((min / side).floor().as_ivec2(), (max / side).floor().as_ivec2());
        for z in first.y..=last.y {
            for x in first.x..=last.x {
                let crowns = self.tile(IVec2::new(x, z));
                out.extend(crowns.iter().filter(|crown| {
                    let at = Vec2::new(crown.position.x, crown.position.z);
                    at.cmpge(min).all() && at.cmplt(max).all()
                }));
            }
        }
    }

    fn cover(&self, x: f32, z: f32) -> f32 {
        self.scatter.canopy_cover(x, z)
    }
}
