//! Neighbour search among 3D points: positions in, points within a radius out.
//!
//! Points are sorted into rows: a dense table of cells over the two shorter axes of their box, and within each row by the
//! longest axis. A query visits the rows it touches and finds its stretch of each by binary search. Build O(n log n);
//! a query O(rows touched · log(row) + points found). The order of visits depends on nothing but the input.

use super::bounding::Aabb;
use bevy::math::Vec3;
use rayon::prelude::*;

/// Points sorted for neighbour search. A *slot* is a place in the sorted order.
#[derive(Clone, Debug)]
pub struct PointGrid {
    /// The axis along which rows are sorted, then the two axes of the table.
    axes: [usize; 3],
    min: Vec3,
    inverse_cell: f32,
    dims: [usize; 2],
    /// First slot of each row, and the number of slots at the end.
    starts: Vec<u32>,
    points: Vec<Vec3>,
    ids: Vec<u32>,
}

impl PointGrid {
    /// Sorts `points` into rows of side `cell`, best about as wide as the radius asked for. A cell that is too small for the
    /// number of points (or not a positive number) is enlarged, so that memory stays O(n).
    pub fn new(points: &[Vec3], cell: f32) -> Self {
        let bounds = Aabb::of(points.iter().copied().filter(|p| p.is_finite()));
        let extent = bounds.extent();
        let mut axes = [0, 1, 2];
        axes.sort_by(|&a, &b| extent[b].total_cmp(&extent[a]));
        let (min, [_, u, v]) = (bounds.min, axes);
        let mut cell = if cell > 0.0 && cell.is_finite() { cell } else { f32::MIN_POSITIVE };
        // A cell too small for the box would give an infinite table; this is the smallest worth starting from.
        cell = cell.max(extent[u] * 1e-4).max(f32::MIN_POSITIVE);
        let count = |cell: f32, axis: usize| (extent[axis] / cell) as usize + 1;
        let most_rows = points.len() * 8 + 64;
        while count(cell, u).saturating_mul(count(cell, v)) > most_rows {
            cell *= 1.25;
        }
        let dims = [count(cell, u), count(cell, v)];
        let inverse_cell = 1.0 / cell;
        let row = |p: Vec3| {
            let column = |axis: usize, dim: usize| {
                (((p[axis] - min[axis]) * inverse_cell) as usize).min(dim - 1)
            };
            column(v, dims[1]) * dims[0] + column(u, dims[0])
        };
        let mut keys: Vec<(u64, u32)> = points
            .par_iter()
            .enumerate()
            .map(|(id, &p)| {
                // Distances from the smallest coordinate are never negative, so their bits sort as they do.
                let along = (p[axes[0]] - min[axes[0]]).max(0.0).to_bits();
                ((row(p) as u64) << 32 | u64::from(along), id as u32)
            })
            .collect();
        keys.par_sort_unstable();
        let mut starts = vec![0u32; dims[0] * dims[1] + 1];
        for &(key, _) in &keys {
            starts[(key >> 32) as usize + 1] += 1;
        }
        for i in 1..starts.len() {
            starts[i] += starts[i - 1];
        }
        let ids: Vec<u32> = keys.iter().map(|&(_, id)| id).collect();
        let points = ids.iter().map(|&id| points[id as usize]).collect();
        Self { axes, min, inverse_cell, dims, starts, points, ids }
    }

    /// The points by slot.
    pub fn points(&self) -> &[Vec3] {
        &self.points
    }

    /// The index each slot had in the input.
    pub fn ids(&self) -> &[u32] {
        &self.ids
    }

    /// Calls `visit(slot, squared distance)` for every point at most `radius` from `center`.
    pub fn for_each_within(&self, center: Vec3, radius: f32, mut visit: impl FnMut(usize, f32)) {
        let [along, u, v] = self.axes;
        let columns = |axis: usize, dim: usize| {
            let first = ((center[axis] - radius - self.min[axis]) * self.inverse_cell) as usize;
            let last = ((center[axis] + radius - self.min[axis]) * self.inverse_cell) as usize;
            // One more on each side: the rounding of a point's own column may differ from that of the query.
            first.saturating_sub(1)..=last.saturating_add(1).min(dim - 1)
        };
        let (first, last) = (center[along] - radius, center[along] + radius);
        let squared = radius * radius;
        for row_v in columns(v, self.dims[1]) {
            for row_u in columns(u, self.dims[0]) {
                let row = row_v * self.dims[0] + row_u;
                let (start, end) = (self.starts[row] as usize, self.starts[row + 1] as usize);
                let points = &self.points[start..end];
                let skip = points.partition_point(|p| p[along] < first);
                for (i, p) in points[skip..].iter().enumerate() {
                    if p[along] > last {
                        break;
                    }
                    let distance = p.distance_squared(center);
                    if distance <= squared {
                        visit(start + skip + i, distance);
                    }
                }
            }
        }
    }

    /// Distance from `point` to the nearest point at another slot than `except`; infinite if there is none.
    /// Looks within `guess` first and doubles it until something is found.
    pub fn nearest(&self, point: Vec3, guess: f32, except: Option<usize>) -> f32 {
        let others = self.points.len() - usize::from(except.is_some());
        let mut radius = guess.max(f32::MIN_POSITIVE);
        let mut best = f32::INFINITY;
        while others > 0 && best == f32::INFINITY && radius.is_finite() {
            self.for_each_within(point, radius, |slot, squared| {
                if Some(slot) != except {
                    best = best.min(squared);
                }
            });
            radius *= 2.0;
        }
        best.sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::hash::SplitMix64;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_query_finds_what_comparing_all_pairs_finds(
            seed in any::<u64>(), count in 1usize..200, cell in 0.001f32..3.0, radius in 0.0f32..1.5, flat in any::<bool>(),
        ) {
            let mut random = SplitMix64(seed);
            let mut next = || random.range(-1.0, 1.0);
            let points: Vec<Vec3> =
                (0..count).map(|_| Vec3::new(next(), next() * 0.3, if flat { 0.0 } else { next() })).collect();
            let grid = PointGrid::new(&points, cell);
            for &center in &points {
                let mut found = vec![];
                grid.for_each_within(center, radius, |slot, _| found.push(grid.ids()[slot]));
                found.sort_unstable();
                let expected: Vec<u32> = (0..count as u32)
                    .filter(|&i| points[i as usize].distance_squared(center) <= radius * radius)
                    .collect();
                prop_assert_eq!(found, expected);
            }
        }
    }

    #[test]
    fn a_grid_of_nothing_or_of_equal_points_works() {
        let empty = PointGrid::new(&[], 1.0);
        empty.for_each_within(Vec3::ZERO, 1.0, |_, _| panic!("there is nothing to find"));
        assert_eq!(empty.nearest(Vec3::ZERO, 1.0, None), f32::INFINITY);
        let equal = PointGrid::new(&[Vec3::ONE; 9], 0.0);
        let mut found = 0;
        equal.for_each_within(Vec3::ONE, 0.1, |_, _| found += 1);
        assert_eq!((found, equal.nearest(Vec3::ONE, 0.1, Some(0))), (9, 0.0));
    }
}
