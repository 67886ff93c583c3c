//! What a tile is peeled into: made once per model for its largest tile, used for every layer of every direction.

use super::{
    GpuPeeler,
    pipelines::{BLOCK, DEPTH_FORMAT, GpuPeelView, LAYER_FORMAT, LEFT_OVER_COUNTERS},
    readback::RECORD_BYTES,
    tile::Tile,
    upload::PeelScene,
};

/// Layers that are peeled before the CPU looks whether there is one more. More waits less, but draws more empty layers.
const LARGEST_BATCH: u64 = 4;
/// Bytes of a batch's records at most, unless a single layer needs more.
const RECORDS_BYTES: u64 = 80 << 20;

/// Textures, buffers and bind groups for one tile at a time.
#[derive(Debug)]
pub(super) struct PeelTargets {
    /// Layers per batch, ≥ 1; their records fit `records` whatever the layers hold.
    pub(super) batch: u32,
    pub(super) layer: wgpu::TextureView,
    /// The two depth buffers of the paper.
    pub(super) depths: [wgpu::TextureView; 2],
    pub(super) view: wgpu::Buffer,
    /// The view, and the depth texture of the same index as the depths to stay behind.
    pub(super) view_groups: [wgpu::BindGroup; 2],
    pub(super) compact_group: wgpu::BindGroup,
    pub(super) header: wgpu::Buffer,
    pub(super) records: wgpu::Buffer,
    pub(super) left_over: wgpu::Buffer,
    pub(super) header_readback: wgpu::Buffer,
    pub(super) left_over_readback: wgpu::Buffer,
}

impl PeelTargets {
    /// Makes targets that fit every tile. wgpu's errors go to the device's error scope.
    pub(super) fn new<'a>(
        peeler: &GpuPeeler,
        tiles: impl Iterator<Item = &'a Tile>,
        scene: &PeelScene,
    ) -> Self {
        let device = &peeler.device;
        let (mut size, mut pixels) = ([1, 1], 1);
        for tile in tiles {
            size = [size[0].max(tile.size[0]), size[1].max(tile.size[1])];
            pixels = pixels.max(u64::from(tile.size[0]) * u64::from(tile.size[1]));
        }
        let limits = device.limits();
        let record_bytes =
            RECORDS_BYTES.min(limits.max_storage_buffer_binding_size).min(limits.max_buffer_size);
        let batch = (record_bytes / (pixels * RECORD_BYTES)).clamp(1, LARGEST_BATCH);

        use wgpu::{BufferUsages as Buffers, TextureUsages as Textures};
        let texture = |label, format| {
            let texture = device.create_texture(&wgpu::TextureDescriptor {
                label: Some(label),
                size: wgpu::Extent3d { width: size[0], height: size[1], depth_or_array_layers: 1 },
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format,
                usage: Textures::RENDER_ATTACHMENT | Textures::TEXTURE_BINDING,
                view_formats: &[],
            });
            texture.create_view(&Default::default())
        };
        let buffer = |label, size, usage| {
            device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(label),
                size,
                usage,
                mapped_at_creation: false,
            })
        };
        let group = |label, layout, resources: &[wgpu::BindingResource<'_>]| {
            let entries: Vec<_> = std::iter::zip(0.., resources)
                .map(|(binding, resource)| wgpu::BindGroupEntry {
                    binding,
                    resource: resource.clone(),
                })
                .collect();
            device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some(label),
                layout,
                entries: &entries,
            })
        };
        let layer = texture("peel_layer", LAYER_FORMAT);
        let depths =
            [texture("peel_depth_even", DEPTH_FORMAT), texture("peel_depth_odd", DEPTH_FORMAT)];
        let view = buffer(
            "peel_view",
            size_of::<GpuPeelView>() as u64,
            Buffers::UNIFORM | Buffers::COPY_DST,
        );
        let view_groups = [&depths[0], &depths[1]].map(|depth| {
            let depth = wgpu::BindingResource::TextureView(depth);
            group("peel_view", &peeler.pipelines.view_layout, &[view.as_entire_binding(), depth])
        });
        let counters = Buffers::STORAGE | Buffers::COPY_SRC | Buffers::COPY_DST;
        let header = buffer("peel_header", 8 + 8 * batch, counters);
        let left_over_bytes = LEFT_OVER_COUNTERS * 4;
        let left_over = buffer("peel_left_over", left_over_bytes, counters);
        let blocks = buffer("peel_blocks", pixels.div_ceil(u64::from(BLOCK)) * 4, Buffers::STORAGE);
        let records = buffer(
            "peel_records",
            batch * pixels * RECORD_BYTES,
            Buffers::STORAGE | Buffers::COPY_SRC,
        );
        let compact_group = group(
            "peel_compact",
            &peeler.pipelines.compact_layout,
            &[
                wgpu::BindingResource::TextureView(&layer),
                scene.triangle_directions.as_entire_binding(),
                header.as_entire_binding(),
                blocks.as_entire_binding(),
                records.as_entire_binding(),
            ],
        );
        let readback = Buffers::COPY_DST | Buffers::MAP_READ;
        Self {
            batch: batch as u32,
            layer,
            depths,
            view,
            view_groups,
            compact_group,
            header_readback: buffer("peel_header_readback", header.size(), readback),
            left_over_readback: buffer("peel_left_over_readback", left_over_bytes, readback),
            header,
            records,
            left_over,
        }
    }
}
