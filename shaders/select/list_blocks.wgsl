// Lists the blocks whose trees are looked at one by one, and sizes the dispatches that do so.
//
// One workgroup: each thread counts a run of blocks, the counts are scanned, each thread writes its run.
// O(blocks / 256 + 256).
#import bevy_treeline::prefix_sum::prefix_sum
#import bevy_treeline::select_bindings::{LISTED, WORKGROUP, counters, grid, settings}
#import bevy_treeline::types::{IndirectArgs, ViewBlock}

// Apart from the other bindings: a buffer cannot be storage and source of indirect arguments in one dispatch.
@group(1) @binding(0) var<storage, read_write> args: IndirectArgs;
@group(1) @binding(1) var<storage, read_write> view_blocks: array<ViewBlock>;

@compute @workgroup_size(#{SELECT_WORKGROUP})
fn list_blocks(@builtin(local_invocation_index) lane: u32) {
    let blocks = settings.block_count;
    let run = (blocks + WORKGROUP - 1u) / WORKGROUP;
    let begin = min(lane * run, blocks);
    let end = min(begin + run, blocks);
    var sum = 0u;
    for (var i = begin; i < end; i++) {
        sum += view_blocks[i].state & LISTED;
    }
    var next = prefix_sum(lane, vec2(sum, 0u)).before.x;
    for (var i = begin; i < end; i++) {
        if (view_blocks[i].state & LISTED) != 0u {
            view_blocks[next].listed = i;
            next += 1u;
        }
    }
    if lane != WORKGROUP - 1u {
        return;
    }
    atomicStore(&counters.near_trees, 0u);
    args.cull = grid(next);
    // The grid may have more workgroups than there are blocks.
    for (; next < min(args.cull.x * args.cull.y, blocks); next++) {
        view_blocks[next].listed = 0xffffffffu;
    }
}
