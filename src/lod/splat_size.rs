//! The area rule: how large the splat of a point is (measured in `docs/results.md`).
//!
//! Every drawn point stands for the same share `a = A / N` of a tree's surface. Its splat is a piece of the surface of
//! that area: a *cell* (what an LDI pixel hits: a square as seen along the peeling direction) or a *disc*.

use std::f32::consts::PI;

/// Default of [`leaf_overlap`]'s gain.
pub const OVERLAP_GAIN: f32 = 0.22;

/// Overlap of splats on a surface that is thick compared with them: no gap is left even where a prefix ends between
/// two levels of the lattice, whose cells are twice as large as the mean.
pub const CLOSED_OVERLAP: f32 = 2.0;

/// Least thickness of each class in LDI pixels, as far as overlap trusts it: of one-sided surfaces (bark, walls), and
/// of two-sided ones, where anything up to the size of a leaf keeps its outline.
pub const TRUSTED_THICKNESS: [[f32; 4]; 2] = [[1.0, 3.0, 8.0, 24.0], [0.0, 0.0, 0.0, 6.0]];

/// Radius in world units of each of `n` discs that together have the surface `area` (world units², scaled): `a =
/// area / n`, `sqrt(a / π)`. Before overlap.
pub fn disc_radius(area: f32, n: f32) -> f32 {
    (area / n.max(1e-6) / PI).sqrt()
}

/// Factor on the area of the splat of a leaf, 1 to `1 + gain`: `1 + gain (1 − 1 / (1 + L / 4a))`. 1 where a point of
/// `radius` (of the disc) stands for a whole leaf of area `leaf_area` (`L`, world units²), `1 + gain` where a leaf has many,
/// and where there are no leaves (`L` is 0).
pub fn leaf_overlap(radius: f32, leaf_area: f32, gain: f32) -> f32 {
    if leaf_area > 0.0 {
        let a = PI * radius * radius;
        return 1.0 + gain * (1.0 - 1.0 / (1.0 + leaf_area / (4.0 * a)));
    }
    1.0 + gain
}

/// Factor on the area of a splat, 1 to 2: closes the gaps that a prefix leaves, without fattening what is smaller than a
/// splat.
///
/// Leaves start at their [`leaf_overlap`], one-sided surfaces (twigs, bark) at 1. Where the surface is at least
/// two to four splats thick it rises to [`CLOSED_OVERLAP`]. `spacing` is the mean distance of drawn points in LDI
/// pixels, `sqrt(N0 / N)`.
pub fn overlap(leaf_overlap: f32, thickness: u8, is_one_sided: bool, spacing: f32) -> f32 {
    // Twigs are one-sided and thinner than a splat: they get nothing.
    let leaf = if is_one_sided { 1.0 } else { leaf_overlap };
    let trusted = TRUSTED_THICKNESS[usize::from(!is_one_sided)][usize::from(thickness.min(3))];
    let closed = (trusted / (2.0 * spacing) - 1.0).clamp(0.0, 1.0);
    leaf + (CLOSED_OVERLAP - leaf) * closed
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn splats_have_the_area_of_the_tree_times_the_overlap() {
        let area_of = |n: f32, leaf_area: f32, thickness: u8, one_sided: bool, spacing: f32| {
            let r = disc_radius(60.0, n);
            n * r * r * PI * overlap(leaf_overlap(r, leaf_area, 0.5), thickness, one_sided, spacing)
                / 60.0
        };
        // Few points: a leaf is smaller than a splat, nothing is gained; many: half as much again.
        assert!((area_of(100.0, 0.0059, 0, false, 1.0) - 1.0).abs() < 0.01);
        assert!((area_of(1e8, 0.0059, 0, false, 1.0) - 1.5).abs() < 0.01);
        // A trunk is closed while it is thick compared with the splats, a twig never.
        assert!((area_of(1000.0, 0.0059, 2, true, 1.0) - CLOSED_OVERLAP).abs() < 1e-4);
        assert!((area_of(1000.0, 0.0059, 2, true, 4.0) - 1.0).abs() < 1e-4);
        assert!((area_of(1000.0, 0.0059, 0, true, 1.0) - 1.0).abs() < 1e-4);
    }
}
