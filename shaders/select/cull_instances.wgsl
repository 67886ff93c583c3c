// Culls instances and decides how many points of each are drawn.
//
// One workgroup per block of the view, one thread per instance. In: species, instances, blocks, view. Out: `draws`
// (points and splat radius of each instance) and `block_items` (work items of each block). O(instances in blocks).
// CPU twin: src/forest/select.rs.
#import bevy_treeline::hash::unit_from_bits
#import bevy_treeline::instance::{NOT_RESIDENT, has_mesh, hash_of, rotate, rotation_of, seed_of, species_of}
#import bevy_treeline::lod::{area_factor, d_zero, disc_radius, fade_band, fade_state, prefix_count, range_share, round_count}
#import bevy_treeline::select_bindings::{WORKGROUP, block_index, block_items, counters, draws, instances, item_count, settings, species, view, view_blocks}
#import bevy_treeline::types::{InstanceDraw, ViewBlock}

var<workgroup> group_items: atomic<u32>;

fn outside_frustum(center: vec3<f32>, radius: f32) -> bool {
    if settings.culling_frozen != 0u {
        for (var i = 0u; i < 4u; i++) {
            let plane = settings.culling_planes[i];
            if dot(plane.xyz, center) + plane.w < -radius {
                return true;
            }
        }
        return false;
    }
    // Plane 5 is the far plane, which bounds nothing: the projection is infinite.
    for (var i = 0u; i < 5u; i++) {
        if dot(view.frustum[i].xyz, center) + view.frustum[i].w < -radius {
            return true;
        }
    }
    return false;
}

fn select_instance(block: ViewBlock, lane: u32) -> InstanceDraw {
    var nothing = InstanceDraw(0u, 0.0);
    let instance = instances[block.first_instance + lane];
    let kind_index = species_of(instance);
    if kind_index == NOT_RESIDENT {
        return nothing;
    }
    let kind = species[kind_index];
    atomicAdd(&counters.instances_seen, 1u);
    let center = instance.position + rotate(rotation_of(instance), kind.center * instance.scale);
    if outside_frustum(center, kind.radius * instance.scale) {
        atomicAdd(&counters.culled_frustum, 1u);
        return nothing;
    }
    // An orthographic view has the same scale everywhere: distance 1, where Z0 holds. It draws points only.
    let eye = select(view.world_position, settings.culling_eye, settings.culling_frozen != 0u);
    let d = select(distance(center, eye), 1.0, settings.orthographic != 0u);
    let s = kind.pixel * instance.scale;
    let n0 = f32(kind.point_count);
    let n = prefix_count(n0, s, settings.pixels_per_unit, d, settings.quality);
    var wanted = n;
    if has_mesh(instance) && settings.orthographic == 0u {
        let hash = unit_from_bits(seed_of(instance));
        let band = fade_band(d_zero(s, settings.pixels_per_unit), settings.min_mesh_distance, settings.fade_width, settings.fade_jitter, hash);
        let state = fade_state(band, d);
        if state.points <= 0.0 {
            atomicAdd(&counters.as_mesh, 1u);
            return nothing;
        }
        if state.mesh > 0.0 {
            atomicAdd(&counters.in_fade, 1u);
        }
        wanted *= state.points;
    }
    if settings.orthographic == 0u {
        wanted *= range_share(d, block.fade_begin, block.fade_end);
    }
    let count = round_count(wanted, hash_of(instance));
    if count == 0u {
        atomicAdd(&counters.culled_small, 1u);
        return nothing;
    }
    // The splat size follows the prefix before fading: points leave, they do not grow.
    let scale2 = instance.scale * instance.scale;
    let radius = disc_radius(kind.surface_area * scale2 * area_factor(kind.area_factors, n), n);
    return InstanceDraw(min(count, kind.point_count), radius);
}

@compute @workgroup_size(#{SELECT_WORKGROUP})
fn cull_instances(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    // Workgroup memory is not cleared for us.
    if lane == 0u {
        atomicStore(&group_items, 0u);
    }
    workgroupBarrier();
    let block = block_index(group, groups);
    if block < settings.block_count {
        let view_block = view_blocks[block];
        if lane < view_block.count {
            let draw = select_instance(view_block, lane);
            draws[block * WORKGROUP + lane] = draw;
            atomicAdd(&group_items, item_count(draw.count));
        }
    }
    workgroupBarrier();
    if lane == 0u && block < settings.block_count {
        block_items[block] = atomicLoad(&group_items);
    }
}
