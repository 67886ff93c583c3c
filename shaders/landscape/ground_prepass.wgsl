// The same vertices as in `ground.wgsl`, for prepasses and shadow maps.
#import bevy_pbr::mesh_view_bindings::view
#import bevy_treeline::landscape::{GroundChunk, ground_point}
#ifdef MOTION_VECTOR_PREPASS
#import bevy_pbr::prepass_bindings::previous_view_uniforms
#endif
#ifdef PREPASS_FRAGMENT
#import bevy_pbr::prepass_io::FragmentOutput
#endif

@group(#{MATERIAL_BIND_GROUP}) @binding(1) var<uniform> chunk: GroundChunk;

struct GroundPrepassVertex {
    @builtin(position) @invariant clip: vec4<f32>,
    @location(0) world: vec3<f32>,
#ifdef UNCLIPPED_DEPTH_ORTHO_EMULATION
    @location(1) unclipped_depth: f32,
#endif
}

@vertex
fn ground_prepass_vertex(@location(0) position: vec3<f32>, @location(1) morph: vec2<f32>) -> GroundPrepassVertex {
    var out: GroundPrepassVertex;
    out.world = ground_point(chunk, position.y, morph.x, morph.y).world;
    out.clip = view.clip_from_world * vec4(out.world, 1.0);
#ifdef UNCLIPPED_DEPTH_ORTHO_EMULATION
    out.unclipped_depth = out.clip.z;
    out.clip.z = min(out.clip.z, 1.0);
#endif
    return out;
}

#ifdef PREPASS_FRAGMENT
@fragment
fn ground_prepass(in: GroundPrepassVertex) -> FragmentOutput {
    var out: FragmentOutput;
#ifdef NORMAL_PREPASS
    // Of the triangle: all that dithering and occlusion ask for.
    let facet = normalize(cross(dpdy(in.world), dpdx(in.world)));
    out.normal = vec4(facet * 0.5 + 0.5, 1.0);
#endif
#ifdef MOTION_VECTOR_PREPASS
    let now = view.unjittered_clip_from_world * vec4(in.world, 1.0);
    let before = previous_view_uniforms.clip_from_world * vec4(in.world, 1.0);
    out.motion_vector = (now.xy / now.w - before.xy / before.w) * vec2(0.5, -0.5);
#endif
#ifdef DEFERRED_PREPASS
    // Drawn forward only.
    out.deferred = vec4(0u);
    out.deferred_lighting_pass_id = 0u;
#endif
#ifdef UNCLIPPED_DEPTH_ORTHO_EMULATION
    out.frag_depth = in.unclipped_depth;
#endif
    return out;
}
#endif
