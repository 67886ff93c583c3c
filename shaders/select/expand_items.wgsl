// Cuts the runs of trees into work items of up to 64 points, and says of each how its points come to the screen.
//
// One thread per item, which finds its run by bisection: one of the 64 that begin with the one that `emit_runs` has found for
// the workgroup's first item, since every run has an item. O(items log 64). CPU twin: src/forest/select.rs.
#import bevy_treeline::instance::{species_of, tree_instance}
#import bevy_treeline::select_bindings::{POINTS_PER_ITEM, block_index, counters, settings, view}
#import bevy_treeline::splat_item::splat_item
#import bevy_treeline::types::{Run, Species, SplatItem, TreeLook, TreePlace, WorkItem}

@group(1) @binding(0) var<storage, read> species: array<Species>;
@group(1) @binding(1) var<storage, read> places: array<TreePlace>;
@group(1) @binding(2) var<storage, read> looks: array<TreeLook>;
@group(1) @binding(3) var<storage, read> runs: array<Run>;
@group(1) @binding(4) var<storage, read_write> items: array<WorkItem>;
@group(1) @binding(5) var<storage, read_write> splat_items: array<SplatItem>;

var<workgroup> group_points: atomic<u32>;
// The run of the workgroup's first item.
var<workgroup> head: u32;

@compute @workgroup_size(#{POINTS_PER_ITEM})
fn expand_items(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let first = block_index(group, groups) * POINTS_PER_ITEM;
    let first_item = atomicLoad(&counters.first_item);
    let fitting = atomicLoad(&counters.phase_items);
    let last_run = atomicLoad(&counters.phase_runs);
    // Workgroup memory is not cleared for us. The thread that reads the head is the one that writes an item over it.
    if lane == 0u {
        atomicStore(&group_points, 0u);
        head = items[min(first_item + first, settings.item_capacity - 1u)].instance;
    }
    workgroupBarrier();
    let place = first + lane;
    // The grid may have more workgroups than there are items.
    if place < fitting {
        // The last run whose first item is not after the place.
        var low = head;
        var high = min(head + POINTS_PER_ITEM, last_run);
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
        let instance = tree_instance(places[run.instance], looks[run.instance]);
        items[first_item + place] = WorkItem(run.instance, first_point, count, run.radius);
        splat_items[first_item + place] = splat_item(view.view_from_world, instance, species[species_of(instance.look)], first_point, count, run.radius, settings.overlap_gain, settings.splat_shape);
        atomicAdd(&group_points, count);
    }
    workgroupBarrier();
    if lane == 0u {
        atomicAdd(&counters.points, atomicLoad(&group_points));
        atomicAdd(&counters.second_points, select(0u, atomicLoad(&group_points), settings.phase == 1u));
    }
}
