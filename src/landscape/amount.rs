//! How dense stands must be for a total of trees: by sampling, or exactly for few trees. O(samples) or O(candidates).

use super::{ScatterError, TreeAmount, blue_noise::Candidate, planter::Planter, stand::StandGrid};
use crate::math::hash::SplitMix64;
use bevy::math::{IVec2, Vec2};
use rayon::prelude::*;

/// Samples a side of the ground: the error of the sum is below 1 %.
const SAMPLES: u32 = 120;
/// Totals up to this are counted instead of sampled: chance alone would miss them by more than a per cent.
const COUNTED: u64 = 10_000;
/// Bytes of a tree in memory: its own 32, twice, as buffers hold old and new while they grow.
pub(super) const BYTES_PER_TREE: u64 = 64;

/// What the amount comes to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Amount {
    /// Plants per m² of a closed stand.
    pub per_m2: f32,
    /// Plants on the whole ground.
    pub expected: f64,
}

/// Relative densities at evenly spread places, 0 where nothing can stand.
struct Samples {
    densities: Vec<f32>,
    /// Ground that a sample stands for.
    area_m2: f64,
}

impl Samples {
    fn of(planter: &Planter) -> Self {
        let side = planter.stands.ground.side_m();
        let step = side / SAMPLES as f32;
        let sample = |i: u32| {
            let mut rng = SplitMix64(planter.seed ^ u64::from(i) << 20);
            let stratum = Vec2::new((i % SAMPLES) as f32, (i / SAMPLES) as f32);
            let place = (stratum + Vec2::new(rng.next_f32(), rng.next_f32())) * step - side * 0.5;
            let (_, grid) = cell(planter, place);
            let density = grid.density(place);
            if density <= 0.0 {
                return 0.0;
            }
            let species = planter.stands.members[grid.pick(place, rng.next_f32()).1].0;
            let stands = planter.stands.footing(place.x, place.y, species).is_some();
            if stands { density } else { 0.0 }
        };
        let densities = (0..SAMPLES * SAMPLES).into_par_iter().map(sample).collect();
        Self { densities, area_m2: f64::from(step) * f64::from(step) }
    }

    /// Plants on the whole ground where closed stands hold `per_m2`.
    fn total(&self, planter: &Planter, per_m2: f32) -> f64 {
        let plants =
            |&density: &f32| f64::from((per_m2 * density).min(planter.most_per_m2(density)));
        self.densities.iter().map(plants).sum::<f64>() * self.area_m2
    }
}

/// The grid's cell that holds a place, alone, as [`Planter::tile`] has it.
fn cell(planter: &Planter, place: Vec2) -> (IVec2, StandGrid) {
    let tile = (place / planter.tile_m).floor();
    let (cells, step_m) = planter.cells();
    let corner = tile * planter.tile_m;
    let cell =
        ((place - corner) / step_m).floor().clamp(Vec2::ZERO, Vec2::splat(cells as f32 - 1.0));
    (tile.as_ivec2(), StandGrid::new(&planter.stands, corner + cell * step_m, step_m, 1))
}

/// The density for an amount.
///
/// # Errors
/// [`ScatterError::None`], [`ScatterError::Room`] or [`ScatterError::Memory`].
pub(super) fn resolve(
    planter: &Planter,
    amount: TreeAmount,
    max_bytes: u64,
    tiles: &[IVec2],
) -> Result<Amount, ScatterError> {
    let samples = Samples::of(planter);
    let room = samples.total(planter, f32::MAX);
    let resolved = match amount {
        TreeAmount::PerHectare(per_hectare) => {
            let most = planter.pattern.most_per_m2() * 1e4;
            if per_hectare > most {
                return Err(ScatterError::Density { requested: per_hectare, fits: most.floor() });
            }
            let per_m2 = per_hectare / 1e4;
            Amount { per_m2, expected: samples.total(planter, per_m2) }
        }
        TreeAmount::Total(0) => return Err(ScatterError::None),
        TreeAmount::Total(total) => {
            // What fits is known within a few per cent too: the number named in the error always does.
            let fits = (0.97 * room) as u64;
            if total > fits {
                return Err(ScatterError::Room { requested: total, fits });
            }
            let per_m2 = bisect(|per_m2| samples.total(planter, per_m2), total as f64);
            let counted =
                (total <= COUNTED).then(|| count(planter, total, per_m2, tiles)).flatten();
            Amount { per_m2: counted.unwrap_or(per_m2), expected: total as f64 }
        }
    };
    let fits = max_bytes / BYTES_PER_TREE;
    if resolved.expected > fits as f64 {
        return Err(ScatterError::Memory { requested: resolved.expected as u64, fits, max_bytes });
    }
    Ok(resolved)
}

/// Where an ascending function passes `goal`, from 1e-12 to 1e4 per m².
fn bisect(f: impl Fn(f32) -> f64, goal: f64) -> f32 {
    let (mut low, mut high) = (-12.0f32, 4.0f32);
    for _ in 0..48 {
        let middle = 0.5 * (low + high);
        if f(10f32.powf(middle)) < goal { low = middle } else { high = middle }
    }
    10f32.powf(0.5 * (low + high))
}

/// The density at which exactly `total` candidates are taken; `None` if the ground has not as many near `per_m2`.
fn count(planter: &Planter, total: u64, per_m2: f32, tiles: &[IVec2]) -> Option<f32> {
    // Enough for the sampling's error and for chance, which is large where the total is small.
    let up_to = per_m2 * (1.15 + 5.0 / (total as f32).sqrt() + 12.0 / total as f32);
    let thresholds = |tile: IVec2| {
        let threshold = |c: Candidate| {
            let place = tile.as_vec2() * planter.tile_m + c.place;
            let (_, grid) = cell(planter, place);
            let threshold = planter.threshold(&c, grid.density(place));
            let taken = threshold < up_to && planter.plant(tile, &c, &grid, 0.0).is_some();
            taken.then_some(threshold)
        };
        // No stand is denser than this, edges with shrubs included.
        let most = up_to * 2.5;
        planter
            .pattern
            .candidates(tile, planter.seed, most)
            .filter_map(threshold)
            .collect::<Vec<f32>>()
    };
    let mut all: Vec<f32> = tiles.par_iter().flat_map_iter(|tile| thresholds(*tile)).collect();
    let last = total as usize;
    if all.len() <= last {
        return None;
    }
    // Between the last that is taken and the first that is not: rounding decides nothing.
    let (taken, limit, _) = all.select_nth_unstable_by(last, f32::total_cmp);
    let taken = taken.iter().copied().fold(0.0, f32::max);
    Some(0.5 * (taken + *limit))
}
