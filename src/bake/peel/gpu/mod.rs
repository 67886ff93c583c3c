//! Depth peeling with render passes (Bærentzen 2005, §2 and §3).
//!
//! In: a model and one LDI viewport per direction; out: the samples that each direction keeps. Per direction all
//! triangles are drawn once a layer into the nearest of what lies behind the layer before, with two depth textures in
//! turn; a compute pass then keeps the fragments whose triangle is most parallel to the image and only those are read
//! back (20 bytes each). Layers are peeled in batches of up to four, so that the CPU waits once a batch.
//!
//! Cost: O(layers × (triangles + pixels)) per direction on the GPU; one CPU wait per four layers and tile.
//! Memory: 145 bytes a triangle, the textures, 24 bytes a pixel of a tile (at most 2048 × 2048) and twice up to 80 MiB
//! of records. Needs no optional feature of WebGPU. Runs on any thread, outside frames, also on a device that draws frames.
//!
//! `upload` puts the model on the GPU, `targets` holds what a tile is peeled into, `tile` peels one, `readback` waits
//! and decodes, `pipelines` compiles `shaders/bake/peel.wgsl`.

use super::{LdiViewport, PeelOutput};
use crate::bake::{
    settings::{BakeSettings, SettingsError},
    source::SourceModel,
};
use bevy::tasks::block_on;

mod pipelines;
mod readback;
mod targets;
mod tile;
mod triangles;
mod upload;

#[cfg(test)]
mod parity_tests;
#[cfg(test)]
mod tests;

use pipelines::PeelPipelines;
use targets::PeelTargets;
use tile::{Tile, TilePeeler};
use triangles::TriangleTable;
use upload::PeelScene;

/// Side of the largest tile in pixels: its records must fit the smallest storage binding that WebGPU promises.
const LARGEST_TILE: u32 = 2048;

/// Why the GPU could not peel. Every case can be baked with the CPU twin instead.
#[derive(Debug, thiserror::Error)]
pub enum GpuPeelError {
    /// A setting is out of its range.
    #[error(transparent)]
    Settings(#[from] SettingsError),
    /// The model or a viewport breaks a rule of its type.
    #[error("cannot peel model `{model}`: {what}")]
    Model {
        /// Name of the model.
        model: String,
        /// What is wrong, and where.
        what: String,
    },
    /// The device was opened with less than peeling needs.
    #[error(
        "cannot peel on {adapter}: its limit `{limit}` is {have}, but {need} is needed; \
         use `--peel cpu`, or open the device with the adapter's own limits"
    )]
    Limit {
        /// Adapter name.
        adapter: String,
        /// Name of the limit.
        limit: &'static str,
        /// The device's value.
        have: u64,
        /// The value needed.
        need: u64,
    },
    /// The GPU's memory is used up.
    #[error("out of GPU memory on {adapter} while peeling; use `--peel cpu` or a smaller LDI size")]
    OutOfMemory {
        /// Adapter name.
        adapter: String,
    },
    /// The device is gone: driver reset, a pass that ran too long, or a removed GPU.
    #[error("the GPU {adapter} was lost while peeling; use `--peel cpu` or a smaller LDI size")]
    DeviceLost {
        /// Adapter name.
        adapter: String,
    },
    /// The driver or wgpu refused a command: a bug of this crate or of the driver.
    #[error("{adapter} refused to peel; use `--peel cpu` and please report this: {message}")]
    Refused {
        /// Adapter name.
        adapter: String,
        /// What wgpu said.
        message: String,
    },
}

/// Peels models on a GPU.
#[derive(Debug)]
pub struct GpuPeeler {
    device: wgpu::Device,
    queue: wgpu::Queue,
    pipelines: PeelPipelines,
    adapter: String,
    /// Largest side of a tile in pixels, a power of two. Larger LDIs are peeled in tiles.
    tile_limit: u32,
    /// Largest side of a viewport in pixels, a power of two.
    clip_limit: u32,
}

impl GpuPeeler {
    /// Compiles the pipelines. Handles are cheap to clone: a game's own device can be used.
    ///
    /// # Errors
    /// The device's limits are too low, or the driver does not take the shaders.
    pub fn new(device: wgpu::Device, queue: wgpu::Queue) -> Result<Self, GpuPeelError> {
        let adapter = device.adapter_info().name;
        let limits = device.limits();
        let wgpu::Limits {
            max_storage_buffers_per_shader_stage: storage_buffers,
            max_compute_invocations_per_workgroup: invocations,
            max_compute_workgroup_size_x: workgroup,
            max_color_attachment_bytes_per_sample: color_bytes,
            max_bind_groups: bind_groups,
            ..
        } = limits;
        let needs = [
            ("max_storage_buffers_per_shader_stage", storage_buffers, 4),
            ("max_compute_invocations_per_workgroup", invocations, pipelines::BLOCK),
            ("max_compute_workgroup_size_x", workgroup, pipelines::BLOCK),
            ("max_color_attachment_bytes_per_sample", color_bytes, 16),
            ("max_bind_groups", bind_groups, 4),
        ];
        for (limit, have, need) in needs {
            if have < need {
                let (have, need) = (u64::from(have), u64::from(need));
                return Err(GpuPeelError::Limit { adapter, limit, have, need });
            }
        }
        let records_fit = |side: u32| {
            let bytes = u64::from(side) * u64::from(side) * readback::RECORD_BYTES;
            let blocks = (side * side).div_ceil(pipelines::BLOCK);
            bytes <= limits.max_storage_buffer_binding_size.min(limits.max_buffer_size)
                && blocks <= limits.max_compute_workgroups_per_dimension
        };
        let clip_limit = 1 << limits.max_texture_dimension_2d.max(1).ilog2();
        let mut tile_limit = LARGEST_TILE.min(clip_limit);
        while tile_limit > 1 && !records_fit(tile_limit) {
            tile_limit /= 2;
        }
        let pipelines = scoped(&device, &adapter, || Ok(PeelPipelines::new(&device)))?;
        Ok(Self { device, queue, pipelines, adapter, tile_limit, clip_limit })
    }

    /// Name of the adapter, for messages.
    pub fn adapter_name(&self) -> &str {
        &self.adapter
    }

    /// Peels `model` from every viewport's direction. `progress` is called with growing shares, 0 to 1.
    ///
    /// The same model, settings and adapter give the same output. Fragments of one pixel with equal depth count once, the
    /// first in model order; in `left_over` each counts. A viewport without extent (a model without area)
    /// has no layers.
    ///
    /// # Errors
    /// A setting out of its range, a model or viewport that breaks its type's rules, too little memory, a lost device.
    pub fn peel(
        &self,
        model: &SourceModel,
        viewports: &[LdiViewport],
        settings: &BakeSettings,
        progress: &(dyn Fn(f32) + Sync),
    ) -> Result<PeelOutput, GpuPeelError> {
        settings.validate()?;
        self.check_viewports(model, viewports)?;
        let mut output = PeelOutput { viewports: viewports.to_vec(), ..Default::default() };
        progress(0.0);
        let tiles: Vec<Vec<Tile>> = viewports
            .iter()
            .map(|viewport| Tile::cover(viewport, self.tile_limit, self.clip_limit))
            .collect();
        let tile_count = tiles.iter().map(Vec::len).sum::<usize>();
        if tile_count == 0 || model.meshes.iter().all(|mesh| mesh.triangles.is_empty()) {
            let none = vec![0; viewports.len()];
            output.layers = vec![0; viewports.len()];
            (output.fragments, output.left_over) = (none.clone(), none);
            progress(1.0);
            return Ok(output);
        }

        let directions: Vec<_> = viewports.iter().map(|viewport| viewport.direction).collect();
        let triangles = TriangleTable::of(model, &directions)
            .map_err(|what| GpuPeelError::Model { model: model.name.clone(), what })?;
        let (scene, targets) = self.scoped(|| {
            let scene = PeelScene::upload(
                self,
                model,
                &triangles,
                settings.partition_triangles,
                directions.len(),
            )?;
            let targets = PeelTargets::new(self, tiles.iter().flatten(), &scene);
            Ok((scene, targets))
        })?;
        let mut tile_peeler =
            TilePeeler::new(self, &scene, targets, &triangles, settings.max_layers);
        let mut done = 0;
        for (direction, (viewport, tiles)) in std::iter::zip(viewports, &tiles).enumerate() {
            let first_sample = output.samples.len();
            let (mut layers, mut fragments, mut left_over) = (0, 0, 0);
            for tile in tiles {
                let tile_progress =
                    |share: f32| progress((done as f32 + share) / tile_count as f32);
                let peeled = self.scoped(|| {
                    tile_peeler.peel(
                        direction as u8,
                        viewport,
                        tile,
                        &mut output.samples,
                        &tile_progress,
                    )
                })?;
                layers = layers.max(peeled.layers);
                fragments += peeled.fragments;
                left_over += peeled.left_over;
                done += 1;
                progress(done as f32 / tile_count as f32);
            }
            if tiles.len() > 1 {
                // Tiles come one after the other; the order of a direction is by layer, row, column.
                output.samples[first_sample..]
                    .sort_unstable_by_key(|s| (s.layer, s.cell[1], s.cell[0]));
            }
            output.layers.push(layers);
            output.fragments.push(fragments);
            output.left_over.push(left_over);
        }
        Ok(output)
    }

    /// Samples name their direction in 8 bits and their cell in 16 and 16.
    fn check_viewports(
        &self,
        model: &SourceModel,
        viewports: &[LdiViewport],
    ) -> Result<(), GpuPeelError> {
        let error = |what| Err(GpuPeelError::Model { model: model.name.clone(), what });
        if viewports.len() > 256 {
            return error(format!("{} directions, but at most 256 can be peeled", viewports.len()));
        }
        for (i, viewport) in viewports.iter().enumerate() {
            let range = 1..=65536;
            if !(range.contains(&viewport.width) && range.contains(&viewport.height)) {
                let (width, height) = (viewport.width, viewport.height);
                return error(format!(
                    "the LDI of direction {i} is {width}x{height}, but sides must be 1 to 65536"
                ));
            }
        }
        Ok(())
    }

    fn scoped<T>(&self, run: impl FnOnce() -> Result<T, GpuPeelError>) -> Result<T, GpuPeelError> {
        scoped(&self.device, &self.adapter, run)
    }

    fn device_lost(&self) -> GpuPeelError {
        GpuPeelError::DeviceLost { adapter: self.adapter.clone() }
    }
}

/// Runs `run` and returns what wgpu reported meanwhile on this thread, if anything, instead of its result: an object
/// that could not be made explains later failures better than they do themselves.
fn scoped<T>(
    device: &wgpu::Device,
    adapter: &str,
    run: impl FnOnce() -> Result<T, GpuPeelError>,
) -> Result<T, GpuPeelError> {
    let out_of_memory = device.push_error_scope(wgpu::ErrorFilter::OutOfMemory);
    let validation = device.push_error_scope(wgpu::ErrorFilter::Validation);
    let internal = device.push_error_scope(wgpu::ErrorFilter::Internal);
    let result = run();
    let refused = [internal, validation].map(|scope| block_on(scope.pop()));
    if block_on(out_of_memory.pop()).is_some() {
        return Err(GpuPeelError::OutOfMemory { adapter: adapter.to_owned() });
    }
    match refused.into_iter().flatten().next() {
        None => result,
        Some(error) => {
            Err(GpuPeelError::Refused { adapter: adapter.to_owned(), message: error.to_string() })
        }
    }
}
