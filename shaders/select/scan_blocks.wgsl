// Turns the runs and items of each block into the indices of its first, writes the runs of groves, and sizes the
// dispatches that follow.
//
// One workgroup: each thread sums a run of blocks, the sums are scanned, each thread writes its blocks.
// O(blocks / 256 + 256). CPU twin: src/forest/select.rs.
#import bevy_treeline::select_bindings::{GROVE, POINTS_PER_ITEM, WORKGROUP, counters, grid, settings}
#import bevy_treeline::types::{IndirectArgs, InstanceBlock, Run, ViewBlock}

// Apart from the other bindings: a buffer cannot be storage and source of indirect arguments in one dispatch.
@group(1) @binding(0) var<storage, read_write> args: IndirectArgs;
@group(1) @binding(1) var<storage, read_write> view_blocks: array<ViewBlock>;
@group(1) @binding(2) var<storage, read_write> runs: array<Run>;
@group(1) @binding(3) var<storage, read> instance_blocks: array<InstanceBlock>;

var<workgroup> lane_runs: array<u32, #{SELECT_WORKGROUP}>;
var<workgroup> lane_items: array<u32, #{SELECT_WORKGROUP}>;
var<workgroup> lane_grove_runs: array<u32, #{SELECT_WORKGROUP}>;
var<workgroup> lane_grove_items: array<u32, #{SELECT_WORKGROUP}>;

@compute @workgroup_size(#{SELECT_WORKGROUP})
fn scan_blocks(@builtin(local_invocation_index) lane: u32) {
    let blocks = settings.block_count;
    let own = (blocks + WORKGROUP - 1u) / WORKGROUP;
    let begin = min(lane * own, blocks);
    let end = min(begin + own, blocks);
    // Runs and items of trees, of groves.
    var sum = vec4(0u);
    for (var i = begin; i < end; i++) {
        let own = vec2(atomicLoad(&view_blocks[i].runs), atomicLoad(&view_blocks[i].items));
        sum += select(vec4(own, 0u, 0u), vec4(0u, 0u, own), (view_blocks[i].state & GROVE) != 0u);
    }
    lane_runs[lane] = sum.x;
    lane_items[lane] = sum.y;
    lane_grove_runs[lane] = sum.z;
    lane_grove_items[lane] = sum.w;
    workgroupBarrier();
    var first = vec4(0u);
    for (var i = 0u; i < lane; i++) {
        first += vec4(lane_runs[i], lane_items[i], lane_grove_runs[i], lane_grove_items[i]);
    }
    for (var i = begin; i < end; i++) {
        let own = vec2(atomicLoad(&view_blocks[i].runs), atomicLoad(&view_blocks[i].items));
        let state = view_blocks[i].state;
        if (state & GROVE) != 0u {
            let block = view_blocks[i].block;
            runs[settings.first_grove_run + first.z] = Run(first.w, block, instance_blocks[block].first_sample, state >> 8u, 0.0);
            first += vec4(0u, 0u, own);
        } else {
            atomicStore(&view_blocks[i].runs, first.x);
            atomicStore(&view_blocks[i].items, first.y);
            first += vec4(own, 0u, 0u);
        }
    }
    if lane != WORKGROUP - 1u {
        return;
    }
    // Groves fill the list of items from its end; the second phase goes on where the first has stopped, on both sides.
    var taken = vec2(0u);
    if settings.phase == 1u {
        taken = vec2(atomicLoad(&counters.phase_items), atomicLoad(&counters.phase_grove_items));
    }
    atomicStore(&counters.first_item, taken.x);
    atomicStore(&counters.first_grove_item, taken.y);
    let room = settings.item_capacity - taken.x - taken.y;
    let fitting = min(first.y, room);
    let fitting_groves = min(first.w, room - fitting);
    atomicStore(&counters.phase_items, fitting);
    // Every run has an item, so runs that do not fit have none that does.
    atomicStore(&counters.phase_runs, min(first.x, settings.item_capacity));
    atomicStore(&counters.phase_grove_items, fitting_groves);
    atomicStore(&counters.phase_grove_runs, first.z);
    atomicAdd(&counters.items, fitting + fitting_groves);
    atomicAdd(&counters.item_overflow, first.y - fitting + first.w - fitting_groves);
    args.expand = grid((fitting + fitting_groves + POINTS_PER_ITEM - 1u) / POINTS_PER_ITEM);
    args.splat = grid(fitting);
    args.groves = grid(fitting_groves);
    args.resolve = vec4(6u, 0u, 0u, 0u);
}
