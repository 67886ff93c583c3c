//! Positions as 16-, 16- and 14-bit numbers within a box. The WGSL twin is `shaders/lib/surfel.wgsl`.

use super::bounding::Aabb;
use bevy::math::Vec3;

/// Largest value of each quantised coordinate. Two bits of z hold the thickness class of a surfel.
pub const POSITION_STEPS: Vec3 = Vec3::new(65535.0, 65535.0, 16383.0);

/// `position` in steps of the box, rounded to nearest and clamped to it.
pub fn quantize_position(position: Vec3, bounds: &Aabb) -> [u16; 3] {
    let extent = bounds.extent().max(Vec3::splat(f32::MIN_POSITIVE));
    let unit = (position - bounds.min) / extent;
    (unit * POSITION_STEPS).round().clamp(Vec3::ZERO, POSITION_STEPS).to_array().map(|v| v as u16)
}

/// The inverse of [`quantize_position`].
pub fn dequantize_position(q: [u16; 3], bounds: &Aabb) -> Vec3 {
    let unit = Vec3::from_array(q.map(f32::from)) / POSITION_STEPS;
    bounds.min + unit * bounds.extent()
}

/// Linear light (0 to 1) → sRGB byte.
pub fn linear_to_srgb8(linear: f32) -> u8 {
    let c = linear.clamp(0.0, 1.0);
    let s = if c <= 0.003_130_8 { c * 12.92 } else { 1.055 * c.powf(1.0 / 2.4) - 0.055 };
    (s * 255.0).round() as u8
}

/// sRGB byte → linear light (0 to 1).
pub fn srgb8_to_linear(srgb: u8) -> f32 {
    let s = f32::from(srgb) / 255.0;
    if s <= 0.040_45 { s / 12.92 } else { ((s + 0.055) / 1.055).powf(2.4) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn positions_survive_within_half_a_step() {
        let bounds = Aabb { min: Vec3::new(-3.0, 0.0, 2.0), max: Vec3::new(5.0, 10.0, 2.0) };
        for i in 0..100 {
            let t = i as f32 / 99.0;
            let p = bounds.min + bounds.extent() * Vec3::new(t, 1.0 - t, 0.5);
            let back = dequantize_position(quantize_position(p, &bounds), &bounds);
            let step = bounds.extent() / POSITION_STEPS;
            assert!(((back - p).abs().cmple(step * 0.51 + 1e-6)).all(), "{p} became {back}");
        }
    }

    #[test]
    fn every_srgb_byte_survives() {
        for b in 0..=255u8 {
            assert_eq!(linear_to_srgb8(srgb8_to_linear(b)), b);
        }
    }
}
