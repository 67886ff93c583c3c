// A point's lit colour, with Bevy's own lighting: what every resolve pass does with a sample.
#define_import_path bevy_treeline::shade

#import bevy_pbr::mesh_view_bindings as bindings
#import bevy_pbr::mesh_view_bindings::view
#import bevy_pbr::mesh_types::MESH_FLAGS_SHADOW_RECEIVER_BIT
#import bevy_pbr::pbr_functions
#import bevy_pbr::pbr_types::{STANDARD_MATERIAL_FLAGS_FOG_ENABLED_BIT, pbr_input_new}
#ifdef TREELINE_DEBUG_VIEW
#import bevy_treeline::debug_view::debug_color
#endif
#ifdef TREELINE_SUNLIGHT
#import bevy_treeline::sunlight::sunlight
#endif
#ifdef TREELINE_CONTRAST
#import bevy_treeline::contrast::{averaged_after_display, contrast_factor, leaves_in_pixel, own_share, unpack_seen_mean}
#endif
#import bevy_treeline::instance::{TreeInstance, rotate, rotation_of, species_of, tint_of, tree_instance}
#import bevy_treeline::lod::{OF_GROVE, WINDOW_CYCLE, factor_between, factor_place, factor_words, grove_point, grove_sample, prefix_count}
#import bevy_treeline::surfel::{SURFEL_KEEPS_NORMAL, SURFEL_LEAF, SURFEL_UNLIT, surfel_albedo, surfel_ambient_visibility, surfel_face_normal, surfel_flags, surfel_light_factor, surfel_metallic, surfel_roughness, surfel_normal}
#import bevy_treeline::types::{SelectSettings, Species, SurfelCold, SurfelHot, TreeLook, TreePlace, WorkItem}

@group(2) @binding(0) var<storage, read> looks: array<TreeLook>;
@group(2) @binding(1) var<storage, read> items: array<WorkItem>;
@group(2) @binding(2) var<storage, read> surfels_hot: array<SurfelHot>;
@group(2) @binding(3) var<storage, read> surfels_cold: array<SurfelCold>;
// Read as two words, so that this stage needs no 64-bit support: payload, depth bits.
@group(2) @binding(4) var<storage, read> visibility: array<vec2<u32>>;
@group(2) @binding(5) var<storage, read> blocks: array<u32>;
@group(2) @binding(6) var<storage, read> species: array<Species>;
// Samples of groves, two a word: `grove_sample`.
@group(2) @binding(7) var<storage, read> samples: array<u32>;
@group(2) @binding(8) var<storage, read> places: array<TreePlace>;
@group(2) @binding(9) var<uniform> settings: SelectSettings;

#ifdef TREELINE_FOG
#import bevy_pbr::mesh_view_types::DIRECTIONAL_LIGHT_FLAGS_SHADOWS_ENABLED_BIT
#import bevy_pbr::shadows

// Bevy's exponential fogs, to the last term (`bevy_pbr::pbr_functions::apply_fog`). A software driver runs every branch
// of that, so here the kind of fog is part of the pipeline.
fn apply_fog(color: vec3<f32>, world_position: vec4<f32>, frag_coord: vec2<f32>) -> vec3<f32> {
    let ray = world_position.xyz - view.world_position;
    let distance = length(ray);
    var fog_color = bindings::fog.base_color.rgb;
    if #{TREELINE_FOG_GLOW}u == 1u {
        let glow = bindings::fog.directional_light_color;
        let direction = ray / distance;
        let view_z = (view.view_from_world * world_position).z;
        for (var i = 0u; i < bindings::lights.n_directional_lights; i++) {
            let light = &bindings::lights.directional_lights[i];
            let cosine = max(dot(direction, (*light).direction_to_light), 0.0);
            var scattering = pow(cosine, bindings::fog.directional_light_exponent) * (*light).color.rgb * view.exposure;
            if ((*light).flags & DIRECTIONAL_LIGHT_FLAGS_SHADOWS_ENABLED_BIT) != 0u {
                scattering *= shadows::fetch_directional_shadow(i, world_position, -direction, view_z, frag_coord);
            }
            fog_color += scattering * glow.rgb * glow.a;
        }
    }
    var depth = distance * bindings::fog.be.x;
    if #{TREELINE_FOG_SQUARED}u == 1u {
        depth *= depth;
    }
    return mix(color, fog_color, bindings::fog.base_color.a * (1.0 - exp(-depth)));
}
#endif

// Points that a tree deserves: as selection says, so that it is the same in a grove.
fn points_deserved(instance: TreeInstance, rotation: vec4<f32>, kind_index: u32) -> f32 {
    let center = instance.position + rotate(rotation, species[kind_index].center * instance.scale);
    let eye = select(view.world_position, settings.culling_eye, settings.culling_frozen != 0u);
    let d = select(distance(center, eye), 1.0, settings.orthographic != 0u);
    let s = species[kind_index].pixel * instance.scale;
    return prefix_count(f32(species[kind_index].point_count), s, settings.pixels_per_unit, d, settings.quality);
}

// The factor on the colour of a tree of `n` points. Twin of `factor_of`.
fn light_of_few(kind_index: u32, n: f32) -> f32 {
    let place = factor_place(n, f32(species[kind_index].point_count));
    let words = factor_words(place);
    return factor_between(species[kind_index].light_factors[words.x], species[kind_index].light_factors[words.y], place);
}

#ifdef TREELINE_CONTRAST
// How much of its own colour a point keeps at a distance from the eye.
fn share_of_own(kind_index: u32, scale: f32, distance: f32) -> f32 {
    let side = settings.samples_per_side;
    // Windows are shown to be averaged: a whole cycle of them.
    let samples = side * side * select(1u, WINDOW_CYCLE, settings.window > 0u);
    let leaf_area = species[kind_index].mean_leaf_area * scale * scale;
    let leaves = leaves_in_pixel(leaf_area, distance / settings.pixels_per_unit);
    return own_share(contrast_factor(leaves, f32(samples)), settings.contrast);
}
#endif

// Colour of what a sample holds (payload, depth bits; a payload of 0 may not come here). `center`: of the sample, in pixels
// of the viewport; `frag_coord`: of the pixel, in the target.
fn shade(texel: vec2<u32>, center: vec2<f32>, frag_coord: vec2<f32>) -> vec4<f32> {
    let item = items[(texel.x - 1u) >> 6u];
    var point = item.first_point + ((texel.x - 1u) & 63u);
    var instance_index = item.instance;
    if (item.count & OF_GROVE) != 0u {
        let sample = grove_sample(samples[point >> 1u], point);
        instance_index += sample >> 8u;
        let kind = species[species_of(looks[instance_index])];
        point = kind.first_point + grove_point(sample & 0xffu, (item.count >> 8u) & 0xffu, kind.point_count);
    }
    let instance = tree_instance(places[instance_index], looks[instance_index]);
    let kind_index = species_of(instance.look);
    let cold = surfels_cold[point];
    let rotation = rotation_of(instance.look);
    let depth = bitcast<f32>(texel.y);

    let ndc = center / view.viewport.zw * vec2(2.0, -2.0) + vec2(-1.0, 1.0);
    let position = view.world_from_clip * vec4(ndc, depth, 1.0);
    var albedo = surfel_albedo(cold.normal_albedo_rg, cold.albedo_b_misc) * tint_of(instance.look);
    let flags = surfel_flags(cold.albedo_b_misc);
    let is_lit = (flags & SURFEL_UNLIT) == 0u;
#ifdef TREELINE_CONTRAST
    let seen_mean = unpack_seen_mean(species[kind_index].seen_mean);
    let away = select(distance(position.xyz / position.w, view.world_position), 1.0, settings.orthographic != 0u);
    let own = share_of_own(kind_index, instance.scale, away);
#endif
    if is_lit {
        // As the vertex colours of near meshes: a factor for all light, so that a tree looks the same on both sides of
        // the crossfade.
        albedo *= surfel_light_factor(surfel_ambient_visibility(cold.albedo_b_misc));
        albedo *= light_of_few(kind_index, points_deserved(instance, rotation, kind_index));
#ifdef TREELINE_CONTRAST
        // The mean is right for any number of points.
        albedo = mix(seen_mean.rgb * tint_of(instance.look), albedo, own) * averaged_after_display(own);
#endif
    }

    var pbr = pbr_input_new();
    pbr.frag_coord = vec4(frag_coord, depth, 1.0);
    pbr.world_position = position / position.w;
    pbr.is_orthographic = view.clip_from_view[3].w == 1.0;
    pbr.V = pbr_functions::calculate_view(pbr.world_position, pbr.is_orthographic);
    pbr.flags = MESH_FLAGS_SHADOW_RECEIVER_BIT;
    pbr.material.base_color = vec4(albedo, 1.0);
    var color = pbr.material.base_color;
    if is_lit {
        // The face decides which side is seen, as a rasteriser would: interpolated normals look away on low-poly trunks.
        let face = rotate(rotation, surfel_face_normal(surfels_hot[point].position_z_face));
        let normal = rotate(rotation, surfel_normal(cold.normal_albedo_rg));
        let keeps = (flags & SURFEL_KEEPS_NORMAL) != 0u;
        pbr.N = select(-normal, normal, keeps || dot(face, pbr.V) >= 0.0);
        pbr.world_normal = pbr.N;
        pbr.material.perceptual_roughness = max(surfel_roughness(cold.albedo_b_misc), 0.089);
        if keeps {
            // Waxy, but never as smooth as a plane: as `standard_material` in src/bake/near.rs.
            pbr.material.reflectance = vec3(0.25);
        }
        pbr.material.metallic = surfel_metallic(cold.albedo_b_misc);
#ifdef TREELINE_SUNLIGHT
#ifdef TREELINE_CONTRAST
        // Leaves alone: a trunk is lit as one.
        color = sunlight(pbr, select(1.0, own, (flags & SURFEL_LEAF) != 0u), seen_mean.a);
#else
        color = sunlight(pbr);
#endif
#else
        color = pbr_functions::apply_pbr_lighting(pbr);
#endif
    }
#ifdef TREELINE_FOG
    color = vec4(apply_fog(color.rgb, pbr.world_position, frag_coord), color.a);
#else
    pbr.material.flags |= STANDARD_MATERIAL_FLAGS_FOG_ENABLED_BIT;
#endif
#ifdef TREELINE_DEBUG_VIEW
    let shading_normal = rotate(rotation, surfel_normal(cold.normal_albedo_rg));
    return vec4(debug_color(#{TREELINE_DEBUG_VIEW}u, item, instance, species[kind_index], settings, cold, shading_normal, pbr.world_position.xyz), 1.0);
#else
    return pbr_functions::main_pass_post_lighting_processing(pbr, color);
#endif
}
