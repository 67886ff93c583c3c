// Turns the items of each block of instances into the index of its first item, and sizes the splat dispatch.
//
// One workgroup: each thread sums a run of blocks, the runs are scanned, each thread writes its run.
// O(blocks / 256 + 256). CPU twin: src/forest/select.rs.
#import bevy_treeline::select_bindings::{WORKGROUP, block_items, counters, settings}
#import bevy_treeline::types::IndirectArgs

// Apart from the other bindings: a buffer cannot be storage and source of indirect arguments in one dispatch.
@group(1) @binding(0) var<storage, read_write> args: IndirectArgs;

var<workgroup> run_items: array<u32, #{SELECT_WORKGROUP}>;

@compute @workgroup_size(#{SELECT_WORKGROUP})
fn scan_blocks(@builtin(local_invocation_index) lane: u32) {
    let blocks = settings.block_count;
    let run = (blocks + WORKGROUP - 1u) / WORKGROUP;
    let begin = min(lane * run, blocks);
    let end = min(begin + run, blocks);
    var sum = 0u;
    for (var i = begin; i < end; i++) {
        sum += block_items[i];
    }
    run_items[lane] = sum;
    workgroupBarrier();
    var first = 0u;
    for (var i = 0u; i < lane; i++) {
        first += run_items[i];
    }
    for (var i = begin; i < end; i++) {
        let count = block_items[i];
        block_items[i] = first;
        first += count;
    }
    if lane != WORKGROUP - 1u {
        return;
    }
    let fitting = min(first, settings.item_capacity);
    atomicStore(&counters.items, fitting);
    atomicStore(&counters.item_overflow, first - fitting);
    let rows = max((fitting + 65534u) / 65535u, 1u);
    args.splat = vec3((fitting + rows - 1u) / rows, rows, 1u);
    args.resolve = vec4(6u, 0u, 0u, 0u);
}
