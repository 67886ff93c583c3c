// Two-pass path without 64-bit atomics, second pass: the point that has the depth found by `splat_depth`.
//
// Of several at the same depth the largest payload wins, as with one 64-bit maximum, so both paths give one picture.
// A point exactly as deep as a prepass mesh replaces it only here; the 64-bit path does the same (payload 0 loses).
#import bevy_treeline::project::{covers, item_place, project}
#import bevy_treeline::splat_bindings::{grid_size, payload_of, phase_items}

@group(1) @binding(0) var<storage, read_write> visibility: array<atomic<u32>>;

@compute @workgroup_size(#{POINTS_PER_ITEM})
fn splat_payload(@builtin(workgroup_id) group: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
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
            let i = 2u * (u32(y) * grid_size().x + u32(x));
            if splat.depth == atomicLoad(&visibility[i + 1u]) {
                atomicMax(&visibility[i], payload_of(item_place(place), lane));
            }
        }
    }
}
