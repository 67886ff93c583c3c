//! The surfels of every species in two pools (hot and cold), cluster by cluster, and what selection knows of a species.
//!
//! In: loaded species; out: buffers, and a [`SpeciesSlot`] each, which stays while the species is used. Cost: all surfels
//! whenever the set of species changes, else nothing.

use crate::{
    asset::{SeenMean, SurfelCold, SurfelHot, TreeAsset, TreeClusters, TreeData},
    forest::SpeciesShape,
    gpu::types::{GpuCluster, GpuSpecies, SPECIES_NOT_RESIDENT},
    lod::{splat_size::disc_radius, thinning::pack_factors},
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
    /// Nothing of a tree of scale 1 is farther from its position.
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
    resident: HashMap<AssetId<TreeAsset>, Resident>,
    pub buffers: Option<SurfelBuffers>,
    /// Some species was peeled from other directions than X, Y and Z: its splats are discs.
    pub has_discs: bool,
    /// Grows with every change.
    pub generation: u64,
}

struct Resident {
    tree: Arc<TreeData>,
    clusters: Arc<TreeClusters>,
    slot: SpeciesSlot,
}

impl SurfelPool {
    /// Where a species is.
    pub fn slot(&self, id: AssetId<TreeAsset>) -> SpeciesSlot {
        self.resident.get(&id).map_or(SpeciesSlot::NOT_RESIDENT, |resident| resident.slot)
    }

    /// What selection knows of each species, by its index on the GPU.
    pub fn shapes(&self) -> Vec<Option<SpeciesShape>> {
        let mut shapes = vec![];
        for Resident { tree, slot, .. } in self.resident.values() {
            let index = slot.index as usize;
            if shapes.len() <= index {
                shapes.resize(index + 1, None);
            }
            shapes[index] = Some(SpeciesShape::from(&**tree));
        }
        shapes
    }
}

/// Buffers of the pool.
pub(in crate::render) struct SurfelBuffers {
    pub species: Buffer,
    pub clusters: Buffer,
    pub hot: Buffer,
    pub cold: Buffer,
}

fn same(
    a: &[(AssetId<TreeAsset>, Arc<TreeData>)],
    b: &[(AssetId<TreeAsset>, Arc<TreeData>)],
) -> bool {
    a.len() == b.len() && a.iter().zip(b).all(|(a, b)| a.0 == b.0 && Arc::ptr_eq(&a.1, &b.1))
}

/// Red and green, blue and half of the shade, as 16 bits each. Twin of `unpack_seen_mean` in `shaders/lib/contrast.wgsl`.
fn pack_seen_mean(mean: &SeenMean) -> [u32; 2] {
    let unorm = |value: f32| (value.clamp(0.0, 1.0) * 65_535.0).round() as u32;
    let [r, g, b] = mean.color.map(unorm);
    [r | g << 16, b | unorm(0.5 * mean.shade) << 16]
}

fn gpu_species(
    tree: &TreeData,
    first_point: u32,
    first_cluster: u32,
    level_count: u32,
) -> GpuSpecies {
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
        first_cluster,
        level_count,
        seen_mean: pack_seen_mean(&tree.seen_mean),
        area_factors: pack_factors(&tree.area_factors),
        light_factors: pack_factors(&tree.light_factors),
    }
}

/// From the position of a tree of scale 1 to the far end of its farthest splat, where all points are drawn. (Where fewer
/// are, splats are larger; the GPU reckons with that in pixels.)
fn reach(tree: &TreeData) -> f32 {
    let splat = disc_radius(tree.surface_area, tree.point_count() as f32);
    tree.bounds.center().length() + tree.bounds.radius() + 3.0 * splat
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
    let mut before = std::mem::take(&mut pool.resident);
    let (mut hot, mut cold) = (Vec::<SurfelHot>::new(), Vec::<SurfelCold>::new());
    let mut clusters = Vec::<GpuCluster>::new();
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
        let kept = before.remove(id);
        let index = kept.as_ref().map_or(next, |kept| kept.slot.index as usize);
        let same = kept.filter(|kept| Arc::ptr_eq(&kept.tree, tree));
        let layout = same
            .as_ref()
            .map_or_else(|| Arc::new(TreeClusters::of(tree)), |same| same.clusters.clone());
        if index >= SPECIES_NOT_RESIDENT as usize {
            error!(
                "a tree of {} points is not drawn: {SPECIES_NOT_RESIDENT} species are in use already, the most that there \
                 can be on the GPU. Use fewer species at once.",
                tree.point_count()
            );
            continue;
        }
        let bytes = ((hot.len() + layout.points.len()) * size_of::<SurfelHot>()) as u64;
        if bytes > limit {
            error!(
                "a tree of {} points is not drawn: with it the surfel pool needs {bytes} bytes in one buffer, and this \
                 device allows {limit}. Bake with a smaller LDI size, or use fewer species at once.",
                tree.point_count()
            );
            continue;
        }
        let first_point = hot.len() as u32;
        next =
            claim(index, gpu_species(tree, first_point, clusters.len() as u32, layout.level_count));
        let slot = SpeciesSlot {
            index: index as u32,
            generation: same.map_or(pool.generation, |same| same.slot.generation),
            reach: reach(tree),
        };
        clusters.extend(layout.clusters.iter().map(|cluster| GpuCluster {
            lo: cluster.bounds.min.to_array(),
            first_point: first_point + cluster.first,
            extent: cluster.bounds.extent().to_array(),
            count: cluster.count,
        }));
        hot.extend(layout.points.iter().map(|i| tree.hot[*i as usize]));
        cold.extend(layout.points.iter().map(|i| tree.cold[*i as usize]));
        let resident = Resident { tree: tree.clone(), clusters: layout, slot };
        pool.resident.insert(*id, resident);
    }
    pool.has_discs = pool.resident.values().any(|resident| resident.tree.sample_share() == 0.0);
    // A binding may not be empty.
    if species.is_empty() {
        species.push(bytemuck::Zeroable::zeroed());
        clusters.push(bytemuck::Zeroable::zeroed());
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
        clusters: upload("treeline_clusters", bytemuck::cast_slice(&clusters)),
        hot: upload("treeline_surfels_hot", bytemuck::cast_slice(&hot)),
        cold: upload("treeline_surfels_cold", bytemuck::cast_slice(&cold)),
    });
}
