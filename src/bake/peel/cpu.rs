//! CPU twin of the peeler: model and viewports in, the samples of every layer out, as `gpu` gives them.
//!
//! Each direction's image is cut into bands of rows; a band rasterises the triangles that reach it, sorts the fragments of
//! each pixel by depth, and makes samples only of those that are kept. Bands run in parallel and hold no more than their own
//! fragments, so memory follows the output. O(triangles + rows + fragments · log(layers)).

use super::raster::{self, ProjectedVertex, RasterTriangle};
use super::{LdiViewport, PeelDirection, PeelOutput, PeelSample, most_parallel};
use crate::bake::settings::BakeSettings;
use crate::bake::source::{SourceAlpha, SourceMesh, SourceModel};
use crate::bake::texture::{base_color, interpolate};
use crate::math::{quantize::linear_to_srgb8, triangle::normal_and_area};
use bevy::math::Vec3;
use rayon::prelude::*;
use std::ops::Range;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Pixels of a band: few enough for its fragments to stay in a core's cache.
const BAND_PIXELS: u32 = 8192;

/// A triangle with an area, in model order.
struct Face {
    mesh: u32,
    triangle: u32,
    normal: Vec3,
    /// The direction that keeps its samples.
    owner: u16,
}

/// A fragment before sorting.
#[derive(Clone, Copy, Default)]
struct Fragment {
    /// Pixel within the band.
    pixel: u32,
    depth: f32,
    face: u32,
    /// Weights of corners 1 and 2.
    weights: [f32; 2],
}

/// Work space of a thread, reused from band to band.
#[derive(Default)]
struct Scratch {
    unsorted: Vec<Fragment>,
    fragments: Vec<Fragment>,
    starts: Vec<u32>,
    /// Layer and fragment of each sample to be, by pixel; then the fragments alone, by layer.
    kept: Vec<(u16, u32)>,
    by_layer: Vec<u32>,
}

/// What a band found. Samples are by layer, row, column.
struct Band {
    samples: Vec<PeelSample>,
    /// Where each layer's samples end.
    layer_ends: Vec<usize>,
    layers: u32,
    fragments: u64,
    left_over: u64,
}

/// One direction's image and what all its bands share.
struct Image<'a> {
    model: &'a SourceModel,
    faces: &'a [Face],
    viewport: &'a LdiViewport,
    direction: u16,
    vertices: Vec<Vec<Option<ProjectedVertex>>>,
    partition_triangles: bool,
    max_layers: u32,
    band_rows: u32,
}

/// Peels `model` within each viewport; the viewports' order is that of the directions (at most 256).
///
/// `fragments` of the result counts those within the layers peeled, `left_over` those behind; fragments of one pixel with
/// equal depth count once in both, and the first in model order stands for them, as with a GPU's LESS test. Triangles
/// without an area, with corners that do not exist or are not finite, and what lies outside the images gives nothing. `progress` is told
/// the share that is done, 0 to 1, from any thread.
pub fn peel(
    model: &SourceModel,
    viewports: &[LdiViewport],
    settings: &BakeSettings,
    progress: &(dyn Fn(f32) + Sync),
) -> PeelOutput {
    let directions: Vec<PeelDirection> = viewports.iter().map(|v| v.direction).collect();
    let faces = faces(model, &directions);
    let band_count = |v: &LdiViewport| v.height.div_ceil(band_rows(v)) as usize;
    let total: usize = viewports.iter().map(band_count).sum();
    let done = AtomicUsize::new(0);
    let band_done = || {
        let done = done.fetch_add(1, Ordering::Relaxed) + 1;
        progress(done as f32 / total as f32);
    };
    let mut output = PeelOutput { viewports: viewports.to_vec(), ..Default::default() };
    for (direction, viewport) in viewports.iter().enumerate() {
        let project = |mesh: &SourceMesh| {
            mesh.positions.par_iter().map(|&p| raster::project(viewport, p)).collect()
        };
        let image = Image {
            model,
            faces: &faces,
            viewport,
            direction: direction as u16,
            vertices: model.meshes.iter().map(project).collect(),
            partition_triangles: settings.partition_triangles,
            // Layers of samples are 16-bit.
            max_layers: settings.max_layers.min(1 << 16),
            band_rows: band_rows(viewport),
        };
        let bands: Vec<Band> = image
            .bins()
            .par_iter()
            .enumerate()
            .map_init(Scratch::default, |scratch, (index, faces)| {
                let band = image.peel_band(index as u32, faces, scratch);
                band_done();
                band
            })
            .collect();
        append(&mut output, &bands);
    }
    output
}

/// Every triangle with an area, in model order.
fn faces(model: &SourceModel, directions: &[PeelDirection]) -> Vec<Face> {
    let mut faces = Vec::new();
    for (mesh_index, mesh) in model.meshes.iter().enumerate() {
        let face = |(index, triangle): (usize, &[u32; 3])| {
            let [a, b, c] = triangle.map(|i| mesh.positions.get(i as usize).copied());
            let (normal, _) = normal_and_area(a?, b?, c?)?;
            let owner = most_parallel(directions, normal) as u16;
            Some(Face { mesh: mesh_index as u32, triangle: index as u32, normal, owner })
        };
        faces.par_extend(mesh.triangles.par_iter().enumerate().filter_map(face));
    }
    faces
}

fn band_rows(viewport: &LdiViewport) -> u32 {
    (BAND_PIXELS / viewport.width.max(1)).max(1)
}

/// Appends a direction: its layers one after the other, each from all bands.
fn append(output: &mut PeelOutput, bands: &[Band]) {
    output.layers.push(bands.iter().map(|band| band.layers).max().unwrap_or(0));
    output.fragments.push(bands.iter().map(|band| band.fragments).sum());
    output.left_over.push(bands.iter().map(|band| band.left_over).sum());
    output.samples.reserve(bands.iter().map(|band| band.samples.len()).sum());
    let layers = bands.iter().map(|band| band.layer_ends.len()).max().unwrap_or(0);
    for layer in 0..layers {
        for band in bands {
            let Some(&end) = band.layer_ends.get(layer) else { continue };
            let start = layer.checked_sub(1).map_or(0, |before| band.layer_ends[before]);
            output.samples.extend_from_slice(&band.samples[start..end]);
        }
    }
}

impl Image<'_> {
    fn raster_triangle(&self, face: &Face) -> Option<RasterTriangle> {
        let corners = self.model.meshes[face.mesh as usize].triangles[face.triangle as usize];
        let vertices = &self.vertices[face.mesh as usize];
        let [a, b, c] = corners.map(|i| vertices[i as usize]);
        RasterTriangle::new([a?, b?, c?])
    }

    /// The faces that reach each band, in model order.
    fn bins(&self) -> Vec<Vec<u32>> {
        let height = self.viewport.height;
        let mut bins = vec![Vec::new(); height.div_ceil(self.band_rows) as usize];
        for (index, face) in self.faces.iter().enumerate() {
            if self.partition_triangles && face.owner != self.direction {
                continue;
            }
            let Some(triangle) = self.raster_triangle(face) else { continue };
            let rows = triangle.rows(height);
            if rows.is_empty() {
                continue;
            }
            for band in rows.start / self.band_rows..=(rows.end - 1) / self.band_rows {
                bins[band as usize].push(index as u32);
            }
        }
        bins
    }

    fn peel_band(&self, band: u32, faces: &[u32], scratch: &mut Scratch) -> Band {
        let first_row = band * self.band_rows;
        let rows = first_row..(first_row + self.band_rows).min(self.viewport.height);
        scratch.unsorted.clear();
        for &face in faces {
            self.rasterise(face, rows.clone(), &mut scratch.unsorted);
        }
        let pixels = (rows.end - rows.start) as usize * self.viewport.width as usize;
        sort_by_pixel(pixels, scratch);
        let mut band = self.find_layers(scratch);
        let fragments = &scratch.fragments;
        let mut layer = 0;
        band.samples.reserve(scratch.by_layer.len());
        for (i, &fragment) in scratch.by_layer.iter().enumerate() {
            while band.layer_ends[layer] <= i {
                layer += 1;
            }
            let sample = self.sample(&fragments[fragment as usize], layer as u16, first_row);
            band.samples.push(sample);
        }
        band
    }

    /// Appends a face's fragments within `rows`, without those that its mask makes holes.
    fn rasterise(&self, index: u32, rows: Range<u32>, fragments: &mut Vec<Fragment>) {
        let face = &self.faces[index as usize];
        let Some(triangle) = self.raster_triangle(face) else { return };
        let mesh = &self.model.meshes[face.mesh as usize];
        let corners = mesh.triangles[face.triangle as usize];
        let cutoff = match self.model.materials.get(mesh.material).map(|m| m.alpha) {
            Some(SourceAlpha::Mask(cutoff)) => Some(cutoff),
            _ => None,
        };
        let (first_row, width) = (rows.start, self.viewport.width);
        triangle.for_each_fragment(rows, width, |column, row, depth, weights| {
            if cutoff
                .is_some_and(|cutoff| base_color(self.model, mesh, corners, weights).w < cutoff)
            {
                return;
            }
            let pixel = (row - first_row) * width + column;
            let weights = [weights[1], weights[2]];
            fragments.push(Fragment { pixel, depth, face: index, weights });
        });
    }

    /// Ranks the fragments of each pixel and lists those to keep in `scratch.by_layer`.
    fn find_layers(&self, scratch: &mut Scratch) -> Band {
        let mut band =
            Band { samples: vec![], layer_ends: vec![], layers: 0, fragments: 0, left_over: 0 };
        scratch.kept.clear();
        for range in scratch.starts.windows(2) {
            let [start, end] = [range[0] as usize, range[1] as usize];
            let pixel = &mut scratch.fragments[start..end];
            // Stable, so the first of equal depths is the first in model order.
            pixel.sort_by(|a, b| a.depth.total_cmp(&b.depth));
            let mut rank = 0;
            for i in 0..pixel.len() {
                if i > 0 && pixel[i].depth == pixel[i - 1].depth {
                    continue;
                }
                if rank >= self.max_layers {
                    band.left_over += 1;
                    continue;
                }
                if self.faces[pixel[i].face as usize].owner == self.direction {
                    scratch.kept.push((rank as u16, (start + i) as u32));
                }
                rank += 1;
            }
            band.fragments += u64::from(rank);
            band.layers = band.layers.max(rank);
        }
        sort_by_layer(scratch, &mut band.layer_ends);
        band
    }

    fn sample(&self, fragment: &Fragment, layer: u16, first_row: u32) -> PeelSample {
        let face = &self.faces[fragment.face as usize];
        let mesh = &self.model.meshes[face.mesh as usize];
        let corners = mesh.triangles[face.triangle as usize];
        let [v, w] = fragment.weights;
        let weights = [1.0 - v - w, v, w];
        let LdiViewport { direction, origin, pixel, width, depth, .. } = *self.viewport;
        let (column, row) = (fragment.pixel % width, fragment.pixel / width + first_row);
        let right = direction.right * ((column as f32 + 0.5) * pixel);
        let up = direction.up * ((row as f32 + 0.5) * pixel);
        let normal = interpolate(&mesh.normals, corners, weights).unwrap_or(face.normal);
        let color = base_color(self.model, mesh, corners, weights);
        PeelSample {
            position: origin + right + up + direction.forward * (fragment.depth * depth),
            normal: normal.normalize_or(face.normal),
            face_normal: face.normal,
            albedo: [color.x, color.y, color.z].map(linear_to_srgb8),
            material: mesh.material as u16,
            direction: self.direction as u8,
            layer,
            cell: [column as u16, row as u16],
        }
    }
}

/// Counting sort of `unsorted` into `fragments`; stable, so each pixel's fragments stay in model order.
fn sort_by_pixel(pixels: usize, scratch: &mut Scratch) {
    let Scratch { unsorted, fragments, starts, .. } = scratch;
    starts.clear();
    starts.resize(pixels + 1, 0);
    for fragment in unsorted.iter() {
        starts[fragment.pixel as usize + 1] += 1;
    }
    for i in 1..starts.len() {
        starts[i] += starts[i - 1];
    }
    fragments.clear();
    fragments.resize(unsorted.len(), Fragment::default());
    for fragment in unsorted.iter() {
        let place = &mut starts[fragment.pixel as usize];
        fragments[*place as usize] = *fragment;
        *place += 1;
    }
    // Each start has moved to its end, which is the next one's start.
    starts.rotate_right(1);
    starts[0] = 0;
}

/// Counting sort of `kept` into `by_layer`; stable, so each layer stays in the order of rows and columns.
fn sort_by_layer(scratch: &mut Scratch, layer_ends: &mut Vec<usize>) {
    let Scratch { kept, by_layer, .. } = scratch;
    let layers = kept.iter().map(|&(layer, _)| usize::from(layer) + 1).max().unwrap_or(0);
    let mut places = vec![0usize; layers + 1];
    for &(layer, _) in kept.iter() {
        places[usize::from(layer) + 1] += 1;
    }
    for i in 1..places.len() {
        places[i] += places[i - 1];
    }
    by_layer.clear();
    by_layer.resize(kept.len(), 0);
    for &(layer, fragment) in kept.iter() {
        let place = &mut places[usize::from(layer)];
        by_layer[*place] = fragment;
        *place += 1;
    }
    places.truncate(layers);
    *layer_ends = places;
}

#[cfg(test)]
#[path = "cpu_tests.rs"]
mod tests;
