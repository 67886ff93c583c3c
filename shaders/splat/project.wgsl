// A point of a work item on the screen: a piece of the surface (or a screen-aligned square, for debugging) and the
// pixels it may touch.
//
// Defs, since a software driver runs both sides of every branch: SPLAT_DISCS, SPLAT_SQUARES or SPLAT_MIXED (cells, but discs
// for trees peeled from other directions) instead of cells alone; SPLAT_PARALLEL for parallel views; SPLAT_GROVES for
// samples of groves; SPLAT_SECOND for trees in the second phase.
#define_import_path bevy_treeline::project

#ifdef SPLAT_GROVES
#import bevy_treeline::grove::grove_item
#endif
#import bevy_treeline::lod::{PI, overlap}
#import bevy_treeline::splat_bindings::{counters, grid_size, settings, splat_items, surfels_hot, view}
#import bevy_treeline::splat_item::{AS_DISCS, COUNT}
#import bevy_treeline::surfel::{surfel_face_direction, surfel_is_one_sided, surfel_thickness}
#import bevy_treeline::types::SplatItem

// Below this cosine between view and normal a splat is a line, and its plane no use.
const EDGE_ON: f32 = 0.015;

struct Splat {
    // False: nothing to draw, and the rest means nothing.
    visible: bool,
    // Bits of the reversed-z depth of the centre.
    depth: u32,
    // Samples begin..end (end excluded), in the viewport. A pixel here is a sample.
    begin: vec2<i32>,
    end: vec2<i32>,
    // Where the ray through a pixel meets the plane of the splat: `across_u / across` and `across_v / across` from the
    // centre, each linear in the pixel: (d/dx, d/dy, at pixel 0, 0).
    across_u: vec3<f32>,
    across_v: vec3<f32>,
    across: vec3<f32>,
    // Half the side of a cell, or the radius of a disc.
    size: f32,
    is_disc: bool,
}

fn nothing() -> Splat {
    return Splat(false, 0u, vec2(0), vec2(0), vec3(0.0), vec3(0.0), vec3(0.0), 0.0, false);
}

// A number that is `origin` at the pixel `at` and grows by `slope` a pixel.
fn linear_form(slope: vec2<f32>, origin: f32, at: vec2<f32>) -> vec3<f32> {
    return vec3(slope, origin - dot(slope, at));
}

#ifdef SPLAT_GROVES
// Items of groves lie at the end of the list, the first one last.
fn item_place(place: u32) -> u32 {
    return settings.item_capacity - 1u - atomicLoad(&counters.first_grove_item) - place;
}

fn project(place: u32, lane: u32) -> Splat {
    let own = grove_item(splat_items[item_place(place)], lane);
    var splat = project_point(own, own.first_point);
    splat.visible = splat.visible && (own.count_flags & COUNT) != 0u;
    return splat;
}
#else
fn item_place(place: u32) -> u32 {
#ifdef SPLAT_SECOND
    return atomicLoad(&counters.first_item) + place;
#else
    // Known from the number of the workgroup alone: a software driver then reads the item once for all of it.
    return place;
#endif
}

fn project(place: u32, lane: u32) -> Splat {
    let item = splat_items[item_place(place)];
    var splat = project_point(item, item.first_point + min(lane, (item.count_flags & COUNT) - 1u));
    splat.visible = splat.visible && lane < (item.count_flags & COUNT);
    return splat;
}
#endif

// A piece of a surface.
struct Shape {
    // View space: what D, the way from its centre to a point of its plane, is measured along.
    right: vec3<f32>,
    up: vec3<f32>,
    // How far it reaches from its centre, view space.
    extent: vec3<f32>,
    // As Splat.size.
    size: f32,
}

fn disc(normal: vec3<f32>, area: f32) -> Shape {
    let size = sqrt(area / PI);
    let n = normalize(normal);
    let right = normalize(select(vec3(n.y, -n.x, 0.0), vec3(0.0, n.z, -n.y), abs(n.z) > 0.7));
    return Shape(right, cross(n, right), vec3(size), size);
}

// What an LDI pixel hits, which is what a point stands for: the piece of the surface that is a square as seen along the
// peeling direction, the one its face is most parallel to. On a slanted face it is longer that way.
fn cell(item: SplatItem, face: vec3<f32>, normal: vec3<f32>, area: f32) -> Shape {
    let axes = mat3x3<f32>(
        vec3(item.row_x.x, item.row_y.x, item.row_z.x) * item.inverse_step.x,
        vec3(item.row_x.y, item.row_y.y, item.row_z.y) * item.inverse_step.y,
        vec3(item.row_x.z, item.row_y.z, item.row_z.z) * item.inverse_step.z,
    );
    let steep = abs(face);
    let along_x = steep.x >= steep.y && steep.x >= steep.z;
    let along_y = !along_x && steep.y >= steep.z;
    let axis = select(select(axes[2], axes[1], along_y), axes[0], along_x);
    let right = select(axes[0], axes[2], along_x);
    let up = select(axes[1], axes[2], along_y);
    let size = 0.5 * sqrt(area);
    // The sides of the square, moved along the peeling direction into the surface.
    let slope = axis / dot(normal, axis);
    let extent = size * (abs(right - slope * dot(normal, right)) + abs(up - slope * dot(normal, up)));
    return Shape(right, up, extent, size);
}

fn project_point(item: SplatItem, point: u32) -> Splat {
    var splat = nothing();
    let surfel = surfels_hot[point];
    let grid = vec4(f32(surfel.position_xy & 0xffffu), f32(surfel.position_xy >> 16u), f32(surfel.position_z_face & 0x3fffu), 1.0);
    let center = vec3(dot(item.row_x, grid), dot(item.row_y, grid), dot(item.row_z, grid));
    let clip = view.clip_from_view * vec4(center, 1.0);
    // In front of the near plane: reversed z puts it at depth 1.
    let before = clip.w <= 0.0 || clip.z > clip.w;
    // Not of length 1: nothing here depends on it but the limit of EDGE_ON.
    let face = surfel_face_direction(surfel.position_z_face);
    let along = face * item.inverse_step;
    let normal = vec3(dot(item.row_x.xyz, along), dot(item.row_y.xyz, along), dot(item.row_z.xyz, along));
    let plane = dot(normal, center);
#ifdef SPLAT_PARALLEL
    let orthographic = true;
#else
    let orthographic = false;
#endif
    // Cosine between normal and view, times the distance.
    let toward = select(-plane, normal.z, orthographic);
    let away = select(length(center), 1.0, orthographic);
    let one_sided = surfel_is_one_sided(surfel.position_z_face);
    // Nothing returns early: a software driver runs what follows all the same, for the other threads.
    let hidden = before || abs(toward) < EDGE_ON * away || (toward < 0.0 && one_sided);
    let ndc = clip.xyz / clip.w;
    let pixel = (ndc.xy * vec2(0.5, -0.5) + 0.5) * vec2<f32>(grid_size());
    // World units a pixel there.
    let unit = clip.w / (settings.pixels_per_unit * f32(settings.samples_per_side));
    splat.depth = bitcast<u32>(ndc.z);

    let area = item.area * overlap(item.leaf_overlap, surfel_thickness(surfel.position_z_face), one_sided, item.half_inverse_spacing);
#ifdef SPLAT_SQUARES
    let extent = vec3(0.5 * sqrt(area), 0.5 * sqrt(area), 0.0);
    splat.across.z = 1.0;
#else
#ifdef SPLAT_DISCS
    var shape = disc(normal, area);
    splat.is_disc = true;
#else
    var shape = cell(item, face, normal, area);
#endif
#ifdef SPLAT_MIXED
    if (item.count_flags & AS_DISCS) != 0u {
        shape = disc(normal, area);
        splat.is_disc = true;
    }
#endif
    let right = shape.right;
    let up = shape.up;
    let extent = shape.extent;
    splat.size = shape.size;
    // The ray through the pixel (dx, dy) away from the centre's meets the plane of the splat at D from the centre.
    // In perspective dot(D, right) = (dx a + dy b) / (plane + dx c + dy d); in parallel views the divisor is constant.
    let step = vec2(unit, -unit);
    if orthographic {
        splat.across_u = linear_form(step * (right.xy * normal.z - right.z * normal.xy), 0.0, pixel);
        splat.across_v = linear_form(step * (up.xy * normal.z - up.z * normal.xy), 0.0, pixel);
        splat.across.z = normal.z;
    } else {
        splat.across_u = linear_form(step * (plane * right.xy - dot(center, right) * normal.xy), 0.0, pixel);
        splat.across_v = linear_form(step * (plane * up.xy - dot(center, up) * normal.xy), 0.0, pixel);
        splat.across = linear_form(step * normal.xy, plane, pixel);
    }
#endif
    var reach = extent.xy / unit;
    if !orthographic {
        // What is nearer than the centre looks larger, and away from the axis it moves outwards, too.
        let nearest = max(-center.z - extent.z, 0.1 * -center.z);
        reach = (extent.xy + abs(center.xy / center.z) * extent.z) / unit * (-center.z / nearest);
    }
    splat.begin = max(vec2<i32>(ceil(pixel - reach - 0.5)), vec2(0));
    splat.end = min(vec2<i32>(ceil(pixel + reach - 0.5)), vec2<i32>(grid_size()));
    splat.visible = !hidden && all(splat.begin < splat.end);
    return splat;
}

// Whether the ray through the centre of a pixel meets the splat.
fn covers(splat: Splat, at: vec2<i32>) -> bool {
    let here = vec3(vec2<f32>(at) + 0.5, 1.0);
    let u = dot(splat.across_u, here);
    let v = dot(splat.across_v, here);
    let limit = splat.size * abs(dot(splat.across, here));
    return select(max(abs(u), abs(v)) <= limit, u * u + v * v <= limit * limit, splat.is_disc);
}
