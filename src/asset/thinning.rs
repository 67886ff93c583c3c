//! How much a tree of few points has to shrink them, so that it covers what it should.
//!
//! The area rule gives all points together the area of the tree, whatever their number. But a crown hides most of itself,
//! and a few large splats hide less of each other than many small ones, and reach beyond its outline: a tree of eight
//! points would cover half as much again. So the splats of each number of points get a factor on their area, with which
//! they cover what the tree covers (stochastic simplification, Cook et al. 2007, with coverage measured instead of assumed).
//!
//! In: points in progressive order; out: a factor for 1, 2, 4 … points. By drawing prefixes from some directions on a coarse grid,
//! when a tree is baked or read. O(points).

use super::{
    surfel::{SURFEL_TWO_SIDED, Surfel},
    tree_data::TreeData,
};
use crate::lod::splat_size::{AREA_OCTAVES, OVERLAP_GAIN, disc_radius, leaf_overlap, overlap};
use bevy::math::{Mat3, Vec2, Vec3};
use rayon::prelude::*;
use std::f32::consts::PI;

/// Directions of view, for few points and for many. Azimuths are turned by the golden angle, elevations alternate.
const DIRECTIONS: usize = 8;
const DIRECTIONS_OF_MANY: usize = 2;
const AZIMUTH_STEP: f32 = 2.399_963;
/// Radians above the horizon: a forest is seen from among its trees or from a hill.
const ELEVATIONS: [f32; 2] = [0.08, 0.35];
/// Samples along each side of the grid, which is four times as wide as the tree's sphere has radius.
const GRID: usize = 256;
/// Octaves of few points: their splats are large, seen from one side they differ from what they are from another.
const FEW: usize = 12;
/// Steps towards a factor. Each octave starts from the factor of the next.
const STEPS: usize = 3;
/// Most area of a tree in areas of the grid: bounds the work on files that lie.
const MOST_AREA: f32 = 64.0;
/// What a factor may be: a tree whose first point is seen edge on must not grow without bounds.
const RANGE: (f32, f32) = (0.2, 1.25);

/// The factors on the area of splats of a tree of 1, 2, 4 … points, for [`area_factor`](crate::lod::splat_size::area_factor). All
/// 1 for a tree without area, or of more than could be.
pub fn area_factors(tree: &TreeData) -> [f32; AREA_OCTAVES] {
    let mut factors = [1.0; AREA_OCTAVES];
    let side = 4.0 * tree.bounds.radius();
    if !(tree.surface_area <= MOST_AREA * side * side) {
        return factors;
    }
    let points: Vec<Surfel> =
        (0..tree.point_count()).filter_map(|index| tree.surfel(index)).collect();
    // All points without overlap are the surface as it was sampled.
    let mut whole = covered(tree, &points, DIRECTIONS_OF_MANY, None);
    if !(whole > 0.0) {
        return factors;
    }
    let (mut factor, mut directions) = (1.0, DIRECTIONS_OF_MANY);
    for octave in (0..AREA_OCTAVES).rev() {
        let count = 1 << octave;
        let Some(prefix) = points.get(..count) else { continue };
        let steps = if octave < FEW { STEPS } else { 1 };
        if octave < FEW && directions == DIRECTIONS_OF_MANY {
            // From here on seen from all sides, and held against what twice as many points cover there, which is cheaper
            // than all of them.
            directions = DIRECTIONS;
            whole = match points.get(..2 * count) {
                Some(twice) => covered(tree, twice, directions, Some(factor)),
                None => covered(tree, &points, directions, None),
            };
        }
        for _ in 0..steps {
            let found = covered(tree, prefix, directions, Some(factor));
            factor = (factor * whole / found.max(whole * 0.1)).clamp(RANGE.0, RANGE.1);
        }
        factors[octave] = factor;
    }
    // A tree of fewer points has no octaves beyond them: its last factor holds.
    let known = (points.len().ilog2() as usize).min(AREA_OCTAVES - 1);
    let last = factors[known];
    factors[known..].fill(last);
    factors
}

/// Samples that the splats of `points` cover, over some directions. Their area is that of the area rule times a factor, with
/// overlap; or without both.
fn covered(tree: &TreeData, points: &[Surfel], directions: usize, factor: Option<f32>) -> f32 {
    let area = tree.surface_area * factor.unwrap_or(1.0);
    let radius = disc_radius(area, points.len() as f32);
    if !(radius > 0.0 && radius.is_finite()) {
        return 0.0;
    }
    let gain = factor.map(|_| OVERLAP_GAIN);
    let from_direction = |direction: usize| {
        let mut grid = Grid::new(tree, direction);
        points.iter().for_each(|point| grid.draw(tree, point, radius, gain));
        grid.samples.iter().filter(|covered| **covered).count()
    };
    (0..directions).into_par_iter().map(from_direction).sum::<usize>() as f32
}

/// What is covered, seen from one direction in parallel projection.
struct Grid {
    samples: Vec<bool>,
    /// Rows: right, up, and towards the eye.
    view_from_model: Mat3,
    center: Vec3,
    samples_per_unit: f32,
}

impl Grid {
    fn new(tree: &TreeData, direction: usize) -> Self {
        let azimuth = direction as f32 * AZIMUTH_STEP;
        let elevation = ELEVATIONS[direction % ELEVATIONS.len()];
        Self {
            samples: vec![false; GRID * GRID],
            view_from_model: Mat3::from_rotation_x(elevation) * Mat3::from_rotation_y(azimuth),
            center: tree.bounds.center(),
            samples_per_unit: GRID as f32 / (4.0 * tree.bounds.radius().max(f32::MIN_POSITIVE)),
        }
    }

    /// Draws a splat of `radius`, which overlaps by `gain` if at all: as `project` and `covers` of
    /// `shaders/splat/project.wgsl` do.
    fn draw(&mut self, tree: &TreeData, point: &Surfel, radius: f32, gain: Option<f32>) {
        let face = point.face_normal;
        let toward = (self.view_from_model * face).z;
        let one_sided = point.flags & SURFEL_TWO_SIDED == 0;
        if toward.abs() < 0.02 || (toward < 0.0 && one_sided) {
            return;
        }
        let share = tree.sample_share();
        let spacing = radius / tree.pixel * (PI * share.max(0.6)).sqrt();
        let leaf = tree.mean_leaf_area;
        let grown = gain.map_or(1.0, |gain| {
            let leaf = leaf_overlap(radius, leaf, gain);
            overlap(leaf, point.thickness, one_sided, spacing)
        });
        let area = PI * radius * radius * grown;
        // Half sides of a cell, or half axes of a disc, in the surface.
        let is_cell = share > 0.0;
        let (right, up) = if is_cell {
            let half = 0.5 * (area * share).sqrt();
            let axis = face.abs().max_position();
            let in_surface =
                |side: Vec3| (side - Vec3::AXES[axis] * (face.dot(side) / face[axis])) * half;
            (in_surface(Vec3::AXES[(axis + 1) % 3]), in_surface(Vec3::AXES[(axis + 2) % 3]))
        } else {
            let (right, up) = face.any_orthonormal_pair();
            let half = (area / PI).sqrt();
            (right * half, up * half)
        };
        let on_grid = |v: Vec3| (self.view_from_model * v).truncate() * self.samples_per_unit;
        let center = on_grid(point.position - self.center) + GRID as f32 * 0.5;
        let (right, up) = (on_grid(right), on_grid(up));
        self.fill(center, right, up, is_cell);
    }

    /// Marks the samples in a parallelogram, or in the ellipse within it.
    fn fill(&mut self, center: Vec2, right: Vec2, up: Vec2, is_cell: bool) {
        let determinant = right.perp_dot(up);
        if determinant.abs() < 1e-9 {
            return;
        }
        let reach = right.abs() + up.abs();
        let last = GRID as f32;
        let begin = (center - reach - 0.5).ceil().clamp(Vec2::ZERO, Vec2::splat(last));
        let end = (center + reach - 0.5).ceil().clamp(Vec2::ZERO, Vec2::splat(last));
        for y in begin.y as usize..end.y as usize {
            for x in begin.x as usize..end.x as usize {
                let d = Vec2::new(x as f32 + 0.5, y as f32 + 0.5) - center;
                let place = Vec2::new(d.perp_dot(up), right.perp_dot(d)) / determinant;
                let size = if is_cell { place.abs().max_element() } else { place.length() };
                self.samples[y * GRID + x] |= size <= 1.0;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::asset::synthetic::synthetic_tree;

    #[test]
    fn few_points_of_a_crown_that_hides_itself_shrink() {
        let mut tree = synthetic_tree(20_000, 3);
        tree.surface_area = 400.0;
        let factors = area_factors(&tree);
        assert!((0.2..0.8).contains(&factors[2]), "{factors:?}");
        assert!(factors[2] < factors[6] && factors[6] < factors[11], "{factors:?}");
        assert!((0.7..1.1).contains(&factors[11]) && factors[14] == factors[15], "{factors:?}");
        // With them every prefix covers what all points cover.
        let points: Vec<Surfel> = (0..20_000).filter_map(|i| tree.surfel(i)).collect();
        let whole = covered(&tree, &points, DIRECTIONS, None);
        for octave in 2..AREA_OCTAVES - 1 {
            let prefix = &points[..1 << octave];
            let found = covered(&tree, prefix, DIRECTIONS, Some(factors[octave]));
            assert!((found / whole - 1.0).abs() < 0.06, "{} at {octave}", found / whole);
        }
    }

    #[test]
    fn a_tree_without_area_is_left_as_it_is() {
        let mut tree = synthetic_tree(100, 3);
        tree.surface_area = 0.0;
        assert_eq!(area_factors(&tree), [1.0; AREA_OCTAVES]);
        let single = area_factors(&synthetic_tree(1, 3));
        assert!(single.iter().all(|f| (RANGE.0..=RANGE.1).contains(f)));
    }
}
