//! The area rule: how large the oriented disc of a point is (design §4; measured in the trial "points against truth").

use std::f32::consts::PI;

/// Default of [`overlap`]'s gain: the largest extra area of a disc where many points share a leaf.
pub const OVERLAP_GAIN: f32 = 0.25;

/// Overlap of discs on closed surfaces (bark, walls): circles of half the diagonal of a square cover the lattice of
/// such squares without a gap, and have `π / 2` of its area.
pub const CLOSED_OVERLAP: f32 = PI / 2.0;

/// Radius in world units of each of `n` discs that together have the surface `area` (world units², scaled): `a =
/// area / n`, `sqrt(a / π)`. Before overlap, and as seen along the peeling direction.
pub fn disc_radius(area: f32, n: f32) -> f32 {
    (area / n.max(1e-6) / PI).sqrt()
}

/// Factor on the area of a disc of `radius`, ≥ 1: closes the gaps between discs without fattening what is smaller
/// than a disc.
///
/// `g = 1 + gain (1 − 1 / (1 + L / 4a))` for two-sided leaves of area `leaf_area` (`L`, world units²): 1 where a point
/// stands for a whole leaf, `1 + gain` where a leaf has many. [`CLOSED_OVERLAP`] for surfaces that are not leaves.
pub fn overlap(radius: f32, leaf_area: f32, is_leaf: bool, gain: f32) -> f32 {
    if !is_leaf || leaf_area <= 0.0 {
        return CLOSED_OVERLAP;
    }
    let a = PI * radius * radius;
    1.0 + gain * (1.0 - 1.0 / (1.0 + leaf_area / (4.0 * a)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn discs_have_the_area_of_the_tree_times_the_overlap() {
        let area_of = |n: f32, leaf_area: f32, is_leaf: bool| {
            let r = disc_radius(60.0, n);
            n * r * r * PI * overlap(r, leaf_area, is_leaf, 0.5) / 60.0
        };
        // Few points: a leaf is smaller than a disc, nothing is gained; many: half as much again.
        assert!((area_of(100.0, 0.0059, true) - 1.0).abs() < 0.01);
        assert!((area_of(1e8, 0.0059, true) - 1.5).abs() < 0.01);
        assert!((area_of(1000.0, 0.0059, false) - CLOSED_OVERLAP).abs() < 1e-4);
    }
}
