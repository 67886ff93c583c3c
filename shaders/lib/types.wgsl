// Structs shared with Rust, where they are declared with `gpu_types!`. tests/shader_layout.rs compares the two.
#define_import_path bevy_treeline::types

// The half of a surfel that the splat pass reads. Unpacked by surfel.wgsl.
struct SurfelHot {
    position_xy: u32,
    position_z_face: u32,
}

// The half of a surfel that the resolve pass reads. Unpacked by surfel.wgsl.
struct SurfelCold {
    normal_albedo_rg: u32,
    albedo_b_misc: u32,
}
