//! The area rule: how large the oriented disc of a point is (design §4; measured in the trial "points against truth").

/// Largest extra area of a disc where many points share a leaf: overlap closes the gaps between discs.
pub const OVERLAP_GAIN: f32 = 0.5;

/// Radius in world units of each of `n` discs that stand for a tree of surface `area` (world units², scaled) with
/// leaves of `leaf_area` each (same units; 0 without leaves).
///
/// `a = area / n`, `g = 1 + 0.5 (1 − 1 / (1 + L / 4a))`, radius `sqrt(g a / π)`. With no known leaf the surface is
/// taken as closed: full gain.
pub fn disc_radius(area: f32, n: f32, leaf_area: f32, overlap_gain: f32) -> f32 {
    let a = area / n.max(1e-6);
    let closed = if leaf_area > 0.0 { 1.0 - 1.0 / (1.0 + leaf_area / (4.0 * a)) } else { 1.0 };
    ((1.0 + overlap_gain * closed) * a / std::f32::consts::PI).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn discs_cover_the_area_times_the_gain() {
        let area_of = |n: f32, leaf: f32| {
            let r = disc_radius(60.0, n, leaf, OVERLAP_GAIN);
            n * r * r * std::f32::consts::PI / 60.0
        };
        // Few points: a leaf is smaller than a disc, nothing is gained; many: half as much again.
        assert!((area_of(100.0, 0.0059) - 1.0).abs() < 0.01);
        assert!((area_of(1e8, 0.0059) - 1.5).abs() < 0.01);
        assert!((area_of(1000.0, 0.0) - 1.5).abs() < 1e-4);
    }
}
