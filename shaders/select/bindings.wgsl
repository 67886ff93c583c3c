// Bindings of every selection pass.
#define_import_path bevy_treeline::select_bindings

#import bevy_render::view::View
#import bevy_treeline::types::{Counters, InstanceDraw, SelectSettings, Species, TreeInstance, ViewBlock, WorkItem}

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<uniform> settings: SelectSettings;
@group(0) @binding(2) var<storage, read> species: array<Species>;
@group(0) @binding(3) var<storage, read> instances: array<TreeInstance>;
// What the view selects from, front to back: one workgroup each.
@group(0) @binding(4) var<storage, read> view_blocks: array<ViewBlock>;
// WORKGROUP of each block; those beyond its count are not written.
@group(0) @binding(5) var<storage, read_write> draws: array<InstanceDraw>;
// Work items of each block; after `scan_blocks`, the index of its first item.
@group(0) @binding(6) var<storage, read_write> block_items: array<u32>;
@group(0) @binding(7) var<storage, read_write> items: array<WorkItem>;
@group(0) @binding(8) var<storage, read_write> counters: Counters;

const WORKGROUP: u32 = #{SELECT_WORKGROUP}u;
const POINTS_PER_ITEM: u32 = #{POINTS_PER_ITEM}u;

fn item_count(points: u32) -> u32 {
    return (points + POINTS_PER_ITEM - 1u) / POINTS_PER_ITEM;
}

// Index of a thread's workgroup in a dispatch that may be two-dimensional (a side ends at 65,535).
fn block_index(id: vec3<u32>, count: vec3<u32>) -> u32 {
    return id.y * count.x + id.x;
}
