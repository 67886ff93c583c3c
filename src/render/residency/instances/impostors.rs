//! Single trees: one slice of the instance buffer, written again when any of them changes.
//!
//! In: single trees, sorted; out: their instances, runs that the same cameras see, and blocks of those. Cost: a copy of each
//! single tree a frame.

use super::{InstancePool, UNIT, Writer, units};
use crate::{
    gpu::types::{GpuInstanceBlock, GpuTreeInstance, INSTANCE_HAS_MESH},
    lod::fade::ViewRange,
    render::{
        extract::ExtractedTrees,
        residency::{
            blocks::TileBlocks,
            packing::{measure_blocks, pack_tree},
            surfels::SurfelPool,
        },
    },
};
use bevy::camera::visibility::RenderLayers;

/// Single trees that follow each other in the buffer and are seen by the same cameras.
pub(in crate::render) struct ImpostorRun {
    pub first: u32,
    pub count: u32,
    pub layers: RenderLayers,
    /// Indices of its blocks.
    pub blocks: std::ops::Range<u32>,
}

/// The slice of the single trees.
#[derive(Default)]
pub(super) struct ImpostorSlice {
    first: u32,
    room: u32,
    written: Vec<GpuTreeInstance>,
    first_block: u32,
    blocks: Vec<GpuInstanceBlock>,
}

impl InstancePool {
    /// Writes the single trees if any of them changed.
    pub(super) fn update_impostors(
        &mut self,
        trees: &ExtractedTrees,
        surfels: &SurfelPool,
        writer: &mut Writer,
    ) {
        self.impostors.clear();
        let mut packed: Vec<GpuTreeInstance> = vec![];
        for impostor in &trees.impostors {
            let tree = pack_tree(impostor.instance, surfels.slot(impostor.species));
            packed.push(tree);
        }
        for near in &trees.near {
            if let Ok(i) = trees.impostors.binary_search_by_key(&near.owner, |i| i.entity) {
                packed[i].look.species_scale |= INSTANCE_HAS_MESH;
            }
        }
        let slice = &mut self.impostor_slice;
        if packed.len() > slice.room as usize {
            self.slices.release(slice.first / UNIT, slice.room / UNIT);
            (slice.first, slice.room) = (0, 0);
            slice.written.clear();
            // Room for more, so that spawning one does not move all each time.
            let room = units(packed.len()).next_power_of_two();
            let Some(first) = self.place(room, room, writer) else { return };
            self.impostor_slice.first = first;
            self.impostor_slice.room = room * UNIT;
        }
        self.update_impostor_blocks(trees, surfels, &packed, writer);
        let slice = &mut self.impostor_slice;
        if slice.written != packed
            && let Some(buffers) = &self.buffers
        {
            buffers.write(slice.first, &packed, writer.queue);
            slice.written = packed;
        }
    }

    /// Cuts the single trees into runs that the same cameras see, and those into blocks.
    fn update_impostor_blocks(
        &mut self,
        trees: &ExtractedTrees,
        surfels: &SurfelPool,
        packed: &[GpuTreeInstance],
        writer: &Writer,
    ) {
        let slice = &mut self.impostor_slice;
        for (i, impostor) in trees.impostors.iter().enumerate() {
            match self.impostors.last_mut() {
                Some(run) if run.layers == impostor.layers => run.count += 1,
                _ => self.impostors.push(ImpostorRun {
                    first: slice.first + i as u32,
                    count: 1,
                    layers: impostor.layers.clone(),
                    blocks: 0..0,
                }),
            }
        }
        let mut blocks: Vec<GpuInstanceBlock> = vec![];
        for run in &mut self.impostors {
            let first = (run.first - slice.first) as usize;
            let slot_of = |i: usize| surfels.slot(trees.impostors[first + i].species);
            let measured = measure_blocks(&packed[first..first + run.count as usize], slot_of);
            let begin = blocks.len() as u32;
            blocks.extend(TileBlocks::new(run.first, &measured, ViewRange::default()).all);
            run.blocks = begin..blocks.len() as u32;
        }
        if blocks.len() != slice.blocks.len() {
            self.blocks.release(slice.first_block, slice.blocks.len() as u32);
            slice.blocks.clear();
            let count = blocks.len() as u32;
            let Some(first) = self.blocks.allocate(count, writer.device, writer.queue) else {
                self.impostors.clear();
                return;
            };
            slice.first_block = first;
        }
        for run in &mut self.impostors {
            run.blocks = run.blocks.start + slice.first_block..run.blocks.end + slice.first_block;
        }
        if slice.blocks != blocks {
            self.blocks.write(slice.first_block, bytemuck::cast_slice(&blocks), writer.queue);
            slice.blocks = blocks;
        }
    }
}
