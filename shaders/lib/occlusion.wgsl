// Boxes against a depth pyramid. CPU twin: src/math/occlusion.rs.
#define_import_path bevy_treeline::occlusion

const PYRAMID_LEVELS: u32 = 5u;

// A box on the screen.
struct ScreenBox {
    // Pixels.
    lo: vec2<f32>,
    hi: vec2<f32>,
    // Reversed-z depth of its nearest corner.
    depth: f32,
    // Least distance along the view axis (`w`).
    nearest: f32,
    // False: it reaches before the near plane, and hides from nothing.
    bounded: bool,
}

// The box that a corner and three edges span in clip space.
fn screen_box(corner: vec4<f32>, right: vec4<f32>, up: vec4<f32>, back: vec4<f32>, size: vec2<f32>) -> ScreenBox {
    var found = ScreenBox(vec2(1e30), vec2(-1e30), 0.0, 1e30, true);
    for (var i = 0u; i < 8u; i++) {
        let clip = corner + f32(i & 1u) * right + f32((i >> 1u) & 1u) * up + f32(i >> 2u) * back;
        if clip.w <= 1e-6 || clip.z > clip.w {
            found.bounded = false;
            return found;
        }
        let ndc = clip.xyz / clip.w;
        let pixel = (ndc.xy * vec2(0.5, -0.5) + 0.5) * size;
        found.lo = min(found.lo, pixel);
        found.hi = max(found.hi, pixel);
        found.depth = max(found.depth, ndc.z);
        found.nearest = min(found.nearest, clip.w);
    }
    return found;
}

// Side of a texel of a level, in pixels: 4, 16, 64, 256, 1024.
fn pyramid_side(level: u32) -> u32 {
    return 4u << (2u * level);
}

// Texels of a level for a picture of `size` pixels.
fn pyramid_size(size: vec2<u32>, level: u32) -> vec2<u32> {
    let side = pyramid_side(level);
    return (size + side - 1u) / side;
}

// Place of a level's first texel.
fn pyramid_offset(size: vec2<u32>, level: u32) -> u32 {
    // Without a loop: a software driver runs it for the thread that needs it longest.
    let first = pyramid_size(size, 0u);
    let second = pyramid_size(size, 1u);
    let third = pyramid_size(size, 2u);
    let fourth = pyramid_size(size, 3u);
    let finer = select(0u, first.x * first.y, level > 0u) + select(0u, second.x * second.y, level > 1u);
    return finer + select(0u, third.x * third.y, level > 2u) + select(0u, fourth.x * fourth.y, level > 3u);
}

// The finest level where `span` pixels meet at most five texels.
fn pyramid_level(span: f32) -> u32 {
    return select(0u, 1u, span > 16.0) + select(0u, 1u, span > 64.0) + select(0u, 1u, span > 256.0) + select(0u, 1u, span > 1024.0);
}
