// Culls the trees of the listed blocks, and counts the runs and work items of those that are drawn whole.
//
// One workgroup per listed block, one thread per instance. In: species, instances, blocks, pyramids. Out: a TreeDraw for
// each thread, which later passes and the second phase read instead of asking again; `runs` and `items` of each block; a list of
// the trees that are looked at cluster by cluster. O(instances in listed blocks). CPU twin: src/forest/select.rs.
#import bevy_treeline::culling::{REACH, all_of, hides, sphere_outside}
#import bevy_treeline::instance::{NOT_RESIDENT, matrix_of, rotation_of, species_of, tree_instance}
#import bevy_treeline::lod::{disc_radius, factor_between, factor_place, factor_words, level_clusters, level_of}
#import bevy_treeline::select_bindings::{HAS_HIDDEN, LISTED, SECOND, WAS_HIDDEN, WAS_PARTLY_HIDDEN, WORKGROUP, block_index, counters, instance_count, item_count, settings, view}
#import bevy_treeline::selection::wanted_points
#import bevy_treeline::types::{InstanceBlock, Species, TreeDraw, TreeLook, TreePlace, ViewBlock}

@group(1) @binding(1) var<storage, read> instance_blocks: array<InstanceBlock>;
@group(1) @binding(2) var<storage, read_write> view_blocks: array<ViewBlock>;
@group(1) @binding(3) var<storage, read> species: array<Species>;
@group(1) @binding(4) var<storage, read> places: array<TreePlace>;
@group(1) @binding(5) var<storage, read> looks: array<TreeLook>;
@group(1) @binding(6) var<storage, read_write> draws: array<TreeDraw>;

// Why a tree is not drawn, or that it is.
const DRAWN: u32 = 0u;
const ABSENT: u32 = 1u;
const OUTSIDE: u32 = 2u;
const SMALL: u32 = 3u;
const MESH: u32 = 4u;
const OCCLUDED: u32 = 5u;
// Drawn in the first phase, and all of it.
const OTHER_PHASE: u32 = 6u;
// Not a verdict: trees that fade.
const FADING: u32 = 7u;

var<workgroup> group_runs: atomic<u32>;
var<workgroup> group_items: atomic<u32>;
var<workgroup> group_hidden: atomic<u32>;
// Trees by verdict, and those that fade.
var<workgroup> verdicts: array<atomic<u32>, 8>;

struct Tree {
    verdict: u32,
    count: u32,
    radius: f32,
    // Clusters of its level.
    all: u32,
    fading: bool,
}

// What is drawn of a tree. `asks_pyramid`: unless a pyramid hides it.
fn select_tree(block: InstanceBlock, lane: u32, asks_pyramid: bool) -> Tree {
    var tree = Tree(ABSENT, 0u, 0.0, 0u, false);
    let instance = tree_instance(places[block.first_instance + lane], looks[block.first_instance + lane]);
    let kind_index = species_of(instance.look);
    if kind_index == NOT_RESIDENT {
        return tree;
    }
    let kind = species[kind_index];
    let turned = matrix_of(rotation_of(instance.look));
    let placed = mat3x3<f32>(turned[0] * instance.scale, turned[1] * instance.scale, turned[2] * instance.scale);
    let center = instance.position + placed * kind.center;
    tree.verdict = OUTSIDE;
    if sphere_outside(center, kind.radius * instance.scale) {
        return tree;
    }
    // A parallel view has the same scale everywhere: distance 1, where Z0 holds.
    let eye = select(view.world_position, settings.culling_eye, settings.culling_frozen != 0u);
    let d = select(distance(center, eye), 1.0, settings.orthographic != 0u);
    let wanted = wanted_points(settings, instance, kind, d, block.fade_begin, block.fade_end);
    tree.fading = wanted.fading;
    tree.verdict = select(SMALL, MESH, wanted.as_mesh);
    if wanted.as_mesh || wanted.count == 0u {
        return tree;
    }
    let place = factor_place(wanted.full, f32(kind.point_count));
    let words = factor_words(place);
    let factor = factor_between(species[kind_index].area_factors[words.x], species[kind_index].area_factors[words.y], place);
    tree.verdict = DRAWN;
    tree.count = wanted.count;
    tree.radius = disc_radius(kind.surface_area * instance.scale * instance.scale * factor, wanted.full);
    tree.all = all_of(level_clusters(level_of(tree.count, kind.level_count)).y);
    let lo = instance.position + placed * kind.lo;
    let edges = mat3x3<f32>(placed[0] * kind.extent.x, placed[1] * kind.extent.y, placed[2] * kind.extent.z);
    if asks_pyramid && hides(lo, edges, REACH * tree.radius) {
        tree.verdict = OCCLUDED;
    }
    return tree;
}

@compute @workgroup_size(#{SELECT_WORKGROUP})
fn cull_instances(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    // A software driver reads this once for all threads of the workgroup, but only before the first branch.
    let place = block_index(group, groups);
    let listed = view_blocks[min(place, settings.block_count - 1u)].listed;
    let is_listed = place < settings.block_count && listed < settings.block_count;
    let index = select(0u, listed, is_listed);
    let state = view_blocks[index].state;
    let block = instance_blocks[view_blocks[index].block];
    // Workgroup memory is not cleared for us.
    if lane == 0u {
        atomicStore(&group_runs, 0u);
        atomicStore(&group_items, 0u);
        atomicStore(&group_hidden, 0u);
    }
    if lane < 8u {
        atomicStore(&verdicts[lane], 0u);
    }
    workgroupBarrier();
    let block_was_hidden = (state & WAS_HIDDEN) != 0u;
    if is_listed {
        let slot = index * WORKGROUP + lane;
        // The second phase knows what the first has found, unless that has not come here.
        var first_count = 0u;
        var first_mask = 0u;
        if SECOND && !block_was_hidden {
            first_count = draws[slot].count;
            first_mask = draws[slot].mask;
        }
        let is_partly_drawn = first_mask != 0u;
        var tree = Tree(ABSENT, 0u, 0.0, 0u, false);
        if lane < instance_count(block) {
            if SECOND && !block_was_hidden && (first_count & WAS_PARTLY_HIDDEN) == 0u {
                tree.verdict = OTHER_PHASE;
            } else {
                tree = select_tree(block, lane, settings.occlusion != 0u && !is_partly_drawn);
            }
        }
        let is_hidden = tree.verdict == OCCLUDED;
        let is_whole = tree.all == 1u;
        draws[slot].count = tree.count | select(0u, WAS_PARTLY_HIDDEN, is_hidden);
        draws[slot].radius = tree.radius;
        draws[slot].mask = select(0u, tree.all & ~first_mask, tree.verdict == DRAWN);
        if tree.verdict == DRAWN && is_whole {
            atomicAdd(&group_runs, 1u);
            atomicAdd(&group_items, item_count(tree.count));
        }
        if tree.verdict == DRAWN && !is_whole {
            draws[atomicAdd(&counters.near_trees, 1u)].near = slot;
        }
        if is_hidden || !is_whole {
            atomicAdd(&group_hidden, select(0u, 1u, tree.count > 0u));
        }
        atomicAdd(&verdicts[tree.verdict], 1u);
        if tree.fading {
            atomicAdd(&verdicts[FADING], 1u);
        }
    }
    workgroupBarrier();
    if lane != 0u || !is_listed {
        return;
    }
    atomicStore(&view_blocks[index].runs, atomicLoad(&group_runs));
    atomicStore(&view_blocks[index].items, atomicLoad(&group_items));
    atomicAdd(&counters.culled_occluded, select(0u, atomicLoad(&verdicts[OCCLUDED]), SECOND));
    if SECOND && !block_was_hidden {
        // The first phase has counted the others.
        return;
    }
    let all = WORKGROUP - atomicLoad(&verdicts[ABSENT]);
    atomicAdd(&counters.instances_seen, select(all, 0u, SECOND));
    atomicAdd(&counters.culled_frustum, atomicLoad(&verdicts[OUTSIDE]));
    atomicAdd(&counters.culled_small, atomicLoad(&verdicts[SMALL]));
    atomicAdd(&counters.as_mesh, atomicLoad(&verdicts[MESH]));
    atomicAdd(&counters.in_fade, atomicLoad(&verdicts[FADING]));
    if !SECOND && atomicLoad(&group_hidden) != 0u {
        view_blocks[index].state = state | HAS_HIDDEN;
    }
}
