// Resolve of four samples a pixel: each surfel that any of them shows is shaded once and counts as often as it is shown.
//
// Two draws of one quad per covered block. Pixels with four covered samples are opaque: before the opaque pass, with
// depth. The others blend with what is behind them, so they come after it (`TREELINE_EDGES`) and leave the depth as it is.
#import bevy_pbr::mesh_view_bindings::view
#import bevy_treeline::block_quad::block_corner
#import bevy_treeline::shade::{blocks, shade, visibility}

@vertex
fn resolve_samples_vertex(@builtin(vertex_index) corner: u32, @builtin(instance_index) quad: u32) -> @builtin(position) vec4<f32> {
    return block_corner(blocks[quad], corner, view.viewport.zw);
}

struct Resolved {
    @location(0) color: vec4<f32>,
    @builtin(frag_depth) depth: f32,
}

@fragment
fn resolve_samples(@builtin(position) frag_coord: vec4<f32>) -> Resolved {
    let size = vec2<u32>(view.viewport.zw);
    let pixel = min(vec2<u32>(frag_coord.xy - view.viewport.xy), size - 1u);
    var texels: array<vec2<u32>, 4>;
    var covered = 0u;
    var nearest = 0.0;
    var farthest = 1.0;
    for (var i = 0u; i < 4u; i++) {
        let at = 2u * pixel + vec2(i & 1u, i >> 1u);
        texels[i] = visibility[at.y * 2u * size.x + at.x];
        if texels[i].x != 0u {
            covered += 1u;
            nearest = max(nearest, bitcast<f32>(texels[i].y));
            farthest = min(farthest, bitcast<f32>(texels[i].y));
        }
    }
#ifdef TREELINE_EDGES
    if covered == 0u || covered == 4u {
        discard;
    }
#else
    if covered < 4u {
        discard;
    }
#endif
    var color = vec4(0.0);
    for (var i = 0u; i < 4u; i++) {
        let payload = texels[i].x;
        var is_shaded = payload == 0u;
        var share = 0.0;
        for (var j = 0u; j < 4u; j++) {
            let is_same = texels[j].x == payload;
            is_shaded = is_shaded || (is_same && j < i);
            share += select(0.0, 0.25, is_same);
        }
        if is_shaded {
            continue;
        }
        let center = vec2<f32>(2u * pixel + vec2(i & 1u, i >> 1u)) * 0.5 + 0.25;
        color += share * vec4(shade(texels[i], center, frag_coord.xy).rgb, 1.0);
    }
#ifdef TREELINE_EDGES
    // Premultiplied. In front of what is behind the nearest of its samples.
    return Resolved(color, nearest);
#else
    // A mesh among the samples shows: the opaque pass draws it over the farthest.
    return Resolved(color, farthest);
#endif
}
