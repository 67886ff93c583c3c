//! Ground made of noise and rivers: seed and size in, [`Ground`] out. Making costs about half a second at any size, a
//! height about 0.3 µs.
//!
//! Domain-warped fractal and ridged noise says where mountains rise and lakes lie → rivers carve a grid (`erosion`) →
//! between its posts, octaves of noise whose amplitude follows steepness and sinks where the sum is already steep (the
//! erosion-like damping of Quilez, "Value noise derivatives").

use super::{
    Ground,
    erosion::{Shaping, carve},
    gradient_noise::{OFFSET, fractal, noise},
    height_grid::{Cubic, HeightGrid},
    rivers::{wetness, widen_valleys},
    smoothstep,
};
use crate::math::hash::SplitMix64;
use bevy::math::Vec2;
use thiserror::Error;

/// Most and fewest cells a side of the carved grid, and their smallest size: no gullies a tree could bridge.
const CELLS: [usize; 2] = [512, 64];
const CELL_M: f32 = 7.0;
/// The carved square is larger than the ground: rivers leave over its border, which would show.
const MARGIN: f32 = 0.07;
/// Shortest and longest side in metres.
const SIDES_M: [f32; 2] = [500.0, 65_536.0];
/// Octaves of detail end at this wavelength in metres.
const FINEST_WAVE_M: f32 = 5.0;

/// Where still water lies.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Water {
    /// Nowhere.
    None,
    /// In the lowest places, about this share of the ground (0 to 0.6); its level is 0 m. Default: 0.07.
    Share(f32),
    /// At a height in metres, whatever that floods. Heights are about 0 to [`TerrainSettings::relief_m`].
    Level(f32),
}

/// What the ground is like.
#[derive(Clone, Debug, PartialEq)]
pub struct TerrainSettings {
    /// Of everything. Default: 1.
    pub seed: u64,
    /// Length of a side in metres, 500 to 65,536. Default: 16,384.
    pub side_m: f32,
    /// Height of the mountains in metres, above 0. Default (`None`): 900 m on a side of 16 km, less on smaller sides.
    pub relief_m: Option<f32>,
    /// Share of mountains, 0 (plains) to 1. Default: 0.5.
    pub mountains: f32,
    /// Default: `Water::Share(0.07)`.
    pub water: Water,
}

impl Default for TerrainSettings {
    fn default() -> Self {
        Self {
            seed: 1,
            side_m: 16_384.0,
            relief_m: None,
            mountains: 0.5,
            water: Water::Share(0.07),
        }
    }
}

/// Why there is no ground.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum TerrainError {
    /// A setting cannot be used.
    #[error("terrain: `{field}` is {value}; it must be {must}")]
    Value {
        /// Which.
        field: &'static str,
        /// What it is.
        value: f32,
        /// What it must be.
        must: &'static str,
    },
    /// Everything would be under water.
    #[error(
        "terrain: water at {water_m} m is above everything (the highest ground of seed {seed} is at {highest_m:.0} m); \
         lower the water or raise `relief_m`"
    )]
    Drowned {
        /// Level asked for.
        water_m: f32,
        /// Highest ground.
        highest_m: f32,
        /// Seed of the terrain.
        seed: u64,
    },
}

/// Mountains, valleys, plains and lakes; see the module.
pub struct NoiseTerrain {
    side_m: f32,
    water_m: Option<f32>,
    range: [f32; 2],
    carved: HeightGrid,
    /// 0 dry ridge to 1 river bank, on every second post of the carved grid.
    wetness: HeightGrid,
    /// Cells a side of the carved grid, and metres of one.
    cells: usize,
    cell_m: f32,
    /// Amplitude of the first octave of detail on steep ground, metres.
    rough_m: f32,
    octaves: u32,
    seed: u32,
}

/// Fields that say what rises where, over the carved square.
struct Plan {
    seed: u32,
    /// Carved square in units of the features.
    features: f32,
    mountains: f32,
}

impl Plan {
    fn place(&self, x: f32, z: f32) -> Vec2 {
        let at = Vec2::new(x - 0.5, z - 0.5) * self.features;
        let bend = |stream: u32| fractal(at * 1.1 + OFFSET, 3, self.seed ^ stream);
        at + Vec2::new(bend(0x51), bend(0x52)) * 0.28
    }

    /// Basins and plains, −1 to 1.
    fn base(&self, x: f32, z: f32) -> f32 {
        fractal(self.place(x, z) * 1.7, 5, self.seed ^ 0xB)
    }

    fn uplift(&self, x: f32, z: f32) -> f32 {
        let at = self.place(x, z);
        let belt = fractal(at * 1.05 + OFFSET * 3.0, 3, self.seed ^ 0x17);
        let edge = 0.6 - 0.9 * self.mountains;
        let mountains = smoothstep(edge - 0.22, edge + 0.42, belt);
        // Chains of summits: where a second noise crosses 0.
        let ridge = 1.0 - noise(at * 1.6 + OFFSET, self.seed ^ 0x2F).value.abs().min(1.0);
        let hills = 0.5 + 0.5 * fractal(at * 3.7, 3, self.seed ^ 0x3D);
        0.012 + 0.035 * hills.max(0.0).powi(2) + mountains * (0.3 + 0.7 * ridge * ridge * ridge)
    }
}

impl NoiseTerrain {
    /// Makes the ground.
    ///
    /// # Errors
    /// If a setting is out of its range, or the water would cover everything.
    pub fn new(settings: &TerrainSettings) -> Result<Self, TerrainError> {
        check(settings)?;
        let side_m = settings.side_m;
        let relief_m = settings.relief_m.unwrap_or(900.0 * (side_m / 16_384.0).powf(0.7));
        let relief_m = if settings.relief_m.is_none() { relief_m.min(1900.0) } else { relief_m };
        let seed = SplitMix64(settings.seed).next_u64() as u32;
        let carved_side_m = side_m * (1.0 + 2.0 * MARGIN);
        let mut cells = CELLS[0];
        while cells > CELLS[1] && carved_side_m / (cells as f32) < CELL_M {
            cells /= 2;
        }
        // Mountains stay as large as on 16 km; a larger ground has more of them.
        let features = (carved_side_m / 16_384.0).max(1.0);
        let plan = Plan { seed, features, mountains: settings.mountains };
        let share = if let Water::Share(share) = settings.water { share } else { 0.0 };
        let shore = quantile(&plan, share);
        let bed_m = 0.05 * relief_m;
        let outlet = |x: f32, z: f32| share > 0.0 && plan.base(x, z) < shore;
        let uplift = |x: f32, z: f32| {
            // Shores rise gently.
            plan.uplift(x, z) * (0.15 + 0.85 * smoothstep(0.0, 0.35, plan.base(x, z) - shore))
        };
        let unevenness = |x: f32, z: f32| {
            plan.base(x, z) + 0.6 * fractal(plan.place(x, z) * 9.0, 4, seed ^ 0x77)
        };
        let shaping = Shaping {
            uplift: &uplift,
            outlet: &outlet,
            unevenness: &unevenness,
            relief_m,
            side_m: carved_side_m,
        };
        let carved = carve(&shaping, cells);
        let wetness = wetness(&carved.drained, cells);
        let mut heights = carved.heights;
        if share > 0.0 {
            let place = |i: usize| i as f32 / cells as f32;
            for (i, height) in heights.posts.iter_mut().enumerate() {
                let under = shore - plan.base(place(i % (cells + 1)), place(i / (cells + 1)));
                if under > 0.0 {
                    *height = -bed_m * (0.06 + smoothstep(0.0, 0.4, under));
                }
            }
        }
        widen_valleys(&mut heights, &wetness, 3);
        let cell_m = carved_side_m / cells as f32;
        let octaves = (2.0 * cell_m / FINEST_WAVE_M).log2().ceil().clamp(1.0, 8.0) as u32;
        let [low, high] = heights.range();
        let rough_m = 0.11 * 2.0 * cell_m.min(64.0);
        let water_m = match settings.water {
            Water::None => None,
            Water::Share(share) => (share > 0.0).then_some(0.0),
            Water::Level(level) => Some(level),
        };
        if let Some(water_m) = water_m.filter(|water| *water >= high) {
            return Err(TerrainError::Drowned { water_m, highest_m: high, seed: settings.seed });
        }
        let reach = 2.5 * rough_m + 0.02 * relief_m;
        Ok(Self {
            side_m,
            water_m,
            range: [low - reach, high + reach],
            carved: heights,
            wetness,
            cells,
            cell_m,
            rough_m,
            octaves,
            seed,
        })
    }

    /// Posts of the carved grid from the first one.
    fn posts(&self, x: f32, z: f32) -> Vec2 {
        let half = self.side_m * 0.5;
        let at = Vec2::new(x.clamp(-half, half), z.clamp(-half, half));
        at / self.cell_m + self.cells as f32 * 0.5
    }

    /// Rivers on a grid run straight; bending the place straightens that out.
    fn bent(&self, at: Vec2) -> Vec2 {
        let bend = |stream: u32| {
            noise(at * 0.083 + OFFSET, self.seed ^ stream).value * 3.2
                + noise(at * 0.29, self.seed ^ stream).value * 0.9
        };
        at + Vec2::new(bend(0xA1), bend(0xA2))
    }
}

impl Ground for NoiseTerrain {
    fn side_m(&self) -> f32 {
        self.side_m
    }

    fn height(&self, x: f32, z: f32) -> f32 {
        let at = self.bent(self.posts(x, z));
        let [coarse, dx, dz] = self.carved.with_slope(at.x, at.y, Cubic::BSpline);
        let slope = Vec2::new(dx, dz) / self.cell_m;
        let steep = slope.length();
        // Meadows undulate, slopes are rough, and what lies under water is smooth.
        let dry = self
            .water_m
            .map_or(1.0, |level| smoothstep(-0.5, 0.02 * self.cell_m.max(60.0), coarse - level));
        let rough = self.rough_m * dry * (0.05 + smoothstep(0.03, 0.75, steep));
        let mut sum = 0.0;
        let mut drift = slope * 0.6;
        let (mut amplitude, mut frequency) = (1.0, 0.5);
        for octave in 0..self.octaves {
            let sample =
                noise(at * frequency + OFFSET * octave as f32, self.seed ^ (0x700 + octave));
            let wave = sample.value;
            drift += sample.slope * (amplitude * frequency * rough / self.cell_m);
            sum += amplitude * wave / (1.0 + 1.6 * drift.length_squared());
            amplitude *= 0.47;
            frequency *= 2.03;
        }
        coarse + rough * sum
    }

    fn height_range(&self) -> [f32; 2] {
        self.range
    }

    fn detail_m(&self) -> f32 {
        1.0
    }

    fn water_level(&self) -> Option<f32> {
        self.water_m
    }

    fn moisture(&self, x: f32, z: f32) -> f32 {
        let at = self.bent(self.posts(x, z));
        let river = self.wetness.bilinear(at.x * 0.5, at.y * 0.5);
        let wander = fractal(at * 0.11, 3, self.seed ^ 0x900);
        (river + 0.18 * wander).clamp(0.0, 1.0)
    }
}

fn check(settings: &TerrainSettings) -> Result<(), TerrainError> {
    let value = |field, value, must| Err(TerrainError::Value { field, value, must });
    if !(SIDES_M[0]..=SIDES_M[1]).contains(&settings.side_m) {
        return value("side_m", settings.side_m, "from 500 to 65,536 metres");
    }
    if let Some(relief) = settings.relief_m.filter(|r| !(*r > 0.0 && *r <= 9000.0)) {
        return value("relief_m", relief, "above 0 and at most 9,000 metres");
    }
    if !(0.0..=1.0).contains(&settings.mountains) {
        return value("mountains", settings.mountains, "from 0 to 1");
    }
    match settings.water {
        Water::Share(share) if !(0.0..=0.6).contains(&share) => {
            value("water", share, "a share from 0 to 0.6, or `Water::Level` in metres")
        }
        Water::Level(level) if !level.is_finite() => value("water", level, "a height in metres"),
        _ => Ok(()),
    }
}

/// The value of the plan's base below which `share` of it lies.
fn quantile(plan: &Plan, share: f32) -> f32 {
    const SIDE: usize = 64;
    let at = |i: usize| (i as f32 + 0.5) / SIDE as f32;
    let mut values: Vec<f32> =
        (0..SIDE * SIDE).map(|i| plan.base(at(i % SIDE), at(i / SIDE))).collect();
    values.sort_by(f32::total_cmp);
    values[((values.len() - 1) as f32 * share) as usize]
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn made(settings: TerrainSettings) -> NoiseTerrain {
        NoiseTerrain::new(&settings).expect("the settings are good")
    }

    #[test]
    fn a_landscape_has_plains_slopes_water_and_mountains() {
        for seed in 1..4 {
            let ground = made(TerrainSettings { seed, ..Default::default() });
            let places: Vec<_> = (0..4000)
                .map(|i| ((i % 63) as f32 / 63.0 - 0.5, (i / 63) as f32 / 64.0 - 0.5))
                .map(|(x, z)| ground.site(x * 16_384.0, z * 16_384.0))
                .collect();
            let share = |f: &dyn Fn(&super::super::Site) -> bool| {
                places.iter().filter(|s| f(s)).count() as f32 / places.len() as f32
            };
            let flat = share(&|s| s.slope < 0.12 && s.above_water_m > 0.0);
            let steep = share(&|s| s.slope > 0.4);
            let water = share(&|s| s.above_water_m < 0.0);
            let high = share(&|s| s.height_m > 450.0);
            println!("seed {seed}: flat {flat} steep {steep} water {water} high {high}");
            assert!(
                flat > 0.15 && steep > 0.04 && high > 0.02,
                "seed {seed}: {flat} {steep} {high}"
            );
            assert!((0.01..0.25).contains(&water), "seed {seed}: {water}");
        }
    }

    #[test]
    fn a_setting_out_of_range_is_named() {
        let error = |settings: TerrainSettings| match NoiseTerrain::new(&settings) {
            Ok(_) => panic!("{settings:?} is refused"),
            Err(error) => error.to_string(),
        };
        let base = TerrainSettings { side_m: 1000.0, ..Default::default() };
        assert!(error(TerrainSettings { side_m: f32::NAN, ..base.clone() }).contains("side_m"));
        assert!(error(TerrainSettings { mountains: 2.0, ..base.clone() }).contains("mountains"));
        assert!(
            error(TerrainSettings { relief_m: Some(-1.0), ..base.clone() }).contains("relief_m")
        );
        let drowned = error(TerrainSettings { water: Water::Level(5000.0), ..base });
        assert!(drowned.contains("above everything") && drowned.contains("5000"), "{drowned}");
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(6))]
        #[test]
        fn heights_stay_in_range_and_are_smooth_and_repeatable(seed in any::<u64>(), side_m in 500.0f32..65_536.0) {
            let settings = TerrainSettings { seed, side_m, ..Default::default() };
            let (ground, again) = (made(settings.clone()), made(settings));
            let [low, high] = ground.height_range();
            for i in 0..3000 {
                let (x, z) = (((i * 37) % 101) as f32 / 101.0 - 0.5, ((i * 53) % 89) as f32 / 89.0 - 0.5);
                let (x, z) = (x * side_m * 1.1, z * side_m * 1.1);
                let h = ground.height(x, z);
                prop_assert!(h >= low && h <= high, "{} at {} {} is not in {}..{}", h, x, z, low, high);
                prop_assert_eq!(h, again.height(x, z));
                prop_assert!((ground.height(x + 0.1, z) - h).abs() < 0.4, "a step at {} {}", x, z);
                prop_assert!((0.0..=1.0).contains(&ground.moisture(x, z)));
            }
        }
    }
}
