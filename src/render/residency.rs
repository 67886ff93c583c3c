//! What is resident on the GPU: the surfels of every species in two pools (hot and cold), and one buffer of instances.

use super::extract::ExtractedTrees;
use crate::{
    asset::{SurfelCold, SurfelHot, TreeAsset, TreeData},
    forest::{NearTree, TreeInstance},
    gpu::types::{GpuSpecies, GpuTreeInstance, INSTANCE_HAS_MESH, SPECIES_NOT_RESIDENT},
};
use bevy::{
    math::Affine3A,
    platform::collections::HashMap,
    prelude::*,
    render::{
        render_resource::{Buffer, BufferDescriptor, BufferInitDescriptor, BufferUsages},
        renderer::{RenderDevice, RenderQueue},
    },
};
use std::sync::Arc;

/// Surfels of the resident species.
#[derive(Resource, Default)]
pub(super) struct SurfelPool {
    /// What the buffers hold; compared by pointer.
    resident: Vec<(AssetId<TreeAsset>, Arc<TreeData>)>,
    /// What was asked for last, resident or not.
    requested: Vec<(AssetId<TreeAsset>, Arc<TreeData>)>,
    index_of: HashMap<AssetId<TreeAsset>, u32>,
    pub buffers: Option<SurfelBuffers>,
    /// Grows with every change.
    pub generation: u64,
}

/// Buffers of the pool.
pub(super) struct SurfelBuffers {
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
        sample_share: sample_share(tree),
    }
}

fn sample_share(tree: &TreeData) -> f32 {
    if tree.statistics.layers.len() > 3 || tree.surface_area <= 0.0 {
        return 0.0;
    }
    tree.point_count() as f32 * tree.pixel * tree.pixel / tree.surface_area
}

/// Uploads the surfels of new species. The whole pool is written again when the set of species changes, which happens
/// when assets load, not while the camera moves.
pub(super) fn prepare_surfels(
    mut pool: ResMut<SurfelPool>,
    trees: Res<ExtractedTrees>,
    device: Res<RenderDevice>,
) {
    if pool.buffers.is_some() && same(&pool.requested, &trees.species) {
        return;
    }
    pool.requested.clone_from(&trees.species);
    pool.generation += 1;
    let limits = device.limits();
    let limit = limits.max_storage_buffer_binding_size.min(limits.max_buffer_size);
    let (mut species, mut hot, mut cold) =
        (vec![], Vec::<SurfelHot>::new(), Vec::<SurfelCold>::new());
    pool.resident.clear();
    pool.index_of.clear();
    for (id, tree) in &trees.species {
        let bytes = ((hot.len() + tree.point_count()) * size_of::<SurfelHot>()) as u64;
        if bytes > limit {
            error!(
                "a tree of {} points is not drawn: with it the surfel pool needs {bytes} bytes in one buffer, and this \
                 device allows {limit}. Bake with a smaller LDI size, or use fewer species at once.",
                tree.point_count()
            );
            continue;
        }
        pool.index_of.insert(*id, species.len() as u32);
        species.push(gpu_species(tree, hot.len() as u32));
        hot.extend_from_slice(&tree.hot);
        cold.extend_from_slice(&tree.cold);
        pool.resident.push((*id, tree.clone()));
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

struct ResidentForest {
    entity: Entity,
    instances: Arc<Vec<GpuTreeInstance>>,
    transform: Affine3A,
    first: u32,
}

/// All instances: those of forests, written when they change, then single trees, written every frame.
#[derive(Resource, Default)]
pub(super) struct InstancePool {
    forests: Vec<ResidentForest>,
    first_impostor: u32,
    /// Packed words of instances that have a mesh, by index, to take the flag back.
    flagged: HashMap<u32, u32>,
    pool_generation: u64,
    pub buffer: Option<Buffer>,
    pub count: u32,
    /// Grows when `buffer` is another one.
    pub generation: u64,
    reported_limit: bool,
}

/// Byte offset of the flags within an instance.
const FLAGS_OFFSET: u64 = std::mem::offset_of!(GpuTreeInstance, species_seed_flags) as u64;
const INSTANCE_BYTES: u64 = size_of::<GpuTreeInstance>() as u64;

impl InstancePool {
    fn is_current(&self, trees: &ExtractedTrees, surfels: &SurfelPool) -> bool {
        self.buffer.is_some()
            && self.pool_generation == surfels.generation
            && self.forests.len() == trees.forests.len()
            && self.forests.iter().zip(&trees.forests).all(|(a, b)| {
                a.entity == b.entity
                    && Arc::ptr_eq(&a.instances, &b.instances)
                    && a.transform == b.transform
            })
    }

    /// Index of a tree in the buffer.
    fn index_of(&self, tree: NearTree, trees: &ExtractedTrees) -> Option<u32> {
        if let Ok(i) = self.forests.binary_search_by_key(&tree.owner, |f| f.entity) {
            let forest = &self.forests[i];
            return ((tree.index as usize) < forest.instances.len())
                .then_some(forest.first + tree.index);
        }
        let i = trees.impostors.binary_search_by_key(&tree.owner, |i| i.entity).ok()?;
        Some(self.first_impostor + i as u32)
    }
}

/// Brings the instance buffer up to date.
pub(super) fn prepare_instances(
    mut pool: ResMut<InstancePool>,
    surfels: Res<SurfelPool>,
    trees: Res<ExtractedTrees>,
    device: Res<RenderDevice>,
    queue: Res<RenderQueue>,
) {
    let pool = &mut *pool;
    let resident =
        |id: &AssetId<TreeAsset>| surfels.index_of.get(id).copied().unwrap_or(SPECIES_NOT_RESIDENT);
    let impostors: Vec<GpuTreeInstance> = trees
        .impostors
        .iter()
        .map(|impostor| {
            let mut packed = impostor.instance.pack();
            packed.species_seed_flags =
                packed.species_seed_flags & 0x00ff_0000 | resident(&impostor.species);
            packed
        })
        .collect();

    let forest_trees: usize = trees.forests.iter().map(|forest| forest.instances.len()).sum();
    let wanted = (forest_trees + impostors.len()) as u64;
    let limit =
        (device.limits().max_storage_buffer_binding_size / INSTANCE_BYTES).min(u32::MAX.into());
    pool.count = wanted.min(limit) as u32;
    if wanted > limit && !pool.reported_limit {
        error!(
            "{wanted} trees need {} bytes in one buffer, and this device allows {limit} trees: the rest is not drawn.",
            wanted * INSTANCE_BYTES
        );
        pool.reported_limit = true;
    }
    let capacity = pool.buffer.as_ref().map_or(0, |b| b.size() / INSTANCE_BYTES);
    let grow = u64::from(pool.count) > capacity || pool.buffer.is_none();
    if grow {
        // Room for a few more single trees, so that spawning one does not make a new buffer each time.
        let size =
            (u64::from(pool.count) + 256).next_multiple_of(256).min(limit.max(1)) * INSTANCE_BYTES;
        pool.buffer = Some(device.create_buffer(&BufferDescriptor {
            label: Some("treeline_instances"),
            size,
            usage: BufferUsages::STORAGE | BufferUsages::COPY_DST,
            mapped_at_creation: false,
        }));
        pool.generation += 1;
        pool.flagged.clear();
    }
    let mut packed_forests: Vec<GpuTreeInstance> = vec![];
    // A new buffer holds no forests yet.
    let rewrite = grow || !pool.is_current(&trees, &surfels);
    if rewrite {
        pool.forests.clear();
        for forest in &trees.forests {
            let species: Vec<u32> = forest.species.iter().map(resident).collect();
            pool.forests.push(ResidentForest {
                entity: forest.entity,
                instances: forest.instances.clone(),
                transform: forest.transform,
                first: packed_forests.len() as u32,
            });
            let identity = forest.transform == Affine3A::IDENTITY;
            packed_forests.extend(forest.instances.iter().map(|packed| {
                let mut out = if identity {
                    *packed
                } else {
                    TreeInstance::unpack(packed).in_world(&forest.transform).pack()
                };
                let local = (packed.species_seed_flags & 0xffff) as usize;
                let index = species.get(local).copied().unwrap_or(SPECIES_NOT_RESIDENT);
                out.species_seed_flags = packed.species_seed_flags & 0x00ff_0000 | index;
                out
            }));
        }
        pool.first_impostor = packed_forests.len() as u32;
        pool.pool_generation = surfels.generation;
        pool.flagged.clear();
    }
    let Some(buffer) = pool.buffer.clone() else { return };
    if rewrite {
        let fitting = packed_forests.len().min(pool.count as usize);
        queue.write_buffer(&buffer, 0, bytemuck::cast_slice(&packed_forests[..fitting]));
    }
    let room = (pool.count.saturating_sub(pool.first_impostor) as usize).min(impostors.len());
    if room > 0 {
        let at = u64::from(pool.first_impostor) * INSTANCE_BYTES;
        queue.write_buffer(&buffer, at, bytemuck::cast_slice(&impostors[..room]));
    }
    flag_near_trees(pool, &trees, &impostors, &queue, &buffer, &surfels);
}

/// Writes the mesh flag of the instances where it changed: a few words a frame.
fn flag_near_trees(
    pool: &mut InstancePool,
    trees: &ExtractedTrees,
    impostors: &[GpuTreeInstance],
    queue: &RenderQueue,
    buffer: &Buffer,
    surfels: &SurfelPool,
) {
    let write = |index: u32, word: u32| {
        queue.write_buffer(
            buffer,
            u64::from(index) * INSTANCE_BYTES + FLAGS_OFFSET,
            &word.to_le_bytes(),
        );
    };
    let mut now: HashMap<u32, u32> = default();
    for near in &trees.near {
        let Some(index) = pool.index_of(*near, trees).filter(|i| *i < pool.count) else { continue };
        let word = if index >= pool.first_impostor {
            impostors[(index - pool.first_impostor) as usize].species_seed_flags
        } else {
            let Ok(i) = pool.forests.binary_search_by_key(&near.owner, |f| f.entity) else {
                continue;
            };
            let packed = pool.forests[i].instances[near.index as usize].species_seed_flags;
            let species =
                trees.forests.get(i).and_then(|f| f.species.get((packed & 0xffff) as usize));
            let resident = species
                .and_then(|id| surfels.index_of.get(id).copied())
                .unwrap_or(SPECIES_NOT_RESIDENT);
            packed & 0x00ff_0000 | resident
        };
        // Single trees are written every frame, without the flag.
        if index >= pool.first_impostor || pool.flagged.get(&index) != Some(&word) {
            write(index, word | INSTANCE_HAS_MESH);
        }
        now.insert(index, word);
    }
    for (index, word) in &pool.flagged {
        if !now.contains_key(index) && *index < pool.first_impostor {
            write(*index, *word);
        }
    }
    pool.flagged = now;
}
