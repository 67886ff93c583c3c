//! A tiling texture for what is too small to paint: grain of soil and grass, and waves. Made in code; about 5 ms.

use crate::landscape::gradient_noise::tiling;
use bevy::math::Vec2;

/// Texels a side.
const SIDE: usize = 128;

/// R: grain around 0.5; GB: slopes of waves around 0.5; A: 1.
pub(super) struct Grain {
    pub bytes: Vec<u8>,
    pub side: u32,
    pub mips: u32,
}

pub(super) fn grain() -> Grain {
    let texel = |n: usize| {
        let at = Vec2::new((n % SIDE) as f32, (n / SIDE) as f32) / SIDE as f32;
        let octave = |waves: u32, seed: u32| tiling(at, waves, seed);
        // Tufts and gaps: the finer, the stronger.
        let tufts = 0.35 * octave(6, 1).value
            + 0.4 * octave(17, 2).value
            + 0.5 * octave(37, 3).value
            + 0.4 * octave(61, 4).value;
        let waves = octave(4, 5).slope * 0.22
            + octave(9, 6).slope * 0.25
            + octave(19, 7).slope * 0.26
            + octave(37, 8).slope * 0.2;
        [0.5 + 0.5 * tufts, 0.5 + 0.35 * waves.x, 0.5 + 0.35 * waves.y]
    };
    let mut level: Vec<[f32; 3]> = (0..SIDE * SIDE).map(texel).collect();
    let (mut bytes, mut side, mut mips) = (Vec::new(), SIDE, 0);
    loop {
        bytes.extend(level.iter().flat_map(|texel| {
            let [r, g, b] = texel.map(|v| (v.clamp(0.0, 1.0) * 255.0 + 0.5) as u8);
            [r, g, b, 255]
        }));
        mips += 1;
        if side == 1 {
            return Grain { bytes, side: SIDE as u32, mips };
        }
        side /= 2;
        level = (0..side * side)
            .map(|n| {
                let at = (n / side) * 4 * side + (n % side) * 2;
                let four = [at, at + 1, at + side * 2, at + side * 2 + 1];
                [0, 1, 2].map(|c| four.iter().map(|i| level[*i][c]).sum::<f32>() * 0.25)
            })
            .collect();
    }
}
