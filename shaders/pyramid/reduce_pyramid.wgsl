// The coarser levels of the depth pyramid, one from the other: the farthest of 4×4 texels.
//
// One workgroup. O(texels of the finest level / 256). CPU twin: `pyramid` in src/math/occlusion.rs.
#import bevy_treeline::occlusion::{PYRAMID_LEVELS, pyramid_offset, pyramid_size}
#import bevy_treeline::types::SelectSettings

@group(0) @binding(0) var<uniform> settings: SelectSettings;
@group(0) @binding(2) var<storage, read_write> pyramid: array<f32>;

@compute @workgroup_size(#{SELECT_WORKGROUP})
fn reduce_pyramid(@builtin(local_invocation_index) lane: u32) {
    for (var level = 1u; level < PYRAMID_LEVELS; level++) {
        let finer = pyramid_size(settings.size, level - 1u);
        let finer_first = settings.pyramid_current + pyramid_offset(settings.size, level - 1u);
        let texels = pyramid_size(settings.size, level);
        let first = settings.pyramid_current + pyramid_offset(settings.size, level);
        for (var i = lane; i < texels.x * texels.y; i += #{SELECT_WORKGROUP}u) {
            let begin = vec2(i % texels.x, i / texels.x) * 4u;
            let end = min(begin + 4u, finer);
            var farthest = 1.0;
            for (var y = begin.y; y < end.y; y++) {
                for (var x = begin.x; x < end.x; x++) {
                    farthest = min(farthest, pyramid[finer_first + y * finer.x + x]);
                }
            }
            pyramid[first + i] = farthest;
        }
        storageBarrier();
    }
}
