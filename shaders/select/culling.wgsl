// Frustum and occlusion of boxes: what blocks, trees and clusters are asked alike. CPU twin: src/math/occlusion.rs.
//
// Occlusion has two phases. The first draws what the pyramid of the frame before does not hide; the depth of that makes
// this frame's pyramid, and the second draws what it shows of the rest. So nothing is ever missing, however fast the
// camera moves: the frame before only decides when a thing is drawn.
#define_import_path bevy_treeline::culling

#import bevy_treeline::lod::LEAST_SHARE
#import bevy_treeline::occlusion::{ScreenBox, pyramid_level, pyramid_offset, pyramid_side, pyramid_size, screen_box}
#import bevy_treeline::select_bindings::{SECOND, settings, view}

// That of the frame before and that of this one.
@group(1) @binding(0) var<storage, read> pyramid: array<f32>;

// Splats reach farther than their points: at most this many of their radii.
const REACH: f32 = 3.0;
// The same in pixels at one point a pixel, where trees of any distance stand in a box.
const FAR_REACH: f32 = 2.5;

fn outside_frustum(center: vec3<f32>, half: vec3<f32>) -> bool {
    if settings.culling_frozen != 0u {
        for (var i = 0u; i < 4u; i++) {
            let plane = settings.culling_planes[i];
            if dot(plane.xyz, center) + plane.w < -dot(abs(plane.xyz), half) {
                return true;
            }
        }
        return false;
    }
    // Plane 5 is the far plane, which bounds nothing: the projection is infinite.
    for (var i = 0u; i < 5u; i++) {
        let plane = view.frustum[i];
        if dot(plane.xyz, center) + plane.w < -dot(abs(plane.xyz), half) {
            return true;
        }
    }
    return false;
}

fn sphere_outside(center: vec3<f32>, radius: f32) -> bool {
    if settings.culling_frozen != 0u {
        for (var i = 0u; i < 4u; i++) {
            let plane = settings.culling_planes[i];
            if dot(plane.xyz, center) + plane.w < -radius {
                return true;
            }
        }
        return false;
    }
    for (var i = 0u; i < 5u; i++) {
        if dot(view.frustum[i].xyz, center) + view.frustum[i].w < -radius {
            return true;
        }
    }
    return false;
}

// Whether a box is behind everything in the pyramid that begins at `first`.
fn is_hidden(first: u32, seen: ScreenBox, margin: f32) -> bool {
    let lo_edge = seen.lo - margin;
    let hi_edge = seen.hi + margin;
    let last = vec2<f32>(settings.size) - 1.0;
    if !seen.bounded || any(hi_edge < vec2(0.0)) || any(lo_edge > last) {
        return false;
    }
    let lo = clamp(lo_edge, vec2(0.0), last);
    let hi = clamp(hi_edge, vec2(0.0), last);
    let level = pyramid_level(max(hi.x - lo.x, hi.y - lo.y));
    let texels = pyramid_size(settings.size, level);
    let level_first = first + pyramid_offset(settings.size, level);
    let side = f32(pyramid_side(level));
    let begin = vec2<u32>(lo / side);
    let end = min(vec2<u32>(hi / side), texels - 1u);
    for (var y = begin.y; y <= end.y; y++) {
        for (var x = begin.x; x <= end.x; x++) {
            if seen.depth >= pyramid[level_first + y * texels.x + x] {
                return false;
            }
        }
    }
    return true;
}

// A box somewhere in the world, by a corner and its edges. Splats reach out of it: `reach` in world units, and a pixel.
fn is_hidden_from(clip_from_world: mat4x4<f32>, first: u32, lo: vec3<f32>, edges: mat3x3<f32>, reach: f32) -> bool {
    let seen = screen_box(
        clip_from_world * vec4(lo, 1.0),
        clip_from_world * vec4(edges[0], 0.0),
        clip_from_world * vec4(edges[1], 0.0),
        clip_from_world * vec4(edges[2], 0.0),
        vec2<f32>(settings.size),
    );
    // Trees that get less than a point a pixel have splats of more than a pixel, however far they are.
    let margin = 1.0 + select(0.0, FAR_REACH * inverseSqrt(settings.quality * LEAST_SHARE), reach == 0.0);
    return is_hidden(first, seen, reach * settings.pixels_per_unit / seen.nearest + margin);
}

// What the frame before says in the first phase, and this one in the second.
fn hides(lo: vec3<f32>, edges: mat3x3<f32>, reach: f32) -> bool {
    if SECOND {
        return is_hidden_from(view.clip_from_world, settings.pyramid_current, lo, edges, reach);
    }
    if settings.previous_valid == 0u {
        return false;
    }
    return is_hidden_from(settings.previous_clip_from_world, settings.pyramid_previous, lo, edges, reach);
}

fn edges_of(extent: vec3<f32>) -> mat3x3<f32> {
    return mat3x3<f32>(vec3(extent.x, 0.0, 0.0), vec3(0.0, extent.y, 0.0), vec3(0.0, 0.0, extent.z));
}

// A mask of `n` clusters, 1 to 32.
fn all_of(n: u32) -> u32 {
    return 0xffffffffu >> (32u - n);
}
