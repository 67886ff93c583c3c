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

/// Trees of fewer points get fewer for each of their pixels: see [`thinned`].
pub const FULL_POINTS: f32 = 4096.0;

/// Share of its points that no tree goes below: see [`thinned`].
pub const LEAST_SHARE: f32 = 0.125;

/// Points of a tree that would have `n` if it had as many a pixel as a near one. What is in front of each other in a small
/// crown is not told apart, and the splats of fewer points are as much larger: `n` from [`FULL_POINTS`] on, `n^1.5` below,
/// down to [`LEAST_SHARE`] of `n`. It grows with `n`, so that prefixes of groves stay prefixes.
pub fn thinned(n: f32) -> f32 {
    n * (n / FULL_POINTS).sqrt().clamp(LEAST_SHARE, 1.0)
}

/// The inverse of [`thinned`].
pub fn unthinned(n: f64) -> f64 {
    let (full, share) = (f64::from(FULL_POINTS), f64::from(LEAST_SHARE));
    (n * n * full).cbrt().max(n).min(n / share)
}

/// `N = N0 (s Z0 / d)² q`, [`thinned`] and clamped to `N0`: points wanted at distance `d`, not yet rounded. The paper's eq. 1,
/// where `q` is 1 and no tree is thinned. A distance of 0 gives `N0`.
pub fn prefix_count(n0: f32, s: f32, z0: f32, d: f32, quality: f32) -> f32 {
    let ratio = d0(s, z0) / d.max(1e-6);
    thinned(n0 * quality * ratio * ratio).min(n0)
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
        for (times, share) in [(1.0, 1.0), (2.0, 0.25), (4.0, 1.0 / 16.0)] {
            let n = prefix_count(100_000.0, s, z0, d0 * times, 1.0);
            assert!((n - 100_000.0 * share).abs() < 1.0, "{times} d0 gives {n}");
        }
    }

    #[test]
    fn small_trees_get_fewer_points_a_pixel_and_never_more_by_distance() {
        let thin = [8192.0, 4096.0, 1024.0, 256.0, 64.0, 4.0].map(thinned);
        assert_eq!(thin, [8192.0, 4096.0, 512.0, 64.0, 8.0, 0.5]);
        for n in (0..8000).map(|i| f64::from(i) * 0.7) {
            let back = f64::from(thinned(unthinned(n) as f32));
            assert!((back - n).abs() <= 1e-6 * n, "{n} {back}");
            assert!(thinned(n as f32 + 0.1) > thinned(n as f32));
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
