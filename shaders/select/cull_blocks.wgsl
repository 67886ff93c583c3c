// Decides for each block of instances whether its trees are looked at one by one, drawn as a grove, or hidden.
//
// One thread per block of the view. In: blocks, view, pyramids. Out: `state`, and the runs and items of groves.
// O(blocks in sight).
#import bevy_treeline::culling::{edges_of, hides, outside_frustum}
#import bevy_treeline::lod::view_scale
#import bevy_treeline::select_bindings::{GROVE, HAS_HIDDEN, LISTED, SECOND, WAS_HIDDEN, counters, item_count, resident_count, settings, view}
#import bevy_treeline::types::{InstanceBlock, ViewBlock}

// Blocks of up to WORKGROUP instances, of all forests.
@group(1) @binding(1) var<storage, read> instance_blocks: array<InstanceBlock>;
// Those that the view selects from, front to back. `listed` belongs to no block: it is a list of those that have to be
// looked at tree by tree. `runs` and `items` are those of the block; after `scan_blocks`, the indices of the first.
@group(1) @binding(2) var<storage, read_write> view_blocks: array<ViewBlock>;

// Length of the prefix that a view at `k` may draw of a grove. Twin of `GroveList::prefix_length`.
fn prefix_length(block: InstanceBlock, k: f32) -> u32 {
    let ratio = k / block.top;
    if !(ratio < 1.0) {
        return block.marks[0] & 0xffffu;
    }
    // Octave and place in it are the exponent and the fraction of an f32.
    let bits = bitcast<u32>(ratio);
    let octave = 126u - min(bits >> 23u, 126u);
    if octave >= 15u {
        return block.marks[15] & 0xffffu;
    }
    let fraction = bitcast<f32>((bits & 0x7fffffu) | 0x3f800000u) - 1.0;
    let high = block.marks[octave] & 0xffffu;
    let low = block.marks[octave + 1u] & 0xffffu;
    let between = f32(low) + f32(high - low) * fraction;
    return min(u32(ceil(between)) + (block.marks[octave] >> 16u), high);
}

@compute @workgroup_size(64)
fn cull_blocks(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= settings.block_count {
        return;
    }
    let before = view_blocks[id.x].state;
    var state = before & (WAS_HIDDEN | HAS_HIDDEN);
    if !SECOND {
        state = 0u;
    }
    atomicStore(&view_blocks[id.x].runs, 0u);
    atomicStore(&view_blocks[id.x].items, 0u);
    let block = instance_blocks[view_blocks[id.x].block];
    view_blocks[id.x].first_instance = block.first_instance;
    let half = 0.5 * block.extent;
    let center = block.lo + half;
    if SECOND {
        // Drawn already, and all of it.
        if (before & (WAS_HIDDEN | HAS_HIDDEN)) == 0u {
            view_blocks[id.x].state = 0u;
            return;
        }
        if (before & WAS_HIDDEN) != 0u && hides(block.lo, edges_of(block.extent), 0.0) {
            atomicAdd(&counters.culled_occluded, resident_count(block));
            view_blocks[id.x].state = state;
            return;
        }
    } else {
        if outside_frustum(center, half) {
            atomicAdd(&counters.instances_seen, resident_count(block));
            atomicAdd(&counters.culled_frustum, resident_count(block));
            view_blocks[id.x].state = 0u;
            return;
        }
        if settings.occlusion != 0u && hides(block.lo, edges_of(block.extent), 0.0) {
            atomicAdd(&counters.instances_seen, resident_count(block));
            view_blocks[id.x].state = WAS_HIDDEN;
            return;
        }
    }
    let eye = select(view.world_position, settings.culling_eye, settings.culling_frozen != 0u);
    let nearest = select(distance(clamp(eye, block.lo, block.lo + block.extent), eye), 1.0, settings.orthographic != 0u);
    let k = view_scale(settings.quality, settings.pixels_per_unit, nearest);
    // There is room for what is found out about trees of the first blocks; the others are groves, however this rounds.
    if k < block.complete_below || id.x >= settings.listable_blocks {
        let samples = prefix_length(block, k);
        atomicAdd(&counters.instances_seen, select(0u, resident_count(block), !SECOND));
        atomicAdd(&counters.groves, 1u);
        if samples > 0u {
            atomicStore(&view_blocks[id.x].runs, 1u);
            atomicStore(&view_blocks[id.x].items, item_count(samples));
            state |= GROVE | (samples << 8u);
        }
    } else {
        state |= LISTED;
    }
    view_blocks[id.x].state = state;
}
