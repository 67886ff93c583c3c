// A point of a work item on the screen: a piece of the surface (or a screen-aligned square, for debugging) and the
// pixels it may touch.
#define_import_path bevy_treeline::project

#import bevy_treeline::instance::{matrix_of, rotation_of, species_of}
#import bevy_treeline::lod::{PI, overlap}
#import bevy_treeline::splat_bindings::{grid_size, instances, items, settings, species, surfels_hot, view}
#import bevy_treeline::surfel::{surfel_face_normal, surfel_is_one_sided, surfel_position, surfel_thickness}

// Below this cosine between view and normal a splat is a line, and its plane no use.
const EDGE_ON: f32 = 0.02;
// `SelectSettings.splat_shape`.
const CELLS: u32 = 0u;
const DISCS: u32 = 1u;

struct Splat {
    // False: nothing to draw.
    visible: bool,
    // Bits of the reversed-z depth of the centre.
    depth: u32,
    // Samples begin..end (end excluded), in the viewport. A pixel here is a sample.
    begin: vec2<i32>,
    end: vec2<i32>,
    // View space: centre, unit normal, and their product; world units.
    center: vec3<f32>,
    normal: vec3<f32>,
    plane: f32,
    // View space: the sides of an LDI pixel. Both 0: the splat is a disc in its own plane.
    right: vec3<f32>,
    up: vec3<f32>,
    // Half the side of a cell, or the squared radius of a disc.
    size: f32,
    // Pixel of the centre, and world units per pixel there.
    pixel: vec2<f32>,
    unit: f32,
}

fn project(item_index: u32, lane: u32) -> Splat {
    var splat: Splat;
    splat.visible = false;
    let item = items[item_index];
    if lane >= item.count {
        return splat;
    }
    let instance = instances[item.instance];
    let kind = species[species_of(instance)];
    let surfel = surfels_hot[item.first_point + lane];
    let model = surfel_position(surfel.position_xy, surfel.position_z_face, kind.lo, kind.extent);
    let face = surfel_face_normal(surfel.position_z_face);
    // One matrix for everything: rotations are the same for all points of an item, but a lane has no one to ask.
    let view_from_model = mat3x3<f32>(view.view_from_world[0].xyz, view.view_from_world[1].xyz, view.view_from_world[2].xyz) * matrix_of(rotation_of(instance));
    let foot = view.view_from_world * vec4(instance.position, 1.0);
    splat.center = foot.xyz + view_from_model * (model * instance.scale);
    splat.normal = view_from_model * face;
    splat.plane = dot(splat.normal, splat.center);

    let clip = view.clip_from_view * vec4(splat.center, 1.0);
    // In front of the near plane: reversed z puts it at depth 1.
    if clip.w <= 0.0 || clip.z > clip.w {
        return splat;
    }
    let orthographic = settings.orthographic != 0u;
    // Cosine between normal and view, times the distance.
    let toward = select(-splat.plane, splat.normal.z, orthographic);
    let away = select(length(splat.center), 1.0, orthographic);
    let one_sided = surfel_is_one_sided(surfel.position_z_face);
    if abs(toward) < EDGE_ON * away || (toward < 0.0 && one_sided) {
        return splat;
    }
    let ndc = clip.xyz / clip.w;
    splat.pixel = (ndc.xy * vec2(0.5, -0.5) + 0.5) * vec2<f32>(grid_size());
    splat.unit = clip.w / (settings.pixels_per_unit * f32(settings.samples_per_side));
    splat.depth = bitcast<u32>(ndc.z);

    let leaf_area = kind.mean_leaf_area * instance.scale * instance.scale;
    let shape = select(settings.splat_shape, DISCS, settings.splat_shape == CELLS && kind.sample_share == 0.0);
    // Mean distance of drawn points in LDI pixels: sqrt(N0 / N), from what each stands for.
    let pixel = kind.pixel * instance.scale;
    let spacing = item.radius / pixel * sqrt(PI * max(kind.sample_share, 0.6));
    let grown = overlap(item.radius, leaf_area, settings.overlap_gain, surfel_thickness(surfel.position_z_face), one_sided, spacing);
    // Area of the splat; of a cell, as seen along the peeling direction.
    var area = PI * item.radius * item.radius * grown;
    // How far the splat reaches from its centre, view space.
    var extent = vec3(sqrt(area / PI));
    if shape == CELLS {
        // A point stands for what an LDI pixel hits: the piece of the surface that is a square as seen along the
        // peeling direction, which is the one its face is most parallel to. On a slanted face it is longer that way.
        let steep = abs(face);
        var axis = view_from_model[2];
        splat.right = view_from_model[0];
        splat.up = view_from_model[1];
        if steep.x >= steep.y && steep.x >= steep.z {
            axis = view_from_model[0];
            splat.right = view_from_model[2];
        } else if steep.y >= steep.z {
            axis = view_from_model[1];
            splat.up = view_from_model[2];
        }
        area *= kind.sample_share;
        splat.size = 0.5 * sqrt(area);
        // The sides of the square, moved along the peeling direction into the surface.
        let slope = axis / dot(splat.normal, axis);
        let along_right = splat.right - slope * dot(splat.normal, splat.right);
        let along_up = splat.up - slope * dot(splat.normal, splat.up);
        extent = splat.size * (abs(along_right) + abs(along_up));
    } else if shape == DISCS {
        splat.size = area / PI;
    } else {
        extent = vec3(0.5 * sqrt(area), 0.5 * sqrt(area), 0.0);
    }
    var reach = extent.xy / splat.unit;
    if !orthographic {
        // What is nearer than the centre looks larger, and away from the axis it moves outwards, too.
        let nearest = max(-splat.center.z - extent.z, 0.1 * -splat.center.z);
        reach = (extent.xy + abs(splat.center.xy / splat.center.z) * extent.z) / splat.unit * (-splat.center.z / nearest);
    }
    splat.begin = max(vec2<i32>(ceil(splat.pixel - reach - 0.5)), vec2(0));
    splat.end = min(vec2<i32>(ceil(splat.pixel + reach - 0.5)), vec2<i32>(grid_size()));
    splat.visible = all(splat.begin < splat.end);
    return splat;
}

// Whether the ray through the centre of a pixel meets the splat.
fn covers(splat: Splat, at: vec2<i32>) -> bool {
    if settings.splat_shape > DISCS {
        return true;
    }
    let offset = (vec2<f32>(at) + 0.5 - splat.pixel) * vec2(splat.unit, -splat.unit);
    let on_plane = vec3(splat.center.xy + offset, splat.center.z);
    var d: vec3<f32>;
    if settings.orthographic != 0u {
        let along = dot(splat.normal, on_plane - splat.center) / splat.normal.z;
        d = vec3(offset, -along);
    } else {
        d = on_plane * (splat.plane / dot(splat.normal, on_plane)) - splat.center;
    }
    let across = max(abs(dot(d, splat.right)), abs(dot(d, splat.up)));
    if dot(splat.right, splat.right) > 0.0 {
        return across <= splat.size;
    }
    return dot(d, d) <= splat.size;
}
