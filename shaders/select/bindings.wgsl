// Bindings of every selection pass: group 0.
#define_import_path bevy_treeline::select_bindings

#import bevy_render::view::View
#import bevy_treeline::types::{Counters, InstanceBlock, SelectSettings}

@group(0) @binding(0) var<uniform> view: View;
// Of this phase.
@group(0) @binding(1) var<uniform> settings: SelectSettings;
@group(0) @binding(2) var<storage, read_write> counters: Counters;

const WORKGROUP: u32 = #{SELECT_WORKGROUP}u;
const POINTS_PER_ITEM: u32 = #{POINTS_PER_ITEM}u;

// The phase. A software driver runs both sides of every branch, so each has pipelines of its own.
#ifdef SELECT_SECOND
const SECOND: bool = true;
#else
const SECOND: bool = false;
#endif

// Bits of ViewBlock.state. Of this phase: look at its trees one by one; draw it as a grove, whose samples stand above
// bit 8. From the first phase: nothing of it was drawn; some of its trees may not have been drawn.
const LISTED: u32 = 1u;
const GROVE: u32 = 2u;
const WAS_HIDDEN: u32 = 4u;
const HAS_HIDDEN: u32 = 8u;

// Bit of TreeDraw.count: the first phase found something of the tree hidden. If its mask is 0, all of it.
const WAS_PARTLY_HIDDEN: u32 = 0x80000000u;

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
