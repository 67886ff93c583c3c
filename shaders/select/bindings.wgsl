// Bindings of every selection pass: group 0. Passes that cull have group 1 of culling.wgsl.
#define_import_path bevy_treeline::select_bindings

#import bevy_render::view::View
#import bevy_treeline::types::{Counters, InstanceBlock, SelectSettings, ViewBlock}

@group(0) @binding(0) var<uniform> view: View;
// Of this phase.
@group(0) @binding(1) var<uniform> settings: SelectSettings;
// Blocks of up to WORKGROUP instances, of all forests.
@group(0) @binding(2) var<storage, read> instance_blocks: array<InstanceBlock>;
// Those that the view selects from, front to back. `listed` belongs to no block: it is a list of those that have to be
// looked at tree by tree. `runs` and `items` are those of the block; after `scan_blocks`, the indices of the first.
@group(0) @binding(3) var<storage, read_write> view_blocks: array<ViewBlock>;
@group(0) @binding(4) var<storage, read_write> counters: Counters;

const WORKGROUP: u32 = #{SELECT_WORKGROUP}u;
const POINTS_PER_ITEM: u32 = #{POINTS_PER_ITEM}u;

// The phase. A software driver runs both sides of every branch, so each has pipelines of its own.
#ifdef SELECT_SECOND
const SECOND: bool = true;
#else
const SECOND: bool = false;
#endif

// Bits of ViewBlock.state. Of this phase: look at its trees one by one; draw it as a grove, whose samples stand above
// bit 8. From the first phase: nothing of it was drawn; some of its trees were not drawn.
const LISTED: u32 = 1u;
const GROVE: u32 = 2u;
const WAS_HIDDEN: u32 = 4u;
const HAS_HIDDEN: u32 = 8u;

// Instances of a block; and of these, those whose species is resident.
fn instance_count(block: InstanceBlock) -> u32 {
    return block.counts & 0xffffu;
}

fn resident_count(block: InstanceBlock) -> u32 {
    return block.counts >> 16u;
}

fn item_count(points: u32) -> u32 {
    return (points + POINTS_PER_ITEM - 1u) / POINTS_PER_ITEM;
}

// Index of a thread's workgroup in a dispatch that may be two-dimensional (a side ends at 65,535).
fn block_index(id: vec3<u32>, count: vec3<u32>) -> u32 {
    return id.y * count.x + id.x;
}

// Workgroups in x and y for `count` workgroups. Twin of `render::select::grid`.
fn grid(count: u32) -> vec3<u32> {
    let rows = max((count + 65534u) / 65535u, 1u);
    return vec3((count + rows - 1u) / rows, rows, 1u);
}
