// Bevy's lighting where there is nothing but directional and ambient lights: `bevy_pbr::pbr_functions::apply_pbr_lighting`
// to the last term, by the same functions, without its loops over lamps and their shadows. A software driver runs those
// once even where there are none.
#define_import_path bevy_treeline::sunlight

#import bevy_pbr::ambient::ambient_light
#import bevy_pbr::lighting
#import bevy_pbr::mesh_types::MESH_FLAGS_SHADOW_RECEIVER_BIT
#import bevy_pbr::mesh_view_bindings as bindings
#import bevy_pbr::mesh_view_bindings::view
#import bevy_pbr::mesh_view_types::DIRECTIONAL_LIGHT_FLAGS_SHADOWS_ENABLED_BIT
#import bevy_pbr::pbr_functions::{calculate_F0, calculate_F0_dielectric, calculate_diffuse_color}
#import bevy_pbr::pbr_types::PbrInput
#import bevy_pbr::shadows
#ifdef TREELINE_CONTRAST
#import bevy_treeline::contrast::mean_shade
#import bevy_treeline::lod::PI
#endif

#ifdef TREELINE_CONTRAST
// `own`: share of a point's own diffuse light; the rest is the mean of leaves of any direction, times `shade`. Highlights stay
// its own: how bright they are follows from more than directions.
fn sunlight(in: PbrInput, own: f32, shade: f32) -> vec4<f32> {
#else
fn sunlight(in: PbrInput) -> vec4<f32> {
#endif
    let base = in.material.base_color;
    let metallic = in.material.metallic;
    let perceptual_roughness = in.material.perceptual_roughness;
    let reflectance = in.material.reflectance;
    let n_dot_v = max(dot(in.N, in.V), 0.0001);
    let diffuse_color = calculate_diffuse_color(base.rgb, metallic, 0.0, 0.0);
    var input: lighting::LightingInput;
    input.layers[lighting::LAYER_BASE].NdotV = n_dot_v;
    input.layers[lighting::LAYER_BASE].N = in.N;
    input.layers[lighting::LAYER_BASE].R = reflect(-in.V, in.N);
    input.layers[lighting::LAYER_BASE].perceptual_roughness = perceptual_roughness;
    input.layers[lighting::LAYER_BASE].roughness = lighting::perceptualRoughnessToRoughness(perceptual_roughness);
    input.P = in.world_position.xyz;
    input.V = in.V;
    input.diffuse_color = diffuse_color;
    input.metallic = metallic;
    input.F0_dielectric = calculate_F0_dielectric(reflectance);
    input.F0_metallic = base.rgb;
    input.F_ab = lighting::F_AB(perceptual_roughness, n_dot_v);

    var direct = vec3(0.0);
    for (var i = 0u; i < bindings::lights.n_directional_lights; i++) {
        var light = lighting::directional_light(i, &input, true);
#ifdef TREELINE_CONTRAST
        let sun = &bindings::lights.directional_lights[i];
        let to_sun = (*sun).direction_to_light;
        let more = shade * mean_shade(dot(to_sun, in.V)) - max(dot(in.N, to_sun), 0.0);
        light = max(light + diffuse_color / PI * (*sun).color.rgb * ((1.0 - own) * more), vec3(0.0));
#endif
#ifdef TREELINE_SUN_SHADOWS
        let casts_shadows = (bindings::lights.directional_lights[i].flags & DIRECTIONAL_LIGHT_FLAGS_SHADOWS_ENABLED_BIT) != 0u;
        if casts_shadows && (in.flags & MESH_FLAGS_SHADOW_RECEIVER_BIT) != 0u {
            let view_z = (view.view_from_world * in.world_position).z;
            light *= shadows::fetch_directional_shadow(i, in.world_position, in.world_normal, view_z, in.frag_coord.xy);
        }
#endif
        direct += light;
    }
    let specular_color = calculate_F0(base.rgb, metallic, reflectance);
    let ambient = ambient_light(in.world_position, in.N, in.V, n_dot_v, diffuse_color, specular_color, perceptual_roughness, in.diffuse_occlusion);
    return vec4(view.exposure * (direct + ambient), base.a);
}
