// Fills the visibility buffer with the depth of the meshes drawn by the prepass, or clears it. Points behind them are
// then rejected by the same test that rejects points behind points.
//
// One thread per sample. The samples of a pixel share the depth of its centre.
#import bevy_treeline::splat_bindings::{grid_size, settings}

// Two words a sample: payload, depth bits; as u64 the depth is the high half.
@group(1) @binding(0) var<storage, read_write> visibility: array<vec2<u32>>;
@group(1) @binding(1) var prepass_depth: texture_depth_2d;

@compute @workgroup_size(64)
fn init_visibility(@builtin(global_invocation_id) id: vec3<u32>) {
    let grid = grid_size();
    if id.x >= grid.x || id.y >= grid.y {
        return;
    }
    var depth = 0.0;
    if settings.has_prepass != 0u {
        depth = textureLoad(prepass_depth, vec2<i32>(id.xy / settings.samples_per_side + settings.origin), 0);
    }
    visibility[id.y * grid.x + id.x] = vec2(0u, bitcast<u32>(depth));
}
