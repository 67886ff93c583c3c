// Cuts the runs of groves into work items of up to 64 samples, from the end of the list of items.
//
// One thread per item, which finds its run by bisection among those of all groves. O(items log groves). Apart from
// `expand_items`: a software driver would run either for the items of both.
#import bevy_treeline::lod::OF_GROVE
#import bevy_treeline::select_bindings::{POINTS_PER_ITEM, block_index, counters, settings}
#import bevy_treeline::splat_item::GROVE_UNIT
#import bevy_treeline::types::{InstanceBlock, Run, SplatItem, WorkItem}

@group(1) @binding(0) var<storage, read> instance_blocks: array<InstanceBlock>;
@group(1) @binding(1) var<storage, read> runs: array<Run>;
@group(1) @binding(2) var<storage, read_write> items: array<WorkItem>;
@group(1) @binding(3) var<storage, read_write> splat_items: array<SplatItem>;

var<workgroup> group_points: atomic<u32>;

@compute @workgroup_size(#{POINTS_PER_ITEM})
fn expand_groves(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let place = block_index(group, groups) * POINTS_PER_ITEM + lane;
    let first_item = atomicLoad(&counters.first_grove_item);
    let fitting = atomicLoad(&counters.phase_grove_items);
    let last_run = settings.first_grove_run + atomicLoad(&counters.phase_grove_runs);
    // Workgroup memory is not cleared for us.
    if lane == 0u {
        atomicStore(&group_points, 0u);
    }
    workgroupBarrier();
    // The grid may have more workgroups than there are items.
    if place < fitting {
        // The last run whose first item is not after the place.
        var low = settings.first_grove_run;
        var high = last_run;
        while high > low + 1u {
            let middle = (low + high) / 2u;
            let is_after = runs[middle].first_item > place;
            high = select(high, middle, is_after);
            low = select(middle, low, is_after);
        }
        let run = runs[low];
        let skipped = (place - run.first_item) * POINTS_PER_ITEM;
        let count = min(run.points - skipped, POINTS_PER_ITEM);
        let first_point = run.first_point + skipped;
        let first_instance = instance_blocks[run.instance].first_instance;
        let index = settings.item_capacity - 1u - first_item - place;
        items[index] = WorkItem(first_instance, first_point, count | (settings.window << 8u) | OF_GROVE, 0.0);
        splat_items[index].first_point = first_point;
        splat_items[index].area = instance_blocks[run.instance].fade_begin;
        splat_items[index].leaf_overlap = instance_blocks[run.instance].fade_end;
        splat_items[index].count_flags = count | ((first_instance / GROVE_UNIT) << 8u);
        atomicAdd(&group_points, count);
    }
    workgroupBarrier();
    if lane == 0u {
        atomicAdd(&counters.points, atomicLoad(&group_points));
        atomicAdd(&counters.second_points, select(0u, atomicLoad(&group_points), settings.phase == 1u));
    }
}
