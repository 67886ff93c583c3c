//! A tree of a forest, its 32-byte form in the main world, and its 24-byte form on the GPU. The WGSL twin of the unpacking is `shaders/lib/instance.wgsl`.

use crate::{
    gpu::types::{GpuTreeInstance, GpuTreeLook, GpuTreePlace, SPECIES_NOT_RESIDENT},
    math::{
        compact::{rotation_bits, rotation_from_bits, scale_bits},
        hash::{mix_bits, unit_from_bits},
    },
};
use bevy::math::{Affine3A, Quat, Vec3};

/// One tree of a [`Forest`](crate::Forest).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TreeInstance {
    /// Of the model's origin, in the space of the forest entity.
    pub position: Vec3,
    /// Any rotation; usually a yaw and a little lean.
    pub rotation: Quat,
    /// Uniform, > 0. Default: 1.
    pub scale: f32,
    /// Index into the forest's species.
    pub species: u16,
    /// Colour factor per channel (red, green, blue), 128 = unchanged, 255 ≈ twice as bright. Default: 128.
    pub tint: [u8; 3],
    /// Decides where in its range this instance changes between mesh and points. Default: 0; any hash will do.
    pub seed: u8,
}

/// A tree as forests keep it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct PackedTree {
    pub position: Vec3,
    pub scale: f32,
    /// Unit quaternion x, y, z, w, 32767 = 1.
    rotation: [i16; 4],
    tint: [u8; 3],
    seed: u8,
    pub species: u16,
}

impl Default for TreeInstance {
    fn default() -> Self {
        Self {
            position: Vec3::ZERO,
            rotation: Quat::IDENTITY,
            scale: 1.0,
            species: 0,
            tint: [128; 3],
            seed: 0,
        }
    }
}

impl TreeInstance {
    /// A tree at `position`, as modelled.
    pub fn at(position: Vec3) -> Self {
        Self { position, ..Self::default() }
    }

    /// Turned about the vertical by `yaw` radians.
    pub fn with_yaw(self, yaw: f32) -> Self {
        Self { rotation: Quat::from_rotation_y(yaw), ..self }
    }

    /// Scaled uniformly.
    pub fn with_scale(self, scale: f32) -> Self {
        Self { scale, ..self }
    }

    /// Of another species of the forest.
    pub fn with_species(self, species: u16) -> Self {
        Self { species, ..self }
    }

    /// Packs into 32 bytes.
    pub(crate) fn pack(&self) -> PackedTree {
        let q = self.rotation.normalize();
        let snorm = |v: f32| (v.clamp(-1.0, 1.0) * 32767.0).round() as i16;
        PackedTree {
            position: self.position,
            scale: self.scale,
            rotation: q.to_array().map(snorm),
            tint: self.tint,
            seed: self.seed,
            species: self.species,
        }
    }

    /// The inverse of [`TreeInstance::pack`], up to rounding of the rotation.
    pub(crate) fn unpack(packed: &PackedTree) -> Self {
        let PackedTree { position, scale, rotation, tint, seed, species } = *packed;
        let [x, y, z, w] = rotation.map(|v| f32::from(v) / 32767.0);
        let rotation = Quat::from_xyzw(x, y, z, w).normalize();
        Self { position, rotation, scale, species, tint, seed }
    }

    /// The 24 bytes that the GPU reads of a tree in world space: all of it, but for rounding of rotation
    /// (0.002 radians) and scale (1 / 4,096 of it).
    pub fn compact(&self) -> GpuTreeInstance {
        let [x, y, z] = self.position.to_array();
        let [r, g, b] = self.tint.map(u32::from);
        let species = u32::from(self.species).min(SPECIES_NOT_RESIDENT);
        let rotation = rotation_bits(self.rotation);
        GpuTreeInstance {
            place: GpuTreePlace { x, y, z },
            look: GpuTreeLook {
                rotation: rotation as u32,
                tint_seed: r | g << 8 | b << 16 | u32::from(self.seed) << 24,
                species_scale: species
                    | ((rotation >> 32) as u32) << 13
                    | scale_bits(self.scale) << 16,
            },
        }
    }

    /// The inverse of [`TreeInstance::compact`]: the tree as the GPU sees it.
    pub fn from_compact(tree: &GpuTreeInstance) -> Self {
        let [r, g, b, seed] = tree.look.tint_seed.to_le_bytes();
        let upper = tree.look.species_scale >> 13 & 7;
        Self {
            position: tree.position(),
            rotation: rotation_from_bits(u64::from(upper) << 32 | u64::from(tree.look.rotation)),
            scale: tree.scale(),
            species: tree.species() as u16,
            tint: [r, g, b],
            seed,
        }
    }

    /// A number in [0, 1) that this tree keeps whatever else comes and goes: a hash of its position (world space, to
    /// the bit) and seed. Twin of `hash_of`.
    pub fn hash(&self) -> f32 {
        let [x, y, z] = self.position.to_array().map(f32::to_bits);
        let seed = mix_bits(u32::from(self.seed) ^ 0x51ed_270b);
        unit_from_bits(x ^ mix_bits(y ^ mix_bits(z ^ seed)))
    }

    /// This tree seen from the world, where the forest's entity stands at `world_from_forest`. Scales that differ by
    /// axis become their mean: points have one scale.
    pub fn in_world(&self, world_from_forest: &Affine3A) -> Self {
        let (scale, rotation, _) = world_from_forest.to_scale_rotation_translation();
        Self {
            position: world_from_forest.transform_point3(self.position),
            rotation: rotation * self.rotation,
            scale: self.scale * scale.abs().element_sum() / 3.0,
            ..*self
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::compact::angle_between;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn an_instance_survives_packing(x in -1e4f32..1e4, yaw in -3.0f32..3.0, lean in -0.2f32..0.2, scale in 0.01f32..50.0, species: u16, seed: u8, r: u8) {
            let tree = TreeInstance {
                position: Vec3::new(x, -x, 3.0),
                rotation: Quat::from_rotation_x(lean) * Quat::from_rotation_y(yaw),
                scale,
                species,
                tint: [r, 128, 7],
                seed,
            };
            let back = TreeInstance::unpack(&tree.pack());
            prop_assert_eq!((back.position, back.scale, back.species, back.tint, back.seed), (tree.position, scale, species, tree.tint, seed));
            prop_assert!(angle_between(back.rotation, tree.rotation) < 1e-3);
            let back = TreeInstance::from_compact(&tree.compact());
            prop_assert_eq!((back.position, back.tint, back.seed), (tree.position, tree.tint, seed));
            prop_assert_eq!(u32::from(back.species), u32::from(species).min(SPECIES_NOT_RESIDENT));
            prop_assert!(angle_between(back.rotation, tree.rotation) < 2e-3 && (back.scale / scale - 1.0).abs() < 3e-4);
            // What the GPU has is kept by another turn, but for ties of the largest component.
            let again = TreeInstance::from_compact(&back.compact());
            prop_assert!(angle_between(again.rotation, back.rotation) < 2e-3 && again.scale == back.scale);
        }
    }

    #[test]
    fn hashes_of_trees_in_rows_are_spread_evenly() {
        let mut bins = [0u32; 16];
        for i in 0..16_000u32 {
            let at = Vec3::new((i % 128) as f32 * 2.0, 0.0, (i / 128) as f32 * 2.0);
            bins[(TreeInstance::at(at).hash() * 16.0) as usize] += 1;
        }
        assert!(bins.iter().all(|n| (850..1150).contains(n)), "{bins:?}");
        let tree = TreeInstance::at(Vec3::ONE);
        assert_ne!(tree.hash(), TreeInstance { seed: 1, ..tree }.hash());
    }

    #[test]
    fn an_instance_takes_few_bytes() {
        assert_eq!((size_of::<PackedTree>(), size_of::<GpuTreeInstance>()), (32, 24));
    }
}
