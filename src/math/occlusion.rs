//! Boxes against a depth pyramid: is all of a box behind what has been drawn? (Greene, Kass and Miller 1993,
//! "Hierarchical Z-buffer visibility".) The WGSL twin is `shaders/lib/occlusion.wgsl`.
//!
//! The pyramid keeps the *farthest* depth of squares of 4, 16, 64, 256 and 1,024 pixels; a box is hidden if its nearest corner
//! is farther than that in every square that it meets. Depths are reversed: 1 is near, 0 is far.

use bevy::math::{Mat4, UVec2, Vec2, Vec3, Vec4, Vec4Swizzles};

/// Levels of a pyramid.
pub const PYRAMID_LEVELS: u32 = 5;

/// A box on the screen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScreenBox {
    /// Left and upper side, pixels.
    pub lo: Vec2,
    /// Right and lower side, pixels.
    pub hi: Vec2,
    /// Reversed-z depth of its nearest corner.
    pub depth: f32,
    /// Least distance along the view axis (`w`).
    pub nearest: f32,
    /// False: it reaches before the near plane, and hides from nothing.
    pub bounded: bool,
}

/// The box from `lo` to `lo + extent` seen through `clip_from_box` on a picture of `size` pixels. Exact: the corners of a
/// convex body bound its picture, also of flat and tall ones at grazing views.
pub fn screen_box(clip_from_box: &Mat4, lo: Vec3, extent: Vec3, size: Vec2) -> ScreenBox {
    let corner = *clip_from_box * lo.extend(1.0);
    let edges: [Vec4; 3] = [
        clip_from_box.x_axis * extent.x,
        clip_from_box.y_axis * extent.y,
        clip_from_box.z_axis * extent.z,
    ];
    let mut found = ScreenBox {
        lo: Vec2::splat(1e30),
        hi: Vec2::splat(-1e30),
        depth: 0.0,
        nearest: 1e30,
        bounded: true,
    };
    for i in 0..8u32 {
        let [x, y, z] = [i & 1, i >> 1 & 1, i >> 2].map(|bit| bit as f32);
        let clip = corner + x * edges[0] + y * edges[1] + z * edges[2];
        if clip.w <= 1e-6 || clip.z > clip.w {
            found.bounded = false;
            return found;
        }
        let ndc = clip.xyz() / clip.w;
        let pixel = (ndc.truncate() * Vec2::new(0.5, -0.5) + 0.5) * size;
        found.lo = found.lo.min(pixel);
        found.hi = found.hi.max(pixel);
        found.depth = found.depth.max(ndc.z);
        found.nearest = found.nearest.min(clip.w);
    }
    found
}

/// Side of a texel of a level, in pixels: 4, 16, 64, 256, 1,024.
pub fn pyramid_side(level: u32) -> u32 {
    4 << (2 * level)
}

/// Texels of a level for a picture of `size` pixels.
pub fn pyramid_size(size: UVec2, level: u32) -> UVec2 {
    let side = pyramid_side(level);
    (size + side - 1) / side
}

/// Place of a level's first texel; that of [`PYRAMID_LEVELS`] is the number of all texels.
pub fn pyramid_offset(size: UVec2, level: u32) -> u32 {
    (0..level).map(|i| pyramid_size(size, i).element_product()).sum()
}

/// The finest level where `span` pixels meet at most five texels.
pub fn pyramid_level(span: f32) -> u32 {
    (0..PYRAMID_LEVELS - 1)
        .filter(|i| span > (4 * pyramid_side(*i)) as f32)
        .max()
        .map_or(0, |i| i + 1)
}

/// The pyramid over the depths of a picture, row by row: the farthest of each square. `is_closed`: single pixels that are
/// farther than their neighbours in a 2×2 square are taken for those.
pub fn pyramid(depths: &[f32], size: UVec2, is_closed: bool) -> Vec<f32> {
    let at = |x: u32, y: u32| depths[(y.min(size.y - 1) * size.x + x.min(size.x - 1)) as usize];
    let mut out = vec![];
    for level in 0..PYRAMID_LEVELS {
        let (texels, side) = (pyramid_size(size, level), pyramid_side(level));
        for (ty, tx) in (0..texels.y).flat_map(|y| (0..texels.x).map(move |x| (y, x))) {
            let mut farthest = 1.0f32;
            let step = if is_closed { 2 } else { 1 };
            for y in (ty * side..((ty + 1) * side).min(size.y)).step_by(step) {
                for x in (tx * side..((tx + 1) * side).min(size.x)).step_by(step) {
                    let mut depth = at(x, y);
                    if is_closed {
                        depth = depth.max(at(x + 1, y)).max(at(x, y + 1)).max(at(x + 1, y + 1));
                    }
                    farthest = farthest.min(depth);
                }
            }
            out.push(farthest);
        }
    }
    out
}

/// Whether a box is behind everything in the pyramid; `margin` pixels around it count as its own. What reaches before the
/// near plane or lies wholly off the picture is not.
pub fn is_hidden(pyramid: &[f32], size: UVec2, seen: &ScreenBox, margin: f32) -> bool {
    let (lo, hi) = (seen.lo - margin, seen.hi + margin);
    let last = size.as_vec2() - 1.0;
    if !seen.bounded || hi.cmplt(Vec2::ZERO).any() || lo.cmpgt(last).any() {
        return false;
    }
    let (lo, hi) = (lo.clamp(Vec2::ZERO, last), hi.clamp(Vec2::ZERO, last));
    let level = pyramid_level((hi - lo).max_element());
    let (first, texels) = (pyramid_offset(size, level), pyramid_size(size, level));
    let side = pyramid_side(level) as f32;
    let (begin, end) = ((lo / side).as_uvec2(), (hi / side).as_uvec2().min(texels - 1));
    for y in begin.y..=end.y {
        for x in begin.x..=end.x {
            if seen.depth >= pyramid[(first + y * texels.x + x) as usize] {
                return false;
            }
        }
    }
    true
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const SIZE: UVec2 = UVec2::new(330, 190);

    fn clip() -> Mat4 {
        let view = Mat4::look_at_rh(Vec3::new(0.0, 2.0, 0.0), Vec3::new(0.0, 2.0, -10.0), Vec3::Y);
        Mat4::perspective_infinite_reverse_rh(0.8, 330.0 / 190.0, 0.1) * view
    }

    #[test]
    fn levels_cover_the_picture() {
        assert_eq!(pyramid_size(SIZE, 0), UVec2::new(83, 48));
        assert_eq!(pyramid_size(SIZE, 4), UVec2::ONE);
        let spans = [10.0, 16.0, 17.0, 65.0, 300.0, 1e9];
        assert_eq!(spans.map(pyramid_level), [0, 0, 1, 2, 3, 4]);
        let all = pyramid(&vec![0.5; 330 * 190], SIZE, false);
        assert_eq!(all.len() as u32, pyramid_offset(SIZE, PYRAMID_LEVELS));
        assert!(all.iter().all(|depth| *depth == 0.5));
    }

    #[test]
    fn closing_ignores_holes_of_a_pixel() {
        let mut depths = vec![0.5; 330 * 190];
        depths[20 * 330 + 21] = 0.0;
        assert_eq!(pyramid(&depths, SIZE, false)[5 * 83 + 5], 0.0);
        assert_eq!(pyramid(&depths, SIZE, true)[5 * 83 + 5], 0.5);
        for (x, y) in [(22, 20), (23, 20), (22, 21), (23, 21)] {
            depths[y * 330 + x] = 0.0;
        }
        assert_eq!(pyramid(&depths, SIZE, true)[5 * 83 + 5], 0.0);
    }

    #[test]
    fn what_reaches_behind_the_eye_is_never_hidden() {
        let near =
            screen_box(&clip(), Vec3::new(-1.0, 1.0, -1.0), Vec3::splat(2.0), SIZE.as_vec2());
        assert!(
            !near.bounded
                && !is_hidden(&pyramid(&vec![1.0; 330 * 190], SIZE, false), SIZE, &near, 0.0)
        );
    }

    proptest! {
        // No point of a hidden box is in front of the wall, and what is far behind the wall is hidden.
        #[test]
        fn hidden_boxes_are_behind(x in -8.0f32..8.0, y in -3.0f32..6.0, z in -60.0f32..-4.0, side in 0.05f32..6.0, wall in 5.0f32..50.0) {
            let depth = 0.1 / wall;
            let depths = pyramid(&vec![depth; 330 * 190], SIZE, false);
            let seen = screen_box(&clip(), Vec3::new(x, y, z), Vec3::splat(side), SIZE.as_vec2());
            let hidden = is_hidden(&depths, SIZE, &seen, 1.0);
            if hidden {
                prop_assert!(-(z + side) > wall * 0.999, "{seen:?}");
            } else if seen.bounded && -(z + side) > wall * 1.01 {
                let on_screen = seen.hi.cmpge(Vec2::ZERO).all() && seen.lo.cmple(SIZE.as_vec2()).all();
                prop_assert!(!on_screen || seen.lo.cmpgt(SIZE.as_vec2() - 2.5).any(), "{seen:?}");
            }
        }

        // A part of a box that is hidden is hidden too, whatever the level that each is tested on.
        #[test]
        fn parts_of_hidden_boxes_are_hidden(seed in 0u64..1000, x in -6.0f32..4.0, z in -60.0f32..-10.0, side in 0.5f32..6.0) {
            let mut random = crate::math::hash::SplitMix64(seed);
            let depths: Vec<f32> = (0..330 * 190).map(|_| 0.1 / random.range(5.0, 30.0)).collect();
            let depths = pyramid(&depths, SIZE, false);
            let whole = screen_box(&clip(), Vec3::new(x, 0.0, z), Vec3::splat(side), SIZE.as_vec2());
            if is_hidden(&depths, SIZE, &whole, 2.0) {
                let part = screen_box(&clip(), Vec3::new(x + 0.3 * side, 0.2 * side, z + 0.1 * side), Vec3::splat(side * 0.4), SIZE.as_vec2());
                let off = part.hi.cmplt(Vec2::ZERO).any() || part.lo.cmpgt(SIZE.as_vec2() - 1.0).any();
                prop_assert!(off || is_hidden(&depths, SIZE, &part, 1.0));
            }
        }
    }
}
