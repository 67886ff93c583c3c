// Writes the runs of the listed blocks' trees, in the order of blocks, instances and clusters, whatever order threads run in.
//
// One workgroup per listed block, one thread per instance, which asks again what `cull_instances` has asked. O(instances in
// listed blocks + runs). CPU twin: src/forest/select.rs.
#import bevy_treeline::culling::{Draw, clusters, instances, points_of_cluster, runs_and_items, select_instance, species}
#import bevy_treeline::hash::mix_bits
#import bevy_treeline::instance::species_of
#import bevy_treeline::lod::{level_clusters, window_start}
#import bevy_treeline::select_bindings::{LISTED, WAS_HIDDEN, WORKGROUP, block_index, instance_blocks, instance_count, item_count, settings, view_blocks}
#import bevy_treeline::types::Run

@group(2) @binding(0) var<storage, read_write> runs: array<Run>;

var<workgroup> lane_runs: array<u32, #{SELECT_WORKGROUP}>;
var<workgroup> lane_items: array<u32, #{SELECT_WORKGROUP}>;

@compute @workgroup_size(#{SELECT_WORKGROUP})
fn emit_runs(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let place = block_index(group, groups);
    var index = 0u;
    var is_listed = place < settings.block_count;
    if is_listed {
        index = view_blocks[place].listed;
        is_listed = index < settings.block_count;
    }
    var draw: Draw;
    draw.mask = 0u;
    var instance = 0u;
    var kind_index = 0u;
    var own = vec2(0u);
    if is_listed {
        let block = instance_blocks[view_blocks[index].block];
        let state = view_blocks[index].state;
        if (state & LISTED) != 0u && lane < instance_count(block) {
            instance = block.first_instance + lane;
            draw = select_instance(block, lane, (state & WAS_HIDDEN) != 0u);
            if draw.mask != 0u {
                kind_index = species_of(instances[instance]);
                own = runs_and_items(draw, kind_index);
            }
        }
    }
    lane_runs[lane] = own.x;
    lane_items[lane] = own.y;
    workgroupBarrier();
    // Inclusive scan (Hillis and Steele 1986): log2(256) steps.
    for (var step = 1u; step < WORKGROUP; step <<= 1u) {
        var before = vec2(0u);
        if lane >= step {
            before = vec2(lane_runs[lane - step], lane_items[lane - step]);
        }
        workgroupBarrier();
        lane_runs[lane] += before.x;
        lane_items[lane] += before.y;
        workgroupBarrier();
    }
    if draw.mask == 0u {
        return;
    }
    var run = view_blocks[index].runs + lane_runs[lane] - own.x;
    var item = view_blocks[index].items + lane_items[lane] - own.y;
    let kind = species[kind_index];
    let first = kind.first_cluster + level_clusters(draw.level).x;
    for (var mask = draw.mask; mask != 0u; mask &= mask - 1u) {
        let i = countTrailingZeros(mask);
        let points = points_of_cluster(draw, kind, i);
        if points == 0u {
            continue;
        }
        if run >= settings.item_capacity {
            break;
        }
        let cluster = clusters[first + i];
        // Each tree at another turn, so that frames do not differ as a whole.
        let start = select(0u, window_start(points, cluster.count, settings.window + (mix_bits(instance) & 7u)), settings.window > 0u);
        runs[run] = Run(item, instance, cluster.first_point + start, points, draw.radius);
        run += 1u;
        item += item_count(points);
    }
}
