// Deferred buffer → lit colour of near meshes, where there is nothing but directional and ambient light: Bevy's
// `deferred_lighting.wgsl`, by the same functions, without its loops over lamps. Its vertex shader draws this too.
#import bevy_pbr::mesh_view_bindings::deferred_prepass_texture
#import bevy_pbr::pbr_deferred_functions::pbr_input_from_deferred_gbuffer
#import bevy_pbr::pbr_functions::main_pass_post_lighting_processing
#import bevy_pbr::pbr_types::STANDARD_MATERIAL_FLAGS_UNLIT_BIT
#ifdef DEPTH_PREPASS
#import bevy_pbr::prepass_utils::prepass_depth
#endif
#import bevy_treeline::sunlight::sunlight

@fragment
fn light_near(@builtin(position) position: vec4<f32>) -> @location(0) vec4<f32> {
    var frag_coord = vec4(position.xy, 0.0, 0.0);
#ifdef DEPTH_PREPASS
    frag_coord.z = prepass_depth(position, 0u);
#endif
    let pbr = pbr_input_from_deferred_gbuffer(frag_coord, textureLoad(deferred_prepass_texture, vec2<i32>(position.xy), 0));
    var color = pbr.material.base_color;
    if (pbr.material.flags & STANDARD_MATERIAL_FLAGS_UNLIT_BIT) == 0u {
        color = sunlight(pbr);
    }
    return main_pass_post_lighting_processing(pbr, color);
}
