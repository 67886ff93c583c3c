// Writes the runs of the trees of blocks that have one, in the order of blocks, instances and clusters, whatever order threads run in.
//
// One workgroup per block of the list that `scan_blocks` has made, one thread per instance, which reads what culling has found
// out. O(instances in these blocks + runs). CPU twin: src/forest/select.rs.
#import bevy_treeline::hash::mix_bits
#import bevy_treeline::instance::species_of
#import bevy_treeline::lod::{cluster_points, level_clusters, level_of, list_points, window_start}
#import bevy_treeline::prefix_sum::prefix_sum
#import bevy_treeline::select_bindings::{POINTS_PER_ITEM, WAS_PARTLY_HIDDEN, WORKGROUP, block_index, counters, item_count, settings}
#import bevy_treeline::types::{Cluster, Run, Species, TreeDraw, TreeLook, ViewBlock, WorkItem}

@group(1) @binding(0) var<storage, read_write> runs: array<Run>;
@group(1) @binding(1) var<storage, read> clusters: array<Cluster>;
@group(1) @binding(2) var<storage, read_write> view_blocks: array<ViewBlock>;
@group(1) @binding(3) var<storage, read> species: array<Species>;
@group(1) @binding(4) var<storage, read> looks: array<TreeLook>;
@group(1) @binding(5) var<storage, read> draws: array<TreeDraw>;
@group(1) @binding(6) var<storage, read_write> items: array<WorkItem>;

// Points that a tree of `count` takes from a cluster of its level, of which all have `all`.
fn points_of_cluster(count: u32, level: u32, size: u32, all: u32) -> u32 {
    return select(cluster_points(count, size, all), count, level == 0u);
}

@compute @workgroup_size(#{SELECT_WORKGROUP})
fn emit_runs(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let place = block_index(group, groups);
    let listed = view_blocks[min(place, settings.block_count - 1u)].listed;
    let is_listed = place < settings.block_count && listed < settings.block_count;
    let index = select(0u, listed, is_listed);
    // Of the block.
    let first = vec2(atomicLoad(&view_blocks[index].runs), atomicLoad(&view_blocks[index].items));
    let first_item = atomicLoad(&counters.first_item);
    let fitting = atomicLoad(&counters.phase_items);
    let slot = index * WORKGROUP + lane;
    let instance = view_blocks[index].first_instance + lane;
    let count = draws[slot].count & ~WAS_PARTLY_HIDDEN;
    let mask = select(0u, draws[slot].mask, is_listed);
    var level = 0u;
    var first_cluster = 0u;
    // Points in all lists of its level.
    var all = 0u;
    var own = vec2(0u);
    if mask != 0u {
        let kind_index = species_of(looks[instance]);
        let level_count = species[kind_index].level_count;
        level = level_of(count, level_count);
        first_cluster = species[kind_index].first_cluster + level_clusters(level).x;
        all = list_points(level, level_count, species[kind_index].point_count);
        for (var left = mask; left != 0u; left &= left - 1u) {
            let points = points_of_cluster(count, level, clusters[first_cluster + countTrailingZeros(left)].count, all);
            own += vec2(min(points, 1u), item_count(points));
        }
    }
    let before = first + prefix_sum(lane, own).before;
    var run = before.x;
    var item = before.y;
    for (var left = mask; left != 0u; left &= left - 1u) {
        let cluster = first_cluster + countTrailingZeros(left);
        let size = clusters[cluster].count;
        let points = points_of_cluster(count, level, size, all);
        if points == 0u {
            continue;
        }
        if run >= settings.item_capacity {
            break;
        }
        // Each tree at another turn, so that frames do not differ as a whole.
        let start = select(0u, window_start(points, size, settings.window + (mix_bits(instance) & 7u)), settings.window > 0u);
        runs[run] = Run(item, instance, clusters[cluster].first_point + start, points, draws[slot].radius);
        // Tells each workgroup of `expand_items` the run of its first item, where it will write that item.
        let end = item + item_count(points);
        for (var head = item_count(item) * POINTS_PER_ITEM; head < min(end, fitting); head += POINTS_PER_ITEM) {
            items[first_item + head].instance = run;
        }
        run += 1u;
        item = end;
    }
}
