//! Crowns along a path: a source of them by rectangle in, crowns near a place out. Asks for each tile once.

use bevy::math::{Vec2, Vec3};
use std::collections::{HashMap, HashSet};

/// Side of the tiles that are asked for, metres.
const TILE_M: f32 = 64.0;
/// Crowns wider than this are taken for this wide, metres.
const MOST_RADIUS_M: f32 = 20.0;
/// Trees lower than this have branches down to the ground, metres.
const LEAST_OPEN_HEIGHT_M: f32 = 8.0;
/// Share of a taller tree's height below which there is only the trunk.
const OPEN_SHARE: f32 = 0.3;
/// Radius of a trunk as a share of its crown's.
const TRUNK_SHARE: f32 = 0.12;

/// A tree as a flight sees it: a trunk that carries an upright cylinder of leaves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Crown {
    /// Foot of the trunk, metres.
    pub position: Vec3,
    /// Radius of the crown, metres.
    pub radius_m: f32,
    /// Top of the crown above the foot, metres.
    pub height_m: f32,
}

impl Crown {
    /// Height above the foot below which there is only the trunk: 0.3 of the height, 0 for trees under 8 m.
    pub fn open_below_m(&self) -> f32 {
        if self.height_m >= LEAST_OPEN_HEIGHT_M { OPEN_SHARE * self.height_m } else { 0.0 }
    }

    /// Radius of the trunk: 0.12 of the crown's.
    pub fn trunk_m(&self) -> f32 {
        TRUNK_SHARE * self.radius_m
    }

    /// Horizontal distance from the axis of the trunk to a place, metres.
    pub fn distance(&self, at: Vec2) -> f32 {
        at.distance(Vec2::new(self.position.x, self.position.z))
    }

    /// What tells it from others.
    pub(super) fn key(&self) -> [u32; 3] {
        self.position.to_array().map(f32::to_bits)
    }

    /// True where there are leaves: within the radius, between the open part and the top.
    pub fn contains(&self, point: Vec3) -> bool {
        let up = point.y - self.position.y;
        self.distance(Vec2::new(point.x, point.z)) < self.radius_m
            && up > self.open_below_m()
            && up < self.height_m
    }
}

/// The crowns whose feet are in the rectangle from `min` (inclusive) to `max` (exclusive) of x and z. Asked for tiles of
/// 64 m along the path, each once; the same rectangle must give the same crowns.
pub type CrownSource<'a> = dyn Fn(Vec2, Vec2) -> Vec<Crown> + 'a;

/// Crowns below which there is no way, by [`Crown::key`].
pub(super) type LowCrowns = HashSet<[u32; 3]>;

/// Remembers what a source said.
pub(super) struct Crowns<'a> {
    source: &'a CrownSource<'a>,
    tiles: HashMap<[i32; 2], Vec<Crown>>,
}

impl<'a> Crowns<'a> {
    pub(super) fn new(source: &'a CrownSource<'a>) -> Self {
        Self { source, tiles: HashMap::new() }
    }

    /// Visits crowns that reach to within `reach_m` of a place, tile by tile in a fixed order.
    pub(super) fn visit(&mut self, at: Vec2, reach_m: f32, mut visit: impl FnMut(&Crown)) {
        let reach = reach_m + MOST_RADIUS_M;
        let [x0, z0] = (at - reach).to_array().map(|v| (v / TILE_M).floor() as i32);
        let [x1, z1] = (at + reach).to_array().map(|v| (v / TILE_M).floor() as i32);
        for z in z0..=z1 {
            for x in x0..=x1 {
                let source = self.source;
                let tile = self.tiles.entry([x, z]).or_insert_with(|| {
                    let min = Vec2::new(x as f32, z as f32) * TILE_M;
                    let mut crowns = source(min, min + TILE_M);
                    // Not drawn either.
                    crowns
                        .retain(|c| c.position.is_finite() && c.radius_m > 0.0 && c.height_m > 0.0);
                    for crown in &mut crowns {
                        crown.radius_m = crown.radius_m.min(MOST_RADIUS_M);
                    }
                    crowns
                });
                for crown in tile.iter().filter(|c| c.distance(at) < c.radius_m + reach_m) {
                    visit(crown);
                }
            }
        }
    }
}
