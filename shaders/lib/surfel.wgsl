// The baked point, unpacked from its words. Twin of src/asset/surfel.rs, where the layout is described.
// Each function takes only the words it needs, so that a pass reads no more than that.
#define_import_path bevy_treeline::surfel

#import bevy_treeline::octahedral

// Bits of surfel_flags.
const SURFEL_LEAF: u32 = 1u;
const SURFEL_TWO_SIDED: u32 = 2u;
const SURFEL_UNLIT: u32 = 4u;
const SURFEL_KEEPS_NORMAL: u32 = 8u;

// Hot half: model space, within the model's box.
fn surfel_position(position_xy: u32, position_z_face: u32, box_lo: vec3<f32>, box_extent: vec3<f32>) -> vec3<f32> {
    let q = vec3<u32>(position_xy & 0xffffu, position_xy >> 16u, position_z_face & 0x3fffu);
    return box_lo + vec3<f32>(q) / vec3(65535.0, 65535.0, 16383.0) * box_extent;
}

// Hot half: thickness class, 0 to 3.
fn surfel_thickness(position_z_face: u32) -> u32 {
    return (position_z_face >> 14u) & 3u;
}

// Hot half: unit normal of the triangle.
fn surfel_face_normal(position_z_face: u32) -> vec3<f32> {
    let q = vec2<u32>((position_z_face >> 16u) & 255u, (position_z_face >> 24u) & 127u);
    return octahedral::decode_bits(q, 8u, 7u);
}

// Hot half: the same, not normalised.
fn surfel_face_direction(position_z_face: u32) -> vec3<f32> {
    let q = vec2<u32>((position_z_face >> 16u) & 255u, (position_z_face >> 24u) & 127u);
    return octahedral::decode_direction_bits(q, 8u, 7u);
}

// Hot half: true if the point is seen from the front of its face only.
fn surfel_is_one_sided(position_z_face: u32) -> bool {
    return (position_z_face >> 31u) != 0u;
}

// Cold half: unit shading normal.
fn surfel_normal(normal_albedo_rg: u32) -> vec3<f32> {
    return octahedral::decode_bits(vec2<u32>(normal_albedo_rg & 255u, (normal_albedo_rg >> 8u) & 255u), 8u, 8u);
}

// sRGB (0 to 1) → linear light. Twin of math::quantize::srgb8_to_linear.
fn srgb_to_linear(srgb: vec3<f32>) -> vec3<f32> {
    let curve = pow((srgb + 0.055) / 1.055, vec3<f32>(2.4));
    return select(curve, srgb / 12.92, srgb <= vec3<f32>(0.04045));
}

// Cold half: albedo in linear light.
fn surfel_albedo(normal_albedo_rg: u32, albedo_b_misc: u32) -> vec3<f32> {
    let srgb = vec3<u32>((normal_albedo_rg >> 16u) & 255u, normal_albedo_rg >> 24u, albedo_b_misc & 255u);
    return srgb_to_linear(vec3<f32>(srgb) / 255.0);
}

// Cold half: SURFEL_LEAF, SURFEL_TWO_SIDED, SURFEL_UNLIT, SURFEL_KEEPS_NORMAL.
fn surfel_flags(albedo_b_misc: u32) -> u32 {
    return (albedo_b_misc >> 8u) & 15u;
}

// Cold half: perceptual roughness, 0 to 1.
fn surfel_roughness(albedo_b_misc: u32) -> f32 {
    return f32((albedo_b_misc >> 12u) & 15u) / 15.0;
}

// Cold half: share of the sky that reaches the point, 0 to 1.
fn surfel_ambient_visibility(albedo_b_misc: u32) -> f32 {
    return f32((albedo_b_misc >> 16u) & 255u) / 255.0;
}

// What ambient visibility does to the colour. Twin of asset::light_factor.
fn surfel_light_factor(ambient_visibility: f32) -> f32 {
    return min(0.2 + 1.05 * ambient_visibility, 1.0);
}

// Cold half: colour class for deferred blending.
fn surfel_group(albedo_b_misc: u32) -> u32 {
    return (albedo_b_misc >> 24u) & 15u;
}

// Cold half: metalness, 0 to 1.
fn surfel_metallic(albedo_b_misc: u32) -> f32 {
    return f32(albedo_b_misc >> 28u) / 15.0;
}
