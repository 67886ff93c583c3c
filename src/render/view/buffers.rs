//! Buffers of a view, made and sized.

use crate::{
    gpu::types::{
        GpuCounters, GpuIndirectArgs, GpuRun, GpuSelectSettings, GpuSplatItem, GpuTreeDraw,
        GpuViewBlock, GpuWorkItem, RESOLVE_BLOCK, SELECT_WORKGROUP,
    },
    math::occlusion::{PYRAMID_LEVELS, pyramid_offset},
};
use bevy::{
    math::UVec2,
    render::{
        render_resource::{Buffer, BufferDescriptor, BufferUsages},
        renderer::RenderDevice,
    },
};

/// For storage of at least one element, which a binding has to hold.
fn buffer(device: &RenderDevice, label: &'static str, size: u64, usage: BufferUsages) -> Buffer {
    // A binding holds one element at least.
    let size = size.max(256);
    device.create_buffer(&BufferDescriptor {
        label: Some(label),
        size,
        usage,
        mapped_at_creation: false,
    })
}

/// Bytes from the settings of one phase to those of the next: the largest alignment that devices ask for.
pub(in crate::render) const PHASE_STRIDE: u32 = 512;
const _: () = assert!(size_of::<GpuSelectSettings>() <= PHASE_STRIDE as usize);

/// Settings, counters and arguments: of one size in all views.
pub(super) fn fixed_buffers(device: &RenderDevice) -> [Buffer; 3] {
    let copied = BufferUsages::COPY_SRC | BufferUsages::COPY_DST;
    let of = |label, size, usage| buffer(device, label, size, usage);
    [
        of(
            "treeline_settings",
            2 * u64::from(PHASE_STRIDE),
            BufferUsages::UNIFORM | BufferUsages::COPY_DST,
        ),
        of("treeline_counters", size_of::<GpuCounters>() as u64, BufferUsages::STORAGE | copied),
        of(
            "treeline_args",
            size_of::<GpuIndirectArgs>() as u64,
            BufferUsages::STORAGE | BufferUsages::INDIRECT,
        ),
    ]
}

pub(super) fn pixel_buffers(device: &RenderDevice, size: UVec2, samples: u32) -> [Buffer; 3] {
    let pixels = u64::from(size.x) * u64::from(size.y) * u64::from(samples);
    let blocks =
        u64::from(size.x.div_ceil(RESOLVE_BLOCK)) * u64::from(size.y.div_ceil(RESOLVE_BLOCK));
    let storage = BufferUsages::STORAGE | BufferUsages::COPY_DST | BufferUsages::COPY_SRC;
    let texels = u64::from(pyramid_offset(size, PYRAMID_LEVELS));
    [
        buffer(device, "treeline_visibility", pixels * 8, storage),
        buffer(device, "treeline_blocks", blocks * 4, BufferUsages::STORAGE),
        buffer(device, "treeline_pyramid", 2 * texels * 4, storage),
    ]
}

pub(super) fn block_buffer(device: &RenderDevice, blocks: u32) -> Buffer {
    let size = u64::from(blocks) * size_of::<GpuViewBlock>() as u64;
    let written = BufferUsages::STORAGE | BufferUsages::COPY_DST;
    buffer(device, "treeline_view_blocks", size, written)
}

/// Bytes of what is found out about the trees of a block.
pub(super) const DRAW_BYTES: u64 = SELECT_WORKGROUP as u64 * size_of::<GpuTreeDraw>() as u64;

pub(super) fn draw_buffer(device: &RenderDevice, blocks: u32) -> Buffer {
    buffer(device, "treeline_draws", u64::from(blocks.max(1)) * DRAW_BYTES, BufferUsages::STORAGE)
}

/// Runs of trees, each with an item, and of groves, one a block.
pub(super) fn run_buffer(device: &RenderDevice, items: u32, blocks: u32) -> Buffer {
    let size = (u64::from(items) + u64::from(blocks)) * size_of::<GpuRun>() as u64;
    buffer(device, "treeline_runs", size, BufferUsages::STORAGE | BufferUsages::COPY_SRC)
}

/// Items, and how they come to the screen.
pub(super) fn item_buffers(device: &RenderDevice, capacity: u32) -> [Buffer; 2] {
    let of = |label, bytes: usize| {
        let size = u64::from(capacity) * bytes as u64;
        buffer(device, label, size, BufferUsages::STORAGE | BufferUsages::COPY_SRC)
    };
    [
        of("treeline_items", size_of::<GpuWorkItem>()),
        of("treeline_splat_items", size_of::<GpuSplatItem>()),
    ]
}
