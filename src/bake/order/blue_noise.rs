//! Blue-noise order: progressive weighted sample elimination (Yuksel 2015) of the samples' positions.
//!
//! The algorithm is `math::sample_elimination`; here is only the estimate of the surface's area that it needs.

use crate::bake::peel::PeelSample;
use crate::math::sample_elimination;
use bevy::math::Vec3;

/// The blue-noise order of samples (as peeling lists them).
pub fn order(samples: &[PeelSample], seed: u64, progress: &(dyn Fn(f32) + Sync)) -> Vec<u32> {
    let positions: Vec<Vec3> = super::positions(samples);
    let pixel = pixel_side(samples);
    let area = samples.len() as f32 * pixel * pixel;
    sample_elimination::progressive_order(&positions, area, seed, progress)
}

/// Side of an LDI pixel: the smallest distance per column between samples that follow each other in a row.
///
/// Such samples are a column's distance apart, or more where the surface slopes; some slope nearly nothing. 0 if no two
/// samples share a row.
fn pixel_side(samples: &[PeelSample]) -> f32 {
    let side = |pair: &[PeelSample]| {
        let [a, b] = pair else { return None };
        let row = |s: &PeelSample| (s.direction, s.layer, s.cell[1]);
        let columns = f32::from(b.cell[0].checked_sub(a.cell[0])?);
        let distance = a.position.distance(b.position);
        (row(a) == row(b) && columns > 0.0 && distance > 0.0).then(|| distance / columns)
    };
    let smallest = samples.windows(2).filter_map(side).fold(f32::INFINITY, f32::min);
    if smallest.is_finite() { smallest } else { 0.0 }
}
