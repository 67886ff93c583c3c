//! Progressive orders: samples in, a permutation out, of which every prefix is a level of detail of the whole tree.
//!
//! Costs for n samples: `random` O(n), `lattice` O(n log n), `blue_noise` and `farthest` O(n log² n) with a larger constant.

use super::peel::PeelSample;
use super::settings::OrderMethod;
use crate::math::point_grid::PointGrid;
use bevy::math::Vec3;
use rayon::prelude::*;

pub mod blue_noise;
pub mod farthest;
pub mod lattice;
pub mod random;

/// Orders samples (as peeling lists them): `result[k]` is the index of the sample that comes k-th.
///
/// Deterministic in its inputs; another seed gives another order. `progress` is told the share that is done, 0 to 1.
pub fn order(
    samples: &[PeelSample],
    method: OrderMethod,
    seed: u64,
    progress: &(dyn Fn(f32) + Sync),
) -> Vec<u32> {
    let order = match method {
        OrderMethod::Random => random::order(samples.len(), seed),
        OrderMethod::FarthestPoint => farthest::order(&positions(samples), seed, progress),
        OrderMethod::BlueNoise => blue_noise::order(samples, seed, progress),
        OrderMethod::Lattice => lattice::order(samples, seed),
    };
    progress(1.0);
    order
}

fn positions(samples: &[PeelSample]) -> Vec<Vec3> {
    samples.iter().map(|sample| sample.position).collect()
}

/// How evenly the first `n` points of an order lie: the coefficient of variation (standard deviation / mean) of the
/// distance from each to its nearest neighbour among them.
///
/// 0 is a perfect lattice, 0.52 what independent random points of a plane give; below 2 points it is 0. It sees clumps and not
/// holes: see [`coverage_gap`] for those. O(n) neighbour searches.
pub fn coverage_evenness(positions: &[Vec3], order: &[u32], n: usize) -> f32 {
    let (grid, spacing) = prefix_grid(positions, order, n);
    if grid.points().len() < 2 {
        return 0.0;
    }
    let distances: Vec<f64> = grid
        .points()
        .par_iter()
        .enumerate()
        .map(|(slot, &p)| f64::from(grid.nearest(p, spacing, Some(slot))))
        .collect();
    let count = distances.len() as f64;
    let mean = distances.iter().sum::<f64>() / count;
    let variance = distances.iter().map(|d| (d - mean) * (d - mean)).sum::<f64>() / count;
    if mean > 0.0 { (variance.sqrt() / mean) as f32 } else { 0.0 }
}

/// The largest hole that the first `n` points of an order leave: the distance from the point of the whole list that is
/// farthest from all of them. In units of the positions; infinite if `n` is 0.
pub fn coverage_gap(positions: &[Vec3], order: &[u32], n: usize) -> f32 {
    let (grid, spacing) = prefix_grid(positions, order, n);
    positions.par_iter().map(|&p| grid.nearest(p, spacing, None)).reduce(|| 0.0, f32::max)
}

/// The prefix, sorted for search, and roughly the distance between its points.
fn prefix_grid(positions: &[Vec3], order: &[u32], n: usize) -> (PointGrid, f32) {
    let prefix: Vec<Vec3> =
        order.iter().take(n).filter_map(|&i| positions.get(i as usize).copied()).collect();
    let extent = crate::math::bounding::Aabb::of(prefix.iter().copied()).extent();
    let area = 2.0 * (extent.x * extent.y + extent.y * extent.z + extent.z * extent.x);
    let spacing = (area / prefix.len().max(1) as f32).sqrt().max(extent.max_element() * 1e-4);
    (PointGrid::new(&prefix, spacing), spacing)
}

#[cfg(test)]
mod tests;
