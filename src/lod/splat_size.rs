//! The area rule: how large the splat of a point is (design §4; measured in `docs/results.md`).
//!
//! Every drawn point stands for the same share `a = A / N` of a tree's surface. Its splat is a piece of the surface of
//! that area: a *cell* (what an LDI pixel hits: a square as seen along the peeling direction) or a *disc*.

use std::f32::consts::PI;

/// Default of [`overlap`]'s gain.
pub const OVERLAP_GAIN: f32 = 0.15;

/// Overlap of discs on closed surfaces (bark, walls): circles of half the diagonal of a square cover the lattice of
/// such squares without a gap, and have `π / 2` of its area. Cells need none: they tile.
pub const CLOSED_DISC_OVERLAP: f32 = PI / 2.0;

/// Radius in world units of each of `n` discs that together have the surface `area` (world units², scaled): `a =
/// area / n`, `sqrt(a / π)`. Before overlap.
pub fn disc_radius(area: f32, n: f32) -> f32 {
    (area / n.max(1e-6) / PI).sqrt()
}

/// Factor on the area of a splat of `radius` (of the disc), ≥ 1: closes the gaps that a prefix between two whole
/// levels of the lattice leaves, without fattening what is smaller than a splat.
///
/// `g = 1 + gain (1 − 1 / (1 + L / 4a))` on two-sided leaves of area `leaf_area` (`L`, world units²): 1 where a point
/// stands for a whole leaf, `1 + gain` where a leaf has many. On other surfaces `1 + gain` for cells and
/// [`CLOSED_DISC_OVERLAP`] for discs.
pub fn overlap(radius: f32, leaf_area: f32, is_leaf: bool, gain: f32, is_cell: bool) -> f32 {
    if !is_leaf || leaf_area <= 0.0 {
        return if is_cell { 1.0 + gain } else { CLOSED_DISC_OVERLAP };
    }
    let a = PI * radius * radius;
    1.0 + gain * (1.0 - 1.0 / (1.0 + leaf_area / (4.0 * a)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn splats_have_the_area_of_the_tree_times_the_overlap() {
        let area_of = |n: f32, leaf_area: f32, is_leaf: bool, is_cell: bool| {
            let r = disc_radius(60.0, n);
            n * r * r * PI * overlap(r, leaf_area, is_leaf, 0.5, is_cell) / 60.0
        };
        // Few points: a leaf is smaller than a splat, nothing is gained; many: half as much again.
        assert!((area_of(100.0, 0.0059, true, true) - 1.0).abs() < 0.01);
        assert!((area_of(1e8, 0.0059, true, true) - 1.5).abs() < 0.01);
        assert!((area_of(1000.0, 0.0059, false, false) - CLOSED_DISC_OVERLAP).abs() < 1e-4);
        assert!((area_of(1000.0, 0.0, true, true) - 1.5).abs() < 1e-4);
    }
}
