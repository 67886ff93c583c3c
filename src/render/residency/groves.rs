//! Groves: the blocks of far trees as ordered lists of samples, made in the background.
//!
//! In: tiles, cameras; out: samples on the GPU, and the blocks of the tile told where they lie. Until then, and
//! where there is no room, the trees of a block are looked at one by one: the picture is the same. A grove keeps what cameras
//! at two thirds of their distance would draw of it, and is made again when one comes nearer, or all are far away. Cost: about 0.1 ms a
//! block, off the main thread; a write a tile.

use super::{
    blocks::TileBlocks,
    grove_order::{Onlooker, by_urgency},
    packing::{WorldFromForest, pack_forest},
    surfels::{SpeciesSlot, SurfelPool},
};
use crate::{
    forest::{GroveList, PackedTree, SpeciesShape, grove_list},
    gpu::{
        slice_buffer::SliceBuffer,
        types::{GpuTreeInstance, SELECT_WORKGROUP},
    },
    math::bounding::Aabb,
};
use bevy::{
    prelude::*,
    render::renderer::{RenderDevice, RenderQueue},
    tasks::{AsyncComputeTaskPool, Task, block_on, poll_once},
};
use std::sync::Arc;

/// Tiles in the making at one time. What is in the making comes before what a camera has turned to since.
const TASKS: usize = 1024;
/// Bytes of samples that are written in a frame at most, so that streaming never holds one up.
const WRITE_BYTES: usize = 8 << 20;
/// Smallest scale of a view that groves are made for: pixels per world unit at distance 1.
const LEAST_PIXELS_PER_UNIT: f32 = 400.0;

/// View scales are square in distance: groves are made for those of two thirds of the distance.
const LEAD: f32 = 2.25;
/// By how much view scales may grow until what was made for them is too little.
const MARGIN: f32 = 1.5;
/// How many times more than would be made now is too much: 5 times the distance.
const WASTE: f32 = 25.0;

/// The trees of a tile. Cheap to clone.
#[derive(Clone)]
pub(in crate::render) struct Trees {
    pub instances: Arc<Vec<PackedTree>>,
    /// Place in the slice of each tree of the forest. Empty: as they come.
    pub places: Arc<Vec<u32>>,
    pub world_from_forest: WorldFromForest,
    pub species: Vec<SpeciesSlot>,
}

impl Trees {
    /// As they lie in the slice.
    fn pack(&self) -> Vec<GpuTreeInstance> {
        let mut order: Vec<u32> = (0..self.instances.len() as u32).collect();
        for (tree, place) in (0u32..).zip(self.places.iter()) {
            order[*place as usize] = tree;
        }
        let mut out = Vec::with_capacity(order.len());
        pack_forest(&self.instances, &order, &self.world_from_forest, &self.species, &mut out);
        out
    }
}

/// A tile whose groves are to be made.
pub(super) struct Request {
    pub tile: Entity,
    /// Tells the tile from a later one of the same entity.
    pub revision: u64,
    pub bounds: Aabb,
    pub trees: Trees,
    pub samples_per_tree: usize,
    /// Largest view scale that they are for.
    pub up_to: f32,
    /// End of the tile's view range.
    pub fade_end: f32,
}

/// The view scale that the groves of a tile are to be made for, if what they were made for will not do: `k` is the largest
/// at which a camera sees it.
pub(super) fn wanted_scale(blocks: &TileBlocks, k: f32) -> Option<f32> {
    let lacks = k * MARGIN > blocks.made_for && !blocks.is_full;
    let wastes = blocks.made_for > k * (LEAD * WASTE);
    (lacks || wastes).then_some(k * LEAD)
}

/// The samples of all groves.
pub(super) struct Groves {
    /// Two a word.
    pub samples: SliceBuffer,
    requests: Vec<Request>,
    tasks: Vec<(Entity, u64, Task<Lists>)>,
}

/// The groves of a tile's blocks.
struct Lists {
    all: Vec<GroveList>,
    made_for: f32,
    is_full: bool,
}

/// What the groves of a tile are.
pub(super) struct Grown {
    pub tile: Entity,
    pub revision: u64,
    lists: Lists,
}

impl Groves {
    pub fn new(device: &RenderDevice) -> Self {
        Self {
            samples: SliceBuffer::new("treeline_samples", 4, 1 << 16, device),
            requests: default(),
            tasks: vec![],
        }
    }

    /// Tiles that wait for their groves.
    pub fn pending(&self) -> usize {
        self.requests.len() + self.tasks.len()
    }

    /// Asks for the groves of a tile that waits for none.
    pub fn request(&mut self, request: Request) {
        self.requests.push(request);
    }

    /// Gives back the samples of a tile.
    pub fn release(&mut self, blocks: &mut TileBlocks) {
        let samples = std::mem::take(&mut blocks.samples);
        self.samples.release(samples.start, samples.len() as u32);
    }

    /// Nobody wants those of this tile any more.
    pub fn forget(&mut self, tile: Entity) {
        self.requests.retain(|request| request.tile != tile);
        self.tasks.retain(|(of, ..)| *of != tile);
    }

    /// Starts what waits, the most urgent first.
    fn start(&mut self, surfels: &SurfelPool, onlookers: &[Onlooker]) {
        let free = TASKS.saturating_sub(self.tasks.len());
        if free == 0 || self.requests.is_empty() {
            return;
        }
        let shapes: Arc<Vec<Option<SpeciesShape>>> = Arc::new(surfels.shapes());
        let bounds: Vec<Aabb> = self.requests.iter().map(|request| request.bounds).collect();
        let mut requests: Vec<_> = self.requests.drain(..).map(Some).collect();
        for index in by_urgency(&bounds, onlookers).into_iter().take(free) {
            let request = requests[index].take().expect("an order names each index once");
            let (tile, revision, shapes) = (request.tile, request.revision, shapes.clone());
            let task = AsyncComputeTaskPool::get().spawn(async move { grow(&request, &shapes) });
            self.tasks.push((tile, revision, task));
        }
        self.requests.extend(requests.into_iter().flatten());
    }

    /// Takes what is ready, in the order in which it was started, and starts what waits in its place.
    pub fn update(&mut self, surfels: &SurfelPool, onlookers: &[Onlooker]) -> Vec<Grown> {
        let mut ready = vec![];
        let mut bytes = 0;
        while bytes < WRITE_BYTES
            && let Some((tile, revision, task)) = self.tasks.first_mut()
            && let Some(lists) = block_on(poll_once(task))
        {
            bytes += lists.all.iter().map(|list| list.samples.len() * 2).sum::<usize>();
            ready.push(Grown { tile: *tile, revision: *revision, lists });
            drop(self.tasks.remove(0));
        }
        self.start(surfels, onlookers);
        ready
    }

    /// Writes the samples of a tile and tells its blocks, in place of those that it had. False: there is no room.
    pub fn place(
        &mut self,
        grown: Grown,
        blocks: &mut TileBlocks,
        device: &RenderDevice,
        queue: &RenderQueue,
    ) -> bool {
        let Lists { all, made_for, is_full } = grown.lists;
        // Also where there is no room: who asks again would get no more.
        (blocks.made_for, blocks.is_full) = (made_for, is_full);
        let samples: Vec<u16> = all.iter().flat_map(|list| &list.samples).copied().collect();
        let words: Vec<u32> = samples
            .chunks(2)
            .map(|two| u32::from(two[0]) | u32::from(*two.get(1).unwrap_or(&0)) << 16)
            .collect();
        let Some(first) = self.samples.allocate(words.len() as u32, device, queue) else {
            return false;
        };
        self.samples.write(first, bytemuck::cast_slice(&words), queue);
        self.release(blocks);
        blocks.set_groves(first, &all);
        true
    }
}

/// The groves of a tile's blocks. Those that no view would use are empty.
fn grow(request: &Request, shapes: &[Option<SpeciesShape>]) -> Lists {
    let (instances, up_to) = (request.trees.pack(), request.up_to);
    let mut is_full = true;
    let list = |block: &[GpuTreeInstance]| {
        let shape = |index: u16| shapes.get(usize::from(index)).copied().flatten();
        let list = grove_list(block, shape, block.len() * request.samples_per_tree, up_to);
        is_full &= list.complete_below <= up_to;
        // The view scale grows towards the eye: a grove begins where it has fallen to `complete_below`.
        let begin = LEAST_PIXELS_PER_UNIT / list.complete_below.sqrt();
        if begin < request.fade_end { list } else { GroveList::default() }
    };
    let all = instances.chunks(SELECT_WORKGROUP as usize).map(list).collect();
    Lists { all, made_for: up_to, is_full }
}
