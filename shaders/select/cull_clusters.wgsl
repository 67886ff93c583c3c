// Culls the clusters of near trees: of each, frustum and occlusion; and counts their runs and work items.
//
// One workgroup per near tree, one thread per cluster. In: the draws of `cull_instances`, whose mask says which clusters may be
// drawn. Out: the mask of those that are; `runs` and `items` of their blocks. O(near trees).
#import bevy_treeline::culling::{REACH, all_of, hides, sphere_outside}
#import bevy_treeline::instance::{matrix_of, rotation_of, species_of, tree_instance}
#import bevy_treeline::lod::{cluster_points, level_clusters, level_of, list_points}
#import bevy_treeline::select_bindings::{SECOND, WAS_PARTLY_HIDDEN, WORKGROUP, block_index, counters, item_count, settings}
#import bevy_treeline::types::{Cluster, Species, TreeDraw, TreeLook, TreePlace, ViewBlock}

@group(1) @binding(1) var<storage, read> clusters: array<Cluster>;
@group(1) @binding(2) var<storage, read_write> view_blocks: array<ViewBlock>;
@group(1) @binding(3) var<storage, read> species: array<Species>;
@group(1) @binding(4) var<storage, read> places: array<TreePlace>;
@group(1) @binding(5) var<storage, read> looks: array<TreeLook>;
@group(1) @binding(6) var<storage, read_write> draws: array<TreeDraw>;

var<workgroup> drawn: atomic<u32>;
var<workgroup> hidden: atomic<u32>;
var<workgroup> group_runs: atomic<u32>;
var<workgroup> group_items: atomic<u32>;

@compute @workgroup_size(32)
fn cull_clusters(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let place = block_index(group, groups);
    let slot = draws[place].near;
    let index = slot / WORKGROUP;
    // Workgroup memory is not cleared for us.
    if lane == 0u {
        atomicStore(&drawn, 0u);
        atomicStore(&hidden, 0u);
        atomicStore(&group_runs, 0u);
        atomicStore(&group_items, 0u);
    }
    workgroupBarrier();
    // The grid may have more workgroups than there are trees.
    let is_there = place < atomicLoad(&counters.near_trees);
    let count = draws[slot].count;
    let candidates = draws[slot].mask;
    let instance_index = view_blocks[index].first_instance + slot % WORKGROUP;
    let instance = tree_instance(places[instance_index], looks[instance_index]);
    let kind = species[species_of(instance.look)];
    let level = level_of(count, kind.level_count);
    let list = level_clusters(level);
    if is_there && lane < list.y && (candidates & (1u << lane)) != 0u {
        let cluster = clusters[kind.first_cluster + list.x + lane];
        var is_drawn = true;
        if settings.occlusion != 0u {
            let reach = REACH * draws[slot].radius;
            let turned = matrix_of(rotation_of(instance.look));
            let placed = mat3x3<f32>(turned[0] * instance.scale, turned[1] * instance.scale, turned[2] * instance.scale);
            let lo = instance.position + placed * cluster.lo;
            let edges = mat3x3<f32>(placed[0] * cluster.extent.x, placed[1] * cluster.extent.y, placed[2] * cluster.extent.z);
            let middle = lo + 0.5 * (edges[0] + edges[1] + edges[2]);
            let is_inside = !sphere_outside(middle, 0.5 * length(cluster.extent) * instance.scale + reach);
            let is_hidden = hides(lo, edges, reach);
            atomicOr(&hidden, select(0u, 1u << lane, is_inside && is_hidden));
            is_drawn = is_inside && !is_hidden;
        }
        if is_drawn {
            let points = cluster_points(count, cluster.count, list_points(level, kind.level_count, kind.point_count));
            atomicOr(&drawn, 1u << lane);
            atomicAdd(&group_runs, min(points, 1u));
            atomicAdd(&group_items, item_count(points));
        }
    }
    workgroupBarrier();
    if lane != 0u || !is_there {
        return;
    }
    draws[slot].mask = atomicLoad(&drawn);
    atomicAdd(&view_blocks[index].runs, atomicLoad(&group_runs));
    atomicAdd(&view_blocks[index].items, atomicLoad(&group_items));
    if SECOND {
        atomicAdd(&counters.culled_occluded, select(0u, 1u, atomicLoad(&hidden) == all_of(list.y)));
    } else if atomicLoad(&hidden) != 0u {
        draws[slot].count = count | WAS_PARTLY_HIDDEN;
    }
}
