//! The surfels of every species in two pools (hot and cold), and what selection knows of a species.
//!
//! In: loaded species; out: buffers, and a [`SpeciesSlot`] each, which stays while the species is used. Cost: all surfels
//! whenever the set of species changes, else nothing.

use crate::{
    asset::{SurfelCold, SurfelHot, TreeAsset, TreeData},
    gpu::types::{GpuSpecies, SPECIES_NOT_RESIDENT},
    render::extract::ExtractedTrees,
};
use bevy::{
    platform::collections::HashMap,
    prelude::*,
    render::{
        render_resource::{Buffer, BufferInitDescriptor, BufferUsages},
        renderer::RenderDevice,
    },
};
use std::sync::Arc;

/// A species as instances refer to it. Instances have to be packed again when it is another one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::render) struct SpeciesSlot {
    /// Index among the species on the GPU.
    pub index: u32,
    /// [`SurfelPool::generation`] when its data came.
    generation: u64,
    /// No point of a tree of scale 1 is farther from its position.
    pub reach: f32,
}

impl SpeciesSlot {
    /// Of species that are not loaded, or do not exist.
    pub const NOT_RESIDENT: Self = Self { index: SPECIES_NOT_RESIDENT, generation: 0, reach: 0.0 };

    #[cfg(test)]
    pub fn for_test(index: u32, reach: f32) -> Self {
        Self { index, generation: 1, reach }
    }
}

/// Surfels of the resident species.
#[derive(Resource, Default)]
pub(in crate::render) struct SurfelPool {
    /// What was asked for last, resident or not. Compared by pointer.
    requested: Vec<(AssetId<TreeAsset>, Arc<TreeData>)>,
    /// What the buffers hold.
    resident: HashMap<AssetId<TreeAsset>, (Arc<TreeData>, SpeciesSlot)>,
    pub buffers: Option<SurfelBuffers>,
    /// Grows with every change.
    pub generation: u64,
}

impl SurfelPool {
    /// Where a species is.
    pub fn slot(&self, id: AssetId<TreeAsset>) -> SpeciesSlot {
        self.resident.get(&id).map_or(SpeciesSlot::NOT_RESIDENT, |(_, slot)| *slot)
    }
}

/// Buffers of the pool.
pub(in crate::render) struct SurfelBuffers {
    pub species: Buffer,
    pub hot: Buffer,
    pub cold: Buffer,
}

fn same(
    a: &[(AssetId<TreeAsset>, Arc<TreeData>)],
    b: &[(AssetId<TreeAsset>, Arc<TreeData>)],
) -> bool {
    a.len() == b.len() && a.iter().zip(b).all(|(a, b)| a.0 == b.0 && Arc::ptr_eq(&a.1, &b.1))
}

fn gpu_species(tree: &TreeData, first_point: u32) -> GpuSpecies {
    GpuSpecies {
        lo: tree.bounds.min.to_array(),
        first_point,
        extent: tree.bounds.extent().to_array(),
        point_count: tree.point_count() as u32,
        center: tree.bounds.center().to_array(),
        radius: tree.bounds.radius(),
        pixel: tree.pixel,
        surface_area: tree.surface_area,
        mean_leaf_area: tree.mean_leaf_area,
        sample_share: tree.sample_share(),
        area_factors: bytemuck::cast(tree.area_factors),
    }
}

/// Uploads the surfels of new species. The whole pool is written again when the set of species changes, which happens
/// when assets load, not while the camera moves.
pub(in crate::render) fn prepare_surfels(
    mut pool: ResMut<SurfelPool>,
    trees: Res<ExtractedTrees>,
    device: Res<RenderDevice>,
) {
    if pool.buffers.is_some() && same(&pool.requested, &trees.species) {
        return;
    }
    let pool = &mut *pool;
    pool.requested.clone_from(&trees.species);
    pool.generation += 1;
    let limits = device.limits();
    let limit = limits.max_storage_buffer_binding_size.min(limits.max_buffer_size);
    let before = std::mem::take(&mut pool.resident);
    let (mut hot, mut cold) = (Vec::<SurfelHot>::new(), Vec::<SurfelCold>::new());
    let (mut species, mut taken) = (Vec::<GpuSpecies>::new(), Vec::<bool>::new());
    let mut claim = |index: usize, new: GpuSpecies| {
        if species.len() <= index {
            species.resize(index + 1, bytemuck::Zeroable::zeroed());
            taken.resize(index + 1, false);
        }
        (species[index], taken[index]) = (new, true);
        taken.iter().position(|taken| !taken).unwrap_or(taken.len())
    };
    // Those that were here keep their index, so that their trees need not be packed again; then the new ones.
    let (known, new): (Vec<_>, Vec<_>) =
        trees.species.iter().partition(|(id, _)| before.contains_key(id));
    let mut next = 0;
    for (id, tree) in known.into_iter().chain(new) {
        let bytes = ((hot.len() + tree.point_count()) * size_of::<SurfelHot>()) as u64;
        if bytes > limit {
            error!(
                "a tree of {} points is not drawn: with it the surfel pool needs {bytes} bytes in one buffer, and this \
                 device allows {limit}. Bake with a smaller LDI size, or use fewer species at once.",
                tree.point_count()
            );
            continue;
        }
        let kept = before.get(id);
        let index = kept.map_or(next, |(_, slot)| slot.index as usize);
        next = claim(index, gpu_species(tree, hot.len() as u32));
        let is_same = kept.is_some_and(|(data, _)| Arc::ptr_eq(data, tree));
        let slot = SpeciesSlot {
            index: index as u32,
            generation: kept
                .filter(|_| is_same)
                .map_or(pool.generation, |(_, slot)| slot.generation),
            reach: tree.bounds.center().length() + tree.bounds.radius(),
        };
        hot.extend_from_slice(&tree.hot);
        cold.extend_from_slice(&tree.cold);
        pool.resident.insert(*id, (tree.clone(), slot));
    }
    // A binding may not be empty.
    if species.is_empty() {
        species.push(bytemuck::Zeroable::zeroed());
    }
    if hot.is_empty() {
        hot.push(bytemuck::Zeroable::zeroed());
        cold.push(bytemuck::Zeroable::zeroed());
    }
    let upload = |label, contents: &[u8]| {
        let usage = BufferUsages::STORAGE;
        device.create_buffer_with_data(&BufferInitDescriptor {
            label: Some(label),
            contents,
            usage,
        })
    };
    pool.buffers = Some(SurfelBuffers {
        species: upload("treeline_species", bytemuck::cast_slice(&species)),
        hot: upload("treeline_surfels_hot", bytemuck::cast_slice(&hot)),
        cold: upload("treeline_surfels_cold", bytemuck::cast_slice(&cold)),
    });
}
