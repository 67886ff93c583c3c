//! Ambient visibility: how much of the sky reaches a place on a model, through its own leaves and wood.
//!
//! In: a model. Out: [`LightVolume`], which answers for any place and normal; the bake asks it for every point, and the
//! near mesh for every vertex, so that both are equally dark inside a crown. As Mantler & Fuhrmann (2003, §4) do, rays
//! are cast through a regular grid of densities; here density is extinction by leaf area (Nilson 1971: a layer of
//! randomly turned leaves stops half of its area), and each cell keeps what comes from where as spherical harmonics.
//! O(triangles + occupied cells × directions × cells of a side), parallel: some 50 ms for a tree; a place costs O(1).

mod density;

use super::source::SourceModel;
use crate::{
    asset::{SURFEL_TWO_SIDED, Surfel},
    math::spherical_harmonics::{self as harmonics, Harmonics},
};
use bevy::math::Vec3;
use density::optical_depths;
use rayon::prelude::*;

/// Cells along the longest side of the model's box.
const CELLS: f32 = 48.0;
/// Empty cells around the box: places just off a surface are asked for, too.
const MARGIN: f32 = 2.0;
/// Ray directions, spread evenly over the sphere.
const DIRECTIONS: usize = 32;
/// Light from below, reflected by the ground, relative to that of the sky.
const GROUND: f32 = 0.3;
/// A ray starts this many cells away, so that a surface does not shade itself by sharing a cell with its own area.
const START: f32 = 1.0;
/// Optical depth at which a ray is given up: 0.03 % gets through.
const OPAQUE: f32 = 8.0;
/// How far off a surface the light of a side is looked up, in cells.
const OFF_SURFACE: f32 = 1.0;

/// Light that arrives in each cell of a grid around a model. The unit of length does not matter.
#[derive(Clone, Debug)]
pub struct LightVolume {
    grid: Grid,
    /// Light from each direction, x fastest.
    cells: Vec<Harmonics>,
    /// The same without the model.
    open: Harmonics,
}

impl LightVolume {
    /// The light around a model. `progress` gets the share done. Deterministic.
    pub fn of_model(model: &SourceModel, progress: &(dyn Fn(f32) + Sync)) -> Self {
        let rays = rays();
        let open = rays.iter().fold([0.0; 9], |sum, ray| add(sum, ray.light, 1.0));
        progress(0.0);
        let Some(grid) = Grid::around(model) else {
            return Self { grid: Grid::default(), cells: vec![], open };
        };
        let depths = optical_depths(model, &grid);
        progress(0.3);
        let wanted = grid.near_something(&depths);
        let cells = (0..depths.len()).into_par_iter().map(|cell| {
            if !wanted[cell] {
                return open;
            }
            let from = grid.place(cell);
            rays.iter().fold([0.0; 9], |sum, ray| {
                add(sum, ray.light, (-grid.optical_depth(&depths, from, ray.step)).exp())
            })
        });
        let cells = cells.collect();
        progress(1.0);
        Self { grid, cells, open }
    }

    /// Share of all light from outside that reaches a surface, 0 (none) to 1 (nothing is in the way). `normal` is a
    /// unit vector; a `two_sided` surface gets the mean of its sides.
    pub fn visibility(&self, position: Vec3, normal: Vec3, two_sided: bool) -> f32 {
        if self.cells.is_empty() || !position.is_finite() {
            return 1.0;
        }
        let place = (position - self.grid.corner) * self.grid.cells_per_unit;
        let front = self.at_side(place, normal);
        if two_sided { 0.5 * (front + self.at_side(place, -normal)) } else { front }
    }

    fn at_side(&self, place: Vec3, normal: Vec3) -> f32 {
        let kernel = harmonics::cosine_lobe(normal);
        let arriving = harmonics::dot(&self.at(place + normal * OFF_SURFACE), &kernel);
        (arriving / harmonics::dot(&self.open, &kernel).max(f32::MIN_POSITIVE)).clamp(0.0, 1.0)
    }

    /// Between the centres of eight cells.
    fn at(&self, place: Vec3) -> Harmonics {
        let most = Vec3::from_array(self.grid.size.map(|s| s as f32 - 1.0));
        let place = (place - 0.5).clamp(Vec3::ZERO, most);
        let low = place.floor();
        let share = place - low;
        let low = [low.x as usize, low.y as usize, low.z as usize];
        let mut sum = [0.0; 9];
        for corner in 0..8 {
            let bit = |axis: usize| corner >> axis & 1;
            let weight = |axis: usize, t: f32| if bit(axis) == 1 { t } else { 1.0 - t };
            let weight = weight(0, share.x) * weight(1, share.y) * weight(2, share.z);
            if weight > 0.0 {
                let cell = std::array::from_fn(|a| (low[a] + bit(a)).min(self.grid.size[a] - 1));
                sum = add(sum, self.cells[self.grid.index(cell)], weight);
            }
        }
        sum
    }
}

/// Writes the ambient visibility of points. O(n), parallel.
pub fn light_surfels(surfels: &mut [Surfel], light: &LightVolume) {
    surfels.par_iter_mut().for_each(|surfel| {
        let two_sided = surfel.flags & SURFEL_TWO_SIDED != 0;
        let visibility = light.visibility(surfel.position, surfel.normal, two_sided);
        surfel.ambient_visibility = (visibility * 255.0).round() as u8;
    });
}

fn add(mut sum: Harmonics, light: Harmonics, weight: f32) -> Harmonics {
    sum.iter_mut().zip(light).for_each(|(s, l)| *s += l * weight);
    sum
}

/// A direction that light comes from.
struct Ray {
    /// Unit vector: one cell along it.
    step: Vec3,
    light: Harmonics,
}

/// A Fibonacci lattice over the sphere (González 2010), with the sky above and the ground below.
fn rays() -> Vec<Ray> {
    let golden = std::f32::consts::PI * (3.0 - 5.0f32.sqrt());
    let ray = |i: usize| {
        let y = 1.0 - (2.0 * i as f32 + 1.0) / DIRECTIONS as f32;
        let (r, phi) = ((1.0 - y * y).sqrt(), golden * i as f32);
        let step = Vec3::new(r * phi.cos(), y, r * phi.sin());
        // The horizon is no edge: woods and hills stand there.
        let sky = (0.5 + 2.0 * y).clamp(0.0, 1.0);
        let strength = GROUND + (1.0 - GROUND) * sky;
        Ray { step, light: harmonics::basis(step).map(|b| b * strength) }
    };
    (0..DIRECTIONS).map(ray).collect()
}

/// Cubes that fill the model's box and its margin.
#[derive(Clone, Debug, Default)]
struct Grid {
    corner: Vec3,
    cells_per_unit: f32,
    size: [usize; 3],
}

impl Grid {
    /// `None` for a model without extent.
    fn around(model: &SourceModel) -> Option<Self> {
        let bounds = model.bounds();
        let longest = bounds.extent().max_element();
        let cells_per_unit = CELLS / longest;
        if bounds.is_empty() || !cells_per_unit.is_finite() {
            return None;
        }
        let size = (bounds.extent() * cells_per_unit).ceil() + 2.0 * MARGIN;
        let size = size.to_array().map(|s| s.max(1.0) as usize);
        // The box lies in the middle.
        let half = Vec3::from_array(size.map(|s| s as f32)) * (0.5 / cells_per_unit);
        Some(Self { corner: bounds.center() - half, cells_per_unit, size })
    }

    fn index(&self, [x, y, z]: [usize; 3]) -> usize {
        (z * self.size[1] + y) * self.size[0] + x
    }

    fn coordinates(&self, cell: usize) -> [usize; 3] {
        let [x, y, _] = self.size;
        [cell % x, cell / x % y, cell / (x * y)]
    }

    /// Centre of a cell, in cells.
    fn place(&self, cell: usize) -> Vec3 {
        Vec3::from_array(self.coordinates(cell).map(|c| c as f32 + 0.5))
    }

    /// The cell of a place in cells; `None` outside.
    fn cell(&self, place: Vec3) -> Option<usize> {
        // Negative numbers saturate at 0, so the sign is tested on the float.
        let inside = place.min_element() >= 0.0;
        let [x, y, z] = place.to_array().map(|p| p as usize);
        let [width, height, depth] = self.size;
        (inside && x < width && y < height && z < depth).then(|| self.index([x, y, z]))
    }

    /// Along `step` from a place to the end of the grid.
    fn optical_depth(&self, depths: &[f32], from: Vec3, step: Vec3) -> f32 {
        let mut place = from + step * (START + 0.5);
        let mut sum = 0.0;
        while let Some(cell) = self.cell(place) {
            sum += depths[cell];
            if sum > OPAQUE {
                break;
            }
            place += step;
        }
        sum
    }

    /// Cells at most two from one with anything in it: those that surfaces ask for.
    fn near_something(&self, depths: &[f32]) -> Vec<bool> {
        let mut near: Vec<bool> = depths.iter().map(|d| *d > 0.0).collect();
        for axis in 0..3 {
            let stride = [1, self.size[0], self.size[0] * self.size[1]][axis];
            let next = (0..near.len()).into_par_iter().map(|cell| {
                let at = self.coordinates(cell)[axis];
                let low = at.saturating_sub(2);
                let high = (at + 2).min(self.size[axis] - 1);
                (low..=high).any(|other| near[cell + other * stride - at * stride])
            });
            near = next.collect();
        }
        near
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bake::{
        source::{SourceAlpha, SourceMaterial, SourceModel},
        test_models::{self, quad},
    };

    /// Leaves of side `size` in a ball of radius 1, at places of a Fibonacci lattice.
    fn ball(leaves: usize, size: f32, unit: f32) -> SourceModel {
        let golden = std::f32::consts::PI * (3.0 - 5.0f32.sqrt());
        let meshes = (0..leaves).map(|i| {
            let t = (i as f32 + 0.5) / leaves as f32;
            // Another irrational number than that of the turn: both together fill the sphere.
            let y = 1.0 - 2.0 * (i as f32 * 0.754_877_7).fract();
            let (r, phi) = ((1.0 - y * y).sqrt(), golden * i as f32);
            let direction = Vec3::new(r * phi.cos(), y, r * phi.sin());
            let along = direction.any_orthonormal_vector() * size;
            let up = Vec3::new(y, r, 0.3).cross(along).normalize() * size;
            let middle = direction * t.cbrt();
            quad((middle - 0.5 * (along + up)) * unit, along * unit, up * unit, 0)
        });
        let leaf = SourceMaterial { double_sided: true, is_leaf: true, ..Default::default() };
        SourceModel { meshes: meshes.collect(), materials: vec![leaf], ..Default::default() }
    }

    fn light(model: &SourceModel) -> LightVolume {
        LightVolume::of_model(model, &|_| ())
    }

    #[test]
    fn a_ball_of_leaves_is_darker_the_deeper_one_looks() {
        let volume = light(&ball(6000, 0.06, 1.0));
        let at = |r: f32| volume.visibility(Vec3::X * r, Vec3::Y, true);
        let row: Vec<f32> = [0.0, 0.4, 0.7, 0.85, 0.95, 1.1].map(at).to_vec();
        assert!(row.windows(2).all(|w| w[0] < w[1] + 0.01), "{row:?}");
        assert!(row[0] < 0.35 && row[5] > 0.55, "{row:?}");
        assert!(volume.visibility(Vec3::Y, Vec3::X, true) > 0.6, "the top sees the sky");
    }

    #[test]
    fn twice_the_leaves_make_it_darker() {
        let center = |n| light(&ball(n, 0.06, 1.0)).visibility(Vec3::ZERO, Vec3::Y, true);
        let row = [500, 1000, 2000, 4000].map(center);
        assert!(row.windows(2).all(|w| w[1] < w[0]), "{row:?}");
    }

    #[test]
    fn an_isolated_leaf_gets_all_light() {
        let far = Vec3::new(10.0, 3.0, 4.0);
        let quads =
            [Vec3::ZERO, far].map(|at| quad(at, Vec3::X * 0.05, Vec3::new(0.0, 0.03, 0.04), 0));
        let volume = light(&test_models::model(quads.to_vec(), 1));
        for normal in [Vec3::X, Vec3::Y, Vec3::NEG_Z] {
            for two_sided in [false, true] {
                let got = volume.visibility(Vec3::new(0.02, 0.01, 0.02), normal, two_sided);
                assert!(got > 0.97, "{got} at {normal}, two-sided {two_sided}");
            }
        }
        // A leaf that fills the box does not shade itself much either.
        let whole = light(&test_models::model(vec![quad(Vec3::ZERO, Vec3::X, Vec3::Z, 0)], 1));
        let got = whole.visibility(Vec3::new(0.5, 0.0, 0.5), Vec3::Y, true);
        assert!(got > 0.85, "{got}");
    }

    #[test]
    fn the_unit_of_length_changes_nothing() {
        let (metres, centimetres) =
            (light(&ball(2000, 0.06, 1.0)), light(&ball(2000, 0.06, 100.0)));
        for i in 0..50 {
            let at = Vec3::new((i as f32).sin(), (i as f32 * 1.7).cos(), 0.1) * 0.9;
            let (a, b) = (
                metres.visibility(at, Vec3::Z, i % 2 == 0),
                centimetres.visibility(at * 100.0, Vec3::Z, i % 2 == 0),
            );
            assert!((a - b).abs() < 0.02, "{a} and {b} at {at}");
        }
    }

    #[test]
    fn the_same_model_gives_the_same_light() {
        let model = ball(9000, 0.05, 1.0);
        let (first, second) = (light(&model), light(&model));
        assert!(first.cells == second.cells);
    }

    #[test]
    fn a_wall_is_lit_from_its_open_side() {
        // Two walls, half a unit apart, and the outside of one.
        let walls = [0.0, 0.25].map(|z| quad(Vec3::Z * z, Vec3::X, Vec3::Y, 0));
        let volume = light(&test_models::model(walls.to_vec(), 1));
        let middle = Vec3::new(0.5, 0.4, 0.25);
        let (outside, inside) = (
            volume.visibility(middle, Vec3::Z, false),
            volume.visibility(middle, Vec3::NEG_Z, false),
        );
        assert!(outside > 0.9 && inside < 0.6 * outside, "{outside} outside, {inside} between");
    }

    #[test]
    fn holes_of_masks_let_light_through() {
        let mut model = ball(4000, 0.06, 1.0);
        let closed = light(&model).visibility(Vec3::ZERO, Vec3::Y, true);
        model.materials[0].alpha = SourceAlpha::Mask(0.5);
        model.materials[0].base_color.w = 0.1;
        assert_eq!(light(&model).visibility(Vec3::ZERO, Vec3::Y, true), 1.0);
        assert!(closed < 0.5);
    }

    #[test]
    fn a_model_without_extent_is_open() {
        assert_eq!(light(&SourceModel::default()).visibility(Vec3::ZERO, Vec3::Y, false), 1.0);
        let point = test_models::model(vec![quad(Vec3::ONE, Vec3::ZERO, Vec3::ZERO, 0)], 1);
        assert_eq!(light(&point).visibility(Vec3::ONE, Vec3::Y, true), 1.0);
        let volume = light(&ball(10, 0.1, 1.0));
        assert_eq!(volume.visibility(Vec3::splat(f32::NAN), Vec3::Y, true), 1.0);
    }
}
