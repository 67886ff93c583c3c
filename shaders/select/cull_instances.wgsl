// Culls the trees of the listed blocks and counts the runs and work items of each block.
//
// One workgroup per listed block, one thread per instance. In: species, clusters, instances, blocks, pyramids. Out: `runs`
// and `items` of each block. O(instances in listed blocks). CPU twin: src/forest/select.rs.
#import bevy_treeline::culling::{ABSENT, DRAWN, MESH, OCCLUDED, OUTSIDE, SMALL, instances, runs_and_items, select_instance}
#import bevy_treeline::instance::species_of
#import bevy_treeline::select_bindings::{HAS_HIDDEN, LISTED, SECOND, WAS_HIDDEN, block_index, counters, instance_blocks, instance_count, settings, view_blocks}

var<workgroup> group_runs: atomic<u32>;
var<workgroup> group_items: atomic<u32>;
var<workgroup> group_hidden: atomic<u32>;
// Trees by verdict, and those that fade.
var<workgroup> verdicts: array<atomic<u32>, 8>;

@compute @workgroup_size(#{SELECT_WORKGROUP})
fn cull_instances(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
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
    let place = block_index(group, groups);
    var index = 0u;
    var is_listed = place < settings.block_count;
    if is_listed {
        index = view_blocks[place].listed;
        is_listed = index < settings.block_count;
    }
    if is_listed {
        let block = instance_blocks[view_blocks[index].block];
        let state = view_blocks[index].state;
        if (state & LISTED) != 0u && lane < instance_count(block) {
            let draw = select_instance(block, lane, (state & WAS_HIDDEN) != 0u);
            atomicAdd(&verdicts[draw.verdict], 1u);
            if draw.fading {
                atomicAdd(&verdicts[7], 1u);
            }
            if draw.hidden != 0u {
                atomicAdd(&group_hidden, 1u);
            }
            if draw.mask != 0u {
                let sum = runs_and_items(draw, species_of(instances[block.first_instance + lane]));
                atomicAdd(&group_runs, sum.x);
                atomicAdd(&group_items, sum.y);
            }
        }
    }
    workgroupBarrier();
    if lane != 0u || !is_listed {
        return;
    }
    view_blocks[index].runs = atomicLoad(&group_runs);
    view_blocks[index].items = atomicLoad(&group_items);
    atomicAdd(&counters.culled_occluded, select(0u, atomicLoad(&verdicts[OCCLUDED]), SECOND));
    let state = view_blocks[index].state;
    if SECOND && (state & WAS_HIDDEN) == 0u {
        // The first phase has counted the others.
        return;
    }
    let absent = atomicLoad(&verdicts[ABSENT]);
    let all = instance_count(instance_blocks[view_blocks[index].block]) - absent;
    atomicAdd(&counters.instances_seen, select(all, 0u, SECOND));
    atomicAdd(&counters.culled_frustum, atomicLoad(&verdicts[OUTSIDE]));
    atomicAdd(&counters.culled_small, atomicLoad(&verdicts[SMALL]));
    atomicAdd(&counters.as_mesh, atomicLoad(&verdicts[MESH]));
    atomicAdd(&counters.in_fade, atomicLoad(&verdicts[7]));
    if !SECOND && atomicLoad(&group_hidden) != 0u {
        view_blocks[index].state = state | HAS_HIDDEN;
    }
}
