// Draws points into the visibility buffer: one 64-bit atomicMax per covered pixel keeps the nearest.
//
// One workgroup per work item, one thread per point.
#import bevy_treeline::project::{covers, item_place, project}
#import bevy_treeline::splat_bindings::{grid_size, payload_of, phase_items}

@group(1) @binding(0) var<storage, read_write> visibility: array<atomic<u64>>;

@compute @workgroup_size(#{POINTS_PER_ITEM})
fn splat_u64(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let place = group.y * groups.x + group.x;
    // First of all, while the whole workgroup is here: it reads its item once, not once a thread.
    let splat = project(place, lane);
    if place >= phase_items() || !splat.visible {
        return;
    }
    let value = (u64(splat.depth) << 32u) | u64(payload_of(item_place(place), lane));
    for (var y = splat.begin.y; y < splat.end.y; y++) {
        for (var x = splat.begin.x; x < splat.end.x; x++) {
            if !covers(splat, vec2(x, y)) {
                continue;
            }
            let i = u32(y) * grid_size().x + u32(x);
            // The plain load is only a filter: the atomic decides.
            if value > atomicLoad(&visibility[i]) {
                atomicMax(&visibility[i], value);
            }
        }
    }
}
