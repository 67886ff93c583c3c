//! Rotations in 35 bits and scales in 16. The WGSL twin is `shaders/lib/instance.wgsl`.

use bevy::math::{Quat, Vec3, Vec4};

/// Largest component that is written: half of the square of a unit quaternion is the most that two can have alike.
const MOST: f32 = std::f32::consts::FRAC_1_SQRT_2;
/// Steps from 0 to [`MOST`], in eleven bits with a sign.
const STEPS: f32 = 1023.0;
/// Scales begin at 2^-16: exponents of an f32 less this.
const FIRST_EXPONENT: u32 = 127 - 16;

/// A rotation as three components of its quaternion, eleven bits each, and which one is left out: the largest, which follows
/// from the others. Off by at most 0.002 radians, and a third of that on average: 7 mm at the top of a tree of 10 m. By
/// nothing for a tree as it was modelled.
pub fn rotation_bits(rotation: Quat) -> u64 {
    let q = Vec4::from(rotation.normalize());
    let left_out = q.abs().max_position();
    // q and -q are one rotation: the one with a positive largest component is written.
    let q = if q[left_out] < 0.0 { -q } else { q };
    let kept = (0..4).filter(|i| *i != left_out).zip([0, 11, 22]);
    let bits = |v: f32| ((v / MOST).clamp(-1.0, 1.0) * STEPS).round() as i64 as u64 & 0x7ff;
    kept.fold((left_out as u64) << 33, |all, (i, shift)| all | bits(q[i]) << shift)
}

/// The inverse of [`rotation_bits`].
pub fn rotation_from_bits(bits: u64) -> Quat {
    // The sign is the topmost of eleven bits.
    let part = |shift: u32| ((bits << (53 - shift)) as i64 >> 53) as f32 * (MOST / STEPS);
    let kept = Vec3::new(part(0), part(11), part(22));
    let largest = (1.0 - kept.length_squared()).max(0.0).sqrt();
    let q = match bits >> 33 {
        0 => Vec4::new(largest, kept.x, kept.y, kept.z),
        1 => Vec4::new(kept.x, largest, kept.y, kept.z),
        2 => Vec4::new(kept.x, kept.y, largest, kept.z),
        _ => Vec4::new(kept.x, kept.y, kept.z, largest),
    };
    Quat::from_vec4(q).normalize()
}

/// A scale as the exponent and eleven bits of the fraction of an f32: 2^-16 to 65,520, off by at most 1 / 4,096. What is not a
/// number, infinite or not above 2^-16 is 0.
pub fn scale_bits(scale: f32) -> u32 {
    if !(scale.is_finite() && scale > 0.0) {
        return 0;
    }
    let rounded = (scale.to_bits() + (1 << 11)) >> 12;
    rounded.saturating_sub(FIRST_EXPONENT << 11).min(0xffff)
}

/// The inverse of [`scale_bits`].
pub fn scale_from_bits(bits: u32) -> f32 {
    if bits == 0 { 0.0 } else { f32::from_bits((bits + (FIRST_EXPONENT << 11)) << 12) }
}

/// The angle between two rotations, in radians. `Quat::angle_between` takes an arc cosine, which is off by 0.001 for small ones.
#[cfg(test)]
pub fn angle_between(a: Quat, b: Quat) -> f32 {
    let turn = a.inverse() * b;
    2.0 * Vec3::new(turn.x, turn.y, turn.z).length().atan2(turn.w.abs())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn what_is_as_modelled_stays_so() {
        assert_eq!(rotation_from_bits(rotation_bits(Quat::IDENTITY)), Quat::IDENTITY);
        for scale in [1.0, 0.5, 2.0, 1.25] {
            assert_eq!(scale_from_bits(scale_bits(scale)), scale);
        }
        for nothing in [0.0, -1.0, f32::NAN, f32::INFINITY, 1e-6] {
            assert_eq!(scale_from_bits(scale_bits(nothing)), 0.0, "{nothing}");
        }
        assert_eq!(scale_from_bits(scale_bits(1e9)), 65_520.0);
    }

    proptest! {
        #[test]
        fn rotations_survive(x in -1f32..1.0, y in -1f32..1.0, z in -1f32..1.0, w in -1f32..1.0) {
            prop_assume!(Vec4::new(x, y, z, w).length() > 0.1);
            let rotation = Quat::from_xyzw(x, y, z, w).normalize();
            let bits = rotation_bits(rotation);
            let back = rotation_from_bits(bits);
            let angle = angle_between(back, rotation);
            prop_assert!(angle < 2e-3, "{angle} of {rotation}");
            // What is read is written the same again, but for ties of which is the largest.
            let again = rotation_from_bits(rotation_bits(back));
            prop_assert!(angle_between(again, back) < 2e-3);
        }

        #[test]
        fn scales_survive(exponent in -15.0f32..15.0) {
            let scale = exponent.exp2();
            let back = scale_from_bits(scale_bits(scale));
            prop_assert!((back / scale - 1.0).abs() <= 1.0 / 4096.0);
            prop_assert_eq!(scale_from_bits(scale_bits(back)), back);
        }
    }
}
