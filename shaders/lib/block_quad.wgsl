// Quads over the 16×16 blocks of pixels that show points (see classify.wgsl).
#define_import_path bevy_treeline::block_quad

// Clip position of corner 0 to 5 (two triangles) of a block, in a viewport of `size` pixels. `block`: its first column |
// row << 16.
fn block_corner(block: u32, corner: u32, size: vec2<f32>) -> vec4<f32> {
    let right = select(0u, #{RESOLVE_BLOCK}u, corner == 1u || corner == 2u || corner == 4u);
    let down = select(0u, #{RESOLVE_BLOCK}u, corner == 2u || corner == 4u || corner == 5u);
    let pixel = vec2<f32>(vec2((block & 0xffffu) + right, (block >> 16u) + down));
    return vec4(pixel / size * vec2(2.0, -2.0) + vec2(-1.0, 1.0), 0.0, 1.0);
}
