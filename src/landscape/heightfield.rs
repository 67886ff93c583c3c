//! Ground as a square grid of heights: side, cells and seed in; heights and normals out. O(cells²).

use super::{Field, smoothstep};
use bevy::math::Vec3;
use noise::{MultiFractal, NoiseFn, Perlin, RidgedMulti};
use thiserror::Error;

/// The most cells a side (67 million vertices).
pub const MOST_CELLS: u32 = 8192;

/// A square piece of ground around the origin, y up, from −side/2 to side/2 in x and z.
///
/// Each cell is two triangles that meet at the diagonal from (x, z + 1) to (x + 1, z); all queries agree with them.
#[derive(Clone, Debug, PartialEq)]
pub struct Heightfield {
    side_m: f32,
    cells: u32,
    /// (cells + 1)² heights in metres, rows of x by ascending z.
    heights: Vec<f32>,
}

/// Why heights are not a heightfield.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum HeightfieldError {
    /// The list does not match the grid.
    #[error(
        "heightfield of {cells} x {cells} cells: {found} heights given, {expected} needed; give (cells + 1)² of them"
    )]
    Count {
        /// Cells a side.
        cells: u32,
        /// Heights given.
        found: usize,
        /// Heights needed.
        expected: usize,
    },
    /// Side, cells or a height cannot be used.
    #[error("heightfield: {what} is {value}; it must be {must}")]
    Value {
        /// Which.
        what: &'static str,
        /// What it is.
        value: f32,
        /// What it must be.
        must: &'static str,
    },
}

/// A cell and the place in it, 0 to 1.
struct Place {
    x: u32,
    z: u32,
    fx: f32,
    fz: f32,
}

impl Heightfield {
    /// Gentle hills and a broad winding valley, about 60 m from lowest to highest on a side of a kilometre or more, less
    /// on smaller ones. `side_m` is clamped to 1..=100,000 m and `cells` to 1..=[`MOST_CELLS`].
    pub fn rolling(side_m: f32, cells: u32, seed: u64) -> Self {
        let side_m = if side_m.is_nan() { 1.0 } else { side_m.clamp(1.0, 100_000.0) };
        let cells = cells.clamp(1, MOST_CELLS);
        let hills = RollingHills::new(side_m, seed);
        let step = side_m / cells as f32;
        let heights = (0..=cells).flat_map(|z| (0..=cells).map(move |x| (x, z))).map(|(x, z)| {
            hills.height(x as f32 * step - side_m * 0.5, z as f32 * step - side_m * 0.5)
        });
        Self { side_m, cells, heights: heights.collect() }
    }

    /// Ground from heights of your own: (cells + 1)², rows of x by ascending z.
    ///
    /// # Errors
    /// If the count does not match, the side is not positive or a height is not finite.
    pub fn from_heights(
        side_m: f32,
        cells: u32,
        heights: Vec<f32>,
    ) -> Result<Self, HeightfieldError> {
        if !(side_m.is_finite() && side_m > 0.0) {
            return Err(HeightfieldError::Value {
                what: "side_m",
                value: side_m,
                must: "positive and finite",
            });
        }
        if !(1..=MOST_CELLS).contains(&cells) {
            return Err(HeightfieldError::Value {
                what: "cells",
                value: cells as f32,
                must: "1 to 8192",
            });
        }
        let expected = (cells as usize + 1).pow(2);
        if heights.len() != expected {
            return Err(HeightfieldError::Count { cells, found: heights.len(), expected });
        }
        if let Some(&value) = heights.iter().find(|h| !h.is_finite()) {
            return Err(HeightfieldError::Value { what: "a height", value, must: "finite" });
        }
        Ok(Self { side_m, cells, heights })
    }

    /// Length of a side in metres.
    pub fn side_m(&self) -> f32 {
        self.side_m
    }

    /// Cells a side.
    pub fn cells(&self) -> u32 {
        self.cells
    }

    /// All heights in metres, rows of x by ascending z.
    pub fn heights(&self) -> &[f32] {
        &self.heights
    }

    /// Lowest and highest ground in metres. O(cells²).
    pub fn height_range(&self) -> [f32; 2] {
        self.heights
            .iter()
            .fold([f32::INFINITY, f32::NEG_INFINITY], |[low, high], &h| [low.min(h), high.max(h)])
    }

    /// Height of the mesh at (x, z) in metres; outside, that of the nearest border. O(1).
    pub fn height(&self, x: f32, z: f32) -> f32 {
        self.blend(x, z, |x, z| self.vertex_height(x, z))
    }

    /// Unit normal of the mesh's shading at (x, z): the vertices' normals, interpolated. O(1).
    pub fn normal(&self, x: f32, z: f32) -> Vec3 {
        self.blend(x, z, |x, z| self.vertex_normal(x, z)).normalize_or(Vec3::Y)
    }

    /// Angle of the ground to the horizontal at (x, z) in radians, by [`Self::normal`]. O(1).
    pub fn slope(&self, x: f32, z: f32) -> f32 {
        self.normal(x, z).y.clamp(-1.0, 1.0).acos()
    }

    /// Vertices, and triangles counter-clockwise from above.
    #[cfg(test)]
    pub(super) fn triangles(&self) -> (Vec<Vec3>, Vec<[u32; 3]>) {
        let row = self.cells + 1;
        let vertices = (0..row).flat_map(|z| (0..row).map(move |x| (x, z)));
        let positions = vertices.map(|(x, z)| {
            Vec3::new(self.coordinate(x), self.vertex_height(x, z), self.coordinate(z))
        });
        let corners = (0..self.cells).flat_map(|z| (0..self.cells).map(move |x| z * row + x));
        let triangles = corners.flat_map(|i| [[i, i + row, i + 1], [i + 1, i + row, i + row + 1]]);
        (positions.collect(), triangles.collect())
    }

    #[cfg(test)]
    fn coordinate(&self, index: u32) -> f32 {
        index as f32 * (self.side_m / self.cells as f32) - self.side_m * 0.5
    }

    fn vertex_height(&self, x: u32, z: u32) -> f32 {
        self.heights[(z * (self.cells + 1) + x) as usize]
    }

    /// By central differences, one-sided at the border.
    fn vertex_normal(&self, x: u32, z: u32) -> Vec3 {
        let step = self.side_m / self.cells as f32;
        let (x0, x1) = (x.saturating_sub(1), (x + 1).min(self.cells));
        let (z0, z1) = (z.saturating_sub(1), (z + 1).min(self.cells));
        let dx =
            (self.vertex_height(x1, z) - self.vertex_height(x0, z)) / ((x1 - x0) as f32 * step);
        let dz =
            (self.vertex_height(x, z1) - self.vertex_height(x, z0)) / ((z1 - z0) as f32 * step);
        Vec3::new(-dx, 1.0, -dz).normalize_or(Vec3::Y)
    }

    fn place(&self, x: f32, z: f32) -> Place {
        let to_cell = |v: f32| {
            let c = ((v / self.side_m + 0.5) * self.cells as f32).max(0.0).min(self.cells as f32);
            let i = (c as u32).min(self.cells - 1);
            (i, c - i as f32)
        };
        let ((x, fx), (z, fz)) = (to_cell(x), to_cell(z));
        Place { x, z, fx, fz }
    }

    /// Interpolates a value of the vertices over the triangle that holds (x, z).
    fn blend<T>(&self, x: f32, z: f32, vertex: impl Fn(u32, u32) -> T) -> T
    where
        T: std::ops::Add<Output = T>
            + std::ops::Sub<Output = T>
            + std::ops::Mul<f32, Output = T>
            + Copy,
    {
        let Place { x, z, fx, fz } = self.place(x, z);
        let (right, far) = (vertex(x + 1, z), vertex(x, z + 1));
        if fx + fz <= 1.0 {
            let corner = vertex(x, z);
            corner + (right - corner) * fx + (far - corner) * fz
        } else {
            let corner = vertex(x + 1, z + 1);
            corner + (far - corner) * (1.0 - fx) + (right - corner) * (1.0 - fz)
        }
    }
}

impl super::Ground for Heightfield {
    fn side_m(&self) -> f32 {
        self.side_m
    }

    fn height(&self, x: f32, z: f32) -> f32 {
        Self::height(self, x, z)
    }

    fn height_range(&self) -> [f32; 2] {
        Self::height_range(self)
    }

    fn detail_m(&self) -> f32 {
        self.side_m / self.cells as f32
    }
}

/// The formula behind [`Heightfield::rolling`].
struct RollingHills {
    side_m: f32,
    broad: Field,
    hills: Field,
    detail: Field,
    warp: [Field; 2],
    bends: Field,
    ridges: RidgedMulti<Perlin>,
}

impl RollingHills {
    fn new(side_m: f32, seed: u64) -> Self {
        let field = |stream: u64, octaves, wavelength_m| {
            Field::new(seed.wrapping_mul(31).wrapping_add(stream), octaves, wavelength_m)
        };
        Self {
            side_m,
            broad: field(1, 3, 1400.0),
            hills: field(2, 4, 520.0),
            detail: field(3, 3, 60.0),
            warp: [field(4, 2, 420.0), field(5, 2, 420.0)],
            bends: field(6, 2, 900.0),
            ridges: RidgedMulti::new(seed as u32 ^ 0x51_7E).set_octaves(3),
        }
    }

    fn height(&self, x: f32, z: f32) -> f32 {
        // Warped a little, so that hills are not the round blobs of Perlin noise.
        let wx = x + 70.0 * self.warp[0].at(x, z);
        let wz = z + 70.0 * self.warp[1].at(x, z);
        let ridge =
            self.ridges.get([f64::from(wx) / 700.0 + 0.37, f64::from(wz) / 700.0 + 0.61]) as f32;
        let rise = 20.0 + 26.0 * self.broad.at(wx, wz) + 17.0 * self.hills.at(wx, wz) + 5.0 * ridge;
        // Small pieces of ground keep gentle slopes: less relief.
        let relief = (self.side_m / 900.0).min(1.0);
        let axis = self.side_m * (0.08 + 0.16 * self.bends.at(x, 0.0));
        let width = (self.side_m * 0.22).min(380.0);
        let floor = 1.0 - smoothstep(0.12, 1.0, (z - axis).abs() / width);
        let valley = 6.0 + rise * 0.12;
        relief * (rise + (valley - rise) * floor) + 0.5 * self.detail.at(x, z)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::hash::SplitMix64;
    use proptest::prelude::*;

    #[test]
    fn heights_are_those_of_the_triangles() {
        let field = Heightfield::rolling(400.0, 32, 3);
        let (positions, triangles) = field.triangles();
        let mut rng = SplitMix64(1);
        for triangle in triangles.iter().step_by(7) {
            let [a, b, c] = triangle.map(|i| positions[i as usize]);
            assert!((b - a).cross(c - a).y > 0.0, "seen from above, counter-clockwise");
            let (mut u, mut v) = (rng.next_f32(), rng.next_f32());
            if u + v > 1.0 {
                (u, v) = (1.0 - u, 1.0 - v);
            }
            let p = a + (b - a) * u + (c - a) * v;
            assert!((field.height(p.x, p.z) - p.y).abs() < 2e-3, "{p}");
        }
    }

    #[test]
    fn hills_are_gentle_and_seeded() {
        for seed in 0..6 {
            let field = Heightfield::rolling(2000.0, 128, seed);
            let [low, high] = field.height_range();
            assert!((20.0..110.0).contains(&(high - low)), "seed {seed}: {low} to {high}");
            let (positions, _) = field.triangles();
            let steep =
                positions.iter().filter(|p| field.slope(p.x, p.z).to_degrees() > 30.0).count();
            assert!(steep * 20 < positions.len(), "seed {seed}: {steep} steep vertices");
            assert_eq!(field, Heightfield::rolling(2000.0, 128, seed));
        }
        assert_ne!(Heightfield::rolling(500.0, 16, 1), Heightfield::rolling(500.0, 16, 2));
    }

    #[test]
    fn wrong_lists_of_heights_are_refused() {
        let count = Heightfield::from_heights(10.0, 2, vec![0.0; 8]);
        assert_eq!(count, Err(HeightfieldError::Count { cells: 2, found: 8, expected: 9 }));
        assert!(Heightfield::from_heights(10.0, 1, vec![0.0, 1.0, f32::NAN, 0.0]).is_err());
        assert!(Heightfield::from_heights(-1.0, 1, vec![0.0; 4]).is_err());
        assert!(Heightfield::from_heights(1.0, 0, vec![0.0; 1]).is_err());
        assert!(Heightfield::from_heights(1.0, 1, vec![0.0; 4]).is_ok());
    }

    proptest! {
        #[test]
        fn any_place_has_a_height_and_a_unit_normal(x in any::<f32>(), z in any::<f32>(), side in any::<f32>()) {
            let field = Heightfield::rolling(side, 4, 1);
            let [low, high] = field.height_range();
            let height = field.height(x, z);
            prop_assert!(height >= low - 1e-2 && height <= high + 1e-2);
            prop_assert!((field.normal(x, z).length() - 1.0).abs() < 1e-3);
            prop_assert!(field.slope(x, z).is_finite());
        }
    }
}
