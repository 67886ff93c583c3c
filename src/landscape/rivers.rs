//! What rivers leave around them: drained areas of a carved grid in; moisture and wide valley floors out. Pure; O(posts).

use super::{height_grid::HeightGrid, smoothstep};

/// Nearness of rivers, 0 to 1 by the logarithm of what they drain (`erosion`), on every second post. O(posts).
pub(super) fn wetness(drained: &[f32], cells: usize) -> HeightGrid {
    let (posts, half) = (cells + 1, cells / 2 + 1);
    let full = (cells as f32).powf(1.2);
    let mut grid = HeightGrid::new(half, half, |x, z| {
        let index =
            |dx: usize, dz: usize| (2 * z + dz).min(cells) * posts + (2 * x + dx).min(cells);
        let area = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(dx, dz)| drained[index(dx, dz)]);
        (area.into_iter().fold(1.0, f32::max).ln() / full.ln()).clamp(0.0, 1.0)
    });
    // Spreads downhill of nothing: a blur that keeps large values, twice.
    for _ in 0..2 {
        let old = grid.clone();
        grid = HeightGrid::new(half, half, |x, z| {
            let mut best = old.posts[z * half + x];
            let mut sum = 0.0;
            for (dx, dz) in [(0, 1), (2, 1), (1, 0), (1, 2)] {
                let (x, z) = ((x + dx).max(1) - 1, (z + dz).max(1) - 1);
                let near = old.posts[z.min(half - 1) * half + x.min(half - 1)];
                best = best.max(near * 0.85);
                sum += near;
            }
            0.5 * best + 0.125 * sum
        });
    }
    grid
}

/// Rivers fill their valleys with gravel: floors instead of notches. O(posts × passes).
pub(super) fn widen_valleys(heights: &mut HeightGrid, wetness: &HeightGrid, passes: usize) {
    let columns = heights.columns;
    for _ in 0..passes {
        let old = heights.clone();
        for z in 1..columns - 1 {
            for x in 1..columns - 1 {
                let i = z * columns + x;
                let around = [i - 1, i + 1, i - columns, i + columns].map(|j| old.posts[j]);
                let mean = around.iter().sum::<f32>() * 0.25;
                let lowest = around.into_iter().fold(old.posts[i], f32::min);
                let wet = wetness.bilinear(x as f32 * 0.5, z as f32 * 0.5);
                let flat = smoothstep(0.42, 0.8, wet);
                let target = mean + (lowest - mean) * 0.7 * flat;
                heights.posts[i] += (target - old.posts[i]) * (0.28 + 0.5 * flat);
            }
        }
    }
}
