// What a debug view shows of a point: its part of resolve, compiled only where such a view is on.
#define_import_path bevy_treeline::debug_view

#import bevy_pbr::mesh_view_bindings::view
#import bevy_treeline::hash::unit_from_bits
#import bevy_treeline::instance::{TreeInstance, has_mesh, rotate, rotation_of, seed_of, tint_of}
#import bevy_treeline::lod::{OF_GROVE, PI, d_zero, fade_band, fade_state, prefix_count}
#import bevy_treeline::surfel::{surfel_albedo, surfel_ambient_visibility}
#import bevy_treeline::types::{SelectSettings, Species, SurfelCold, WorkItem}


// forest::DebugView.
const POINTS_AND_TRIANGLES: u32 = 1u;
const PREFIX_LENGTH: u32 = 2u;
const POINTS_PER_PIXEL: u32 = 3u;
const FADE_BAND: u32 = 4u;
const TILES: u32 = 5u;
const SURFEL_NORMALS: u32 = 6u;
const AMBIENT_VISIBILITY: u32 = 7u;

// 0 blue, 0.25 cyan, 0.5 green, 0.75 yellow, 1 red.
fn heat(value: f32) -> vec3<f32> {
    let t = 4.0 * clamp(value, 0.0, 1.0);
    return clamp(vec3(t - 2.0, min(t, 4.0 - t), 2.0 - t), vec3(0.0), vec3(1.0));
}

fn debug_color(kind: u32, item: WorkItem, instance: TreeInstance, tree: Species, settings: SelectSettings, cold: SurfelCold, normal: vec3<f32>, world_position: vec3<f32>) -> vec3<f32> {
    let orthographic = settings.orthographic != 0u;
    // The area that a point stands for, world units². Items of groves hold many trees.
    var area = PI * item.radius * item.radius;
    if (item.count & OF_GROVE) != 0u {
        let d = select(distance(world_position, view.world_position), 1.0, orthographic);
        let n = prefix_count(f32(tree.point_count), tree.pixel * instance.scale, settings.pixels_per_unit, d, settings.quality);
        area = tree.surface_area * instance.scale * instance.scale / n;
    }
    switch kind {
        case POINTS_AND_TRIANGLES: {
            return vec3(1.0, 0.0, 0.0);
        }
        case PREFIX_LENGTH: {
            let drawn = tree.surface_area * instance.scale * instance.scale / (area * f32(tree.point_count));
            return heat(1.0 + log2(drawn) / 12.0);
        }
        case POINTS_PER_PIXEL: {
            let pixel = select(distance(world_position, view.world_position), 1.0, orthographic) / settings.pixels_per_unit;
            return heat((2.0 + log2(pixel * pixel / area)) / 6.0);
        }
        case FADE_BAND: {
            let center = instance.position + rotate(rotation_of(instance.look), tree.center * instance.scale);
            let start = d_zero(tree.pixel * instance.scale, settings.pixels_per_unit);
            let band = fade_band(start, settings.min_mesh_distance, settings.fade_width, settings.fade_jitter, unit_from_bits(seed_of(instance.look)));
            let state = fade_state(band, distance(center, view.world_position));
            let fades = has_mesh(instance.look) && !orthographic && state.mesh > 0.0;
            return select(vec3(0.0, 0.5, 0.0), vec3(1.0, 0.25, 0.0), fades);
        }
        case TILES: {
            // The only place that says what a tile is.
            let tile = item.instance / 256u;
            return vec3(unit_from_bits(3u * tile), unit_from_bits(3u * tile + 1u), unit_from_bits(3u * tile + 2u));
        }
        case SURFEL_NORMALS: {
            return 0.5 + 0.5 * normal;
        }
        case AMBIENT_VISIBILITY: {
            return vec3(surfel_ambient_visibility(cold.albedo_b_misc));
        }
        default: {
            return surfel_albedo(cold.normal_albedo_rg, cold.albedo_b_misc) * tint_of(instance.look);
        }
    }
}
