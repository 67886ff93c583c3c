//! From a candidate to a plant: what stands at a place, how large, turned and coloured. O(1), five heights a plant.

use super::{
    Field, PlantKind, ScatteredTree,
    blue_noise::{BlueNoise, Candidate, tile_key},
    smoothstep,
    stand::{Layer, StandGrid, Stands},
};
use crate::math::hash::SplitMix64;
use bevy::math::{IVec2, Quat, Vec2, Vec3};
use std::f32::consts::TAU;

/// Densities at a place are at most this many times their share of what the pattern holds: meadows stay meadows, however
/// many trees are asked for.
const CROWDING: f32 = 2.5;
/// How far leaves turn before or after each other, in units of the season.
const TURNING: f32 = 0.6;

/// One layer of plants and its pattern.
pub(super) struct Planter {
    pub stands: Stands,
    pub pattern: BlueNoise,
    pub tile_m: f32,
    pub seed: u64,
    layer: Layer,
    hue: Field,
}

impl Planter {
    pub fn new(stands: Stands, pattern: BlueNoise, tile_m: f32, layer: Layer, seed: u64) -> Self {
        let seed = SplitMix64(seed ^ (layer as u64 + 1) << 17).next_u64();
        Self { stands, pattern, tile_m, seed, layer, hue: Field::new(seed, 2, 85.0) }
    }

    /// Cells of the grid of stands in a tile, and their side.
    pub fn cells(&self) -> (usize, f32) {
        let step = if self.layer == Layer::Trees { 8.0 } else { 4.0 };
        let cells = (self.tile_m / step).round().max(1.0);
        (cells as usize, self.tile_m / cells)
    }

    /// The most plants per m² at a place of a relative density.
    pub fn most_per_m2(&self, density: f32) -> f32 {
        self.pattern.most_per_m2() * (CROWDING * density).min(1.0)
    }

    /// The density per m² of a closed stand from which on a candidate is taken; infinite if none does.
    pub fn threshold(&self, candidate: &Candidate, density: f32) -> f32 {
        let fits = candidate.at_density < self.most_per_m2(density);
        if fits { candidate.at_density / density } else { f32::INFINITY }
    }

    /// All plants of a tile where closed stands hold `per_m2`.
    pub fn tile(&self, tile: IVec2, per_m2: f32, season: f32) -> Vec<ScatteredTree> {
        let corner = tile.as_vec2() * self.tile_m;
        let half = self.stands.ground.side_m() * 0.5;
        if corner.min_element() >= half || (corner + self.tile_m).max_element() <= -half {
            return vec![];
        }
        if corner.max_element() >= half || (corner + self.tile_m).min_element() <= -half {
            return vec![];
        }
        let (cells, step_m) = self.cells();
        let grid = StandGrid::new(&self.stands, corner, step_m, cells);
        if grid.is_bare() {
            return vec![];
        }
        let most = (per_m2 * grid.densest()).min(self.most_per_m2(grid.densest()));
        self.pattern
            .candidates(tile, self.seed, most)
            .filter(|c| self.threshold(c, grid.density(corner + c.place)) < per_m2)
            .filter_map(|c| self.plant(tile, &c, &grid, season))
            .collect()
    }

    /// The plant of a candidate; `None` where it cannot stand.
    pub fn plant(
        &self,
        tile: IVec2,
        candidate: &Candidate,
        grid: &StandGrid,
        season: f32,
    ) -> Option<ScatteredTree> {
        let place = tile.as_vec2() * self.tile_m + candidate.place;
        let Vec2 { x, y: z } = place;
        if place.abs().max_element() > self.stands.ground.side_m() * 0.5 {
            return None;
        }
        let key = tile_key(tile, self.seed ^ 0x91A7);
        let mut rng =
            SplitMix64(key ^ u64::from(candidate.index).wrapping_mul(0x9FB2_1C65_1E98_DF25));
        let (spot, member) = grid.pick(place, rng.next_f32());
        let species = self.stands.members[member].0;
        let (height, normal) = self.stands.footing(x, z, species)?;
        let kind = &self.stands.species[usize::from(species)];
        let habitat = &kind.habitat;
        // The mean of two numbers: most are near the age of their stand.
        let chance = 0.5 * (rng.next_f32() + rng.next_f32());
        let [young, old] = habitat.scale;
        let inside = smoothstep(0.1, 0.85, spot.forest);
        let scale = if habitat.kind == PlantKind::Tree {
            // Alone they have had time and light; at edges they are the young ones.
            let alone = 1.0 - smoothstep(0.0, 0.12, spot.forest);
            let age = spot.age * 0.62 + chance * 0.5;
            let age = age + (0.35 + 0.65 * chance - age) * alone;
            let edge = 0.68 + 0.32 * inside.max(alone);
            (young + (old - young) * age.min(1.0)) * edge * spot.vigour
        } else {
            (young + (old - young) * chance) * (0.6 + 0.4 * spot.vigour)
        };
        let yaw = rng.range(0.0, TAU);
        let slope = normal.y.clamp(0.0, 1.0).acos();
        let downhill = Vec2::new(normal.x, normal.z).normalize_or_zero();
        // Trunks grow upwards, a little out of the slope; low plants follow the ground.
        let lean = if habitat.kind == PlantKind::Cover { 0.6 * slope } else { 0.07 * slope };
        let chance_lean = Vec2::from_angle(rng.range(0.0, TAU)) * rng.next_f32().powi(2) * 0.045;
        let tilt = downhill * lean + chance_lean;
        let axis = Vec3::new(tilt.y, 0.0, -tilt.x).normalize_or(Vec3::X);
        let rotation = Quat::from_axis_angle(axis, tilt.length()) * Quat::from_rotation_y(yaw);
        // So deep that the downhill side of the foot is in the ground too.
        let foot = habitat.trunk_share * kind.height_m * scale;
        let sink = (0.012 * kind.height_m * scale).min(0.12) + (foot * slope.tan()).min(0.6);
        let offset = (0.55 * rng.next_f32()
            + 0.45 * (0.5 + 0.8 * self.hue.at(z, x)).clamp(0.0, 1.0)
            - 0.25 * spot.altitude.clamp(0.0, 1.0))
        .clamp(0.0, 1.0);
        let autumn = if habitat.deciduous {
            (season * (1.0 + TURNING) - offset * TURNING).clamp(0.0, 1.0)
        } else {
            0.0
        };
        // What stands below crowns gets less light than its own leaves take.
        let below = if habitat.kind == PlantKind::Tree { 0.0 } else { 0.5 };
        let shade = 1.0 - below * smoothstep(0.15, 0.8, spot.forest);
        Some(ScatteredTree {
            position: Vec3::new(x, height - sink, z),
            rotation,
            scale,
            species,
            tint: self.tint(place, autumn, shade, &mut rng),
            autumn,
            seed: (rng.next_u64() >> 56) as u8,
        })
    }

    /// A little brighter, yellower or greener than the neighbour, more alike within 85 m.
    fn tint(&self, place: Vec2, autumn: f32, shade: f32, rng: &mut SplitMix64) -> [u8; 3] {
        let warm = 0.7 * self.hue.at(place.x, place.y) + rng.range(-0.5, 0.5);
        let light = shade * rng.range(0.86, 1.1);
        // Before the leaves have turned they lose their green.
        let turning = (2.0 * autumn).min(1.0);
        let channel = |share: f32| (128.0 * (light * share)).round().clamp(0.0, 255.0) as u8;
        [
            channel(1.0 + 0.12 * warm + 0.18 * turning),
            channel(1.0 + 0.02 * warm),
            channel(1.0 - 0.14 * warm - 0.1 * turning),
        ]
    }
}
