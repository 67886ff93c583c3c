// Decides for each block of instances whether its trees are looked at one by one, drawn as a grove, or hidden.
//
// One thread per block of the view. In: blocks, view, pyramids. Out: `state`, and the runs and items of groves.
// O(blocks in sight).
#import bevy_treeline::culling::{edges_of, is_hidden_now, outside_frustum, was_hidden}
#import bevy_treeline::lod::view_scale
#import bevy_treeline::select_bindings::{GROVE, HAS_HIDDEN, LISTED, SECOND, WAS_HIDDEN, counters, instance_blocks, item_count, resident_count, settings, view, view_blocks}
#import bevy_treeline::types::InstanceBlock

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
    view_blocks[id.x].runs = 0u;
    view_blocks[id.x].items = 0u;
    let block = instance_blocks[view_blocks[id.x].block];
    let half = 0.5 * block.extent;
    let center = block.lo + half;
    if SECOND {
        // Drawn already, and all of it.
        if (before & (WAS_HIDDEN | HAS_HIDDEN)) == 0u {
            view_blocks[id.x].state = 0u;
            return;
        }
        if (before & WAS_HIDDEN) != 0u && is_hidden_now(block.lo, edges_of(block.extent), 0.0) {
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
        if settings.occlusion != 0u && was_hidden(block.lo, edges_of(block.extent), 0.0) {
            atomicAdd(&counters.instances_seen, resident_count(block));
            view_blocks[id.x].state = WAS_HIDDEN;
            return;
        }
    }
    let eye = select(view.world_position, settings.culling_eye, settings.culling_frozen != 0u);
    let nearest = select(distance(clamp(eye, block.lo, block.lo + block.extent), eye), 1.0, settings.orthographic != 0u);
    let k = view_scale(settings.quality, settings.pixels_per_unit, nearest);
    if k < block.complete_below {
        let samples = prefix_length(block, k);
        atomicAdd(&counters.instances_seen, select(0u, resident_count(block), !SECOND));
        atomicAdd(&counters.groves, 1u);
        if samples > 0u {
            view_blocks[id.x].runs = 1u;
            view_blocks[id.x].items = item_count(samples);
            state |= GROVE | (samples << 8u);
        }
    } else {
        state |= LISTED;
    }
    view_blocks[id.x].state = state;
}
