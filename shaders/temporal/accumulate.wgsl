// Temporal antialiasing for pictures of points: each pixel averages the frames in which it saw the same place.
//
// Points are noisy where a surface is not: neighbours in a crown differ more than a frame differs from the average of many. So
// what is kept of the past is decided by depth first, and by colour only far outside of what is around the pixel; Bevy's
// TAA clips by one standard deviation and loses most of what windows of points (`TemporalSampling`) add.
//
// One thread per pixel of the viewport. In: this frame, the history and its depth, motion vectors, depth. Out: the
// picture, the new history (colour, and the number of frames in alpha) and its depth.
#import bevy_pbr::prepass_bindings::PreviousViewUniforms
#import bevy_render::view::View
#import bevy_treeline::types::TemporalSettings

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<uniform> previous_view: PreviousViewUniforms;
@group(0) @binding(2) var<uniform> settings: TemporalSettings;
@group(0) @binding(3) var frame: texture_2d<f32>;
@group(0) @binding(4) var motion_vectors: texture_2d<f32>;
@group(0) @binding(5) var frame_depth: texture_depth_2d;
@group(0) @binding(6) var history: texture_2d<f32>;
@group(0) @binding(7) var history_depth: texture_2d<f32>;
@group(0) @binding(8) var history_sampler: sampler;

// Depths that differ by less, as a share, are one surface.
const SAME_DEPTH: f32 = 0.06;
// Motion, in pixels a frame, up to which a pixel is at rest.
const REST: f32 = 0.02;
// Standard deviations by which the past may differ in motion: leaves of one pixel at many depths each move their own way, and
// what a wrong motion brings along is cut off here (measured: 0.75 to 1.5 are alike, 3 leaves streaks).
const CLIP_IN_MOTION: f32 = 1.0;
// Pixels by which the motions around a pixel may differ from the one that carries its past: there that past is of another
// place, and this frame counts alone (measured: 0.15 to 1 are alike, 1 is best).
const SPREAD: f32 = 1.0;
// Fall of the filter over the pixels around, per squared pixel, that stands for a frame in motion.
const FILTER_FALL: f32 = 2.3;

struct Accumulated {
    @location(0) color: vec4<f32>,
    @location(1) history: vec4<f32>,
    @location(2) depth: f32,
}

// Bright pixels would outweigh all others in an average: high dynamic range is compressed, averaged and expanded again.
fn compress(color: vec3<f32>) -> vec3<f32> {
#ifdef HIGH_DYNAMIC_RANGE
    return color / (1.0 + max(color.r, max(color.g, color.b)));
#else
    return color;
#endif
}

fn expand(color: vec3<f32>) -> vec3<f32> {
#ifdef HIGH_DYNAMIC_RANGE
    return color / max(1.0 - max(color.r, max(color.g, color.b)), 1e-4);
#else
    return color;
#endif
}

fn ycocg_from_rgb(rgb: vec3<f32>) -> vec3<f32> {
    return vec3(0.25 * rgb.r + 0.5 * rgb.g + 0.25 * rgb.b, 0.5 * (rgb.r - rgb.b), 0.5 * rgb.g - 0.25 * (rgb.r + rgb.b));
}

fn rgb_from_ycocg(c: vec3<f32>) -> vec3<f32> {
    return vec3(c.x + c.y - c.z, c.x + c.z, c.x - c.y - c.z);
}

// Catmull-Rom filter in 5 bilinear fetches, without the corners (Jimenez 2016, "Filmic SMAA"), so that history that is
// resampled in every frame of a motion stays sharp. `at` in pixels of the target.
fn sample_history(at: vec2<f32>) -> vec3<f32> {
    let texel = 1.0 / vec2<f32>(textureDimensions(history));
    let center = floor(at - 0.5) + 0.5;
    let f = at - center;
    let w0 = f * (-0.5 + f * (1.0 - 0.5 * f));
    let w1 = 1.0 + f * f * (-2.5 + 1.5 * f);
    let w2 = f * (0.5 + f * (2.0 - 1.5 * f));
    let w3 = f * f * (-0.5 + 0.5 * f);
    let w12 = w1 + w2;
    let p0 = (center - 1.0) * texel;
    let p12 = (center + w2 / w12) * texel;
    let p3 = (center + 2.0) * texel;
    var sum = vec4(textureSampleLevel(history, history_sampler, p12, 0.0).rgb, 1.0) * w12.x * w12.y;
    sum += vec4(textureSampleLevel(history, history_sampler, vec2(p12.x, p0.y), 0.0).rgb, 1.0) * w12.x * w0.y;
    sum += vec4(textureSampleLevel(history, history_sampler, vec2(p0.x, p12.y), 0.0).rgb, 1.0) * w0.x * w12.y;
    sum += vec4(textureSampleLevel(history, history_sampler, vec2(p3.x, p12.y), 0.0).rgb, 1.0) * w3.x * w12.y;
    sum += vec4(textureSampleLevel(history, history_sampler, vec2(p12.x, p3.y), 0.0).rgb, 1.0) * w12.x * w3.y;
    return max(sum.rgb / sum.w, vec3(0.0));
}

// How far, in pixels, what is sampled at the centre of a pixel lies from it in a picture without jitter.
fn jitter_shift() -> vec2<f32> {
    let center = view.world_from_clip * vec4(0.0, 0.0, 0.5, 1.0);
    let unjittered = view.unjittered_clip_from_world * (center / center.w);
    return unjittered.xy / unjittered.w * vec2(0.5, -0.5) * view.viewport.zw;
}

@fragment
fn accumulate(@builtin(position) frag_coord: vec4<f32>) -> Accumulated {
    let pixel = vec2<i32>(frag_coord.xy);
    let low = vec2<i32>(view.viewport.xy);
    let high = low + vec2<i32>(view.viewport.zw) - 1;
    let original = textureLoad(frame, pixel, 0);
    let now = compress(original.rgb);

    // What is around: mean and deviation of colour, range of depth, the nearest pixel.
    var mean = vec3(0.0);
    var square = vec3(0.0);
    var low_color = vec3(1e9);
    var high_color = vec3(0.0);
    var filtered = vec4(0.0);
    let shift = jitter_shift();
    var nearest = pixel;
    // Sum of the motions of what is there, and how many they are. The sky has none.
    var motions = vec3(0.0);
    var depth_low = 1e9;
    var depth_high = -1.0;
    for (var y = -1; y <= 1; y++) {
        for (var x = -1; x <= 1; x++) {
            let at = clamp(pixel + vec2(x, y), low, high);
            let rgb = compress(textureLoad(frame, at, 0).rgb);
            low_color = min(low_color, rgb);
            high_color = max(high_color, rgb);
            // Around where the pixel lies without jitter (Karis 2014, "High quality temporal supersampling"): a frame that
            // counts alone, or nearly, would tremble with the jitter otherwise.
            let away = vec2(f32(x), f32(y)) + shift;
            filtered += vec4(rgb, 1.0) * exp(-FILTER_FALL * dot(away, away));
            let color = ycocg_from_rgb(rgb);
            mean += color / 9.0;
            square += color * color / 9.0;
            let depth = textureLoad(frame_depth, at, 0);
            depth_low = min(depth_low, depth);
            motions += select(vec3(0.0), vec3(textureLoad(motion_vectors, at, 0).xy, 1.0), depth > 0.0);
            if depth > depth_high {
                depth_high = depth;
                nearest = at;
            }
        }
    }
    let own_depth = textureLoad(frame_depth, pixel, 0);
    var out: Accumulated;
    out.depth = own_depth;
    out.color = original;
    out.history = vec4(now, 1.0);
    if settings.reset != 0u {
        return out;
    }
    // What was not seen before has no frames to average but this one: it counts with its surroundings.
    let smooth_now = filtered.rgb / filtered.w;
    out.color = vec4(expand(smooth_now), original.a);
    out.history = vec4(smooth_now, 1.0);
    // Motion of the nearest, so that outlines move with what they outline.
    let motion = textureLoad(motion_vectors, nearest, 0).xy * view.viewport.zw;
    let before = frag_coord.xy - motion;
    let source = vec2<i32>(floor(before));
    if any(source < low) || any(source > high) {
        return out;
    }

    // Was what is here now there before? Depths then: of a point of this pixel, as seen by the camera of then.
    let ndc = (frag_coord.xy - view.viewport.xy) / view.viewport.zw * vec2(2.0, -2.0) + vec2(-1.0, 1.0);
    let here = view.world_from_clip * vec4(ndc, max(own_depth, 1e-7), 1.0);
    let then = previous_view.clip_from_world * (here / here.w);
    let change = then.z / then.w / max(own_depth, 1e-7);
    var before_low = 1e9;
    var before_high = -1.0;
    for (var y = -1; y <= 1; y++) {
        for (var x = -1; x <= 1; x++) {
            let depth = textureLoad(history_depth, clamp(source + vec2(x, y), low, high), 0).x;
            before_low = min(before_low, depth);
            before_high = max(before_high, depth);
        }
    }
    let is_known = before_low * (1.0 - SAME_DEPTH) <= depth_high * change && depth_low * change * (1.0 - SAME_DEPTH) <= before_high;
    if !is_known {
        return out;
    }

    let is_moving = dot(motion, motion) > REST * REST;
    var past: vec3<f32>;
    var present = now;
    if is_moving {
        past = sample_history(before);
        // There are few frames to average, so each counts with its surroundings.
        present = smooth_now;
    } else {
        past = textureLoad(history, pixel, 0).rgb;
    }
    // Clip towards the mean of what is around (Salvi 2016, "An excursion in temporal supersampling").
    let clip = select(settings.clip, min(settings.clip, CLIP_IN_MOTION), is_moving);
    let reach = clip * sqrt(max(square - mean * mean, vec3(0.0))) + 1e-4;
    let offset = ycocg_from_rgb(past) - mean;
    let beyond = max(max(abs(offset.x) / reach.x, abs(offset.y) / reach.y), max(abs(offset.z) / reach.z, 1.0));
    past = rgb_from_ycocg(mean + offset / beyond);
    if is_moving {
        // The box of the clip has corners of colours that nothing around has.
        past = clamp(past, low_color, high_color);
    }

    // Leaves at many depths each move their own way: the more they differ, the less is known of the past.
    let spread = select(0.0, length(motions.xy / max(motions.z, 1.0) * view.viewport.zw - motion), motions.z > 0.0);
    let in_motion = mix(settings.frames_in_motion, 1.0, saturate(spread / SPREAD));
    let limit = select(settings.frames_at_rest, in_motion, is_moving);
    let frames = min(textureLoad(history, source, 0).a + 1.0, limit);
    let average = max(mix(past, present, 1.0 / frames), vec3(0.0));
    out.history = vec4(average, frames);
    out.color = vec4(expand(average), original.a);
    return out;
}
