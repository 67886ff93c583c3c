// The depth pyramid, finest level: the farthest depth of each square of 4×4 pixels of the visibility buffer, which holds
// meshes and splats alike.
//
// One thread per texel. CPU twin: `pyramid` in src/math/occlusion.rs.
#import bevy_treeline::occlusion::{pyramid_side, pyramid_size}
#import bevy_treeline::types::SelectSettings

@group(0) @binding(0) var<uniform> settings: SelectSettings;
// Payload, depth bits.
@group(0) @binding(1) var<storage, read> visibility: array<vec2<u32>>;
@group(0) @binding(2) var<storage, read_write> pyramid: array<f32>;

// Of a sample, of which a pixel has one or 2 × 2.
fn depth_at(x: u32, y: u32) -> f32 {
    let grid = settings.size * settings.samples_per_side;
    let row = min(y, grid.y - 1u) * grid.x;
    return bitcast<f32>(visibility[row + min(x, grid.x - 1u)].y);
}

@compute @workgroup_size(64)
fn build_pyramid(@builtin(global_invocation_id) id: vec3<u32>) {
    let texels = pyramid_size(settings.size, 0u);
    if id.x >= texels.x * texels.y {
        return;
    }
    let side = pyramid_side(0u) * settings.samples_per_side;
    let begin = vec2(id.x % texels.x, id.x / texels.x) * side;
    let end = min(begin + side, settings.size * settings.samples_per_side);
    var farthest = 1.0;
    // SelectSettings.occlusion: 1 takes every pixel as it is; 2 closes holes of a pixel.
    if settings.occlusion == 2u {
        for (var y = begin.y; y < end.y; y += 2u) {
            for (var x = begin.x; x < end.x; x += 2u) {
                let upper = max(depth_at(x, y), depth_at(x + 1u, y));
                let lower = max(depth_at(x, y + 1u), depth_at(x + 1u, y + 1u));
                farthest = min(farthest, max(upper, lower));
            }
        }
    } else {
        for (var y = begin.y; y < end.y; y++) {
            for (var x = begin.x; x < end.x; x++) {
                farthest = min(farthest, depth_at(x, y));
            }
        }
    }
    pyramid[settings.pyramid_current + id.x] = farthest;
}
