//! The instances of all forests and single trees in two buffers: a slice for each forest, and one for the single trees.
//!
//! In: forests that came, changed or went, single trees, near meshes. Out: the buffers, and a [`Tile`] for each forest: where
//! it lies, in the buffers and in the world. The trees of a large forest are sorted by place, so that its blocks are compact,
//! and become groves. Only what changed is packed and written; a larger buffer is filled by a copy
//! on the GPU. Cost: nothing while nothing changes; else a look at each forest, and the trees of those that changed.

mod buffers;
mod growing;
mod impostors;

use super::{
    blocks::TileBlocks,
    groves::{Groves, Trees},
    packing::{WorldFromForest, pack_forest},
    surfels::{SpeciesSlot, SurfelPool},
};
use crate::{
    gpu::{
        slice_buffer::SliceBuffer,
        types::{GpuInstanceBlock, GpuTreeInstance, INSTANCE_HAS_MESH, SELECT_WORKGROUP},
    },
    lod::fade::ViewRange,
    math::{block_order::block_order, bounding::Aabb, slice_allocator::SliceAllocator},
    render::extract::{ExtractedForest, ExtractedTrees},
};
use bevy::{
    camera::visibility::RenderLayers,
    ecs::entity::EntityHashMap,
    platform::collections::HashMap,
    prelude::*,
    render::{
        render_resource::Buffer,
        renderer::{RenderDevice, RenderQueue},
    },
};
use std::sync::Arc;

pub(in crate::render) use buffers::InstanceBuffers;
use buffers::Writer;
use growing::OnlookerQuery;
use impostors::{ImpostorRun, ImpostorSlice};

/// Instances of a unit of the allocator: slices begin and end at multiples, as `GROVE_UNIT` in WGSL. A tile of a few trees
/// wastes 768 bytes at most.
const UNIT: u32 = 32;
const _: () = assert!(SELECT_WORKGROUP.is_multiple_of(UNIT));

/// A forest that is resident.
pub(in crate::render) struct Tile {
    /// Index of its first instance in the buffer.
    pub first: u32,
    /// Instances.
    pub count: u32,
    /// Of these, with a resident species.
    pub resident: u32,
    /// Around all that it may draw, world space.
    pub bounds: Aabb,
    pub view_range: ViewRange,
    pub layers: RenderLayers,
    pub blocks: TileBlocks,
    trees: Trees,
    packed_revision: u64,
    /// Groves are in the making.
    is_growing: bool,
}

/// All instances.
#[derive(Resource)]
pub(in crate::render) struct InstancePool {
    pub buffers: Option<InstanceBuffers>,
    pub blocks: SliceBuffer,
    groves: Groves,
    pub tiles: EntityHashMap<Tile>,
    pub impostors: Vec<ImpostorRun>,
    /// Trees in the buffer.
    pub count: u32,
    /// Forests that wait for their turn or for room.
    pub waiting: u32,
    slices: SliceAllocator,
    impostor_slice: ImpostorSlice,
    /// Words of instances of forests that have a mesh, by index in the buffer, to take the flag back.
    flagged: HashMap<u32, u32>,
    revision: u64,
    surfel_generation: u64,
    reported_limit: bool,
}

impl FromWorld for InstancePool {
    fn from_world(world: &mut World) -> Self {
        let device = world.resource::<RenderDevice>();
        let stride = size_of::<GpuInstanceBlock>() as u64;
        Self {
            buffers: None,
            blocks: SliceBuffer::new("treeline_instance_blocks", stride, 64, device),
            groves: Groves::new(device),
            tiles: default(),
            impostors: vec![],
            count: 0,
            waiting: 0,
            slices: default(),
            impostor_slice: default(),
            flagged: default(),
            revision: 0,
            surfel_generation: 0,
            reported_limit: false,
        }
    }
}

fn units(instances: usize) -> u32 {
    instances.div_ceil(UNIT as usize).try_into().unwrap_or(u32::MAX)
}

/// Brings the instance buffer up to date.
pub(in crate::render) fn prepare_instances(
    mut pool: ResMut<InstancePool>,
    surfels: Res<SurfelPool>,
    trees: Res<ExtractedTrees>,
    cameras: Query<OnlookerQuery, With<Camera3d>>,
    device: Res<RenderDevice>,
    queue: Res<RenderQueue>,
) {
    let mut writer = Writer::new(&device, &queue);
    let is_behind = pool.revision != trees.revision
        || pool.surfel_generation != surfels.generation
        || pool.waiting > 0;
    if is_behind {
        pool.update_forests(&trees, &surfels, &mut writer);
    }
    pool.grow_groves(&surfels, &cameras, trees.groves.samples_per_tree, &writer);
    pool.update_impostors(&trees, &surfels, &mut writer);
    pool.flag_near_trees(&trees, &queue);
    pool.count = pool.impostors.iter().map(|run| run.count).sum::<u32>()
        + pool.tiles.values().map(|tile| tile.count).sum::<u32>();
}

impl InstancePool {
    /// What the samples of groves are read from.
    pub fn samples(&self) -> &Buffer {
        self.groves.samples.buffer()
    }

    /// Forests whose groves are not made yet.
    pub fn pending_groves(&self) -> u32 {
        self.groves.pending() as u32
    }

    /// Bytes on the GPU that trees take, whatever their species: instances, blocks, groves.
    pub fn bytes(&self) -> u64 {
        let instances =
            u64::from(self.slices.used()) * u64::from(UNIT) * size_of::<GpuTreeInstance>() as u64;
        let blocks = u64::from(self.blocks.used()) * size_of::<GpuInstanceBlock>() as u64;
        instances + blocks + u64::from(self.groves.samples.used()) * 4
    }

    fn update_forests(
        &mut self,
        trees: &ExtractedTrees,
        surfels: &SurfelPool,
        writer: &mut Writer,
    ) {
        let slots_of = |forest: &ExtractedForest| {
            forest.species.iter().map(|handle| surfels.slot(handle.id())).collect::<Vec<_>>()
        };
        let species_changed = self.surfel_generation != surfels.generation;
        let was_empty = self.tiles.is_empty();
        let gone: Vec<Entity> = self
            .tiles
            .keys()
            .filter(|entity| !trees.forests.contains_key(*entity))
            .copied()
            .collect();
        for entity in gone {
            self.remove_tile(entity);
        }
        // Maps have no order, and who waits must not depend on it.
        let (mut stale, mut new) = (vec![], vec![]);
        for (&entity, forest) in &trees.forests {
            let Some(tile) = self.tiles.get_mut(&entity) else {
                new.push((forest.packed_revision, entity));
                continue;
            };
            tile.view_range = forest.view_range;
            if tile.blocks.set_view_range(forest.view_range) {
                let blocks = bytemuck::cast_slice(&tile.blocks.all);
                self.blocks.write(tile.blocks.first, blocks, writer.queue);
            }
            if tile.layers != forest.layers {
                tile.layers = forest.layers.clone();
            }
            if tile.packed_revision != forest.packed_revision
                || species_changed && tile.trees.species != slots_of(forest)
            {
                stale.push((forest.packed_revision, entity));
            }
        }
        stale.sort_unstable();
        new.sort_unstable();
        let bytes_of =
            |entity: &Entity| trees.forests[entity].instances.len() * size_of::<GpuTreeInstance>();
        let budget = trees.upload_budget.bytes_per_frame.filter(|_| !was_empty);
        let mut bytes: usize = stale.iter().map(|(_, entity)| bytes_of(entity)).sum();
        // One always fits: a forest larger than the budget arrives, too.
        let in_time = new.iter().enumerate().take_while(|(i, (_, entity))| {
            bytes += bytes_of(entity);
            *i == 0 || budget.is_none_or(|budget| bytes <= budget)
        });
        let in_time = in_time.count();
        self.waiting = (new.len() - in_time) as u32;
        let write: Vec<Entity> = stale.iter().chain(&new[..in_time]).map(|(_, e)| *e).collect();

        // First give back, so that the slices can be used again.
        for entity in &write {
            self.remove_tile(*entity);
        }
        let units_of = |entity: &Entity| units(trees.forests[entity].instances.len());
        let mut to_come: u32 = write.iter().map(units_of).fold(0, u32::saturating_add);
        for entity in write {
            let forest = &trees.forests[&entity];
            let Some(first) = self.place(units_of(&entity), to_come, writer) else {
                self.waiting += 1;
                continue;
            };
            to_come = to_come.saturating_sub(units_of(&entity));
            writer.seek(first, self.buffers.as_ref());
            if let Some(tile) = self.pack_tile(forest, first, slots_of(forest), writer) {
                self.tiles.insert(entity, tile);
            } else {
                self.slices.release(first / UNIT, units_of(&entity));
                self.waiting += 1;
            }
        }
        writer.flush(self.buffers.as_ref());
        self.revision = trees.revision;
        self.surfel_generation = surfels.generation;
    }

    /// Packs a forest for the slice at `first`. `None`: there is no room for its blocks.
    fn pack_tile(
        &mut self,
        forest: &ExtractedForest,
        first: u32,
        species: Vec<SpeciesSlot>,
        writer: &mut Writer,
    ) -> Option<Tile> {
        let instances = &forest.instances;
        let block = SELECT_WORKGROUP as usize;
        let is_one_block = instances.len() <= block;
        let order: Vec<u32> = if is_one_block {
            (0..instances.len() as u32).collect()
        } else {
            let positions: Vec<Vec3> = instances.iter().map(|tree| tree.position).collect();
            block_order(&positions, block)
        };
        let world_from_forest = WorldFromForest::new(forest.transform);
        let packed = pack_forest(instances, &order, &world_from_forest, &species, &mut writer.data);
        let mut blocks = TileBlocks::new(first, &packed, forest.view_range);
        let count = blocks.all.len() as u32;
        blocks.first = self.blocks.allocate(count, writer.device, writer.queue)?;
        self.blocks.write(blocks.first, bytemuck::cast_slice(&blocks.all), writer.queue);
        let mut places = vec![];
        if !is_one_block {
            places.resize(order.len(), 0);
            for (place, tree) in order.iter().enumerate() {
                places[*tree as usize] = place as u32;
            }
        }
        Some(Tile {
            first,
            count: instances.len() as u32,
            resident: packed.iter().map(|block| block.resident).sum(),
            bounds: packed.iter().fold(Aabb::default(), |all, block| all.union(block.bounds)),
            view_range: forest.view_range,
            layers: forest.layers.clone(),
            blocks,
            trees: Trees {
                instances: instances.clone(),
                places: Arc::new(places),
                world_from_forest,
                species,
            },
            packed_revision: forest.packed_revision,
            is_growing: false,
        })
    }

    fn remove_tile(&mut self, entity: Entity) {
        let Some(mut tile) = self.tiles.remove(&entity) else { return };
        if tile.is_growing {
            self.groves.forget(entity);
        }
        self.blocks.release(tile.blocks.first, tile.blocks.all.len() as u32);
        self.groves.release(&mut tile.blocks);
        let units = units(tile.count as usize);
        self.slices.release(tile.first / UNIT, units);
        let end = tile.first + units * UNIT;
        self.flagged.retain(|index, _| !(tile.first..end).contains(index));
    }

    /// Index of the first instance of a new slice. The buffer grows where it must, to have room for `to_come` units at
    /// once; `None` where the device does not allow it.
    fn place(&mut self, units: u32, to_come: u32, writer: &mut Writer) -> Option<u32> {
        if let Some(begin) = self.slices.allocate(units) {
            return Some(begin * UNIT);
        }
        let limits = writer.device.limits();
        let limit = limits.max_storage_buffer_binding_size.min(limits.max_buffer_size);
        let most = (limit / InstanceBuffers::MOST_BYTES).min(u32::MAX.into()) as u32 / UNIT;
        let now = self.slices.capacity();
        let wanted = now.saturating_add(to_come.max(units).max(now / 2)).min(most);
        if wanted > now {
            writer.flush(self.buffers.as_ref());
            self.grow(wanted, writer);
        }
        let begin = self.slices.allocate(units);
        if begin.is_none() && !self.reported_limit {
            error!(
                "some forests are not drawn: this device allows {limit} bytes of trees in one buffer, which is {} trees",
                u64::from(most) * u64::from(UNIT)
            );
            self.reported_limit = true;
        }
        begin.map(|begin| begin * UNIT)
    }

    fn grow(&mut self, units: u32, writer: &Writer) {
        let instances = u64::from(units) * u64::from(UNIT);
        self.buffers = Some(InstanceBuffers::new(instances, self.buffers.as_ref(), writer));
        self.slices.grow(units);
    }

    /// Writes the mesh flag of the trees of forests where it changed: a few words a frame.
    fn flag_near_trees(&mut self, trees: &ExtractedTrees, queue: &RenderQueue) {
        let Some(buffers) = &self.buffers else { return };
        let mut now: HashMap<u32, u32> = default();
        for near in &trees.near {
            let Some(tile) = self.tiles.get(&near.owner) else { continue };
            let trees = &tile.trees;
            let Some(packed) = trees.instances.get(near.index as usize) else { continue };
            let place = trees.places.get(near.index as usize).copied().unwrap_or(near.index);
            let (tree, _) = trees.world_from_forest.pack(packed, &trees.species);
            let (index, word) = (tile.first + place, tree.look.species_scale);
            if self.flagged.get(&index) != Some(&word) {
                buffers.write_species(index, word | INSTANCE_HAS_MESH, queue);
            }
            now.insert(index, word);
        }
        for (index, word) in &self.flagged {
            if !now.contains_key(index) {
                buffers.write_species(*index, *word, queue);
            }
        }
        self.flagged = now;
    }
}
