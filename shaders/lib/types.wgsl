// Structs shared with Rust (src/gpu/types.rs, src/asset/surfel.rs); tests/shader_layout.rs compares them.
#define_import_path bevy_treeline::types

struct SurfelHot {
    position_xy: u32,
    position_z_face: u32,
}

struct SurfelCold {
    normal_albedo_rg: u32,
    albedo_b_misc: u32,
}

struct Species {
    lo: vec3<f32>,
    first_point: u32,
    extent: vec3<f32>,
    point_count: u32,
    center: vec3<f32>,
    radius: f32,
    pixel: f32,
    surface_area: f32,
    mean_leaf_area: f32,
    sample_share: f32,
    first_cluster: u32,
    level_count: u32,
    seen_mean: vec2<u32>,
    area_factors: array<u32, 16>,
    light_factors: array<u32, 16>,
}

struct Cluster {
    lo: vec3<f32>,
    first_point: u32,
    extent: vec3<f32>,
    count: u32,
}

struct TreePlace {
    x: f32,
    y: f32,
    z: f32,
}

struct TreeLook {
    rotation: u32,
    tint_seed: u32,
    species_scale: u32,
}

struct InstanceBlock {
    lo: vec3<f32>,
    first_instance: u32,
    extent: vec3<f32>,
    counts: u32,
    fade_begin: f32,
    fade_end: f32,
    first_sample: u32,
    complete_below: f32,
    top: f32,
    pad: array<u32, 3>,
    marks: array<u32, 16>,
}

struct ViewBlock {
    block: u32,
    first_instance: u32,
    state: u32,
    runs: atomic<u32>,
    items: atomic<u32>,
    listed: u32,
}

struct TreeDraw {
    count: u32,
    radius: f32,
    mask: u32,
    near: u32,
}

struct Run {
    first_item: u32,
    instance: u32,
    first_point: u32,
    points: u32,
    radius: f32,
}

struct WorkItem {
    instance: u32,
    first_point: u32,
    count: u32,
    radius: f32,
}

struct SplatItem {
    row_x: vec4<f32>,
    row_y: vec4<f32>,
    row_z: vec4<f32>,
    inverse_step: vec3<f32>,
    first_point: u32,
    area: f32,
    leaf_overlap: f32,
    half_inverse_spacing: f32,
    count_flags: u32,
}

struct SelectSettings {
    size: vec2<u32>,
    origin: vec2<u32>,
    block_count: u32,
    item_capacity: u32,
    pixels_per_unit: f32,
    quality: f32,
    min_mesh_distance: f32,
    fade_width: f32,
    fade_jitter: f32,
    overlap_gain: f32,
    orthographic: u32,
    splat_shape: u32,
    has_prepass: u32,
    culling_frozen: u32,
    culling_planes: mat4x4<f32>,
    culling_eye: vec3<f32>,
    phase: u32,
    previous_clip_from_world: mat4x4<f32>,
    occlusion: u32,
    previous_valid: u32,
    pyramid_previous: u32,
    pyramid_current: u32,
    listable_blocks: u32,
    first_grove_run: u32,
    window: u32,
    samples_per_side: u32,
    contrast: f32,
    pad: u32,
    pad_pair: vec2<u32>,
}

struct Counters {
    instances_seen: atomic<u32>,
    culled_frustum: atomic<u32>,
    culled_small: atomic<u32>,
    culled_occluded: atomic<u32>,
    as_mesh: atomic<u32>,
    in_fade: atomic<u32>,
    points: atomic<u32>,
    items: atomic<u32>,
    item_overflow: atomic<u32>,
    covered_blocks: atomic<u32>,
    covered_pixels: atomic<u32>,
    groves: atomic<u32>,
    phase_items: atomic<u32>,
    phase_runs: atomic<u32>,
    phase_grove_items: atomic<u32>,
    phase_grove_runs: atomic<u32>,
    first_item: atomic<u32>,
    first_grove_item: atomic<u32>,
    second_points: atomic<u32>,
    near_trees: atomic<u32>,
}

struct IndirectArgs {
    cull: vec3<u32>,
    pad: u32,
    clusters: vec3<u32>,
    pad_clusters: u32,
    emit: vec3<u32>,
    pad_emit: u32,
    expand: vec3<u32>,
    pad_expand: u32,
    expand_groves: vec3<u32>,
    pad_expand_groves: u32,
    splat: vec3<u32>,
    pad_splat: u32,
    groves: vec3<u32>,
    pad_groves: u32,
    resolve: vec4<u32>,
}

struct TemporalSettings {
    frames_at_rest: f32,
    frames_in_motion: f32,
    clip: f32,
    reset: u32,
}
