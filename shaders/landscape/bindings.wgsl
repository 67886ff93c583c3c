// What the shaders of a landscape share: bindings, where a vertex is, sky and haze.
#define_import_path bevy_treeline::landscape

#import bevy_pbr::mesh_view_bindings::{lights, view}
#ifdef DISTANCE_FOG
#import bevy_pbr::mesh_view_bindings::fog
#import bevy_pbr::mesh_view_types::{FOG_MODE_EXPONENTIAL, FOG_MODE_EXPONENTIAL_SQUARED, FOG_MODE_LINEAR}
#endif

struct LandscapeFrame {
    // Place, and distance to the nearest ground.
    eyes: array<vec4<f32>, 4>,
    // By level: distance where the morph to the parent's grid begins, and 1 / its length.
    morphs: array<vec4<f32>, 12>,
    zenith: vec4<f32>,
    horizon: vec4<f32>,
    glow: vec4<f32>,
    disc: vec4<f32>,
    sun_direction: vec4<f32>,
    // Level (far below everything without water), seconds, eyes, half a side of the ground.
    water: vec4<f32>,
}

struct GroundChunk {
    // Posts of its level before the chunk's first.
    first: vec2<f32>,
    quad_m: f32,
    level: u32,
    // uv = post * x + y.
    texture_place: vec2<f32>,
    texture_side: f32,
    // Chunks that have no parent do not morph.
    morphs: f32,
}

struct GroundPoint {
    world: vec3<f32>,
    // Of the ground itself, under water too.
    ground_y: f32,
    uv: vec2<f32>,
    morph: f32,
}

@group(#{MATERIAL_BIND_GROUP}) @binding(0) var<storage, read> frame: LandscapeFrame;

// `posts` = column + 64 * row. Computed from whole numbers, so that neighbours of all levels agree to the bit.
fn ground_point(chunk: GroundChunk, y: f32, target_y: f32, posts: f32) -> GroundPoint {
    let row = floor(posts / 64.0);
    let post = vec2(posts - 64.0 * row, row);
    let at = (chunk.first + post) * chunk.quad_m - frame.water.w;
    var nearest = 1e30;
    for (var i = 0u; i < u32(frame.water.z); i++) {
        let eye = frame.eyes[i];
        let along = at - eye.xz;
        nearest = min(nearest, dot(along, along) + eye.w * eye.w);
    }
    let range = frame.morphs[chunk.level].xy;
    var out: GroundPoint;
    out.morph = saturate((sqrt(nearest) - range.x) * range.y) * chunk.morphs;
    out.ground_y = mix(y, target_y, out.morph);
    out.world = vec3(at.x, max(out.ground_y, frame.water.x), at.y);
    out.uv = post * chunk.texture_place.x + chunk.texture_place.y;
    return out;
}

fn eighth(x: f32) -> f32 {
    let square = x * x;
    let fourth = square * square;
    return fourth * fourth;
}

// Luminance of the sky without the disc, exposed. Twin of `Daylight::sky`.
fn sky_color(direction: vec3<f32>) -> vec3<f32> {
    let up = max(direction.y, 0.0);
    let towards = max(dot(direction, frame.sun_direction.xyz), 0.0);
    let root = sqrt(up);
    let share = 1.0 - exp(-4.2 * root * sqrt(root));
    let towards8 = eighth(towards);
    let sharp = towards8 * towards8;
    let glow = 0.55 * towards8 + 0.9 * sharp * sharp * sharp * sharp;
    return (mix(frame.horizon.rgb, frame.zenith.rgb, share) + frame.glow.rgb * glow) * (1000.0 * view.exposure);
}

// Bevy's distance fog with Bevy's formulas, without its shadow lookups; atmospheric fog counts as exponential.
fn with_haze(color: vec3<f32>, from_eye: vec3<f32>, distance: f32) -> vec3<f32> {
#ifdef DISTANCE_FOG
    var haze = fog.base_color.rgb;
    if fog.directional_light_color.a > 0.0 && lights.n_directional_lights > 0u {
        let towards = max(dot(from_eye, lights.directional_lights[0].direction_to_light), 0.0);
        // The exponent that `Sky` sets is cheaper by multiplication.
        var glow = eighth(towards);
        if fog.directional_light_exponent != 8.0 {
            glow = pow(towards, fog.directional_light_exponent);
        }
        haze += glow * lights.directional_lights[0].color.rgb * view.exposure
            * fog.directional_light_color.rgb * fog.directional_light_color.a;
    }
    var part = 0.0;
    if fog.mode == FOG_MODE_EXPONENTIAL_SQUARED {
        let thickness = distance * fog.be.x;
        part = 1.0 - exp(-thickness * thickness);
    } else if fog.mode == FOG_MODE_LINEAR {
        part = 1.0 - saturate((fog.be.y - distance) / (fog.be.y - fog.be.x));
    } else if fog.mode >= FOG_MODE_EXPONENTIAL {
        part = 1.0 - exp(-distance * fog.be.x);
    }
    return mix(color, haze, part * fog.base_color.a);
#else
    return color;
#endif
}
