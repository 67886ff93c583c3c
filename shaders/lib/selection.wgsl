// How many points of a tree are drawn, apart from culling. CPU twin: `select_instance` in src/forest/select.rs.
#define_import_path bevy_treeline::selection

#import bevy_treeline::hash::unit_from_bits
#import bevy_treeline::instance::{TreeInstance, has_mesh, hash_of, seed_of}
#import bevy_treeline::lod::{d_zero, fade_band, fade_state, prefix_count, range_share, round_count}
#import bevy_treeline::types::{SelectSettings, Species}

struct Wanted {
    // Points, whole.
    count: u32,
    // Before fading and rounding: splats are as large as so many need, since points leave and do not grow.
    full: f32,
    // Drawn by its mesh alone; by both.
    as_mesh: bool,
    fading: bool,
}

// At distance `d` from the eye; a parallel view has the same scale everywhere: distance 1, where Z0 holds.
fn wanted_points(settings: SelectSettings, instance: TreeInstance, kind: Species, d: f32, fade_begin: f32, fade_end: f32) -> Wanted {
    let s = kind.pixel * instance.scale;
    let n = prefix_count(f32(kind.point_count), s, settings.pixels_per_unit, d, settings.quality);
    var found = Wanted(0u, n, false, false);
    var points = n;
    if settings.orthographic == 0u {
        // Parallel views draw points only.
        if has_mesh(instance.look) {
            let hash = unit_from_bits(seed_of(instance.look));
            let band = fade_band(d_zero(s, settings.pixels_per_unit), settings.min_mesh_distance, settings.fade_width, settings.fade_jitter, hash);
            let state = fade_state(band, d);
            if state.points <= 0.0 {
                found.as_mesh = true;
                return found;
            }
            found.fading = state.mesh > 0.0;
            points *= state.points;
        }
        points *= range_share(d, fade_begin, fade_end);
    }
    found.count = min(round_count(points, hash_of(instance)), kind.point_count);
    return found;
}
