//! The trees of a forest in the form that selection reads: world space, species by their index on the GPU.
//!
//! In: a forest, its species; out: packed instances, and for each block of them the box around what they may draw. O(trees).

use super::surfels::SpeciesSlot;
use crate::{
    forest::{PackedTree, TreeInstance},
    gpu::types::{GpuTreeInstance, SELECT_WORKGROUP, SPECIES_NOT_RESIDENT},
    math::bounding::Aabb,
};
use bevy::math::{Affine3A, Mat3A, Vec3};

/// What packing found out about up to [`SELECT_WORKGROUP`] instances.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(in crate::render) struct PackedBlock {
    /// Around every point of every tree, world space. Trees at no finite place do not count; they are not drawn if the
    /// others are out of sight.
    pub bounds: Aabb,
    /// Trees.
    pub count: u32,
    /// Trees whose species is resident.
    pub resident: u32,
}

impl PackedBlock {
    fn add(&mut self, tree: &GpuTreeInstance, slot: SpeciesSlot) {
        self.count += 1;
        if slot.index == SPECIES_NOT_RESIDENT {
            return;
        }
        self.resident += 1;
        let (position, reach) = (tree.position(), slot.reach * tree.scale());
        if position.is_finite() && reach.is_finite() {
            let reach = Vec3::splat(reach.abs());
            self.bounds = self.bounds.including(position - reach).including(position + reach);
        }
    }
}

/// The same for each block of single trees, which are packed already.
pub(super) fn measure_blocks(
    trees: &[GpuTreeInstance],
    slot_of: impl Fn(usize) -> SpeciesSlot,
) -> Vec<PackedBlock> {
    let side = SELECT_WORKGROUP as usize;
    let mut blocks = vec![PackedBlock::default(); trees.len().div_ceil(side)];
    for (i, tree) in trees.iter().enumerate() {
        blocks[i / side].add(tree, slot_of(i));
    }
    blocks
}

/// Where the trees of a forest stand in the world.
#[derive(Clone, Copy)]
pub(super) struct WorldFromForest {
    transform: Affine3A,
    /// Tiles are moved and seldom turned.
    is_moved_only: bool,
}

impl WorldFromForest {
    pub fn new(transform: Affine3A) -> Self {
        Self { transform, is_moved_only: transform.matrix3 == Mat3A::IDENTITY }
    }

    /// A tree as the GPU reads it, without flag, and its species.
    pub fn pack(
        &self,
        tree: &PackedTree,
        species: &[SpeciesSlot],
    ) -> (GpuTreeInstance, SpeciesSlot) {
        let mut tree = TreeInstance::unpack(tree);
        if self.is_moved_only {
            tree.position += Vec3::from(self.transform.translation);
        } else {
            tree = tree.in_world(&self.transform);
        }
        let slot = species.get(usize::from(tree.species)).copied();
        let slot = slot.unwrap_or(SpeciesSlot::NOT_RESIDENT);
        (pack_tree(tree, slot), slot)
    }
}

/// A tree in the world as the GPU reads it, without flag.
pub(super) fn pack_tree(tree: TreeInstance, slot: SpeciesSlot) -> GpuTreeInstance {
    TreeInstance { species: slot.index as u16, ..tree }.compact()
}

/// Appends the trees of a forest to `out`, in this order (indices of `trees`).
pub(super) fn pack_forest(
    trees: &[PackedTree],
    order: &[u32],
    world_from_forest: &WorldFromForest,
    species: &[SpeciesSlot],
    out: &mut Vec<GpuTreeInstance>,
) -> Vec<PackedBlock> {
    let side = SELECT_WORKGROUP as usize;
    let mut blocks = vec![PackedBlock::default(); order.len().div_ceil(side)];
    out.extend(order.iter().enumerate().map(|(place, index)| {
        let (tree, slot) = world_from_forest.pack(&trees[*index as usize], species);
        blocks[place / side].add(&tree, slot);
        tree
    }));
    blocks
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::compact::angle_between;
    use bevy::math::Quat;

    fn trees() -> Vec<PackedTree> {
        let at = |x, scale, species| {
            TreeInstance { scale, seed: 9, ..TreeInstance::at(Vec3::new(x, 1.0, 2.0)) }
                .with_species(species)
                .pack()
        };
        vec![at(0.0, 1.0, 0), at(10.0, 2.0, 1), at(500.0, 1.0, 2), at(f32::NAN, 1.0, 0)]
    }

    const SPECIES: fn() -> Vec<SpeciesSlot> =
        || vec![SpeciesSlot::for_test(7, 3.0), SpeciesSlot::for_test(4, 5.0)];

    #[test]
    fn bounds_hold_every_tree_that_is_drawn() {
        let mut out = vec![];
        let moved = WorldFromForest::new(Affine3A::from_translation(Vec3::X * 100.0));
        let packed = pack_forest(&trees(), &[0, 1, 2, 3], &moved, &SPECIES(), &mut out);
        let bounds = Aabb { min: Vec3::new(97.0, -9.0, -8.0), max: Vec3::new(120.0, 11.0, 12.0) };
        assert_eq!(packed, [PackedBlock { bounds, count: 4, resident: 3 }]);
        let species: Vec<u32> = out.iter().map(GpuTreeInstance::species).collect();
        assert_eq!(species, [7, 4, SPECIES_NOT_RESIDENT, 7]);
        assert!(out.iter().all(|tree| TreeInstance::from_compact(tree).seed == 9));
        assert_eq!((out[1].position(), out[1].scale()), (Vec3::new(110.0, 1.0, 2.0), 2.0));
    }

    #[test]
    fn trees_are_packed_in_the_order_asked_for() {
        let many: Vec<_> = (0..300).flat_map(|_| trees()).collect();
        let order: Vec<u32> = (0..1200).rev().collect();
        let mut out = vec![];
        let blocks = pack_forest(
            &many,
            &order,
            &WorldFromForest::new(Affine3A::IDENTITY),
            &SPECIES(),
            &mut out,
        );
        assert_eq!(
            blocks.iter().map(|block| block.count).collect::<Vec<_>>(),
            [256, 256, 256, 256, 176]
        );
        assert_eq!(blocks.iter().map(|block| block.resident).sum::<u32>(), 900);
        assert_eq!((out[3].position(), out[2].position()), (many[0].position, many[1].position));
    }

    #[test]
    fn a_move_alone_is_packed_as_any_transform_is() {
        let by = Vec3::new(5.0, -3.0, 70.0);
        let (mut quick, mut slow) = (vec![], vec![]);
        let trees = &trees()[..3];
        let order = [0, 1, 2];
        let moved = WorldFromForest::new(Affine3A::from_translation(by));
        pack_forest(trees, &order, &moved, &SPECIES(), &mut quick);
        let turned = Affine3A::from_rotation_translation(Quat::from_rotation_y(1e-6), by);
        pack_forest(trees, &order, &WorldFromForest::new(turned), &SPECIES(), &mut slow);
        for (a, b) in quick.iter().zip(&slow) {
            let (a, b) = (TreeInstance::from_compact(a), TreeInstance::from_compact(b));
            assert!(a.position.distance(b.position) < 1e-3 && a.species == b.species);
            assert!(angle_between(a.rotation, b.rotation) < 2e-3 && a.scale == b.scale);
        }
    }
}
