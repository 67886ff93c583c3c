//! Smaller versions of a base colour texture: RGBA texels in, all mip levels out. O(texels).
//!
//! Near meshes are some metres away and their textures often far larger than what they cover on the screen, so without mip levels each pixel
//! shows a texel at random: noise, and a cache line a pixel. What is cut out by its alpha has two traps. Means of alpha
//! fall below the cut-off where things are thin, so small levels would lose leaves: alpha is scaled until as many texels
//! are above the cut-off as before (Castaño 2010, "Computing alpha mipmaps"). And texels that are cut out have any colour: they count for as
//! much of a mean as their alpha says.

use super::texture::LINEAR_OF_SRGB;
use crate::math::quantize::linear_to_srgb8;
use bevy::math::{Vec4, Vec4Swizzles};
use rayon::prelude::*;

/// Smallest side of the last level of a texture that is cut out: a few texels either are above the cut-off or are not,
/// so none of them covers what the leaf covers.
const LEAST_CUT_OUT_SIDE: u32 = 8;

/// All levels of an image.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MipChain {
    /// Bytes of all levels, the largest first.
    pub rgba8: Vec<u8>,
    /// Their number, at least 1.
    pub levels: u32,
}

/// Texels with colours in linear light, times their weight in means.
struct Level {
    width: u32,
    height: u32,
    texels: Vec<Vec4>,
}

impl Level {
    /// Of sRGB bytes. Where alpha does not cut out, it does not weigh either.
    fn of_bytes(width: u32, height: u32, rgba8: &[u8], cuts_out: bool) -> Self {
        let texel = |bytes: &[u8]| {
            let alpha = f32::from(bytes[3]) / 255.0;
            let [r, g, b] = [0, 1, 2].map(|k| LINEAR_OF_SRGB[usize::from(bytes[k])]);
            let weight = if cuts_out { alpha } else { 1.0 };
            Vec4::new(r * weight, g * weight, b * weight, alpha)
        };
        Self { width, height, texels: rgba8.par_chunks_exact(4).map(texel).collect() }
    }

    /// Half as wide and high; of an odd number of texels, the last counts for two.
    fn half(&self) -> Self {
        let (width, height) = ((self.width / 2).max(1), (self.height / 2).max(1));
        let row = |y: u32| (y.min(self.height - 1) * self.width) as usize;
        let texel = |i: u32| {
            let (x, y) = (i % width * 2, i / width * 2);
            let columns = [x, x + 1].map(|x| x.min(self.width - 1) as usize);
            let rows = [row(y), row(y + 1)];
            let sum: Vec4 = rows.iter().flat_map(|row| columns.map(|x| self.texels[row + x])).sum();
            sum * 0.25
        };
        Self { width, height, texels: (0..width * height).into_par_iter().map(texel).collect() }
    }

    /// What alpha has to be multiplied with so that the share `covered` of the texels is at least `cut_off`.
    fn alpha_scale(&self, covered: f32, cut_off: f32) -> f32 {
        let mut alphas: Vec<f32> = self.texels.par_iter().map(|texel| texel.w).collect();
        let count = (covered * alphas.len() as f32).round() as usize;
        // All or nothing stays so without help.
        let Some(last) = count.checked_sub(1).filter(|_| count < alphas.len()) else { return 1.0 };
        let (more, least, _) = alphas.select_nth_unstable_by(last, |a, b| b.total_cmp(a));
        // Many texels have the same alpha: all of them or none.
        let least = *least;
        let with = self.texels.par_iter().filter(|texel| texel.w >= least).count();
        let above = more.iter().copied().filter(|alpha| *alpha > least);
        let without = above.clone().count();
        let next = above.reduce(f32::min).filter(|_| count - without < with - count);
        let least = next.unwrap_or(least);
        // A hair more, so that rounding to bytes loses none.
        if least > 0.0 { (cut_off + 0.5 / 255.0) / least } else { 1.0 }
    }

    fn bytes(&self, cuts_out: bool, alpha_scale: f32) -> Vec<u8> {
        let bytes = |texel: &Vec4| {
            let weight = if cuts_out { texel.w.max(1e-6) } else { 1.0 };
            let [r, g, b] = (texel.xyz() / weight).to_array().map(linear_to_srgb8);
            [r, g, b, (texel.w * alpha_scale * 255.0).round().min(255.0) as u8]
        };
        self.texels.par_iter().flat_map_iter(bytes).collect()
    }
}

/// The mip levels of sRGB texels, row by row; `cut_off` is the least alpha that is drawn, if alpha cuts out.
///
/// Bytes that do not fit the size give one level: as they are.
pub fn mip_chain(width: u32, height: u32, rgba8: &[u8], cut_off: Option<f32>) -> MipChain {
    let mut chain = MipChain { rgba8: rgba8.to_vec(), levels: 1 };
    if width == 0 || height == 0 || rgba8.len() as u64 != u64::from(width) * u64::from(height) * 4 {
        return chain;
    }
    let cuts_out = cut_off.is_some();
    let mut level = Level::of_bytes(width, height, rgba8, cuts_out);
    let covered = cut_off.map(|cut_off| {
        let above = level.texels.par_iter().filter(|texel| texel.w >= cut_off).count();
        (above as f32 / level.texels.len() as f32, cut_off)
    });
    let is_last = |level: &Level| match cuts_out {
        true => level.width.min(level.height) / 2 < LEAST_CUT_OUT_SIDE,
        false => level.width == 1 && level.height == 1,
    };
    while !is_last(&level) {
        level = level.half();
        let scale = covered.map_or(1.0, |(covered, cut_off)| level.alpha_scale(covered, cut_off));
        chain.rgba8.extend(level.bytes(cuts_out, scale));
        chain.levels += 1;
    }
    chain
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Bytes of each level.
    fn levels(chain: &MipChain, width: u32, height: u32) -> Vec<&[u8]> {
        let mut rest = &chain.rgba8[..];
        let level = |level: u32| {
            let texels = (width >> level).max(1) * (height >> level).max(1);
            let (now, later) = rest.split_at(texels as usize * 4);
            rest = later;
            now
        };
        let all = (0..chain.levels).map(level).collect();
        assert!(rest.is_empty(), "{} bytes too many", rest.len());
        all
    }

    /// Thin green stripes at a slant, a quarter of all; between them nothing, black.
    fn stripes(side: u32) -> Vec<u8> {
        let is_green = |x: u32, y: u32| (0.37 * x as f32 + 0.81 * y as f32) % 9.2 < 2.3;
        let texel = |i: u32| if is_green(i % side, i / side) { [40, 160, 20, 255] } else { [0; 4] };
        (0..side * side).flat_map(texel).collect()
    }

    #[test]
    fn thin_things_stay_as_thick_as_they_are() {
        let side = 128;
        let chain = mip_chain(side, side, &stripes(side), Some(0.5));
        assert_eq!(chain.levels, 5);
        for level in levels(&chain, side, side) {
            let above = level.chunks_exact(4).filter(|texel| texel[3] >= 128).count();
            let share = above as f32 * 4.0 / level.len() as f32;
            assert!((share - 0.25).abs() < 0.07, "{share} of {} bytes", level.len());
        }
    }

    #[test]
    fn what_is_cut_out_does_not_darken_what_is_not() {
        let side = 64;
        let chain = mip_chain(side, side, &stripes(side), Some(0.5));
        for texel in chain.rgba8.chunks_exact(4).filter(|texel| texel[3] > 0) {
            assert_eq!(texel[..3], [40, 160, 20]);
        }
    }

    #[test]
    fn levels_go_down_to_a_texel_in_linear_light_whatever_the_shape() {
        let checks: Vec<u8> =
            (0..8 * 2).flat_map(|i| [if (i + i / 8) % 2 == 0 { 0 } else { 255 }; 4]).collect();
        let chain = mip_chain(8, 2, &checks, None);
        let levels = levels(&chain, 8, 2);
        assert_eq!(levels.len(), 4);
        // Half the light is sRGB 188; alpha is no light.
        assert!(levels[1..].iter().all(|l| l.chunks_exact(4).all(|t| *t == [188, 188, 188, 128])));
        let odd = mip_chain(5, 3, &[90; 5 * 3 * 4], None);
        assert_eq!((odd.levels, odd.rgba8), (3, vec![90; (15 + 2 + 1) * 4]));
    }

    #[test]
    fn what_covers_nothing_or_all_stays_so() {
        for alpha in [0, 255] {
            let texels = [9, 9, 9, alpha].repeat(32 * 32);
            let chain = mip_chain(32, 32, &texels, Some(0.5));
            assert_eq!(chain.levels, 3);
            assert!(chain.rgba8.chunks_exact(4).all(|texel| texel[3] == alpha));
        }
    }

    #[test]
    fn bytes_that_do_not_fit_are_left_alone() {
        let chain = mip_chain(4, 4, &[1, 2, 3], None);
        assert_eq!(chain, MipChain { rgba8: vec![1, 2, 3], levels: 1 });
        assert_eq!(mip_chain(0, 4, &[], None).levels, 1);
    }
}
