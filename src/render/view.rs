//! Buffers and settings of each camera's view.

use super::residency::InstancePool;
use crate::{
    forest::{SplatShape, TreelineSettings},
    gpu::types::{
        GpuCounters, GpuIndirectArgs, GpuInstanceDraw, GpuSelectSettings, GpuWorkItem,
        POINTS_PER_ITEM, RESOLVE_BLOCK, SELECT_WORKGROUP,
    },
    lod::prefix_count::z0,
};
use bevy::{
    core_pipeline::prepass::ViewPrepassTextures,
    platform::collections::HashMap,
    prelude::*,
    render::{
        camera::ExtractedCamera,
        render_resource::{Buffer, BufferDescriptor, BufferUsages, CachedRenderPipelineId},
        renderer::{RenderDevice, RenderQueue},
        view::{ExtractedView, Msaa, RetainedViewEntity},
    },
};

/// GPU side of one view.
pub(super) struct ViewBuffers {
    pub settings: Buffer,
    pub draws: Buffer,
    pub block_items: Buffer,
    pub items: Buffer,
    pub counters: Buffer,
    pub args: Buffer,
    /// Two words a pixel: payload, depth bits.
    pub visibility: Buffer,
    pub blocks: Buffer,
    pub size: UVec2,
    pub instance_count: u32,
    item_capacity: u32,
    used: bool,
    warned: Vec<&'static str>,
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

/// The resolve pipeline of a camera.
#[derive(Component)]
pub(super) struct ViewResolvePipeline(pub CachedRenderPipelineId);

fn buffer(device: &RenderDevice, label: &'static str, size: u64, usage: BufferUsages) -> Buffer {
    let size = size.max(16);
    device.create_buffer(&BufferDescriptor {
        label: Some(label),
        size,
        usage,
        mapped_at_creation: false,
    })
}

fn pixel_buffers(device: &RenderDevice, size: UVec2) -> (Buffer, Buffer) {
    let pixels = u64::from(size.x) * u64::from(size.y);
    let blocks =
        u64::from(size.x.div_ceil(RESOLVE_BLOCK)) * u64::from(size.y.div_ceil(RESOLVE_BLOCK));
    let storage = BufferUsages::STORAGE | BufferUsages::COPY_DST | BufferUsages::COPY_SRC;
    (
        buffer(device, "treeline_visibility", pixels * 8, storage),
        buffer(device, "treeline_blocks", blocks * 4, BufferUsages::STORAGE),
    )
}

fn instance_buffers(device: &RenderDevice, count: u32) -> (Buffer, Buffer) {
    let draws = u64::from(count) * size_of::<GpuInstanceDraw>() as u64;
    let blocks = u64::from(count.div_ceil(SELECT_WORKGROUP)) * 4;
    let storage = BufferUsages::STORAGE | BufferUsages::COPY_SRC;
    (
        buffer(device, "treeline_draws", draws, storage),
        buffer(device, "treeline_block_items", blocks, storage),
    )
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
    for (entity, view, camera, msaa, settings, prepass) in &cameras {
        let size = camera.physical_viewport_size.unwrap_or_default();
        let (settings, moved) = settings.cloned().unwrap_or_default().clamped();
        let has_pixels =
            size.x > 0 && size.y > 0 && u64::from(size.x) * u64::from(size.y) * 8 <= binding_limit;
        if !settings.enabled || !has_pixels || instances.count == 0 {
            commands.entity(entity).remove::<ViewTrees>();
            continue;
        }
        let key = view.retained_view_entity;
        let most = (binding_limit / size_of::<GpuWorkItem>() as u64).min(1 << 26) as u32;
        let wanted = (settings.point_capacity_millions * 1e6 / POINTS_PER_ITEM as f32) as u32;
        let item_capacity = wanted.clamp(1, most);
        let buffers = views.all.entry(key).or_insert_with(|| {
            let (visibility, blocks) = pixel_buffers(&device, size);
            let (draws, block_items) = instance_buffers(&device, instances.count);
            let counters = BufferUsages::STORAGE | BufferUsages::COPY_SRC | BufferUsages::COPY_DST;
            let args = BufferUsages::STORAGE | BufferUsages::INDIRECT;
            let uniform = BufferUsages::UNIFORM | BufferUsages::COPY_DST;
            ViewBuffers {
                settings: buffer(
                    &device,
                    "treeline_settings",
                    size_of::<GpuSelectSettings>() as u64,
                    uniform,
                ),
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
                instance_count: instances.count,
                item_capacity,
                used: true,
                warned: vec![],
            }
        });
        buffers.used = true;
        if buffers.size != size {
            (buffers.visibility, buffers.blocks) = pixel_buffers(&device, size);
            buffers.size = size;
        }
        let room = buffers.draws.size() / size_of::<GpuInstanceDraw>() as u64;
        if room < u64::from(instances.count) {
            (buffers.draws, buffers.block_items) = instance_buffers(&device, instances.count);
        }
        buffers.instance_count = instances.count;
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
            instance_count: instances.count,
            item_capacity,
            pixels_per_unit: z0(size.y as f32, view.clip_from_view.y_axis.y),
            quality: settings.quality,
            min_mesh_distance: settings.min_mesh_distance,
            fade_width: settings.fade_width,
            fade_jitter: settings.fade_jitter,
            overlap_gain: settings.overlap_gain,
            orthographic: u32::from(view.clip_from_view.w_axis.w == 1.0),
            splat_shape: match settings.splat_shape {
                SplatShape::Cells => 0,
                SplatShape::Discs => 1,
                SplatShape::Squares => 2,
            },
            has_prepass: u32::from(has_prepass),
            pad: 0,
        };
        queue.write_buffer(&buffers.settings, 0, bytemuck::bytes_of(&data));
        commands.entity(entity).insert(ViewTrees { key, has_prepass });
    }
    views.all.retain(|_, view| view.used);
}
