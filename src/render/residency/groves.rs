//! Groves: the blocks of far trees as ordered lists of samples, made in the background.
//!
//! In: tiles that were packed, cameras; out: samples on the GPU, and the blocks of the tile told where they lie. Until then, and
//! where there is no room, the trees of a block are looked at one by one: the picture is the same. Cost: about 0.1 ms a
//! block, off the main thread; a write a tile.

use super::{
    blocks::TileBlocks,
    grove_order::{Onlooker, by_urgency},
    surfels::SurfelPool,
};
use crate::{
    forest::{GroveList, SpeciesShape, grove_list},
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

/// A tile whose groves are to be made.
struct Request {
    tile: Entity,
    /// Tells the tile from a later one of the same entity.
    revision: u64,
    bounds: Aabb,
    instances: Vec<GpuTreeInstance>,
    samples_per_tree: usize,
    /// End of the tile's view range.
    fade_end: f32,
}

/// The samples of all groves.
pub(super) struct Groves {
    /// Two a word.
    pub samples: SliceBuffer,
    requests: Vec<Request>,
    tasks: Vec<(Entity, u64, Task<Vec<GroveList>>)>,
}

/// What the groves of a tile are.
pub(super) struct Grown {
    pub tile: Entity,
    pub revision: u64,
    lists: Vec<GroveList>,
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

    /// Asks for the groves of a tile.
    pub fn request(
        &mut self,
        tile: Entity,
        revision: u64,
        bounds: Aabb,
        instances: &[GpuTreeInstance],
        samples_per_tree: usize,
        fade_end: f32,
    ) {
        self.forget(tile);
        let instances = instances.to_vec();
        let request = Request { tile, revision, bounds, instances, samples_per_tree, fade_end };
        self.requests.push(request);
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
            bytes += lists.iter().map(|list| list.samples.len() * 2).sum::<usize>();
            ready.push(Grown { tile: *tile, revision: *revision, lists });
            drop(self.tasks.remove(0));
        }
        self.start(surfels, onlookers);
        ready
    }

    /// Writes the samples of a tile and tells its blocks. False: there is no room.
    pub fn place(
        &mut self,
        grown: Grown,
        blocks: &mut TileBlocks,
        device: &RenderDevice,
        queue: &RenderQueue,
    ) -> bool {
        let samples: Vec<u16> =
            grown.lists.iter().flat_map(|list| &list.samples).copied().collect();
        let words: Vec<u32> = samples
            .chunks(2)
            .map(|two| u32::from(two[0]) | u32::from(*two.get(1).unwrap_or(&0)) << 16)
            .collect();
        let Some(first) = self.samples.allocate(words.len() as u32, device, queue) else {
            return false;
        };
        self.samples.write(first, bytemuck::cast_slice(&words), queue);
        blocks.set_groves(first, &grown.lists);
        true
    }
}

/// The groves of a tile's blocks. Those that no view would use are empty.
fn grow(request: &Request, shapes: &[Option<SpeciesShape>]) -> Vec<GroveList> {
    let blocks = request.instances.chunks(SELECT_WORKGROUP as usize);
    let list = |block: &[GpuTreeInstance]| {
        let shape = |index: u16| shapes.get(usize::from(index)).copied().flatten();
        let list = grove_list(block, shape, block.len() * request.samples_per_tree);
        // The view scale grows towards the eye: a grove begins where it has fallen to `complete_below`.
        let begin = LEAST_PIXELS_PER_UNIT / list.complete_below.sqrt();
        if begin < request.fade_end { list } else { GroveList::default() }
    };
    blocks.map(list).collect()
}
