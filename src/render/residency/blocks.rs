//! The table of blocks: up to 256 neighbouring instances each, with the box around what they may draw.
//!
//! In: packed tiles and runs of single trees; out: the table on the GPU, which views name blocks of by their index.

use super::packing::PackedBlock;
use crate::{
    forest::GroveList,
    gpu::types::{GpuInstanceBlock, SELECT_WORKGROUP},
    lod::fade::ViewRange,
};
use std::ops::Range;

/// The blocks of a tile.
#[derive(Default)]
pub(in crate::render) struct TileBlocks {
    /// Index of the first in the table.
    pub first: u32,
    pub all: Vec<GpuInstanceBlock>,
    /// Its part of the groves' samples, in words of two.
    pub samples: Range<u32>,
    /// Largest view scale that its groves were made for; 0 until they are.
    pub made_for: f32,
    /// They are as long as they may be: nearer views get no more.
    pub is_full: bool,
    complete_below: f32,
}

impl TileBlocks {
    /// Of instances from `first_instance` on, as they were packed.
    pub fn new(first_instance: u32, packed: &[PackedBlock], view_range: ViewRange) -> Self {
        let block = |(i, block): (usize, &PackedBlock)| {
            let (lo, extent) = if block.bounds.is_empty() {
                // Nothing of it can be drawn. A box that is nowhere would be no box.
                (Default::default(), Default::default())
            } else {
                (block.bounds.min, block.bounds.extent())
            };
            GpuInstanceBlock {
                lo: lo.to_array(),
                first_instance: first_instance + i as u32 * SELECT_WORKGROUP,
                extent: extent.to_array(),
                counts: block.count | block.resident << 16,
                fade_begin: view_range.begin,
                fade_end: view_range.end,
                ..bytemuck::Zeroable::zeroed()
            }
        };
        Self { all: packed.iter().enumerate().map(block).collect(), ..Default::default() }
    }

    /// Tells the blocks where their groves lie: samples from the word `first` on, lists in the order of the blocks.
    pub fn set_groves(&mut self, first: u32, lists: &[GroveList]) {
        let mut next = 2 * first;
        for (block, list) in self.all.iter_mut().zip(lists) {
            block.first_sample = next;
            block.complete_below = list.complete_below;
            block.top = list.top;
            block.marks = list.marks;
            next += list.samples.len() as u32;
        }
        self.samples = first..next.div_ceil(2);
        self.complete_below =
            lists.iter().map(|list| list.complete_below).fold(f32::INFINITY, f32::min);
    }

    /// Indices in the table.
    pub fn range(&self) -> Range<u32> {
        self.first..self.first + self.all.len() as u32
    }

    /// View scales below which every block is drawn as a grove; 0 until groves are made.
    pub fn complete_below(&self) -> f32 {
        self.complete_below
    }

    /// Takes over another view range; false if it is the same.
    pub fn set_view_range(&mut self, view_range: ViewRange) -> bool {
        let (begin, end) = (view_range.begin, view_range.end);
        let mut is_changed = false;
        for block in &mut self.all {
            is_changed |= block.fade_begin != begin || block.fade_end != end;
            (block.fade_begin, block.fade_end) = (begin, end);
        }
        is_changed
    }
}
