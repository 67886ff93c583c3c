// Two-pass path without 64-bit atomics, first pass: the nearest depth of every pixel.
//
// One workgroup per work item, one thread per point. `splat_payload` follows.
#import bevy_treeline::project::{covers, project}
#import bevy_treeline::splat_bindings::{grid_size, phase_items}

// As the 64-bit buffer lies in memory: payload, depth bits, payload, …
@group(1) @binding(0) var<storage, read_write> visibility: array<atomic<u32>>;

@compute @workgroup_size(#{POINTS_PER_ITEM})
fn splat_depth(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let place = group.y * groups.x + group.x;
    // First of all, while the whole workgroup is here: it reads its item once, not once a thread.
    let splat = project(place, lane);
    if place >= phase_items() || !splat.visible {
        return;
    }
    for (var y = splat.begin.y; y < splat.end.y; y++) {
        for (var x = splat.begin.x; x < splat.end.x; x++) {
            if !covers(splat, vec2(x, y)) {
                continue;
            }
            let i = 2u * (u32(y) * grid_size().x + u32(x)) + 1u;
            if splat.depth > atomicLoad(&visibility[i]) {
                atomicMax(&visibility[i], splat.depth);
            }
        }
    }
}
