//! Peels one tile of one LDI, layer by layer, until a layer is empty or the last allowed one is peeled.
//!
//! A batch of layers is submitted together with the copy of the batch before, so the GPU never waits for the CPU to
//! decode, and the CPU waits once a batch.

use super::{
    GpuPeelError, GpuPeeler,
    pipelines::{BLOCK, GpuPeelView},
    readback::{GpuLayerCount, RECORD_BYTES, decode_records},
    targets::PeelTargets,
    triangles::TriangleTable,
    upload::PeelScene,
};
use crate::bake::peel::{LdiViewport, PeelSample};

/// A part of an LDI, in pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Tile {
    pub(super) origin: [u32; 2],
    pub(super) size: [u32; 2],
    /// What clip space spans (see `PeelView` in the shader); holds the tile.
    clip_origin: [u32; 2],
    clip_size: [u32; 2],
}

impl Tile {
    /// Tiles of at most `limit` pixels a side that cover the LDI, by row and column; none if the LDI has no extent.
    /// `limit` and `clip_limit`, the largest viewport, are powers of two, the first not above the second.
    pub(super) fn cover(viewport: &LdiViewport, limit: u32, clip_limit: u32) -> Vec<Self> {
        let LdiViewport { width, height, pixel, depth, origin, .. } = *viewport;
        if !(pixel > 0.0
            && pixel.is_finite()
            && depth > 0.0
            && depth.is_finite()
            && origin.is_finite())
        {
            return Vec::new();
        }
        let starts = |length: u32| (0..length).step_by(limit as usize);
        let clip_size = [width, height].map(|side| side.next_power_of_two().min(clip_limit));
        let tile = |x: u32, y: u32| Self {
            origin: [x, y],
            size: [limit.min(width - x), limit.min(height - y)],
            clip_origin: [x - x % clip_size[0], y - y % clip_size[1]],
            clip_size,
        };
        starts(height).flat_map(|y| starts(width).map(move |x| tile(x, y))).collect()
    }
}

/// What a tile held.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct PeeledTile {
    /// Layers with a fragment.
    pub(super) layers: u32,
    /// Fragments of those layers.
    pub(super) fragments: u64,
    /// Fragments behind the last layer allowed.
    pub(super) left_over: u64,
}

/// Peels tile after tile.
pub(super) struct TilePeeler<'a> {
    peeler: &'a GpuPeeler,
    scene: &'a PeelScene,
    targets: PeelTargets,
    triangles: &'a TriangleTable,
    max_layers: u32,
    /// Grows with the largest batch.
    records_readback: Option<wgpu::Buffer>,
}

/// Layers whose records are still on the GPU.
struct PendingBatch {
    first_layer: u32,
    counts: Vec<GpuLayerCount>,
}

impl PendingBatch {
    fn bytes(&self) -> u64 {
        self.counts.iter().map(|count| u64::from(count.kept)).sum::<u64>() * RECORD_BYTES
    }
}

impl<'a> TilePeeler<'a> {
    pub(super) fn new(
        peeler: &'a GpuPeeler,
        scene: &'a PeelScene,
        targets: PeelTargets,
        triangles: &'a TriangleTable,
        max_layers: u32,
    ) -> Self {
        Self { peeler, scene, targets, triangles, max_layers, records_readback: None }
    }

    /// Appends the samples that `direction` keeps, by layer, row and column.
    ///
    /// # Errors
    /// The device is lost; others go to the device's error scope.
    pub(super) fn peel(
        &mut self,
        direction: u8,
        viewport: &LdiViewport,
        tile: &Tile,
        samples: &mut Vec<PeelSample>,
        progress: &dyn Fn(f32),
    ) -> Result<PeeledTile, GpuPeelError> {
        let view = self.view(direction, viewport, tile);
        self.peeler.queue.write_buffer(&self.targets.view, 0, bytemuck::bytes_of(&view));
        let mut peeled = PeeledTile::default();
        let mut pending = PendingBatch { first_layer: 0, counts: Vec::new() };
        let mut is_last = false;
        while !is_last {
            let first = peeled.layers;
            let count = self.targets.batch.min(self.max_layers - first);
            let mut encoder = self.encoder();
            let records_readback = self.copy_records(&mut encoder, pending.bytes());
            if first == 0 {
                self.clear_first_depth(&mut encoder);
            }
            encoder.clear_buffer(&self.targets.header, 0, None);
            for layer in first..first + count {
                self.peel_layer(&mut encoder, layer, direction, tile);
                self.compact_layer(&mut encoder, tile);
            }
            let header_bytes = self.targets.header.size();
            encoder.copy_buffer_to_buffer(
                &self.targets.header,
                0,
                &self.targets.header_readback,
                0,
                header_bytes,
            );
            let submission = self.peeler.queue.submit([encoder.finish()]);
            let header = &self.targets.header_readback;
            let [header, records] =
                self.read_with_records(submission, (header, header_bytes), records_readback)?;
            self.decode(&pending, &records, direction, viewport, samples);

            // Behind `layer` and `total`, two words a layer. A layer behind an empty one is empty.
            let words: Vec<u32> = bytemuck::pod_collect_to_vec(&header);
            let counts = words[2..].chunks_exact(2).take(count as usize);
            let counts: Vec<_> = counts
                .map(|c| GpuLayerCount { covered: c[0], kept: c[1] })
                .take_while(|c| c.covered > 0)
                .collect();
            peeled.layers += counts.len() as u32;
            peeled.fragments += counts.iter().map(|c| u64::from(c.covered)).sum::<u64>();
            is_last = counts.len() < count as usize || peeled.layers == self.max_layers;
            pending = PendingBatch { first_layer: first, counts };
            // How many layers there are is not known beforehand: 8 layers are half of the way.
            progress(peeled.layers as f32 / (peeled.layers as f32 + 8.0));
        }
        peeled.left_over =
            self.finish(direction, viewport, tile, &pending, peeled.layers, samples)?;
        Ok(peeled)
    }

    /// Reads the last batch's records, and counts what is behind if the last layer allowed was reached.
    fn finish(
        &mut self,
        direction: u8,
        viewport: &LdiViewport,
        tile: &Tile,
        pending: &PendingBatch,
        layers: u32,
        samples: &mut Vec<PeelSample>,
    ) -> Result<u64, GpuPeelError> {
        let is_cut_off = layers == self.max_layers;
        if pending.bytes() == 0 && !is_cut_off {
            return Ok(0);
        }
        let mut encoder = self.encoder();
        let records_readback = self.copy_records(&mut encoder, pending.bytes());
        let left_over = &self.targets.left_over_readback;
        let left_over_bytes = if is_cut_off { left_over.size() } else { 0 };
        if is_cut_off {
            self.count_left_over(&mut encoder, layers, direction, tile);
        }
        let submission = self.peeler.queue.submit([encoder.finish()]);
        let [left_over, records] =
            self.read_with_records(submission, (left_over, left_over_bytes), records_readback)?;
        self.decode(pending, &records, direction, viewport, samples);
        Ok(bytemuck::pod_collect_to_vec::<u8, u32>(&left_over).into_iter().map(u64::from).sum())
    }

    fn view(&self, direction: u8, viewport: &LdiViewport, tile: &Tile) -> GpuPeelView {
        let frame = viewport.direction;
        GpuPeelView {
            right: frame.right.to_array(),
            pixel: viewport.pixel,
            up: frame.up.to_array(),
            depth: viewport.depth,
            forward: frame.forward.to_array(),
            direction: u32::from(direction),
            origin: viewport.origin.to_array(),
            tile_width: tile.size[0],
            tile_origin: tile.origin.map(|v| v as f32),
            clip_origin: tile.clip_origin.map(|v| v as f32),
            clip_size: tile.clip_size.map(|v| v as f32),
            tile_height: tile.size[1],
            pad: 0,
        }
    }

    fn encoder(&self) -> wgpu::CommandEncoder {
        self.peeler
            .device
            .create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("peel") })
    }

    /// Before the first layer nothing is peeled: the depth to stay behind is 0.
    fn clear_first_depth(&self, encoder: &mut wgpu::CommandEncoder) {
        encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("clear_first_depth"),
            depth_stencil_attachment: Some(depth_attachment(
                &self.targets.depths[1],
                wgpu::LoadOp::Clear(0.0),
            )),
            ..Default::default()
        });
    }

    /// Draws the nearest fragments behind the layer before. Even layers write the first depth texture, odd the second.
    fn peel_layer(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        layer: u32,
        direction: u8,
        tile: &Tile,
    ) {
        let [own, before] = [layer as usize % 2, (layer as usize + 1) % 2];
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("peel"),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: &self.targets.layer,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations {
                    load: wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT),
                    store: wgpu::StoreOp::Store,
                },
            })],
            depth_stencil_attachment: Some(depth_attachment(
                &self.targets.depths[own],
                wgpu::LoadOp::Clear(1.0),
            )),
            ..Default::default()
        });
        set_viewport(&mut pass, tile);
        pass.set_pipeline(&self.peeler.pipelines.peel);
        pass.set_bind_group(0, &self.targets.view_groups[before], &[]);
        self.scene.draw(&mut pass, direction);
    }

    /// Appends the kept fragments of the layer just drawn to the batch's records.
    fn compact_layer(&self, encoder: &mut wgpu::CommandEncoder, tile: &Tile) {
        let blocks = (tile.size[0] * tile.size[1]).div_ceil(BLOCK);
        let pipelines = &self.peeler.pipelines;
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
            label: Some("peel_compact"),
            timestamp_writes: None,
        });
        pass.set_bind_group(0, &self.targets.view_groups[0], &[]);
        pass.set_bind_group(3, &self.targets.compact_group, &[]);
        let steps = [
            (&pipelines.count_blocks, blocks),
            (&pipelines.scan_blocks, 1),
            (&pipelines.write_records, blocks),
        ];
        for (pipeline, workgroups) in steps {
            pass.set_pipeline(pipeline);
            pass.dispatch_workgroups(workgroups, 1, 1);
        }
    }

    /// Counts the fragments behind the last of `layers` layers.
    fn count_left_over(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        layers: u32,
        direction: u8,
        tile: &Tile,
    ) {
        let counter = self.peeler.pipelines.left_over(&self.peeler.device);
        let group = self.peeler.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("count_left_over"),
            layout: &counter.layout,
            entries: &[wgpu::BindGroupEntry {
                binding: 0,
                resource: self.targets.left_over.as_entire_binding(),
            }],
        });
        encoder.clear_buffer(&self.targets.left_over, 0, None);
        let [unused, last] = [layers as usize % 2, (layers as usize + 1) % 2];
        {
            let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
                label: Some("count_left_over"),
                // A pass needs an attachment; nothing is tested against it or written to it.
                depth_stencil_attachment: Some(depth_attachment(
                    &self.targets.depths[unused],
                    wgpu::LoadOp::Clear(1.0),
                )),
                ..Default::default()
            });
            set_viewport(&mut pass, tile);
            pass.set_pipeline(&counter.pipeline);
            pass.set_bind_group(0, &self.targets.view_groups[last], &[]);
            pass.set_bind_group(2, &group, &[]);
            self.scene.draw(&mut pass, direction);
        }
        let bytes = self.targets.left_over.size();
        encoder.copy_buffer_to_buffer(
            &self.targets.left_over,
            0,
            &self.targets.left_over_readback,
            0,
            bytes,
        );
    }

    /// Copies a batch's records to where the CPU can read them.
    fn copy_records(&mut self, encoder: &mut wgpu::CommandEncoder, bytes: u64) -> u64 {
        if bytes > 0 {
            let too_small =
                self.records_readback.as_ref().is_none_or(|buffer| buffer.size() < bytes);
            if too_small {
                self.records_readback =
                    Some(self.peeler.device.create_buffer(&wgpu::BufferDescriptor {
                        label: Some("peel_records_readback"),
                        size: bytes.next_power_of_two().min(self.targets.records.size()),
                        usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
                        mapped_at_creation: false,
                    }));
            }
            let readback = self.records_readback.as_ref().expect("made above");
            encoder.copy_buffer_to_buffer(&self.targets.records, 0, readback, 0, bytes);
        }
        bytes
    }

    /// Reads a small buffer and the records copied by [`Self::copy_records`].
    fn read_with_records(
        &self,
        submission: wgpu::SubmissionIndex,
        small: (&wgpu::Buffer, u64),
        record_bytes: u64,
    ) -> Result<[Vec<u8>; 2], GpuPeelError> {
        // Without records the second buffer is not touched.
        let records = self.records_readback.as_ref().unwrap_or(small.0);
        self.peeler.read_back(submission, [small, (records, record_bytes)])
    }

    fn decode(
        &self,
        pending: &PendingBatch,
        records: &[u8],
        direction: u8,
        viewport: &LdiViewport,
        samples: &mut Vec<PeelSample>,
    ) {
        let PendingBatch { first_layer, counts } = pending;
        decode_records(records, counts, *first_layer, direction, viewport, self.triangles, samples);
    }
}

/// The viewport reaches beyond the target on all sides, as the LDI does beyond the tile.
fn set_viewport(pass: &mut wgpu::RenderPass<'_>, tile: &Tile) {
    let [x, y] = [0, 1].map(|axis| tile.clip_origin[axis] as f32 - tile.origin[axis] as f32);
    let [width, height] = tile.clip_size.map(|side| side as f32);
    pass.set_viewport(x, y, width, height, 0.0, 1.0);
    pass.set_scissor_rect(0, 0, tile.size[0], tile.size[1]);
}

fn depth_attachment(
    view: &wgpu::TextureView,
    load: wgpu::LoadOp<f32>,
) -> wgpu::RenderPassDepthStencilAttachment<'_> {
    wgpu::RenderPassDepthStencilAttachment {
        view,
        depth_ops: Some(wgpu::Operations { load, store: wgpu::StoreOp::Store }),
        stencil_ops: None,
    }
}
