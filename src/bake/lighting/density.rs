//! How much of a ray each cell of a grid stops: triangles in, optical depths out. O(triangles × pieces), parallel.

use super::Grid;
use crate::bake::{
    source::{SourceAlpha, SourceMesh, SourceModel},
    texture::base_color,
};
use rayon::prelude::*;

/// Share of a surface's area that it takes from a ray, averaged over all directions.
const PROJECTION: f32 = 0.5;
/// Edges of triangles are cut into pieces no longer than this share of a cell, and at most this many.
const PIECE: f32 = 0.5;
const MOST_PIECES: f32 = 128.0;
/// Pieces along an edge of a masked triangle at least, for a fair share of holes.
const MASKED_PIECES: f32 = 2.0;
/// Triangles of a parallel task.
const CHUNK: usize = 4096;

/// Optical depth of each cell, per cell that a ray crosses.
pub(super) fn optical_depths(model: &SourceModel, grid: &Grid) -> Vec<f32> {
    let chunks: Vec<(&SourceMesh, usize)> = model
        .meshes
        .iter()
        .flat_map(|mesh| (0..mesh.triangles.len()).step_by(CHUNK).map(move |start| (mesh, start)))
        .collect();
    let pieces: Vec<Vec<(u32, f32)>> = chunks
        .into_par_iter()
        .map(|(mesh, start)| {
            let mut out = vec![];
            for t in start..(start + CHUNK).min(mesh.triangles.len()) {
                cut_triangle(model, mesh, t, grid, &mut out);
            }
            out
        })
        .collect();
    let mut depths = vec![0.0; grid.size.iter().product()];
    // One after the other: sums of floats depend on the order.
    for (cell, depth) in pieces.into_iter().flatten() {
        depths[cell as usize] += depth;
    }
    depths
}

/// The cells of a triangle's pieces and what each adds to the optical depth; holes of masks add nothing.
fn cut_triangle(
    model: &SourceModel,
    mesh: &SourceMesh,
    t: usize,
    grid: &Grid,
    out: &mut Vec<(u32, f32)>,
) {
    let [a, b, c] = mesh.corners(t).map(|p| (p - grid.corner) * grid.cells_per_unit);
    let longest = a.distance(b).max(b.distance(c)).max(c.distance(a));
    let area = 0.5 * (b - a).cross(c - a).length();
    let material = model.materials.get(mesh.material);
    let cutoff = material.and_then(|m| match m.alpha {
        SourceAlpha::Mask(cutoff) => Some(cutoff),
        SourceAlpha::Opaque => None,
    });
    let least = if cutoff.is_some() { MASKED_PIECES } else { 1.0 };
    let steps = (longest / PIECE).ceil().clamp(least, MOST_PIECES) as usize;
    let depth = PROJECTION * area / (steps * steps) as f32;
    for i in 0..steps {
        for j in 0..steps - i {
            // The upright piece at (i, j), and beside it the inverted one, if there is one.
            let inverted = i + j + 1 < steps;
            for third in [1.0 / 3.0, 2.0 / 3.0].into_iter().take(1 + usize::from(inverted)) {
                let (u, v) = ((i as f32 + third) / steps as f32, (j as f32 + third) / steps as f32);
                let weights = [1.0 - u - v, u, v];
                let is_hole = cutoff.is_some_and(|cutoff| {
                    base_color(model, mesh, mesh.triangles[t], weights).w < cutoff
                });
                let place = a * weights[0] + b * u + c * v;
                if let Some(cell) = grid.cell(place).filter(|_| !is_hole) {
                    out.push((cell as u32, depth));
                }
            }
        }
    }
}
