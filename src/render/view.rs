//! Buffers and settings of each camera's view.

use super::{
    cull_tiles::{TileCounts, TileView, cull_tiles},
    residency::InstancePool,
};
use crate::{
    forest::{SplatShape, TemporalSampling, TreelineSettings},
    gpu::types::{
        GpuCounters, GpuIndirectArgs, GpuInstanceDraw, GpuSelectSettings, GpuViewBlock,
        GpuWorkItem, POINTS_PER_ITEM, RESOLVE_BLOCK, SELECT_WORKGROUP,
    },
    lod::{prefix_count::z0, window::WINDOW_CYCLE},
};
use bevy::{
    camera::{primitives::Frustum, visibility::RenderLayers},
    core_pipeline::prepass::ViewPrepassTextures,
    math::primitives::ViewFrustum,
    platform::collections::HashMap,
    prelude::*,
    render::{
        camera::{ExtractedCamera, TemporalJitter},
        render_resource::{Buffer, BufferDescriptor, BufferUsages},
        renderer::{RenderDevice, RenderQueue},
        view::{ExtractedView, Msaa, RetainedViewEntity},
    },
};

/// GPU side of one view.
pub(super) struct ViewBuffers {
    pub settings: Buffer,
    pub view_blocks: Buffer,
    pub draws: Buffer,
    pub block_items: Buffer,
    pub items: Buffer,
    pub counters: Buffer,
    pub args: Buffer,
    /// Two words a sample: payload, depth bits.
    pub visibility: Buffer,
    pub blocks: Buffer,
    /// Pixels.
    pub size: UVec2,
    /// Samples of a pixel, 1 or 4.
    pub samples: u32,
    /// Blocks of instances that the view selects from.
    pub block_count: u32,
    pub tile_counts: TileCounts,
    /// What `view_blocks` begins with.
    written_blocks: Vec<GpuViewBlock>,
    block_capacity: u32,
    item_capacity: u32,
    used: bool,
    warned: Vec<&'static str>,
    /// Frames in which trees showed windows, counted up to the cycle.
    window_turn: u32,
}

/// Name of a warning beside those of settings.
const TOO_MANY_BLOCKS: &str = "blocks";

impl ViewBuffers {
    /// Makes these the blocks that the view selects from. At most `most` fit.
    fn select_from(
        &mut self,
        blocks: Vec<GpuViewBlock>,
        most: u32,
        device: &RenderDevice,
        queue: &RenderQueue,
    ) {
        self.block_count = blocks.len() as u32;
        if self.block_count > self.block_capacity {
            // Room for more, so that turning the camera does not make new buffers each frame.
            self.block_capacity = self.block_count.saturating_add(self.block_count / 2).min(most);
            [self.view_blocks, self.draws, self.block_items] =
                block_buffers(device, self.block_capacity);
            self.written_blocks.clear();
        }
        if self.written_blocks != blocks {
            queue.write_buffer(&self.view_blocks, 0, bytemuck::cast_slice(&blocks));
            self.written_blocks = blocks;
        }
    }

    /// `GpuSelectSettings::window` of a frame.
    fn next_window(&mut self, sampling: TemporalSampling, is_jittered: bool) -> u32 {
        let has_windows = match sampling {
            TemporalSampling::Auto => is_jittered,
            TemporalSampling::Prefix => false,
            TemporalSampling::Windows => true,
        };
        if !has_windows {
            return 0;
        }
        self.window_turn = (self.window_turn + 1) % (2 * WINDOW_CYCLE);
        self.window_turn + 1
    }
}

/// Buffers by view; a view that is not drawn any more gives them back.
#[derive(Resource, Default)]
pub(super) struct Views {
    all: HashMap<RetainedViewEntity, ViewBuffers>,
}

impl Views {
    pub fn get(&self, view: &ViewTrees) -> Option<&ViewBuffers> {
        self.all.get(&view.key)
    }
}

/// On cameras that draw trees this frame.
#[derive(Component, Clone, Copy)]
pub(super) struct ViewTrees {
    pub key: RetainedViewEntity,
    pub has_prepass: bool,
}

fn buffer(device: &RenderDevice, label: &'static str, size: u64, usage: BufferUsages) -> Buffer {
    let size = size.max(16);
    device.create_buffer(&BufferDescriptor {
        label: Some(label),
        size,
        usage,
        mapped_at_creation: false,
    })
}

fn pixel_buffers(device: &RenderDevice, size: UVec2, samples: u32) -> (Buffer, Buffer) {
    let pixels = u64::from(size.x) * u64::from(size.y) * u64::from(samples);
    let blocks =
        u64::from(size.x.div_ceil(RESOLVE_BLOCK)) * u64::from(size.y.div_ceil(RESOLVE_BLOCK));
    let storage = BufferUsages::STORAGE | BufferUsages::COPY_DST | BufferUsages::COPY_SRC;
    (
        buffer(device, "treeline_visibility", pixels * 8, storage),
        buffer(device, "treeline_blocks", blocks * 4, BufferUsages::STORAGE),
    )
}

/// Bytes of what selection writes for a block of instances.
const BLOCK_DRAWS: u64 = SELECT_WORKGROUP as u64 * size_of::<GpuInstanceDraw>() as u64;

/// Blocks, draws, and items of each block.
fn block_buffers(device: &RenderDevice, blocks: u32) -> [Buffer; 3] {
    let blocks = u64::from(blocks);
    let storage = BufferUsages::STORAGE | BufferUsages::COPY_SRC;
    let bytes = size_of::<GpuViewBlock>() as u64;
    let written = BufferUsages::STORAGE | BufferUsages::COPY_DST;
    [
        buffer(device, "treeline_view_blocks", blocks * bytes, written),
        buffer(device, "treeline_draws", blocks * BLOCK_DRAWS, storage),
        buffer(device, "treeline_block_items", blocks * 4, storage),
    ]
}

fn item_buffer(device: &RenderDevice, capacity: u32) -> Buffer {
    let size = u64::from(capacity) * size_of::<GpuWorkItem>() as u64;
    buffer(device, "treeline_items", size, BufferUsages::STORAGE | BufferUsages::COPY_SRC)
}

/// Makes and sizes the buffers of every camera's view, and writes its settings.
#[expect(clippy::type_complexity, reason = "a query is its type")]
pub(super) fn prepare_views(
    mut commands: Commands,
    mut views: ResMut<Views>,
    cameras: Query<
        (
            Entity,
            &ExtractedView,
            &ExtractedCamera,
            &Msaa,
            Option<&TreelineSettings>,
            Option<&ViewPrepassTextures>,
            Option<&Frustum>,
            Option<&RenderLayers>,
            Option<&TemporalJitter>,
        ),
        With<Camera3d>,
    >,
    instances: Res<InstancePool>,
    device: Res<RenderDevice>,
    queue: Res<RenderQueue>,
) {
    for view in views.all.values_mut() {
        view.used = false;
    }
    let limits = device.limits();
    let binding_limit = limits.max_storage_buffer_binding_size;
    let everyone = RenderLayers::default();
    for (entity, view, camera, msaa, settings, prepass, frustum, layers, jitter) in &cameras {
        let size = camera.physical_viewport_size.unwrap_or_default();
        let (settings, moved) = settings.cloned().unwrap_or_default().clamped();
        let samples = u64::from(size.x) * u64::from(size.y) * u64::from(settings.samples);
        let has_pixels = samples > 0 && samples * 8 <= binding_limit;
        if !settings.enabled || !has_pixels || instances.count == 0 {
            commands.entity(entity).remove::<ViewTrees>();
            continue;
        }
        let key = view.retained_view_entity;
        let most = (binding_limit / size_of::<GpuWorkItem>() as u64).min(1 << 26) as u32;
        let wanted = (settings.point_capacity_millions * 1e6 / POINTS_PER_ITEM as f32) as u32;
        let item_capacity = wanted.clamp(1, most);
        let buffers = views.all.entry(key).or_insert_with(|| {
            let (visibility, blocks) = pixel_buffers(&device, size, settings.samples);
            let counters = BufferUsages::STORAGE | BufferUsages::COPY_SRC | BufferUsages::COPY_DST;
            let args = BufferUsages::STORAGE | BufferUsages::INDIRECT;
            let uniform = BufferUsages::UNIFORM | BufferUsages::COPY_DST;
            let [view_blocks, draws, block_items] = block_buffers(&device, 0);
            ViewBuffers {
                settings: buffer(
                    &device,
                    "treeline_settings",
                    size_of::<GpuSelectSettings>() as u64,
                    uniform,
                ),
                view_blocks,
                draws,
                block_items,
                items: item_buffer(&device, item_capacity),
                counters: buffer(
                    &device,
                    "treeline_counters",
                    size_of::<GpuCounters>() as u64,
                    counters,
                ),
                args: buffer(&device, "treeline_args", size_of::<GpuIndirectArgs>() as u64, args),
                visibility,
                blocks,
                size,
                samples: settings.samples,
                block_count: 0,
                tile_counts: default(),
                written_blocks: vec![],
                block_capacity: 0,
                item_capacity,
                used: true,
                warned: vec![],
                window_turn: 0,
            }
        });
        buffers.used = true;
        if (buffers.size, buffers.samples) != (size, settings.samples) {
            (buffers.visibility, buffers.blocks) = pixel_buffers(&device, size, settings.samples);
            (buffers.size, buffers.samples) = (size, settings.samples);
        }
        let orthographic = view.clip_from_view.w_axis.w == 1.0;
        let frozen = settings.culling_view;
        let frozen_frustum =
            frozen.map(|frozen| ViewFrustum::from_clip_from_world(&frozen.clip_from_world));
        let half_spaces = match (frozen_frustum, frustum) {
            (Some(frozen), _) => Some(frozen.half_spaces),
            (None, Some(frustum)) => Some(frustum.half_spaces),
            (None, None) => None,
        };
        let planes = half_spaces.map(|planes| planes.map(|plane| plane.normal_d()));
        let tile_view = TileView {
            planes: planes.as_ref().map_or(&[], |planes| &planes[..5]),
            eye: frozen.map_or(view.world_from_view.translation(), |frozen| frozen.eye),
            orthographic,
            layers: layers.unwrap_or(&everyone),
        };
        let mut seen = cull_tiles(&instances, &tile_view);
        let most_blocks = (binding_limit / BLOCK_DRAWS) as usize;
        if seen.blocks.len() > most_blocks {
            if !buffers.warned.contains(&TOO_MANY_BLOCKS) {
                warn!(
                    "a view sees more trees than this device can select from: the farthest are not drawn"
                );
                buffers.warned.push(TOO_MANY_BLOCKS);
            }
            seen.blocks.truncate(most_blocks);
        }
        buffers.select_from(seen.blocks, most_blocks as u32, &device, &queue);
        buffers.tile_counts = seen.counts;
        if buffers.item_capacity != item_capacity {
            buffers.items = item_buffer(&device, item_capacity);
            buffers.item_capacity = item_capacity;
        }
        for name in moved {
            if !buffers.warned.contains(&name) {
                warn!(
                    "TreelineSettings::{name} of a camera is out of its range and was moved into it"
                );
                buffers.warned.push(name);
            }
        }
        // A multisampled prepass has one depth per sample; points test against each other only.
        let has_prepass = msaa.samples() == 1 && prepass.is_some_and(|p| p.depth_view().is_some());
        let data = GpuSelectSettings {
            size: size.to_array(),
            origin: camera
                .viewport
                .as_ref()
                .map_or(UVec2::ZERO, |v| v.physical_position)
                .to_array(),
            block_count: buffers.block_count,
            item_capacity,
            pixels_per_unit: z0(size.y as f32, view.clip_from_view.y_axis.y),
            quality: settings.quality,
            min_mesh_distance: settings.min_mesh_distance,
            fade_width: settings.fade_width,
            fade_jitter: settings.fade_jitter,
            overlap_gain: settings.overlap_gain,
            orthographic: u32::from(orthographic),
            splat_shape: match settings.splat_shape {
                SplatShape::Cells => 0,
                SplatShape::Discs => 1,
                SplatShape::Squares => 2,
            },
            has_prepass: u32::from(has_prepass),
            culling_frozen: u32::from(frozen.is_some()),
            culling_planes: planes
                .map_or([[0.0; 4]; 4], |planes| [0, 1, 2, 3].map(|side| planes[side].to_array())),
            culling_eye: tile_view.eye.to_array(),
            window: buffers.next_window(settings.temporal, jitter.is_some()),
            pad: [0; 3],
            samples_per_side: if settings.samples > 1 { 2 } else { 1 },
        };
        queue.write_buffer(&buffers.settings, 0, bytemuck::bytes_of(&data));
        commands.entity(entity).insert(ViewTrees { key, has_prepass });
    }
    views.all.retain(|_, view| view.used);
}
