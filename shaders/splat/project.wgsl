// A point of a work item on the screen: an oriented disc (or a square, for debugging) and the pixels it may touch.
//
// CPU twin: src/forest/splat.rs.
#define_import_path bevy_treeline::project

#import bevy_treeline::instance::{rotate, rotation_of, species_of}
#import bevy_treeline::lod::overlap
#import bevy_treeline::splat_bindings::{instances, items, settings, species, surfels_hot, view}
#import bevy_treeline::surfel::{surfel_face_normal, surfel_is_one_sided, surfel_position}

// Below this cosine between view and normal a disc is a line, and its plane no use.
const EDGE_ON: f32 = 0.02;

struct Splat {
    // False: nothing to draw.
    visible: bool,
    // Bits of the reversed-z depth of the centre.
    depth: u32,
    // Pixels begin..end (end excluded), in the viewport.
    begin: vec2<i32>,
    end: vec2<i32>,
    // View space: centre, unit normal, and their product; world units.
    center: vec3<f32>,
    normal: vec3<f32>,
    plane: f32,
    // Peeling direction, along which the splat is a disc; 0: it is one in its own plane.
    axis: vec3<f32>,
    radius_squared: f32,
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
    let rotation = rotation_of(instance);
    let model = surfel_position(surfel.position_xy, surfel.position_z_face, kind.lo, kind.extent);
    let world = instance.position + rotate(rotation, model * instance.scale);
    let model_face = surfel_face_normal(surfel.position_z_face);
    let face = rotate(rotation, model_face);

    let clip = view.clip_from_world * vec4(world, 1.0);
    // In front of the near plane: reversed z puts it at depth 1.
    if clip.w <= 0.0 || clip.z > clip.w {
        return splat;
    }
    let orthographic = settings.orthographic != 0u;
    let to_eye = select(normalize(view.world_position - world), view.world_from_view[2].xyz, orthographic);
    let facing = dot(face, to_eye);
    let one_sided = surfel_is_one_sided(surfel.position_z_face);
    if abs(facing) < EDGE_ON || (facing < 0.0 && one_sided) {
        return splat;
    }
    let ndc = clip.xyz / clip.w;
    splat.pixel = (ndc.xy * vec2(0.5, -0.5) + 0.5) * vec2<f32>(settings.size);
    splat.unit = clip.w / settings.pixels_per_unit;
    splat.depth = bitcast<u32>(ndc.z);
    splat.center = (view.view_from_world * vec4(world, 1.0)).xyz;
    splat.normal = (view.view_from_world * vec4(face, 0.0)).xyz;
    splat.plane = dot(splat.normal, splat.center);
    let leaf_area = kind.mean_leaf_area * instance.scale * instance.scale;
    var radius_squared = item.radius * item.radius * overlap(item.radius, leaf_area, !one_sided, settings.overlap_gain);
    var radius = sqrt(radius_squared);
    // A point stands for what an LDI pixel hits: a disc as seen along the peeling direction, the one its face is most
    // parallel to; on a slanted face it is longer that way.
    if kind.sample_share > 0.0 {
        let steep = abs(model_face);
        var axis = vec3(0.0, 0.0, 1.0);
        if steep.x >= steep.y && steep.x >= steep.z {
            axis = vec3(1.0, 0.0, 0.0);
        } else if steep.y >= steep.z {
            axis = vec3(0.0, 1.0, 0.0);
        }
        radius_squared *= kind.sample_share;
        radius = sqrt(radius_squared) / dot(steep, axis);
        splat.axis = (view.view_from_world * vec4(rotate(rotation, axis), 0.0)).xyz;
    }
    splat.radius_squared = radius_squared;
    // A disc's outline reaches its radius only across the direction it leans to, but perspective stretches it away
    // from the axis: bound it by the stretch of a sphere.
    var reach = radius / splat.unit;
    if settings.splat_shape == 0u {
        let axis = splat.center / max(-splat.center.z, 1e-6);
        reach *= select(length(axis), 1.0, orthographic) * (1.0 + reach / settings.pixels_per_unit);
    } else {
        // A square of the disc's area.
        reach *= 0.88622693;
    }
    let last = vec2<i32>(settings.size);
    splat.begin = max(vec2<i32>(ceil(splat.pixel - reach - 0.5)), vec2(0));
    splat.end = min(vec2<i32>(ceil(splat.pixel + reach - 0.5)), last);
    splat.visible = all(splat.begin < splat.end);
    return splat;
}

// Whether the ray through the centre of a pixel meets the disc.
fn covers(splat: Splat, at: vec2<i32>) -> bool {
    if settings.splat_shape != 0u {
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
    let along_axis = dot(d, splat.axis);
    return dot(d, d) - along_axis * along_axis <= splat.radius_squared;
}
