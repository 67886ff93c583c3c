// Turns the runs and items of each block into the indices of its first, lists the blocks whose trees have a run, writes the
// runs of groves, and sizes the dispatches that follow.
//
// One workgroup: each thread sums a run of blocks, the sums are scanned, each thread writes its blocks.
// O(blocks / 256 + 256). CPU twin: src/forest/select.rs.
#import bevy_treeline::prefix_sum::prefix_sum
#import bevy_treeline::select_bindings::{GROVE, WORKGROUP, counters, grid, item_count, settings}
#import bevy_treeline::types::{IndirectArgs, InstanceBlock, Run, ViewBlock}

// Apart from the other bindings: a buffer cannot be storage and source of indirect arguments in one dispatch.
@group(1) @binding(0) var<storage, read_write> args: IndirectArgs;
@group(1) @binding(1) var<storage, read_write> view_blocks: array<ViewBlock>;
@group(1) @binding(2) var<storage, read_write> runs: array<Run>;
@group(1) @binding(3) var<storage, read> instance_blocks: array<InstanceBlock>;

@compute @workgroup_size(#{SELECT_WORKGROUP})
fn scan_blocks(@builtin(local_invocation_index) lane: u32) {
    let blocks = settings.block_count;
    let own = (blocks + WORKGROUP - 1u) / WORKGROUP;
    let begin = min(lane * own, blocks);
    let end = min(begin + own, blocks);
    // Runs and items of trees, of groves.
    var sum = vec4(0u);
    var sum_listed = 0u;
    for (var i = begin; i < end; i++) {
        let own = vec2(atomicLoad(&view_blocks[i].runs), atomicLoad(&view_blocks[i].items));
        let is_grove = (view_blocks[i].state & GROVE) != 0u;
        sum += select(vec4(own, 0u, 0u), vec4(0u, 0u, own), is_grove);
        sum_listed += select(min(own.x, 1u), 0u, is_grove);
    }
    var first = vec4(prefix_sum(lane, sum.xy).before, prefix_sum(lane, sum.zw).before);
    var next_listed = prefix_sum(lane, vec2(sum_listed, 0u)).before.x;
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
            if own.x > 0u {
                view_blocks[next_listed].listed = i;
                next_listed += 1u;
            }
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
    args.emit = grid(next_listed);
    // The grid may have more workgroups than there are blocks.
    for (; next_listed < min(args.emit.x * args.emit.y, blocks); next_listed++) {
        view_blocks[next_listed].listed = 0xffffffffu;
    }
    args.expand = grid(item_count(fitting));
    args.expand_groves = grid(item_count(fitting_groves));
    args.splat = grid(fitting);
    args.groves = grid(fitting_groves);
    args.resolve = vec4(6u, 0u, 0u, 0u);
}
