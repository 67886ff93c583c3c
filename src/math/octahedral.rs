//! Octahedral unit vectors: a direction in two numbers.
//!
//! In: unit `Vec3`; out: two integers. The WGSL twin is `shaders/lib/octahedral.wgsl`.
//! Source: Cigolle et al. 2014, "A Survey of Efficient Representations for Independent Unit Vectors".

use bevy::math::{Vec2, Vec3};

/// 1.0 for +0, −1.0 for negative numbers: unlike `signum`, never 0, so the fold loses nothing at the seam.
fn sign_not_zero(value: f32) -> f32 {
    if value >= 0.0 { 1.0 } else { -1.0 }
}

/// Maps a unit vector to the square [−1, 1]². A zero vector maps to the direction +Z.
pub fn encode(direction: Vec3) -> Vec2 {
    let sum = direction.x.abs() + direction.y.abs() + direction.z.abs();
    if !(sum > 0.0 && sum.is_finite()) {
        return Vec2::ZERO;
    }
    let p = direction / sum;
    if p.z >= 0.0 {
        return Vec2::new(p.x, p.y);
    }
    Vec2::new((1.0 - p.y.abs()) * sign_not_zero(p.x), (1.0 - p.x.abs()) * sign_not_zero(p.y))
}

/// The unit vector of a point of the square [−1, 1]²: the inverse of [`encode`].
pub fn decode(e: Vec2) -> Vec3 {
    let mut v = Vec3::new(e.x, e.y, 1.0 - e.x.abs() - e.y.abs());
    let fold = (-v.z).max(0.0);
    v.x += if v.x >= 0.0 { -fold } else { fold };
    v.y += if v.y >= 0.0 { -fold } else { fold };
    v.normalize()
}

/// `encode` in two numbers of `x_bits` and `y_bits` bits (1 to 16), rounded to nearest.
///
/// The grid has an even number of steps, so that 0 (and with it every axis) is exact.
pub fn encode_bits(direction: Vec3, x_bits: u32, y_bits: u32) -> [u32; 2] {
    let e = encode(direction);
    let steps = |bits: u32| ((1u32 << bits) - 2) as f32 * 0.5;
    let quantize = |v: f32, bits: u32| ((v + 1.0) * steps(bits)).round() as u32;
    [quantize(e.x, x_bits), quantize(e.y, y_bits)]
}

/// The inverse of [`encode_bits`].
pub fn decode_bits(q: [u32; 2], x_bits: u32, y_bits: u32) -> Vec3 {
    let steps = |bits: u32| ((1u32 << bits) - 2) as f32 * 0.5;
    let e = Vec2::new(q[0] as f32 / steps(x_bits), q[1] as f32 / steps(y_bits)) - Vec2::ONE;
    decode(e.clamp(-Vec2::ONE, Vec2::ONE))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn axes_survive_quantisation_exactly() {
        for axis in [Vec3::X, Vec3::Y, Vec3::Z, -Vec3::X, -Vec3::Y, -Vec3::Z] {
            let back = decode_bits(encode_bits(axis, 8, 7), 8, 7);
            assert!(back.distance(axis) < 1e-6, "{axis} became {back}");
        }
    }

    proptest! {
        #[test]
        fn a_direction_survives_within_a_step(x in -1.0f32..1.0, y in -1.0f32..1.0, z in -1.0f32..1.0) {
            let v = Vec3::new(x, y, z);
            prop_assume!(v.length() > 1e-3);
            let v = v.normalize();
            prop_assert!(decode(encode(v)).distance(v) < 1e-5);
            // A step of the 7-bit axis is 1/63 of the square; the map stretches lengths by at most √3.
            prop_assert!(decode_bits(encode_bits(v, 8, 7), 8, 7).distance(v) < 1.8 / 63.0);
        }
    }
}
