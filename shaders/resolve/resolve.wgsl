// Visibility buffer → lit colour and depth, inside Bevy's main pass.
//
// One quad per covered block of pixels. Runs before the opaque pass, so that terrain hidden by trees is never shaded.
#import bevy_pbr::mesh_view_bindings::view
#import bevy_treeline::block_quad::block_corner
#import bevy_treeline::shade::{blocks, shade, visibility}

@vertex
fn resolve_vertex(@builtin(vertex_index) corner: u32, @builtin(instance_index) quad: u32) -> @builtin(position) vec4<f32> {
    return block_corner(blocks[quad], corner, view.viewport.zw);
}

struct Resolved {
    @location(0) color: vec4<f32>,
    @builtin(frag_depth) depth: f32,
}

@fragment
fn resolve(@builtin(position) frag_coord: vec4<f32>) -> Resolved {
    let size = vec2<u32>(view.viewport.zw);
    let pixel = vec2<u32>(frag_coord.xy - view.viewport.xy);
    let texel = visibility[min(pixel.y, size.y - 1u) * size.x + min(pixel.x, size.x - 1u)];
    if texel.x == 0u {
        discard;
    }
    return Resolved(shade(texel, vec2<f32>(pixel) + 0.5, frag_coord.xy), bitcast<f32>(texel.y));
}
