//! The baked point: 16 bytes in two halves, so that the hot pass reads only 8.
//!
//! Hot (`u32 × 2`, read by selection's splats): position 16 + 16 + 14 bits in the model's box, thickness class (2
//! bits), octahedral **face** normal (8 + 7 bits), one-sided bit. Cold (`u32 × 2`, read once per covered pixel by resolve): shading normal 2×u8,
//! albedo 3×u8 (sRGB), flags and roughness, ambient visibility, group and metalness. The WGSL twin is `shaders/lib/surfel.wgsl`.

use crate::gpu::mirror::gpu_types;
use crate::math::{bounding::Aabb, octahedral, quantize};
use bevy::math::Vec3;

/// The point belongs to a leaf (else wood, ground, anything).
pub const SURFEL_LEAF: u8 = 1;
/// The surface is seen from both sides.
pub const SURFEL_TWO_SIDED: u8 = 2;
/// The colour is drawn as it is, without light.
pub const SURFEL_UNLIT: u8 = 4;
/// Flag: the shading normal is used as it is from both sides.
pub const SURFEL_KEEPS_NORMAL: u8 = 8;

/// A point in full precision, before packing and after unpacking.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surfel {
    /// Model space.
    pub position: Vec3,
    /// Unit normal of the triangle: decides culling, disc and which side is lit.
    pub face_normal: Vec3,
    /// Unit normal for shading (interpolated vertex normal).
    pub normal: Vec3,
    /// sRGB albedo.
    pub albedo: [u8; 3],
    /// Any of [`SURFEL_LEAF`], [`SURFEL_TWO_SIDED`], [`SURFEL_UNLIT`], [`SURFEL_KEEPS_NORMAL`].
    pub flags: u8,
    /// How thick the surface is here, in LDI pixels: 0 is less than 3, 1 less than 8, 2 less than 24, 3 more.
    pub thickness: u8,
    /// Perceptual roughness, 0 to 1; kept in 16 steps.
    pub roughness: f32,
    /// Share of the sky that reaches the point, 0 to 255 (255 = open). Written by `bake::lighting`.
    pub ambient_visibility: u8,
    /// Colour class for deferred blending, 0 to 15; 0 if not used.
    pub group: u8,
    /// Metalness, 0 to 1; kept in 16 steps.
    pub metallic: f32,
}

gpu_types! {
    /// The half read by the splat pass.
    #[derive(PartialEq, Eq)]
    pub struct SurfelHot as "SurfelHot" {
        /// x | y << 16, in 1/65535ths of the box.
        pub position_xy: u32,
        /// z (in 1/16383ths of the box) | thickness << 14 | octahedral x (8 bits) << 16 | octahedral y (7 bits) << 24 | one-sided << 31.
        pub position_z_face: u32,
    }

    /// The half read by the resolve pass.
    #[derive(PartialEq, Eq)]
    pub struct SurfelCold as "SurfelCold" {
        /// Octahedral shading normal 2×u8 | albedo r << 16 | albedo g << 24.
        pub normal_albedo_rg: u32,
        /// Albedo b | (flags | roughness << 4) << 8 | ambient visibility << 16 | (group | metallic << 4) << 24.
        pub albedo_b_misc: u32,
    }
}

/// What [`Surfel::ambient_visibility`] (here 0 to 1) does to the colour of a surface: a factor of the albedo, 0 to 1.
///
/// One factor for light of the sky and of lamps, because a near mesh has it in its vertex colours, which know no
/// difference. Leaves pass light on, which the visibility knows nothing of: shade has a floor, and the outer leaves of
/// a crown, which have leaves behind them, get all light. The two numbers were chosen by looking.
pub fn light_factor(ambient_visibility: f32) -> f32 {
    (LIGHT_FLOOR + LIGHT_GAIN * ambient_visibility).min(1.0)
}

/// [`light_factor`] where no light of the sky arrives.
const LIGHT_FLOOR: f32 = 0.2;
/// Growth of [`light_factor`] with visibility.
const LIGHT_GAIN: f32 = 1.05;

impl SurfelHot {
    /// In model space; `bounds` is the model's box.
    pub fn position(&self, bounds: &Aabb) -> Vec3 {
        let q = [
            self.position_xy as u16,
            (self.position_xy >> 16) as u16,
            (self.position_z_face & 0x3fff) as u16,
        ];
        quantize::dequantize_position(q, bounds)
    }
}

impl SurfelCold {
    /// Share of the sky that reaches the point, 0 to 255 (255 = open).
    pub fn ambient_visibility(&self) -> u8 {
        (self.albedo_b_misc >> 16) as u8
    }
}

impl Surfel {
    /// Packs into the two halves; `bounds` is the model's box.
    pub fn pack(&self, bounds: &Aabb) -> (SurfelHot, SurfelCold) {
        let [x, y, z] = quantize::quantize_position(self.position, bounds).map(u32::from);
        let face = octahedral::encode_bits(self.face_normal, 8, 7);
        let normal = octahedral::encode_bits(self.normal, 8, 8);
        let one_sided = u32::from(self.flags & SURFEL_TWO_SIDED == 0);
        let roughness = (self.roughness.clamp(0.0, 1.0) * 15.0).round() as u32;
        let metallic = (self.metallic.clamp(0.0, 1.0) * 15.0).round() as u32;
        let [r, g, b] = self.albedo.map(u32::from);
        let hot = SurfelHot {
            position_xy: x | y << 16,
            position_z_face: z
                | u32::from(self.thickness.min(3)) << 14
                | face[0] << 16
                | face[1] << 24
                | one_sided << 31,
        };
        let cold = SurfelCold {
            normal_albedo_rg: normal[0] | normal[1] << 8 | r << 16 | g << 24,
            albedo_b_misc: b
                | (u32::from(self.flags & 15) | roughness << 4) << 8
                | u32::from(self.ambient_visibility) << 16
                | (u32::from(self.group & 15) | metallic << 4) << 24,
        };
        (hot, cold)
    }

    /// The inverse of [`Surfel::pack`], up to rounding.
    pub fn unpack(hot: SurfelHot, cold: SurfelCold, bounds: &Aabb) -> Self {
        let q = [
            hot.position_xy as u16,
            (hot.position_xy >> 16) as u16,
            (hot.position_z_face & 0x3fff) as u16,
        ];
        let face = [hot.position_z_face >> 16 & 255, hot.position_z_face >> 24 & 127];
        let normal = [cold.normal_albedo_rg & 255, cold.normal_albedo_rg >> 8 & 255];
        let misc = cold.albedo_b_misc >> 8 & 255;
        Self {
            position: quantize::dequantize_position(q, bounds),
            face_normal: octahedral::decode_bits(face, 8, 7),
            normal: octahedral::decode_bits(normal, 8, 8),
            albedo: [
                (cold.normal_albedo_rg >> 16) as u8,
                (cold.normal_albedo_rg >> 24) as u8,
                cold.albedo_b_misc as u8,
            ],
            flags: (misc & 15) as u8,
            thickness: (hot.position_z_face >> 14 & 3) as u8,
            roughness: (misc >> 4) as f32 / 15.0,
            ambient_visibility: cold.ambient_visibility(),
            group: (cold.albedo_b_misc >> 24 & 15) as u8,
            metallic: (cold.albedo_b_misc >> 28) as f32 / 15.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_surfel_survives_packing() {
        let bounds = Aabb { min: Vec3::splat(-1.0), max: Vec3::splat(3.0) };
        for flags in [
            0,
            SURFEL_TWO_SIDED | SURFEL_LEAF,
            SURFEL_UNLIT,
            SURFEL_TWO_SIDED | SURFEL_KEEPS_NORMAL,
        ] {
            let surfel = Surfel {
                position: Vec3::new(0.25, 2.5, -0.75),
                face_normal: Vec3::new(0.6, -0.64, 0.48),
                normal: Vec3::new(-0.48, 0.6, -0.64),
                albedo: [12, 200, 255],
                flags,
                thickness: 2,
                roughness: 0.8,
                ambient_visibility: 77,
                group: 3,
                metallic: 0.4,
            };
            let (hot, cold) = surfel.pack(&bounds);
            assert_eq!(hot.position_z_face >> 31 == 1, flags & SURFEL_TWO_SIDED == 0);
            let back = Surfel::unpack(hot, cold, &bounds);
            assert!(back.position.distance(surfel.position) < 4.0 / 16383.0);
            assert!(back.face_normal.distance(surfel.face_normal) < 0.03);
            assert!(back.normal.distance(surfel.normal) < 0.02);
            assert_eq!(
                (back.albedo, back.flags, back.thickness, back.ambient_visibility, back.group),
                (surfel.albedo, flags, 2, 77, 3)
            );
            assert!((back.metallic - 0.4).abs() < 0.034);
            assert!((back.roughness - 0.8).abs() < 0.034);
        }
    }

    #[test]
    fn a_surfel_takes_sixteen_bytes() {
        assert_eq!(size_of::<SurfelHot>() + size_of::<SurfelCold>(), 16);
    }
}
