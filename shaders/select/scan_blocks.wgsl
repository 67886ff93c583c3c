// Turns the runs and items of each block into the indices of its first, writes the runs of groves, and sizes the
// dispatches that follow.
//
// One workgroup: each thread sums a run of blocks, the sums are scanned, each thread writes its blocks.
// O(blocks / 256 + 256). CPU twin: src/forest/select.rs.
#import bevy_treeline::select_bindings::{GROVE, OF_GROVE, POINTS_PER_ITEM, WORKGROUP, counters, grid, instance_blocks, settings, view_blocks}
#import bevy_treeline::types::{IndirectArgs, Run}

// Apart from the other bindings: a buffer cannot be storage and source of indirect arguments in one dispatch.
@group(1) @binding(0) var<storage, read_write> args: IndirectArgs;
@group(1) @binding(1) var<storage, read_write> runs: array<Run>;

var<workgroup> lane_runs: array<u32, #{SELECT_WORKGROUP}>;
var<workgroup> lane_items: array<u32, #{SELECT_WORKGROUP}>;

@compute @workgroup_size(#{SELECT_WORKGROUP})
fn scan_blocks(@builtin(local_invocation_index) lane: u32) {
    let blocks = settings.block_count;
    let own = (blocks + WORKGROUP - 1u) / WORKGROUP;
    let begin = min(lane * own, blocks);
    let end = min(begin + own, blocks);
    var sum = vec2(0u);
    for (var i = begin; i < end; i++) {
        sum += vec2(view_blocks[i].runs, view_blocks[i].items);
    }
    lane_runs[lane] = sum.x;
    lane_items[lane] = sum.y;
    workgroupBarrier();
    var first = vec2(0u);
    for (var i = 0u; i < lane; i++) {
        first += vec2(lane_runs[i], lane_items[i]);
    }
    for (var i = begin; i < end; i++) {
        let count = vec2(view_blocks[i].runs, view_blocks[i].items);
        view_blocks[i].runs = first.x;
        view_blocks[i].items = first.y;
        let state = view_blocks[i].state;
        if (state & GROVE) != 0u && first.x < settings.item_capacity {
            let block = view_blocks[i].block;
            runs[first.x] = Run(first.y, block, instance_blocks[block].first_sample, (state >> 8u) | OF_GROVE, 0.0);
        }
        first += count;
    }
    if lane != WORKGROUP - 1u {
        return;
    }
    // The second phase fills the list of items from its end: what the first has left.
    let room = settings.item_capacity - select(0u, atomicLoad(&counters.items), settings.phase == 1u);
    let fitting = min(first.y, room);
    atomicStore(&counters.phase_items, fitting);
    // Every run has an item, so runs that do not fit have none that does.
    atomicStore(&counters.phase_runs, min(first.x, settings.item_capacity));
    atomicAdd(&counters.items, fitting);
    atomicAdd(&counters.item_overflow, first.y - fitting);
    args.expand = grid((fitting + POINTS_PER_ITEM - 1u) / POINTS_PER_ITEM);
    args.splat = grid(fitting);
    args.resolve = vec4(6u, 0u, 0u, 0u);
}
