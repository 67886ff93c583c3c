//! Depth peeling: model → samples of every surface layer, from several directions (Bærentzen 2005, §2).
//!
//! For each direction a layered depth image (LDI) is rendered orthographically, layer by layer, until a layer has
//! no fragment. `gpu` does it with render passes, `cpu` is its twin in plain Rust; both give the same samples in the
//! same order: by direction, layer, row, column.

use crate::math::bounding::Aabb;
use bevy::math::Vec3;

pub mod cpu;
pub mod gpu;
mod raster;

/// A peeling direction: an orthonormal, right-handed frame. The image lies in the plane of `right` and `up`
/// (columns grow along `right`, rows along `up`); depth grows along `forward`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PeelDirection {
    /// Along the columns.
    pub right: Vec3,
    /// Along the rows.
    pub up: Vec3,
    /// Into the image.
    pub forward: Vec3,
}

/// Where an LDI lies: pixel (x, y) covers `origin + (x..x+1) * pixel * right + (y..y+1) * pixel * up`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LdiViewport {
    /// Frame.
    pub direction: PeelDirection,
    /// Corner of pixel (0, 0), on the nearest plane of the box.
    pub origin: Vec3,
    /// Side of a pixel in model units: the paper's `s`, equal for all directions.
    pub pixel: f32,
    /// Columns, ≥ 1.
    pub width: u32,
    /// Rows, ≥ 1.
    pub height: u32,
    /// Extent along `forward`, > 0.
    pub depth: f32,
}

/// One fragment of one layer that was kept.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PeelSample {
    /// Model space, from pixel centre and depth.
    pub position: Vec3,
    /// Unit shading normal (interpolated).
    pub normal: Vec3,
    /// Unit triangle normal, on the winding's front side.
    pub face_normal: Vec3,
    /// sRGB albedo.
    pub albedo: [u8; 3],
    /// Material index of the model.
    pub material: u16,
    /// Direction index.
    pub direction: u8,
    /// Layer index, 0 = nearest.
    pub layer: u16,
    /// LDI column and row.
    pub cell: [u16; 2],
}

/// What peeling found.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PeelOutput {
    /// Kept samples, by direction, layer, row, column.
    pub samples: Vec<PeelSample>,
    /// Non-empty layers per direction.
    pub layers: Vec<u32>,
    /// All fragments per direction, kept or not.
    pub fragments: Vec<u64>,
    /// Fragments behind the last layer allowed, per direction; not 0 only if `max_layers` was reached. They are lost.
    pub left_over: Vec<u64>,
    /// The viewports, one a direction.
    pub viewports: Vec<LdiViewport>,
}

/// The peeling directions: X, Y, Z for `count == 3`, else `count` axes spread evenly over the half sphere
/// (the first three stay X, Y, Z).
pub fn directions(count: u32) -> Vec<PeelDirection> {
    let frame =
        |forward: Vec3, right: Vec3| PeelDirection { right, up: forward.cross(right), forward };
    let mut all = vec![frame(Vec3::X, Vec3::Y), frame(Vec3::Y, Vec3::Z), frame(Vec3::Z, Vec3::X)];
    // The rest: a Fibonacci lattice over the upper half sphere (González 2010).
    let rest = count.saturating_sub(3);
    let golden = std::f32::consts::PI * (3.0 - 5.0f32.sqrt());
    for i in 0..rest {
        let y = (i as f32 + 0.5) / rest as f32;
        let r = (1.0 - y * y).sqrt();
        let phi = golden * i as f32 + 0.5;
        let forward = Vec3::new(r * phi.cos(), y, r * phi.sin());
        all.push(frame(forward, forward.any_orthonormal_vector()));
    }
    all
}

/// The direction most parallel to a normal: the one that keeps a sample. Ties go to the lowest index.
pub fn most_parallel(directions: &[PeelDirection], normal: Vec3) -> usize {
    let mut best = (0, -1.0);
    for (i, d) in directions.iter().enumerate() {
        let parallel = d.forward.dot(normal).abs();
        if parallel > best.1 {
            best = (i, parallel);
        }
    }
    best.0
}

/// The LDI of each direction for a model within `bounds`, with square pixels of one size for all: the longest side
/// over all directions gets `ldi_size` pixels.
pub fn viewports(bounds: &Aabb, ldi_size: u32, directions: &[PeelDirection]) -> Vec<LdiViewport> {
    let corners = |d: Vec3| {
        (0..8).map(move |i| {
            let pick = |bit: u32, a: f32, b: f32| if i & bit == 0 { a } else { b };
            let corner = Vec3::new(
                pick(1, bounds.min.x, bounds.max.x),
                pick(2, bounds.min.y, bounds.max.y),
                pick(4, bounds.min.z, bounds.max.z),
            );
            corner.dot(d)
        })
    };
    let range = |d: Vec3| {
        corners(d).fold((f32::INFINITY, f32::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)))
    };
    let spans: Vec<_> =
        directions.iter().map(|d| (range(d.right), range(d.up), range(d.forward))).collect();
    let longest = spans.iter().fold(0.0f32, |m, (r, u, _)| m.max(r.1 - r.0).max(u.1 - u.0));
    let pixel = longest / ldi_size as f32;
    let side = |(a, b): (f32, f32)| (((b - a) / pixel).ceil() as u32).clamp(1, ldi_size);
    std::iter::zip(directions, spans)
        .map(|(&direction, (r, u, f))| {
            let (width, height) = (side(r), side(u));
            // The box is centred in the image, so that rounding up leaves the same margin on both sides.
            let right = (r.0 + r.1 - width as f32 * pixel) * 0.5;
            let up = (u.0 + u.1 - height as f32 * pixel) * 0.5;
            LdiViewport {
                direction,
                origin: direction.right * right + direction.up * up + direction.forward * f.0,
                pixel,
                width,
                height,
                depth: (f.1 - f.0).max(pixel * 1e-3),
            }
        })
        .collect()
}
