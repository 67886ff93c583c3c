//! How many points of the progressive order are drawn (Bærentzen 2005, §5, eq. 1 and 2).

/// `Z0`: pixels per world unit at distance 1, from the viewport's height in pixels and `clip_from_view[1][1]`
/// (`1 / tan(fov_y / 2)`). The paper's eq. 2.
pub fn z0(height_px: f32, clip_from_view_11: f32) -> f32 {
    0.5 * height_px * clip_from_view_11
}

/// `d0 = s Z0`: the distance at which an LDI pixel of side `s` (world units: scaled with the instance) covers one
/// pixel of the screen, and so `N = N0`. Nearer than that the mesh is drawn.
pub fn d0(s: f32, z0: f32) -> f32 {
    s * z0
}

/// `N = N0 (s Z0 / d)² q`, clamped to `N0`: points wanted at distance `d`, not yet rounded. The paper's eq. 1, where
/// `q` is 1. A distance of 0 gives `N0`.
pub fn prefix_count(n0: f32, s: f32, z0: f32, d: f32, quality: f32) -> f32 {
    let ratio = d0(s, z0) / d.max(1e-6);
    (n0 * quality * ratio * ratio).min(n0)
}

/// A whole number of points with mean `wanted`: rounds up with a probability of its fraction. `hash` is in [0, 1)
/// and fixed per instance, so that a forest worth less than one point a tree keeps its density.
pub fn round_count(wanted: f32, hash: f32) -> u32 {
    (wanted + hash) as u32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_prefix_falls_with_the_square_of_the_distance_from_d0() {
        let z0 = z0(720.0, 1.0 / (0.5f32 * 45.0f32.to_radians()).tan());
        assert!((z0 - 869.1).abs() < 0.2);
        let s = 0.02;
        let d0 = d0(s, z0);
        assert_eq!(prefix_count(100_000.0, s, z0, 0.0, 1.0), 100_000.0);
        for (times, share) in [(1.0, 1.0), (2.0, 0.25), (4.0, 1.0 / 16.0), (8.0, 1.0 / 64.0)] {
            let n = prefix_count(100_000.0, s, z0, d0 * times, 1.0);
            assert!((n - 100_000.0 * share).abs() < 1.0, "{times} d0 gives {n}");
        }
    }

    #[test]
    fn rounding_keeps_the_mean() {
        let n = 10_000;
        let sum: u32 = (0..n).map(|i| round_count(0.3, i as f32 / n as f32)).sum();
        assert!((sum as f32 / n as f32 - 0.3).abs() < 1e-3);
        assert_eq!(round_count(5.0, 0.999), 5);
    }
}
