// Writes the work items, in the order of blocks, instances and points, whatever order threads run in.
//
// One workgroup per block of instances; its threads share all items of the block, so that a near tree with
// thousands of items does not keep one thread busy. CPU twin: src/forest/select.rs.
#import bevy_treeline::instance::{hash_of, species_of}
#import bevy_treeline::lod::{WINDOW_CYCLE, window_start}
#import bevy_treeline::select_bindings::{POINTS_PER_ITEM, WORKGROUP, block_index, block_items, counters, draws, instances, item_count, items, settings, species, view_blocks}
#import bevy_treeline::types::WorkItem

var<workgroup> first_item: array<u32, #{SELECT_WORKGROUP}>;
var<workgroup> group_points: atomic<u32>;

@compute @workgroup_size(#{SELECT_WORKGROUP})
fn emit_items(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let block = block_index(group, groups);
    let begin = block * WORKGROUP;
    var own = 0u;
    if block < settings.block_count && lane < view_blocks[block].count {
        own = item_count(draws[begin + lane].count);
    }
    first_item[lane] = own;
    // Workgroup memory is not cleared for us.
    if lane == 0u {
        atomicStore(&group_points, 0u);
    }
    workgroupBarrier();
    // Inclusive scan (Hillis and Steele 1986): log2(256) steps.
    for (var step = 1u; step < WORKGROUP; step <<= 1u) {
        var before = 0u;
        if lane >= step {
            before = first_item[lane - step];
        }
        workgroupBarrier();
        first_item[lane] += before;
        workgroupBarrier();
    }
    let total = first_item[WORKGROUP - 1u];
    workgroupBarrier();
    first_item[lane] -= own;
    workgroupBarrier();

    if block < settings.block_count {
        let base = block_items[block];
        for (var k = lane; k < total; k += WORKGROUP) {
            if base + k >= settings.item_capacity {
                break;
            }
            // The last instance whose first item is not after k.
            var low = 0u;
            var high = WORKGROUP;
            while high - low > 1u {
                let middle = (low + high) / 2u;
                if first_item[middle] <= k {
                    low = middle;
                } else {
                    high = middle;
                }
            }
            let index = view_blocks[block].first_instance + low;
            let draw = draws[begin + low];
            let first = (k - first_item[low]) * POINTS_PER_ITEM;
            let count = min(draw.count - first, POINTS_PER_ITEM);
            let instance = instances[index];
            let kind = species_of(instance);
            var start = species[kind].first_point + first;
            if settings.window != 0u {
                // Each tree at its own turn: what one window shows less of does not flicker in all at once.
                let turn = settings.window + u32(hash_of(instance) * f32(WINDOW_CYCLE));
                start += window_start(draw.count, species[kind].point_count, turn);
            }
            items[base + k] = WorkItem(index, start, count, draw.radius);
            atomicAdd(&group_points, count);
        }
    }
    workgroupBarrier();
    if lane == 0u {
        atomicAdd(&counters.points, atomicLoad(&group_points));
    }
}
