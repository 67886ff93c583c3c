//! Closed lists of values along a path: splines, even spacing, smoothing. Each O(n) or O(n log n).

use bevy::math::{Vec2, Vec3};
use std::collections::VecDeque;

/// `count` points evenly spaced on the closed centripetal Catmull-Rom spline through `way`.
///
/// Catmull & Rom 1974, "A Class of Local Interpolating Splines"; centripetal knots make no loops between unevenly spaced
/// points (Yuksel et al. 2011, "Parameterization and Applications of Catmull-Rom Curves").
pub(super) fn spline(way: &[Vec2], count: usize) -> Vec<Vec3> {
    let dense: Vec<Vec3> = (0..way.len())
        .flat_map(|i| {
            let p = [way.len() - 1, 0, 1, 2].map(|k| way[(i + k) % way.len()]);
            (0..64).map(move |k| centripetal(p, k as f32 / 64.0)).map(|p| Vec3::new(p.x, 0.0, p.y))
        })
        .collect();
    resampled(&dense, count).into_iter().map(|(_, p)| p).collect()
}

/// Point at `u` (0 to 1) between the second and third of four points, by Barry and Goldman's pyramid.
fn centripetal(p: [Vec2; 4], u: f32) -> Vec2 {
    let knot = |a: Vec2, b: Vec2| a.distance(b).sqrt().max(1e-3);
    let t1 = knot(p[0], p[1]);
    let t2 = t1 + knot(p[1], p[2]);
    let t3 = t2 + knot(p[2], p[3]);
    let t = t1 + (t2 - t1) * u;
    let mix = |a: Vec2, b: Vec2, ta: f32, tb: f32| {
        a * ((tb - t) / (tb - ta)) + b * ((t - ta) / (tb - ta))
    };
    let (a, b, c) = (mix(p[0], p[1], 0.0, t1), mix(p[1], p[2], t1, t2), mix(p[2], p[3], t2, t3));
    mix(mix(a, b, 0.0, t2), mix(b, c, t1, t3), t1, t2)
}

/// Length of the closed polyline. In `f64`, as ten thousand short pieces add up.
pub(super) fn loop_length(points: &[Vec3]) -> f32 {
    let n = points.len();
    (0..n).map(|i| f64::from(points[i].distance(points[(i + 1) % n]))).sum::<f64>() as f32
}

/// `count` points evenly spaced along the closed polyline, each with the index of the piece that it lies on.
pub(super) fn resampled(points: &[Vec3], count: usize) -> Vec<(usize, Vec3)> {
    let n = points.len();
    let piece = |i: usize| f64::from(points[i].distance(points[(i + 1) % n]));
    let step = (0..n).map(piece).sum::<f64>() / count as f64;
    let mut result = Vec::with_capacity(count);
    let (mut at, mut done) = (0, 0.0);
    for i in 0..count {
        let goal = i as f64 * step;
        while at + 1 < n && done + piece(at) < goal {
            done += piece(at);
            at += 1;
        }
        let length = piece(at);
        let f = if length > 0.0 { ((goal - done) / length).clamp(0.0, 1.0) } else { 0.0 };
        result.push((at, points[at].lerp(points[(at + 1) % n], f as f32)));
    }
    result
}

/// Mean within `half` places to both sides of each place of a closed list. O(n).
pub(super) fn smoothed(values: &[f32], half: usize) -> Vec<f32> {
    let n = values.len();
    let half = half.min(n.saturating_sub(1) / 2);
    // A running sum; in `f64`, so that what is added and taken away cancels.
    let mut sum: f64 = (0..2 * half + 1).map(|k| f64::from(values[(n + k - half) % n])).sum();
    let share = 1.0 / (2 * half + 1) as f64;
    (0..n)
        .map(|i| {
            let mean = (sum * share) as f32;
            sum += f64::from(values[(i + half + 1) % n]) - f64::from(values[(i + n - half) % n]);
            mean
        })
        .collect()
}

/// Twice [`smoothed()`]: a triangle of weights, no corners.
pub(super) fn rounded(values: &[f32], half: usize) -> Vec<f32> {
    smoothed(&smoothed(values, half), half)
}

/// Largest value within `half` places to both sides of each place of a closed list. O(n).
pub(super) fn running_maximum(values: &[f32], half: usize) -> Vec<f32> {
    let n = values.len();
    let half = half.min(n.saturating_sub(1) / 2);
    // Places whose value is not exceeded by a later one of the window, so the first is the largest.
    let mut window: VecDeque<usize> = VecDeque::new();
    let mut result = Vec::with_capacity(n);
    for k in 0..n + 2 * half {
        let value = |place: usize| values[(place + n - half) % n];
        while window.back().is_some_and(|&last| value(last) <= value(k)) {
            window.pop_back();
        }
        window.push_back(k);
        if k >= 2 * half {
            while window.front().is_some_and(|&first| first + 2 * half < k) {
                window.pop_front();
            }
            result.push(value(window[0]));
        }
    }
    result
}

/// What must be added so that each place gets at least its `need` (≥ 0) and neighbours rise with it, early and smoothly:
/// means over windows of a maximum over windows as wide are nowhere below the need.
pub(super) fn spread(need: &[f32], half: usize) -> Vec<f32> {
    let half = half.min(need.len().saturating_sub(1) / 4);
    rounded(&running_maximum(need, 2 * half), half)
}

/// The lowest values that are nowhere below the given and change by at most `most` from place to place. O(n).
pub(super) fn slope_limited(values: &[f32], most: f32) -> Vec<f32> {
    let n = values.len();
    let mut result = values.to_vec();
    // Twice around, so that the highest value reaches everything across the seam.
    for i in 1..2 * n {
        result[i % n] = result[i % n].max(result[(i - 1) % n] - most);
    }
    for i in (0..2 * n - 1).rev() {
        result[i % n] = result[i % n].max(result[(i + 1) % n] - most);
    }
    result
}

/// Rounds corners until no bend is tighter than `radius` places of even spacing, as far as the loop's size allows.
pub(super) fn unbend(points: &mut [Vec3], step: f32, radius_m: f32) {
    let n = points.len();
    let reach = ((radius_m / step) as usize / 4).clamp(1, n / 8);
    for round in 0..24 {
        let tight = (0..n).any(|i| {
            let [a, b, c] = [n - reach, 0, reach].map(|k| points[(i + k) % n]);
            let turn = (b - a).angle_between(c - b);
            turn > reach as f32 * step / radius_m
        });
        if !tight {
            return;
        }
        let half = ((radius_m * (0.4 + 0.1 * round as f32) / step) as usize).clamp(1, n / 8);
        let xs: Vec<f32> = points.iter().map(|p| p.x).collect();
        let zs: Vec<f32> = points.iter().map(|p| p.z).collect();
        for (point, (x, z)) in
            points.iter_mut().zip(rounded(&xs, half).into_iter().zip(rounded(&zs, half)))
        {
            (point.x, point.z) = (x, z);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::hash::SplitMix64;

    fn noise(n: usize) -> Vec<f32> {
        let mut rng = SplitMix64(7);
        (0..n).map(|_| rng.range(-3.0, 9.0)).collect()
    }

    #[test]
    fn fast_windows_agree_with_slow_ones() {
        let values = noise(37);
        for half in [0, 1, 5, 17] {
            let window = |i: usize| (0..=2 * half).map(move |k| (i + 37 + k - half) % 37);
            let (mean, most) = (smoothed(&values, half), running_maximum(&values, half));
            for i in 0..37 {
                let slow: f32 = window(i).map(|k| values[k]).sum::<f32>() / (2 * half + 1) as f32;
                assert!((mean[i] - slow).abs() < 1e-4);
                assert_eq!(most[i], window(i).map(|k| values[k]).fold(f32::MIN, f32::max));
            }
        }
    }

    #[test]
    fn a_spread_and_a_slope_limit_are_nowhere_below_the_need() {
        let need: Vec<f32> = noise(200).iter().map(|v| v.max(0.0)).collect();
        let limited = slope_limited(&need, 0.5);
        for (i, (spread, need)) in spread(&need, 6).iter().zip(&need).enumerate() {
            assert!(*spread >= need - 1e-4 && limited[i] >= *need);
            assert!((limited[i] - limited[(i + 1) % 200]).abs() <= 0.5001);
        }
    }

    #[test]
    fn resampled_points_are_even() {
        let square =
            [(0.0, 0.0), (9.0, 0.0), (9.0, 3.0), (0.0, 3.0)].map(|(x, z)| Vec3::new(x, 0.0, z));
        let points = resampled(&square, 48);
        for i in 0..48 {
            assert!((points[i].1.distance(points[(i + 1) % 48].1) - 0.5).abs() < 1e-4);
        }
        assert!((loop_length(&square) - 24.0).abs() < 1e-4);
    }
}
