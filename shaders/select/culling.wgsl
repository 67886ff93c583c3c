// Frustum and occlusion of boxes and trees, and what is drawn of a tree: what `cull_instances` counts and `emit_runs`
// writes. CPU twins: src/forest/select.rs, src/math/occlusion.rs.
//
// Occlusion has two phases. The first draws what the pyramid of the frame before does not hide; the depth of that makes
// this frame's pyramid, and the second draws what it shows of the rest. So nothing is ever missing, however fast the
// camera moves: the frame before only decides when a thing is drawn. Nothing is remembered but the two pyramids: each
// phase asks the same questions again.
#define_import_path bevy_treeline::culling

#import bevy_treeline::instance::{NOT_RESIDENT, matrix_of, rotation_of, species_of}
#import bevy_treeline::lod::{cluster_points, level_clusters, level_of, list_points}
#import bevy_treeline::occlusion::{ScreenBox, pyramid_level, pyramid_offset, pyramid_side, pyramid_size, screen_box}
#import bevy_treeline::select_bindings::{SECOND, instance_blocks, item_count, settings, view}
#import bevy_treeline::selection::wanted_points
#import bevy_treeline::types::{Cluster, InstanceBlock, Species, TreeInstance}

@group(1) @binding(0) var<storage, read> species: array<Species>;
@group(1) @binding(1) var<storage, read> clusters: array<Cluster>;
@group(1) @binding(2) var<storage, read> instances: array<TreeInstance>;
// That of the frame before and that of this one.
@group(1) @binding(3) var<storage, read> pyramid: array<f32>;

// Splats reach farther than their points: at most this many of their radii.
const REACH: f32 = 3.0;
// The same in pixels at one point a pixel, where trees of any distance stand in a box.
const FAR_REACH: f32 = 2.5;

// Why a tree is not drawn, or that it is.
const DRAWN: u32 = 0u;
const ABSENT: u32 = 1u;
const OUTSIDE: u32 = 2u;
const SMALL: u32 = 3u;
const MESH: u32 = 4u;
const OCCLUDED: u32 = 5u;
// Belongs to the other phase.
const OTHER_PHASE: u32 = 6u;

struct Draw {
    verdict: u32,
    // Points of the whole tree.
    count: u32,
    radius: f32,
    level: u32,
    // Clusters of the level that are drawn in this phase.
    mask: u32,
    // Clusters that belong to the second phase, or none is drawn of.
    hidden: u32,
    fading: bool,
}

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
    let margin = 1.0 + select(0.0, FAR_REACH * inverseSqrt(settings.quality), reach == 0.0);
    return is_hidden(first, seen, reach * settings.pixels_per_unit / seen.nearest + margin);
}

// What the frame before says: not to be drawn in the first phase.
fn was_hidden(lo: vec3<f32>, edges: mat3x3<f32>, reach: f32) -> bool {
    if settings.previous_valid == 0u {
        return false;
    }
    return is_hidden_from(settings.previous_clip_from_world, settings.pyramid_previous, lo, edges, reach);
}

// What this frame says, in the second phase.
fn is_hidden_now(lo: vec3<f32>, edges: mat3x3<f32>, reach: f32) -> bool {
    return is_hidden_from(view.clip_from_world, settings.pyramid_current, lo, edges, reach);
}

fn edges_of(extent: vec3<f32>) -> mat3x3<f32> {
    return mat3x3<f32>(vec3(extent.x, 0.0, 0.0), vec3(0.0, extent.y, 0.0), vec3(0.0, 0.0, extent.z));
}

// An orthographic view has the same scale everywhere: distance 1, where Z0 holds.
fn distance_to(center: vec3<f32>) -> f32 {
    let eye = select(view.world_position, settings.culling_eye, settings.culling_frozen != 0u);
    return select(distance(center, eye), 1.0, settings.orthographic != 0u);
}

// A mask of `n` clusters, 1 to 32.
fn all_of(n: u32) -> u32 {
    return 0xffffffffu >> (32u - n);
}

// Points of a tree and their size, before occlusion.
fn select_points(block: InstanceBlock, instance: TreeInstance, kind: Species, center: vec3<f32>) -> Draw {
    var draw = Draw(SMALL, 0u, 0.0, 0u, 0u, 0u, false);
    let wanted = wanted_points(settings, instance, kind, distance_to(center), block.fade_begin, block.fade_end);
    draw.fading = wanted.fading;
    if wanted.as_mesh {
        draw.verdict = MESH;
    } else if wanted.count > 0u {
        draw.verdict = DRAWN;
        draw.count = wanted.count;
        draw.radius = wanted.radius;
        draw.level = level_of(draw.count, kind.level_count);
        draw.mask = all_of(level_clusters(draw.level).y);
    }
    return draw;
}

// What is drawn of a tree in this phase. `block_was_hidden`: nothing of its block was drawn in the first.
fn select_instance(block: InstanceBlock, lane: u32, block_was_hidden: bool) -> Draw {
    var draw = Draw(ABSENT, 0u, 0.0, 0u, 0u, 0u, false);
    let instance = instances[block.first_instance + lane];
    let kind_index = species_of(instance);
    if kind_index == NOT_RESIDENT {
        return draw;
    }
    let kind = species[kind_index];
    let turned = matrix_of(rotation_of(instance));
    let placed = mat3x3<f32>(turned[0] * instance.scale, turned[1] * instance.scale, turned[2] * instance.scale);
    let center = instance.position + placed * kind.center;
    draw.verdict = OUTSIDE;
    if sphere_outside(center, kind.radius * instance.scale) {
        return draw;
    }
    draw = select_points(block, instance, kind, center);
    if draw.verdict != DRAWN || settings.occlusion == 0u {
        return draw;
    }
    let reach = REACH * draw.radius;
    let lo = instance.position + placed * kind.lo;
    let edges = mat3x3<f32>(placed[0] * kind.extent.x, placed[1] * kind.extent.y, placed[2] * kind.extent.z);
    let before = block_was_hidden || was_hidden(lo, edges, reach);
    var is_occluded = before;
    if SECOND {
        is_occluded = before && is_hidden_now(lo, edges, reach);
    }
    if is_occluded {
        draw.verdict = OCCLUDED;
        draw.hidden = draw.mask;
        draw.mask = 0u;
        return draw;
    }
    if draw.level == 0u {
        if SECOND && !before {
            draw.verdict = OTHER_PHASE;
            draw.mask = 0u;
        }
        return draw;
    }
    // In the first phase the whole is drawn but for its hidden clusters; in the second those that were hidden and are not.
    let list = level_clusters(draw.level);
    var mask = 0u;
    for (var i = 0u; i < list.y; i++) {
        let cluster = clusters[kind.first_cluster + list.x + i];
        let middle = instance.position + placed * (cluster.lo + 0.5 * cluster.extent);
        let is_inside = !sphere_outside(middle, 0.5 * length(cluster.extent) * instance.scale + reach);
        let cluster_lo = instance.position + placed * cluster.lo;
        let cluster_edges = mat3x3<f32>(placed[0] * cluster.extent.x, placed[1] * cluster.extent.y, placed[2] * cluster.extent.z);
        let cluster_before = before || was_hidden(cluster_lo, cluster_edges, reach);
        var hides = cluster_before;
        if SECOND {
            hides = cluster_before && is_hidden_now(cluster_lo, cluster_edges, reach);
        }
        draw.hidden |= select(0u, 1u << i, hides && is_inside);
        mask |= select(0u, 1u << i, is_inside && select(!hides, cluster_before && !hides, SECOND));
    }
    draw.mask = mask;
    if mask == 0u {
        draw.verdict = select(OTHER_PHASE, OCCLUDED, draw.hidden == all_of(list.y));
    }
    return draw;
}

// Points that a draw takes from a cluster of its tree: of `draw.level`, the `i`-th.
fn points_of_cluster(draw: Draw, kind: Species, i: u32) -> u32 {
    if draw.level == 0u {
        return draw.count;
    }
    let cluster = clusters[kind.first_cluster + level_clusters(draw.level).x + i];
    return cluster_points(draw.count, cluster.count, list_points(draw.level, kind.level_count, kind.point_count));
}

// Runs and work items of a draw: a run for each cluster that has a point.
fn runs_and_items(draw: Draw, kind_index: u32) -> vec2<u32> {
    if draw.mask == 0u {
        return vec2(0u);
    }
    if draw.level == 0u {
        return vec2(1u, item_count(draw.count));
    }
    let kind = species[kind_index];
    var sum = vec2(0u);
    for (var mask = draw.mask; mask != 0u; mask &= mask - 1u) {
        let points = points_of_cluster(draw, kind, countTrailingZeros(mask));
        sum += vec2(min(points, 1u), item_count(points));
    }
    return sum;
}
