//! What splats of a tree cover and show, seen from some directions on a coarse grid.

use crate::{
    asset::{
        surfel::{
            SURFEL_KEEPS_NORMAL, SURFEL_LEAF, SURFEL_TWO_SIDED, SURFEL_UNLIT, Surfel, light_factor,
        },
        tree_data::{SeenMean, TreeData},
    },
    lod::{
        contrast::mean_shade,
        splat_size::{OVERLAP_GAIN, disc_radius, leaf_overlap, overlap},
    },
    math::quantize::srgb8_to_linear,
};
use bevy::math::{Mat3, Vec2, Vec3};
use rayon::prelude::*;
use std::f32::consts::PI;

/// Azimuths are turned by the golden angle, elevations alternate.
const AZIMUTH_STEP: f32 = 2.399_963;
/// Radians above the horizon: a forest is seen from among its trees or from a hill.
const ELEVATIONS: [f32; 2] = [0.08, 0.35];
/// Below so many points, a tree's number is now one, now the next (`round_count`).
const FEW_WHOLE: f32 = 32.0;

/// Suns around a tree, since a tree is lit from anywhere: how many, and the sine and cosine of their height.
const SUNS: usize = 6;
const SUN_HEIGHT: (f32, f32) = (0.7, 0.714);
/// Light of the sky beside that of a sun.
const SKY_LIGHT: f32 = 0.25;

/// A point as it is drawn here.
pub struct Element {
    position: Vec3,
    face: Vec3,
    one_sided: bool,
    thickness: u8,
    is_leaf: bool,
    is_lit: bool,
    /// Colour in light of 1, linear: with the shade of its tree.
    color: Vec3,
    /// Shading normals of its front and of its back.
    normals: [Vec3; 2],
    /// Luminance of its front and of its back.
    light: [f32; 2],
}

/// Towards each sun.
fn suns() -> impl Iterator<Item = Vec3> {
    (0..SUNS).map(|i| {
        let (sin, cos) = (i as f32 * 2.0 * PI / SUNS as f32).sin_cos();
        Vec3::new(cos * SUN_HEIGHT.1, SUN_HEIGHT.0, sin * SUN_HEIGHT.1)
    })
}

fn luminance(color: Vec3) -> f32 {
    color.dot(Vec3::new(0.2126, 0.7152, 0.0722))
}

impl Element {
    pub fn of(point: &Surfel) -> Self {
        let has = |flag: u8| point.flags & flag != 0;
        let albedo = Vec3::from(point.albedo.map(srgb8_to_linear));
        let shade = light_factor(f32::from(point.ambient_visibility) / 255.0);
        let color = if has(SURFEL_UNLIT) { albedo } else { albedo * shade };
        let back = if has(SURFEL_KEEPS_NORMAL) { point.normal } else { -point.normal };
        let normals = [point.normal, back];
        let light = normals.map(|normal| {
            let lit = suns().map(|sun| normal.dot(sun).max(0.0)).sum::<f32>() / SUNS as f32;
            luminance(color) * if has(SURFEL_UNLIT) { 1.0 } else { SKY_LIGHT + lit }
        });
        Self {
            position: point.position,
            face: point.face_normal,
            one_sided: !has(SURFEL_TWO_SIDED),
            thickness: point.thickness,
            is_leaf: has(SURFEL_LEAF) && !has(SURFEL_UNLIT),
            is_lit: !has(SURFEL_UNLIT),
            color,
            normals,
            light,
        }
    }
}

/// What is seen of a tree.
#[derive(Clone, Copy, Debug, Default)]
pub struct Seen {
    /// Samples that its splats cover, over all directions.
    pub covered: f32,
    /// Sum of the luminance of what they show.
    light: f32,
}

impl Seen {
    /// Mean luminance of what is covered.
    pub fn brightness(self) -> f32 {
        self.light / self.covered.max(1.0)
    }

    /// The same for other eyes: `here` and `there` are what both see of one thing.
    pub fn seen_as(self, here: Self, there: Self) -> Self {
        let ratio = |mine: f32, here: f32, there: f32| mine * there / here.max(f32::MIN_POSITIVE);
        Self {
            covered: ratio(self.covered, here.covered, there.covered),
            light: ratio(self.light, here.light, there.light),
        }
    }
}

/// From where a tree is looked at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Eyes {
    pub directions: usize,
    /// Samples along each side of the grid, which is four times as wide as the tree's sphere has radius.
    pub grid: usize,
}

/// Splats of equal area.
#[derive(Clone, Copy)]
struct Size {
    radius: f32,
    /// Gain of overlap, if they overlap at all.
    gain: Option<f32>,
}

impl Eyes {
    /// What all points show without overlap.
    pub fn surface(self, tree: &TreeData, points: &[Element]) -> Seen {
        let radius = disc_radius(tree.surface_area, points.len() as f32);
        self.seen(tree, points, Size { radius, gain: None })
    }

    /// What a tree of `n` points shows, if their area is that of the area rule times a factor.
    pub fn prefix(self, tree: &TreeData, points: &[Element], n: f32, factor: f32) -> Seen {
        let radius = disc_radius(tree.surface_area * factor, n);
        let of = |count: usize| {
            let count = count.min(points.len());
            self.seen(tree, &points[..count], Size { radius, gain: Some(OVERLAP_GAIN) })
        };
        if n >= FEW_WHOLE || n.fract() == 0.0 {
            return of(n.round() as usize);
        }
        let (fewer, more, share) = (of(n as usize), of(n as usize + 1), n.fract());
        Seen {
            covered: fewer.covered + (more.covered - fewer.covered) * share,
            light: fewer.light + (more.light - fewer.light) * share,
        }
    }

    fn seen(self, tree: &TreeData, points: &[Element], size: Size) -> Seen {
        let sums = self.sums(tree, points, size, |shown, _| [1.0, shown.element.light[shown.side]]);
        Seen { covered: sums[0], light: sums[1] }
    }

    /// The means of what all points show, for [`SeenMean`].
    pub fn mean(self, tree: &TreeData, points: &[Element]) -> SeenMean {
        let radius = disc_radius(tree.surface_area, points.len() as f32);
        let size = Size { radius, gain: None };
        let sums = self.sums(tree, points, size, |shown, to_eye| {
            let Element { color, normals, is_leaf, is_lit, .. } = shown.element;
            let lit = suns().map(|sun| normals[shown.side].dot(sun).max(0.0)).sum::<f32>();
            let of_any = suns().map(|sun| mean_shade(sun.dot(to_eye))).sum::<f32>();
            // Colours count by their light, so that the mean is as bright as what it stands for.
            let weight = if *is_lit { SKY_LIGHT + lit / SUNS as f32 } else { 0.0 };
            let leaf = if *is_leaf { 1.0 } else { 0.0 };
            let [r, g, b] = (*color * weight).to_array();
            [r, g, b, weight, leaf * lit, leaf * of_any]
        });
        let [r, g, b, weight, lit, of_any] = sums;
        let color = [r, g, b].map(|sum| if weight > 0.0 { sum / weight } else { 1.0 });
        let shade = if of_any > 0.0 { (lit / of_any).clamp(0.0, 2.0) } else { 1.0 };
        SeenMean { color, shade }
    }

    /// Sums over all samples of all directions; `of` also gets the way to the eye.
    fn sums<const N: usize>(
        self,
        tree: &TreeData,
        points: &[Element],
        size: Size,
        of: impl Fn(Shown, Vec3) -> [f32; N] + Sync,
    ) -> [f32; N] {
        if !(size.radius > 0.0 && size.radius.is_finite()) {
            return [0.0; N];
        }
        let add = |sum: [f32; N], more: [f32; N]| std::array::from_fn(|i| sum[i] + more[i]);
        let from_direction = |direction: usize| {
            let mut grid = Grid::new(tree, direction, self.grid);
            (0u32..).zip(points).for_each(|(index, point)| grid.draw(tree, index, point, size));
            let to_eye = grid.view_from_model.transpose() * Vec3::Z;
            let shown = grid.samples.iter().filter(|sample| sample.depth > f32::NEG_INFINITY);
            let shown = shown.map(|sample| Shown {
                element: &points[(sample.point >> 1) as usize],
                side: (sample.point & 1) as usize,
            });
            shown.fold([0.0; N], |sum, shown| add(sum, of(shown, to_eye)))
        };
        // In the order of directions: sums of floats depend on it.
        let all: Vec<[f32; N]> = (0..self.directions).into_par_iter().map(from_direction).collect();
        all.into_iter().fold([0.0; N], add)
    }
}

/// What a sample shows.
struct Shown<'a> {
    element: &'a Element,
    /// 0: its front.
    side: usize,
}

/// Twin of `EDGE_ON` in `shaders/splat/project.wgsl`.
const EDGE_ON: f32 = 0.015;

/// The nearest point of a sample of the grid.
#[derive(Clone, Copy)]
struct Sample {
    /// Towards the eye; minus infinity for none.
    depth: f32,
    /// Index of the point << 1 | whether its back is seen.
    point: u32,
}

/// What is covered, seen from one direction in parallel projection.
struct Grid {
    samples: Vec<Sample>,
    /// Rows: right, up, and towards the eye.
    view_from_model: Mat3,
    center: Vec3,
    samples_per_unit: f32,
    /// Samples along a side.
    side: usize,
}

impl Grid {
    fn new(tree: &TreeData, direction: usize, side: usize) -> Self {
        let azimuth = direction as f32 * AZIMUTH_STEP;
        let elevation = ELEVATIONS[direction % ELEVATIONS.len()];
        Self {
            samples: vec![Sample { depth: f32::NEG_INFINITY, point: 0 }; side * side],
            view_from_model: Mat3::from_rotation_x(elevation) * Mat3::from_rotation_y(azimuth),
            center: tree.bounds.center(),
            samples_per_unit: side as f32 / (4.0 * tree.bounds.radius().max(f32::MIN_POSITIVE)),
            side,
        }
    }

    /// Draws a splat: as `project` and `covers` of `shaders/splat/project.wgsl` do.
    fn draw(&mut self, tree: &TreeData, index: u32, point: &Element, Size { radius, gain }: Size) {
        let face = point.face;
        let toward = (self.view_from_model * face).z;
        if toward.abs() < EDGE_ON || (toward < 0.0 && point.one_sided) {
            return;
        }
        let share = tree.sample_share();
        let spacing = radius / tree.pixel * (PI * share.max(0.6)).sqrt();
        let leaf = tree.mean_leaf_area;
        let grown = gain.map_or(1.0, |gain| {
            let leaf = leaf_overlap(radius, leaf, gain);
            overlap(leaf, point.thickness, point.one_sided, spacing)
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
        let center = on_grid(point.position - self.center) + self.side as f32 * 0.5;
        let (right, up) = (on_grid(right), on_grid(up));
        let depth = (self.view_from_model * point.position).z;
        let sample = Sample { depth, point: index << 1 | u32::from(toward < 0.0) };
        self.fill(center, right, up, is_cell, sample);
    }

    /// Puts a point into the samples in a parallelogram, or in the ellipse within it, if it is the nearest there.
    fn fill(&mut self, center: Vec2, right: Vec2, up: Vec2, is_cell: bool, point: Sample) {
        let determinant = right.perp_dot(up);
        if determinant.abs() < 1e-9 {
            return;
        }
        let reach = right.abs() + up.abs();
        let last = self.side as f32;
        let begin = (center - reach - 0.5).ceil().clamp(Vec2::ZERO, Vec2::splat(last));
        let end = (center + reach - 0.5).ceil().clamp(Vec2::ZERO, Vec2::splat(last));
        for y in begin.y as usize..end.y as usize {
            for x in begin.x as usize..end.x as usize {
                let d = Vec2::new(x as f32 + 0.5, y as f32 + 0.5) - center;
                let place = Vec2::new(d.perp_dot(up), right.perp_dot(d)) / determinant;
                let size = if is_cell { place.abs().max_element() } else { place.length() };
                let sample = &mut self.samples[y * self.side + x];
                if size <= 1.0 && point.depth > sample.depth {
                    *sample = point;
                }
            }
        }
    }
}
