// Visibility buffer → what Bevy's prepass writes for meshes: depth, normals, motion vectors. With it, temporal
// antialiasing, motion blur, ambient occlusion and depth of field see points as they see meshes.
//
// One quad per covered block of pixels.
#import bevy_pbr::prepass_bindings::PreviousViewUniforms
#import bevy_render::view::View
#import bevy_treeline::block_quad::block_corner
#ifdef NORMAL_PREPASS
#import bevy_treeline::instance::{rotate, rotation_of, species_of}
#import bevy_treeline::lod::{OF_GROVE, grove_point, grove_sample}
#import bevy_treeline::surfel::{SURFEL_KEEPS_NORMAL, surfel_face_normal, surfel_flags, surfel_normal}
#import bevy_treeline::types::{Species, SurfelCold, SurfelHot, TreeLook, WorkItem}
#endif

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<uniform> previous_view: PreviousViewUniforms;
@group(1) @binding(0) var<storage, read> visibility: array<vec2<u32>>;
@group(1) @binding(1) var<storage, read> blocks: array<u32>;
#ifdef NORMAL_PREPASS
@group(1) @binding(2) var<storage, read> looks: array<TreeLook>;
@group(1) @binding(3) var<storage, read> items: array<WorkItem>;
@group(1) @binding(4) var<storage, read> surfels_hot: array<SurfelHot>;
@group(1) @binding(5) var<storage, read> surfels_cold: array<SurfelCold>;
@group(1) @binding(6) var<storage, read> species: array<Species>;
// Samples of groves, two a word: `grove_sample`.
@group(1) @binding(7) var<storage, read> samples: array<u32>;
#endif

@vertex
fn write_prepass_vertex(@builtin(vertex_index) corner: u32, @builtin(instance_index) quad: u32) -> @builtin(position) vec4<f32> {
    return block_corner(blocks[quad], corner, view.viewport.zw);
}

// Locations of Bevy's own prepass.
struct Written {
#ifdef NORMAL_PREPASS
    @location(0) normal: vec4<f32>,
#endif
#ifdef MOTION_VECTOR_PREPASS
    @location(1) motion_vector: vec2<f32>,
#endif
    @builtin(frag_depth) depth: f32,
}

// What the nearest of a pixel's samples shows.
fn nearest_sample(pixel: vec2<u32>, columns: u32) -> vec2<u32> {
    let side = #{SAMPLES_PER_SIDE}u;
    var nearest = vec2(0u);
    for (var i = 0u; i < side * side; i++) {
        let at = pixel * side + vec2(i % side, i / side);
        let texel = visibility[at.y * columns * side + at.x];
        if texel.x != 0u && texel.y >= nearest.y {
            nearest = texel;
        }
    }
    return nearest;
}

@fragment
fn write_prepass(@builtin(position) frag_coord: vec4<f32>) -> Written {
    let size = vec2<u32>(view.viewport.zw);
    let pixel = vec2<u32>(frag_coord.xy - view.viewport.xy);
    let texel = nearest_sample(min(pixel, size - 1u), size.x);
    if texel.x == 0u {
        discard;
    }
    var out: Written;
    out.depth = bitcast<f32>(texel.y);
    let ndc = (vec2<f32>(pixel) + 0.5) / view.viewport.zw * vec2(2.0, -2.0) + vec2(-1.0, 1.0);
    let homogeneous = view.world_from_clip * vec4(ndc, out.depth, 1.0);
    let position = vec4(homogeneous.xyz / homogeneous.w, 1.0);
#ifdef MOTION_VECTOR_PREPASS
    // As for meshes (bevy_pbr's prepass.wgsl): without the jitter, y down. The tree stands still.
    let now = view.unjittered_clip_from_world * position;
    let before = previous_view.clip_from_world * position;
    out.motion_vector = (now.xy / now.w - before.xy / before.w) * vec2(0.5, -0.5);
#endif
#ifdef NORMAL_PREPASS
    let item = items[(texel.x - 1u) >> 6u];
    var point = item.first_point + ((texel.x - 1u) & 63u);
    var instance_index = item.instance;
    if (item.count & OF_GROVE) != 0u {
        let sample = grove_sample(samples[point >> 1u], point);
        instance_index += sample >> 8u;
        let kind = species[species_of(looks[instance_index])];
        point = kind.first_point + grove_point(sample & 0xffu, (item.count >> 8u) & 0xffu, kind.point_count);
    }
    let rotation = rotation_of(looks[instance_index]);
    let cold = surfels_cold[point];
    let face = rotate(rotation, surfel_face_normal(surfels_hot[point].position_z_face));
    let normal = rotate(rotation, surfel_normal(cold.normal_albedo_rg));
    // The side that is seen, as in resolve.
    let keeps = (surfel_flags(cold.albedo_b_misc) & SURFEL_KEEPS_NORMAL) != 0u;
    let to_eye = select(view.world_position - position.xyz, view.world_from_view[2].xyz, view.clip_from_view[3].w == 1.0);
    let seen = select(-normal, normal, keeps || dot(face, to_eye) >= 0.0);
    out.normal = vec4(seen * 0.5 + 0.5, 1.0);
#endif
    return out;
}
