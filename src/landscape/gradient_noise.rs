//! Smooth noise with its slope: a place in, value and derivatives out. Pure; about 10 ns an octave.
//!
//! Gradient noise on a square lattice with quintic interpolation (Perlin 2002, "Improving Noise"). The derivatives are
//! what damping by slope and normals ask for; the `noise` crate does not give them, and works in `f64`.

use crate::math::hash::mix_bits;
use bevy::math::Vec2;

/// Value and its derivatives by x and y.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Sample {
    /// Roughly −1 to 1.
    pub value: f32,
    /// Per unit of the coordinates.
    pub slope: Vec2,
}

/// Noise of wavelength 1. Coordinates beyond ±2³¹ are clamped.
pub(super) fn noise(at: Vec2, seed: u32) -> Sample {
    let cell = at.floor();
    let (x, y) = (cell.x as i32 as u32, cell.y as i32 as u32);
    in_cell(at - cell, [x, x.wrapping_add(1)], [y, y.wrapping_add(1)], seed)
}

/// Noise that repeats: `waves` wavelengths from 0 to 1. The slope is per wavelength.
pub(super) fn tiling(at: Vec2, waves: u32, seed: u32) -> Sample {
    let at = at * waves as f32;
    let cell = at.floor();
    let wrap = |v: f32| [v as u32 % waves, (v as u32 + 1) % waves];
    in_cell(at - cell, wrap(cell.x), wrap(cell.y), seed)
}

fn in_cell(f: Vec2, x: [u32; 2], y: [u32; 2], seed: u32) -> Sample {
    let fade = f * f * f * (f * (f * 6.0 - 15.0) + 10.0);
    let rise = f * f * (f * (f * 30.0 - 60.0) + 30.0);
    let (g00, g10) = (gradient(x[0], y[0], seed), gradient(x[1], y[0], seed));
    let (g01, g11) = (gradient(x[0], y[1], seed), gradient(x[1], y[1], seed));
    let a = g00.dot(f);
    let b = g10.dot(f - Vec2::X);
    let c = g01.dot(f - Vec2::Y);
    let d = g11.dot(f - Vec2::ONE);
    let twist = a - b - c + d;
    let value = a + fade.x * (b - a) + fade.y * (c - a) + fade.x * fade.y * twist;
    let along = g00
        + (g10 - g00) * fade.x
        + (g01 - g00) * fade.y
        + (g00 - g10 - g01 + g11) * (fade.x * fade.y);
    let across = Vec2::new(b - a + fade.y * twist, c - a + fade.x * twist) * rise;
    Sample { value, slope: along + across }
}

/// Sum of `octaves` of halving wavelength and amplitude, the first of wavelength 1; roughly −1 to 1.
pub(super) fn fractal(at: Vec2, octaves: u32, seed: u32) -> f32 {
    let (mut sum, mut amplitude, mut frequency) = (0.0, 0.55, 1.0);
    for octave in 0..octaves {
        sum += amplitude * noise(at * frequency + OFFSET * octave as f32, seed ^ octave).value;
        amplitude *= 0.5;
        frequency *= 2.0;
    }
    sum
}

/// Octaves must not share the zeros of their lattices.
pub(super) const OFFSET: Vec2 = Vec2::new(17.31, 9.73);

fn gradient(x: u32, y: u32, seed: u32) -> Vec2 {
    // One multiplication a coordinate decorrelates them; `mix_bits` does the rest.
    let h = mix_bits(x.wrapping_mul(0x8DA6_B343) ^ y.wrapping_mul(0xD816_3841) ^ seed);
    // A square of gradients instead of a circle: rounder work than it looks, and no sine.
    Vec2::new((h & 0xFFFF) as f32, (h >> 16) as f32) * (3.0 / 65535.0) - 1.5
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_slope_is_that_of_the_value() {
        for i in 0..500 {
            let at = Vec2::new(i as f32 * 0.37 - 60.0, i as f32 * -0.61 + 4.0);
            let step = 1e-3;
            let by = |d: Vec2| (noise(at + d, 7).value - noise(at - d, 7).value) / (2.0 * step);
            let measured = Vec2::new(by(Vec2::X * step), by(Vec2::Y * step));
            let slope = noise(at, 7).slope;
            assert!(measured.distance(slope) < 0.03, "{at}: {slope} against {measured}");
        }
    }

    #[test]
    fn noise_uses_its_range_and_not_more() {
        let values: Vec<f32> = (0..20_000)
            .map(|i| noise(Vec2::new(i as f32 * 0.173, i as f32 * 0.071), 1).value)
            .collect();
        let highest = values.iter().copied().fold(f32::MIN, f32::max);
        let mean = values.iter().sum::<f32>() / values.len() as f32;
        assert!(highest > 0.6 && highest < 1.5, "{highest}");
        assert!(mean.abs() < 0.05, "{mean}");
    }
}
