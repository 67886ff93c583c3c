// A chunk of ground or water: painted albedo and sunlight, fine grain near the eye, waves, haze.
#import bevy_pbr::mesh_view_bindings::{lights, view}
#import bevy_treeline::landscape::{GroundChunk, frame, ground_point, sky_color, with_haze}
#ifdef TONEMAP_IN_SHADER
#import bevy_core_pipeline::tonemapping::tone_mapping
#endif
#ifdef RECEIVE_SHADOWS
#import bevy_pbr::shadows::fetch_directional_shadow
#endif

@group(#{MATERIAL_BIND_GROUP}) @binding(1) var<uniform> chunk: GroundChunk;
@group(#{MATERIAL_BIND_GROUP}) @binding(2) var painting: texture_2d<f32>;
@group(#{MATERIAL_BIND_GROUP}) @binding(3) var painting_sampler: sampler;
// Grain in R, slopes of waves in GB.
@group(#{MATERIAL_BIND_GROUP}) @binding(4) var grain: texture_2d<f32>;
@group(#{MATERIAL_BIND_GROUP}) @binding(5) var grain_sampler: sampler;

// Grain is drawn up to this distance, metres.
const GRAIN_M: f32 = 260.0;
const FINE_GRAIN_M: f32 = 90.0;
const INV_PI: f32 = 0.31830989;

struct GroundVertex {
    @builtin(position) @invariant clip: vec4<f32>,
    @location(0) world: vec3<f32>,
    @location(1) uv: vec2<f32>,
    // Height of the ground, morph.
    @location(2) ground: vec2<f32>,
}

@vertex
fn ground_vertex(@location(0) position: vec3<f32>, @location(2) morph: vec2<f32>) -> GroundVertex {
    let point = ground_point(chunk, position.y, morph.x, morph.y);
    var out: GroundVertex;
    out.world = point.world;
    out.clip = view.clip_from_world * vec4(point.world, 1.0);
    out.uv = point.uv;
    out.ground = vec2(point.ground_y, point.morph);
    return out;
}

@fragment
fn ground(in: GroundVertex) -> @location(0) vec4<f32> {
    let offset = in.world - view.world_position;
    let distance = length(offset);
    let from_eye = offset / distance;
    // Between the sharp and the smooth axis of the footprint: a compromise without anisotropic filtering.
    let dx = dpdx(in.uv) * chunk.texture_side;
    let dy = dpdy(in.uv) * chunk.texture_side;
    let a = max(dot(dx, dx), dot(dy, dy));
    let b = max(min(dot(dx, dx), dot(dy, dy)), 1e-6);
    // A chunk about to give way to its parent shows the parent's texels.
    let level = max(0.33 * log2(a) + 0.17 * log2(b), in.ground.y);
    let painted = textureSampleLevel(painting, painting_sampler, in.uv, level);
    var albedo = painted.rgb;
    if distance < GRAIN_M {
        // Explicit levels: derivatives are not allowed here. Footprint of a pixel over a texel of the grain.
        let pixel_m = sqrt(sqrt(a * b)) * chunk.quad_m / (chunk.texture_side * chunk.texture_place.x);
        let wide = textureSampleLevel(grain, grain_sampler, in.world.zx * vec2(0.071, -0.071), log2(pixel_m * 9.1)).r;
        var speckle = 1.1 * (1.0 - distance / GRAIN_M) * (wide - 0.5);
        if distance < FINE_GRAIN_M {
            let close = textureSampleLevel(grain, grain_sampler, in.world.xz * 0.41, log2(pixel_m * 52.0)).r;
            speckle += 1.3 * (1.0 - distance / FINE_GRAIN_M) * (close - 0.5);
        }
        albedo *= 1.0 + speckle;
    }
    var sun = vec3(0.0);
    if lights.n_directional_lights > 0u {
        sun = lights.directional_lights[0].color.rgb * (INV_PI * painted.a);
#ifdef RECEIVE_SHADOWS
        let view_z = dot(vec4(view.view_from_world[0].z, view.view_from_world[1].z, view.view_from_world[2].z, view.view_from_world[3].z), vec4(in.world, 1.0));
        sun *= fetch_directional_shadow(0u, vec4(in.world, 1.0), vec3(0.0, 1.0, 0.0), view_z, in.clip.xy);
#endif
    }
    let light = (sun + lights.ambient_color.rgb) * view.exposure;
    var color = albedo * light;

    let depth = frame.water.x - in.ground.x;
    if depth > 0.0 {
        color = water(in.world, from_eye, distance, depth, color, light, painted.a);
    }
    color = with_haze(color, from_eye, distance);
    var out = vec4(color, 1.0);
#ifdef TONEMAP_IN_SHADER
    out = tone_mapping(out, view.color_grading);
#endif
    return out;
}

fn water(world: vec3<f32>, from_eye: vec3<f32>, distance: f32, depth: f32, bed: vec3<f32>, light: vec3<f32>, sunlit: f32) -> vec3<f32> {
    let time = frame.water.y;
    let level = max(log2(distance * 0.012), 0.0);
    let one = textureSampleLevel(grain, grain_sampler, world.xz * 0.043 + vec2(0.011, 0.007) * time, level).gb;
    let two = textureSampleLevel(grain, grain_sampler, world.zx * 0.019 - vec2(0.006, 0.009) * time, max(level - 1.0, 0.0)).gb;
    // Far waves are smaller than pixels.
    let rough = 0.34 / (1.0 + distance * 0.004);
    let slope = (one + two.yx - 1.0) * rough;
    let normal = normalize(vec3(slope.x, 1.0, slope.y));
    let facing = saturate(-dot(normal, from_eye));
    let grazing = 1.0 - facing;
    let grazing2 = grazing * grazing;
    let mirror = 0.02 + 0.98 * grazing2 * grazing2 * grazing;
    var ray = reflect(from_eye, normal);
    ray.y = abs(ray.y);
    let glint = pow(saturate(dot(ray, frame.sun_direction.xyz)), 260.0) * sunlit;
    let sky = sky_color(ray) + frame.disc.rgb * (glint * 60.0 * view.exposure);
    // The way of light through water to the bed and back.
    let path = depth * (1.0 + 1.0 / max(facing, 0.25));
    let clear = exp(-path * vec3(0.42, 0.15, 0.19));
    let scattered = vec3(0.006, 0.022, 0.024) * light;
    let inside = bed * clear + scattered * (1.0 - clear);
    return mix(bed * 0.8, mix(inside, sky, mirror), smoothstep(0.0, 0.22, depth));
}
