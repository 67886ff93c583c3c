//! How much a tree of few points has to shrink them, so that it covers what it should, and to lighten them, so that it is
//! as bright.
//!
//! The area rule gives all points together the area of the tree, whatever their number. But a crown hides most of itself,
//! and a few large splats hide less of each other than many small ones, and reach beyond its outline: a tree of eight
//! points would cover half as much again. So the splats of each number of points get a factor on their area, with which
//! they cover what the tree covers (stochastic simplification, Cook et al. 2007, with coverage measured instead of assumed).
//!
//! What they show is not the same either: the first points of the order lie anywhere in the crown, and the dark ones of its
//! inside are seen as often as the others. So their colour gets a factor, with which the mean of what is seen stays.
//!
//! In: points in progressive order; out: two factors for 1, 2, 4 … points. By drawing prefixes from some directions on a coarse grid,
//! when a tree is baked or read. O(points).

use super::{
    surfel::{SURFEL_TWO_SIDED, SURFEL_UNLIT, Surfel, light_factor},
    tree_data::TreeData,
};
use crate::{
    lod::splat_size::{AREA_OCTAVES, OVERLAP_GAIN, disc_radius, leaf_overlap, overlap},
    math::quantize::srgb8_to_linear,
};
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

/// What a light factor may be.
const LIGHT_RANGE: (f32, f32) = (0.5, 2.0);

/// Factors for 1, 2, 4 … points, for [`area_factor`](crate::lod::splat_size::area_factor).
#[derive(Clone, Debug, PartialEq)]
pub struct Thinning {
    /// On the area of splats.
    pub area: [f32; AREA_OCTAVES],
    /// On their colour.
    pub light: [f32; AREA_OCTAVES],
}

/// The factors of a tree. All 1 for a tree without area, or of more than could be.
pub fn thinning(tree: &TreeData) -> Thinning {
    let mut factors = Thinning { area: [1.0; AREA_OCTAVES], light: [1.0; AREA_OCTAVES] };
    let side = 4.0 * tree.bounds.radius();
    let is_possible = tree.surface_area <= MOST_AREA * side * side;
    if !is_possible {
        return factors;
    }
    let points: Vec<Surfel> =
        (0..tree.point_count()).filter_map(|index| tree.surfel(index)).collect();
    // All points without overlap are the surface as it was sampled.
    let whole_seen = seen(tree, &points, DIRECTIONS_OF_MANY, None);
    let (mut whole, mut bright) = (whole_seen.covered, whole_seen.brightness());
    let shows_anything = whole > 0.0;
    if !shows_anything {
        return factors;
    }
    let (mut factor, mut light, mut directions) = (1.0, 1.0, DIRECTIONS_OF_MANY);
    for octave in (0..AREA_OCTAVES).rev() {
        let count = 1 << octave;
        let Some(prefix) = points.get(..count) else { continue };
        let steps = if octave < FEW { STEPS } else { 1 };
        if octave < FEW && directions == DIRECTIONS_OF_MANY {
            // From here on seen from all sides, and held against what twice as many points cover there, which is cheaper
            // than all of them.
            directions = DIRECTIONS;
            let held_against = match points.get(..2 * count) {
                Some(twice) => seen(tree, twice, directions, Some(factor)),
                None => seen(tree, &points, directions, None),
            };
            (whole, bright) = (held_against.covered, held_against.brightness() * light);
        }
        for _ in 0..steps {
            let found = seen(tree, prefix, directions, Some(factor));
            factor = (factor * whole / found.covered.max(whole * 0.1)).clamp(RANGE.0, RANGE.1);
            light = (bright / found.brightness().max(1e-6)).clamp(LIGHT_RANGE.0, LIGHT_RANGE.1);
        }
        (factors.area[octave], factors.light[octave]) = (factor, light);
    }
    // A tree of fewer points has no octaves beyond them: its last factor holds.
    let known = (points.len().ilog2() as usize).min(AREA_OCTAVES - 1);
    for factors in [&mut factors.area, &mut factors.light] {
        let last = factors[known];
        factors[known..].fill(last);
    }
    factors
}

/// What is seen of a tree.
#[derive(Clone, Copy, Default)]
struct Seen {
    /// Samples that its splats cover.
    covered: f32,
    /// Sum of the luminance of what they show, unlit but for the tree's own shade.
    light: f32,
}

impl Seen {
    fn brightness(&self) -> f32 {
        self.light / self.covered.max(1.0)
    }
}

/// Luminance (Rec. 709) of a point's colour, with the shade of its tree: as resolve takes them.
fn luminance(point: &Surfel) -> f32 {
    let [r, g, b] = point.albedo.map(srgb8_to_linear);
    let is_lit = point.flags & SURFEL_UNLIT == 0;
    let shade = light_factor(f32::from(point.ambient_visibility) / 255.0);
    (0.2126 * r + 0.7152 * g + 0.0722 * b) * if is_lit { shade } else { 1.0 }
}

/// What the splats of `points` show, over some directions. Their area is that of the area rule times a factor, with overlap;
/// or without both.
fn seen(tree: &TreeData, points: &[Surfel], directions: usize, factor: Option<f32>) -> Seen {
    let area = tree.surface_area * factor.unwrap_or(1.0);
    let radius = disc_radius(area, points.len() as f32);
    if !(radius > 0.0 && radius.is_finite()) {
        return Seen::default();
    }
    let gain = factor.map(|_| OVERLAP_GAIN);
    let from_direction = |direction: usize| {
        let mut grid = Grid::new(tree, direction);
        points.iter().for_each(|point| grid.draw(tree, point, radius, gain));
        let covered = grid.samples.iter().filter(|sample| sample.depth > f32::NEG_INFINITY);
        covered.fold(Seen::default(), |seen, sample| Seen {
            covered: seen.covered + 1.0,
            light: seen.light + sample.luminance,
        })
    };
    // In the order of directions: sums of floats depend on it.
    let all: Vec<Seen> = (0..directions).into_par_iter().map(from_direction).collect();
    all.iter().fold(Seen::default(), |sum, seen| Seen {
        covered: sum.covered + seen.covered,
        light: sum.light + seen.light,
    })
}

/// The nearest point of a sample of the grid.
#[derive(Clone, Copy)]
struct Sample {
    /// Towards the eye; minus infinity for none.
    depth: f32,
    luminance: f32,
}

/// What is covered, seen from one direction in parallel projection.
struct Grid {
    samples: Vec<Sample>,
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
            samples: vec![Sample { depth: f32::NEG_INFINITY, luminance: 0.0 }; GRID * GRID],
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
        let depth = (self.view_from_model * point.position).z;
        let sample = Sample { depth, luminance: luminance(point) };
        self.fill(center, right, up, is_cell, sample);
    }

    /// Puts a point into the samples in a parallelogram, or in the ellipse within it, if it is the nearest there.
    fn fill(&mut self, center: Vec2, right: Vec2, up: Vec2, is_cell: bool, point: Sample) {
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
                let sample = &mut self.samples[y * GRID + x];
                if size <= 1.0 && point.depth > sample.depth {
                    *sample = point;
                }
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
        let factors = thinning(&tree).area;
        assert!((0.2..0.8).contains(&factors[2]), "{factors:?}");
        assert!(factors[2] < factors[6] && factors[6] < factors[11], "{factors:?}");
        assert!((0.7..1.1).contains(&factors[11]) && factors[14] == factors[15], "{factors:?}");
        // With them every prefix covers what all points cover.
        let points: Vec<Surfel> = (0..20_000).filter_map(|i| tree.surfel(i)).collect();
        let whole = seen(&tree, &points, DIRECTIONS, None).covered;
        for octave in 2..AREA_OCTAVES - 1 {
            let prefix = &points[..1 << octave];
            let found = seen(&tree, prefix, DIRECTIONS, Some(factors[octave])).covered;
            assert!((found / whole - 1.0).abs() < 0.06, "{} at {octave}", found / whole);
        }
    }

    #[test]
    fn a_tree_without_area_is_left_as_it_is() {
        let mut tree = synthetic_tree(100, 3);
        tree.surface_area = 0.0;
        let ones = [1.0; AREA_OCTAVES];
        assert_eq!(thinning(&tree), Thinning { area: ones, light: ones });
        let single = thinning(&synthetic_tree(1, 3));
        assert!(single.area.iter().all(|f| (RANGE.0..=RANGE.1).contains(f)));
        assert!(single.light.iter().all(|f| (LIGHT_RANGE.0..=LIGHT_RANGE.1).contains(f)));
    }

    #[test]
    fn few_points_of_a_crown_that_is_dark_inside_are_as_bright_as_the_whole() {
        let mut tree = synthetic_tree(20_000, 3);
        tree.surface_area = 400.0;
        let (middle, radius) = (tree.bounds.center(), tree.bounds.extent() * 0.5);
        for i in 0..tree.point_count() {
            let mut point = tree.surfel(i).expect("it is a point");
            let inside = ((point.position - middle) / radius).length() < 0.8;
            point.ambient_visibility = if inside { 0 } else { 255 };
            (tree.hot[i], tree.cold[i]) = point.pack(&tree.bounds);
        }
        let factors = thinning(&tree).light;
        assert!(factors[2] > 1.15 && factors[2] > factors[10], "{factors:?}");
        assert!((0.9..1.15).contains(&factors[13]), "{factors:?}");
    }
}
