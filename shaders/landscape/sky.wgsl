// Clear sky where nothing else was drawn: a triangle over the screen at infinity.
#import bevy_pbr::mesh_view_bindings::view
#import bevy_treeline::landscape::{frame, sky_color, with_haze}
#ifdef TONEMAP_IN_SHADER
#import bevy_core_pipeline::tonemapping::tone_mapping
#endif

struct SkyVertex {
    @builtin(position) clip: vec4<f32>,
    @location(0) ray: vec3<f32>,
}

@vertex
fn sky_vertex(@location(0) position: vec3<f32>) -> SkyVertex {
    var out: SkyVertex;
    out.clip = vec4(position.xy, 0.0, 1.0);
    // Straight lines on the near plane stay straight.
    let near = view.world_from_clip * vec4(position.xy, 1.0, 1.0);
    out.ray = near.xyz / near.w - view.world_position;
    return out;
}

@fragment
fn sky(in: SkyVertex) -> @location(0) vec4<f32> {
    let direction = normalize(in.ray);
    var color = sky_color(direction);
    if direction.y < 0.0 {
        // Beyond the end of the ground: as ground hidden by haze.
        color = mix(with_haze(color, direction, 1e9), color, saturate(1.0 + direction.y * 60.0));
    }
    let towards = dot(direction, frame.sun_direction.xyz);
    let disc = smoothstep(0.999965, 0.99998, towards);
    color += frame.disc.rgb * (disc * 1000.0 * view.exposure);
    var out = vec4(color, 1.0);
#ifdef TONEMAP_IN_SHADER
    out = tone_mapping(out, view.color_grading);
#endif
    return out;
}
