// Cuts runs into work items of up to 64 points, and says of each how its points come to the screen.
//
// One thread per item, which finds its run by bisection. O(items log runs). CPU twin: src/forest/select.rs.
#import bevy_treeline::select_bindings::{POINTS_PER_ITEM, block_index, counters, settings, view}
#import bevy_treeline::lod::OF_GROVE
#import bevy_treeline::splat_item::{GROVE_UNIT, splat_item}
#import bevy_treeline::instance::{species_of, tree_instance}
#import bevy_treeline::types::{InstanceBlock, Run, Species, SplatItem, TreeLook, TreePlace, WorkItem}

@group(1) @binding(0) var<storage, read> species: array<Species>;
@group(1) @binding(1) var<storage, read> places: array<TreePlace>;
@group(1) @binding(2) var<storage, read> looks: array<TreeLook>;
@group(1) @binding(3) var<storage, read> runs: array<Run>;
@group(1) @binding(4) var<storage, read_write> items: array<WorkItem>;
@group(1) @binding(5) var<storage, read_write> splat_items: array<SplatItem>;
@group(1) @binding(6) var<storage, read> instance_blocks: array<InstanceBlock>;

var<workgroup> group_points: atomic<u32>;

@compute @workgroup_size(#{POINTS_PER_ITEM})
fn expand_items(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    // Workgroup memory is not cleared for us.
    if lane == 0u {
        atomicStore(&group_points, 0u);
    }
    workgroupBarrier();
    let k = block_index(group, groups) * POINTS_PER_ITEM + lane;
    let tree_items = atomicLoad(&counters.phase_items);
    let grove_items = atomicLoad(&counters.phase_grove_items);
    if k < tree_items + grove_items {
        let of_grove = k >= tree_items;
        let place = select(k, k - tree_items, of_grove);
        // The last run whose first item is not after the place.
        let first_run = select(0u, settings.first_grove_run, of_grove);
        var low = first_run;
        var high = first_run + select(atomicLoad(&counters.phase_runs), atomicLoad(&counters.phase_grove_runs), of_grove);
        while high - low > 1u {
            let middle = (low + high) / 2u;
            let is_after = runs[middle].first_item > place;
            high = select(high, middle, is_after);
            low = select(middle, low, is_after);
        }
        let run = runs[low];
        let skipped = (place - run.first_item) * POINTS_PER_ITEM;
        let count = min(run.points - skipped, POINTS_PER_ITEM);
        let first = run.first_point + skipped;
        let grove_index = settings.item_capacity - 1u - atomicLoad(&counters.first_grove_item) - place;
        let index = select(atomicLoad(&counters.first_item) + place, grove_index, of_grove);
        if of_grove {
            let first_instance = instance_blocks[run.instance].first_instance;
            items[index] = WorkItem(first_instance, first, count | (settings.window << 8u) | OF_GROVE, 0.0);
            splat_items[index].first_point = first;
            splat_items[index].area = instance_blocks[run.instance].fade_begin;
            splat_items[index].leaf_overlap = instance_blocks[run.instance].fade_end;
            splat_items[index].count_flags = count | ((first_instance / GROVE_UNIT) << 8u);
        } else {
            let instance = tree_instance(places[run.instance], looks[run.instance]);
            items[index] = WorkItem(run.instance, first, count, run.radius);
            splat_items[index] = splat_item(view.view_from_world, instance, species[species_of(instance.look)], first, count, run.radius, settings.overlap_gain, settings.splat_shape);
        }
        atomicAdd(&group_points, count);
    }
    workgroupBarrier();
    if lane == 0u {
        atomicAdd(&counters.points, atomicLoad(&group_points));
        atomicAdd(&counters.second_points, select(0u, atomicLoad(&group_points), settings.phase == 1u));
    }
}
