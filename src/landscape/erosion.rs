//! Rivers carve a grid: uplift and outlets in, heights and the area drained through each post out. O(n log n) a step.
//!
//! Stream power law, dh/dt = U − K Aᵐ S, solved implicitly from the outlets upwards (Braun & Willett 2013, "A very
//! efficient O(n), implicit and parallel method to solve the stream power equation"), on flow routed through pits by a
//! priority flood (Barnes et al. 2014). Its steady state is a landscape of ridges and branching valleys.

use super::height_grid::{Cubic, HeightGrid};
use crate::math::hash::unit_from_bits;
use std::{cmp::Reverse, collections::BinaryHeap};

/// Exponent of drained area: 0.4 to 0.5 in nature.
const AREA_EXPONENT: f32 = 0.45;
/// Steepest slope that does not slide, rise over run: about 40°.
const TALUS: f32 = 0.84;

/// What is carved.
pub(super) struct Carved {
    pub heights: HeightGrid,
    /// Posts drained through each post, itself included.
    pub drained: Vec<f32>,
}

/// Uplift and outlets by place, both coordinates 0 to 1.
pub(super) struct Shaping<'a> {
    /// ≥ 0, any unit.
    pub uplift: &'a dyn Fn(f32, f32) -> f32,
    /// True where water leaves, at height 0: lakes. The border always is one.
    pub outlet: &'a dyn Fn(f32, f32) -> bool,
    /// Unevenness of the first state by place, about −1 to 1: decides where the main rivers run.
    pub unevenness: &'a dyn Fn(f32, f32) -> f32,
    /// Highest height above the outlets, metres.
    pub relief_m: f32,
    /// Side of the square, metres.
    pub side_m: f32,
}

/// Carves at growing resolution, the last of `cells` a side (a power of two ≥ 32).
pub(super) fn carve(shaping: &Shaping, cells: usize) -> Carved {
    let mut scale = 1.0;
    let mut heights = HeightGrid { columns: 1, rows: 1, posts: vec![0.0] };
    let mut drained = Vec::new();
    let mut level = (cells / 8).max(16);
    while level <= cells {
        let posts = level + 1;
        let at = |i: usize| i as f32 / level as f32;
        let old = heights;
        let stretch = (old.columns - 1) as f32;
        // The finer grid starts from the coarser one; later steps only add smaller valleys.
        heights = HeightGrid::new(posts, posts, |x, z| {
            if stretch == 0.0 {
                return 1.0 + (shaping.unevenness)(at(x), at(z));
            }
            // Uneven by a part of the slope of a cell, or new valleys would follow the grid.
            let [h, dx, dz] = old.with_slope(at(x) * stretch, at(z) * stretch, Cubic::BSpline);
            h + (unit_from_bits((z * posts + x) as u32) - 0.5) * 0.6 * dx.hypot(dz)
        });
        let uplift: Vec<f32> = grid(posts).map(|(x, z)| (shaping.uplift)(at(x), at(z))).collect();
        let outlets: Vec<bool> = grid(posts)
            .map(|(x, z)| {
                let border = x == 0 || z == 0 || x == level || z == level;
                border || (shaping.outlet)(at(x), at(z))
            })
            .collect();
        let steps = if old.columns == 1 { 40 } else { 7 };
        let cell_m = shaping.side_m / level as f32;
        for step in 0..steps {
            let flow = Flow::over(&heights, &outlets);
            drained = flow.drained();
            // In areas of the whole square, so that all resolutions agree.
            let share = 1.0 / (level * level) as f32;
            flow.solve(&mut heights, &uplift, &drained, &outlets, scale, share, at(1));
            if old.columns == 1 && step + 1 == steps {
                // The law is linear in uplift: scale it once to the relief asked for.
                let highest = heights.range()[1].max(1e-6);
                scale = shaping.relief_m / highest;
                heights.posts.iter_mut().for_each(|height| *height *= scale);
            }
            if old.columns > 1 {
                flow.slide(&mut heights, cell_m);
            }
        }
        level *= 2;
    }
    Carved { heights, drained }
}

fn grid(posts: usize) -> impl Iterator<Item = (usize, usize)> {
    (0..posts).flat_map(move |z| (0..posts).map(move |x| (x, z)))
}

/// Where water goes from every post.
struct Flow {
    /// Posts from the outlets upwards: each behind the one it drains to.
    order: Vec<u32>,
    /// The post that each drains to; itself at outlets.
    receiver: Vec<u32>,
    columns: usize,
}

impl Flow {
    fn over(heights: &HeightGrid, outlets: &[bool]) -> Self {
        let columns = heights.columns;
        let count = heights.posts.len();
        let mut receiver: Vec<u32> = (0..count as u32).collect();
        let mut order = Vec::with_capacity(count);
        // Heights are ordered by their bits, which works from 0 up; outlets are at 0.
        let key = |h: f32| h.max(0.0).to_bits();
        let mut queue = BinaryHeap::with_capacity(count / 4);
        let mut level = vec![u32::MAX; count];
        for i in (0..count).filter(|i| outlets[*i]) {
            level[i] = 0;
            queue.push(Reverse((0, i as u32)));
        }
        while let Some(Reverse((at_level, i))) = queue.pop() {
            order.push(i);
            for (j, _) in neighbours(i as usize, columns, count) {
                if level[j] == u32::MAX {
                    // A pit fills up to its spill point, and drains towards it.
                    level[j] = key(heights.posts[j]).max(at_level);
                    receiver[j] = i;
                    queue.push(Reverse((level[j], j as u32)));
                }
            }
        }
        // Outside of pits: the steepest way down.
        for &i in &order {
            let i = i as usize;
            if outlets[i] || level[i] != key(heights.posts[i]) {
                continue;
            }
            let mut steepest = 0.0;
            for (j, distance) in neighbours(i, columns, count) {
                // Uneven ground: of several ways down, water does not always take the one along the grid.
                let ease = 0.6 + 0.8 * unit_from_bits((i * 8 + j) as u32);
                let slope = (heights.posts[i] - heights.posts[j]) / distance * ease;
                if level[j] < level[i] && slope > steepest {
                    steepest = slope;
                    receiver[i] = j as u32;
                }
            }
        }
        Self { order, receiver, columns }
    }

    fn drained(&self) -> Vec<f32> {
        let mut area = vec![1.0f32; self.receiver.len()];
        for &i in self.order.iter().rev() {
            let to = self.receiver[i as usize];
            if to != i {
                area[to as usize] += area[i as usize];
            }
        }
        area
    }

    #[expect(clippy::too_many_arguments, reason = "the terms of the law")]
    fn solve(
        &self,
        heights: &mut HeightGrid,
        uplift: &[f32],
        drained: &[f32],
        outlets: &[bool],
        scale: f32,
        area_share: f32,
        cell: f32,
    ) {
        // Long steps: what is wanted is the steady state.
        const TIME: f32 = 60.0;
        for &i in &self.order {
            let i = i as usize;
            let to = self.receiver[i] as usize;
            if outlets[i] {
                heights.posts[i] = 0.0;
                continue;
            }
            let diagonal = i.abs_diff(to) != 1 && i.abs_diff(to) != self.columns;
            let distance = if diagonal { cell * std::f32::consts::SQRT_2 } else { cell };
            let hardness = 0.55 + 0.9 * unit_from_bits(i as u32 ^ 0xE0D);
            let power = hardness * TIME * (drained[i] * area_share).powf(AREA_EXPONENT) / distance;
            let raised = heights.posts[i] + TIME * uplift[i] * scale;
            heights.posts[i] = (raised + power * heights.posts[to]) / (1.0 + power);
        }
    }

    /// Slopes above the talus slide.
    fn slide(&self, heights: &mut HeightGrid, cell_m: f32) {
        for &i in &self.order {
            let i = i as usize;
            let to = self.receiver[i] as usize;
            let diagonal = i.abs_diff(to) != 1 && i.abs_diff(to) != self.columns;
            let run = if diagonal { cell_m * std::f32::consts::SQRT_2 } else { cell_m };
            heights.posts[i] = heights.posts[i].min(heights.posts[to] + TALUS * run);
        }
    }
}

/// The up to eight posts around one, with their distances in cells.
fn neighbours(i: usize, columns: usize, count: usize) -> impl Iterator<Item = (usize, f32)> {
    let (x, z) = ((i % columns) as isize, (i / columns) as isize);
    let rows = (count / columns) as isize;
    const AROUND: [(isize, isize, f32); 8] = [
        (-1, 0, 1.0),
        (1, 0, 1.0),
        (0, -1, 1.0),
        (0, 1, 1.0),
        (-1, -1, std::f32::consts::SQRT_2),
        (1, -1, std::f32::consts::SQRT_2),
        (-1, 1, std::f32::consts::SQRT_2),
        (1, 1, std::f32::consts::SQRT_2),
    ];
    AROUND.into_iter().filter_map(move |(dx, dz, distance)| {
        let (x, z) = (x + dx, z + dz);
        let inside = x >= 0 && z >= 0 && x < columns as isize && z < rows;
        inside.then_some((z as usize * columns + x as usize, distance))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn dome() -> Carved {
        let shaping = Shaping {
            uplift: &|x, z| 1.0 + (x * 9.0).sin() * (z * 7.0).cos() * 0.5,
            outlet: &|_, _| false,
            unevenness: &|x, z| (x * 31.0).sin() * (z * 27.0).cos() * 0.3,
            relief_m: 500.0,
            side_m: 8000.0,
        };
        carve(&shaping, 128)
    }

    #[test]
    fn rivers_gather_water_and_leave_ridges() {
        let carved = dome();
        let [lowest, highest] = carved.heights.range();
        assert!(lowest >= 0.0 && (250.0..750.0).contains(&highest), "{lowest} {highest}");
        let largest = carved.drained.iter().copied().fold(0.0, f32::max);
        assert!(largest > 400.0, "{largest} posts drain through the largest river");
    }

    #[test]
    fn all_water_leaves_over_the_outlets() {
        let carved = dome();
        let posts = 129;
        let out: f32 = carved
            .drained
            .iter()
            .enumerate()
            .filter(|(i, _)| {
                let (x, z) = (i % posts, i / posts);
                x == 0 || z == 0 || x == posts - 1 || z == posts - 1
            })
            .map(|(_, area)| area)
            .sum();
        assert!((out - (posts * posts) as f32).abs() < 1.0, "{out}");
    }
}
