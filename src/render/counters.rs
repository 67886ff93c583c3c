//! Counters of each view, back from the GPU a frame or more later.

use super::{
    cull_tiles::TileCounts,
    view::{ViewTrees, Views},
};
use crate::gpu::{readback::ReadbackRing, types::GpuCounters};
use bevy::{
    platform::collections::HashSet,
    prelude::*,
    render::{
        camera::ExtractedCamera,
        renderer::{RenderContext, RenderDevice, ViewQuery},
        sync_world::MainEntity,
    },
};
use std::{
    collections::BTreeMap,
    sync::{
        Arc, Mutex,
        atomic::{AtomicBool, Ordering},
    },
};

/// What one camera's view drew in the newest frame that has come back.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ViewCounters {
    /// Frames counted since the start; tells a new value from an old one.
    pub frame: u64,
    /// `q` of that frame: [`TreelineSettings::quality`](crate::TreelineSettings::quality) times the camera's
    /// [`QualityFactor`](crate::QualityFactor).
    pub quality: f32,
    /// Trees of the scene, in sight or not: of visible [`Forest`](crate::Forest)s that are on the GPU, and single trees
    /// on the camera's layers, whose species is loaded.
    pub instances_seen: u32,
    /// Forests that were skipped whole: outside the frustum, beyond their view range, or on no layer of the camera.
    pub culled_tiles: u32,
    /// Of the trees, in forests that were skipped whole. The others were looked at one by one.
    pub culled_in_tiles: u32,
    /// Of the trees, outside the frustum, though their forest is not.
    pub culled_frustum: u32,
    /// Of the trees, deserving no point.
    pub culled_small: u32,
    /// Of the trees, wholly hidden by what is in front of them (and their species is loaded). Trees that were hidden with
    /// their whole block may be outside of the frustum, or deserve no point, as well.
    pub culled_occluded: u32,
    /// Blocks of far trees that were drawn as groves; their trees were not looked at one by one.
    pub groves: u32,
    /// Of the points, drawn after the depth pyramid: what the frame before did not show.
    pub second_points: u32,
    /// Of the trees, drawn by their mesh alone.
    pub as_mesh: u32,
    /// Of the trees, in the crossfade band.
    pub in_fade: u32,
    /// Points splatted.
    pub points: u32,
    /// Work items.
    pub items: u32,
    /// Work items that did not fit (see `TreelineSettings::point_capacity_millions`); their points are missing.
    pub item_overflow: u32,
    /// 16×16 blocks of pixels resolved.
    pub covered_blocks: u32,
    /// Pixels that show a point.
    pub covered_pixels: u32,
    /// Forests that are not on the GPU yet (see [`UploadBudget`](crate::UploadBudget)), of all cameras.
    pub waiting_forests: u32,
    /// Forests whose groves are still being made, of all cameras: their trees are looked at one by one meanwhile.
    pub pending_groves: u32,
    /// Bytes on the GPU that trees take (instances, blocks, groves), of all cameras; without surfels.
    pub tree_bytes: u64,
}

impl ViewCounters {
    /// Bytes that selection, splat and resolve read of instances, items and surfels: the traffic of the technique.
    /// Hot halves once per point, cold halves and items once per covered pixel, instances in forests in sight once.
    pub fn bytes_read(&self) -> u64 {
        let (points, items, pixels) =
            (u64::from(self.points), u64::from(self.items), u64::from(self.covered_pixels));
        let instances = u64::from(self.instances_seen - self.culled_in_tiles);
        instances * 24 + items * (20 + 80) + points * 8 + pixels * (16 + 16 + 24 + 8)
    }
}

/// Counters by camera entity. A resource of both worlds; clones share the values.
#[derive(Resource, Clone, Default)]
pub struct TreelineCounters {
    views: Arc<Mutex<BTreeMap<Entity, ViewCounters>>>,
}

impl TreelineCounters {
    /// The newest counters of a camera, once a frame has come back. `None` for one that draws no trees (any more).
    pub fn of(&self, camera: Entity) -> Option<ViewCounters> {
        self.all().get(&camera).copied()
    }

    /// The newest counters of every camera that draws trees, by entity.
    pub fn all(&self) -> BTreeMap<Entity, ViewCounters> {
        self.views.lock().unwrap_or_else(|poisoned| poisoned.into_inner()).clone()
    }

    fn set(&self, camera: Entity, counters: ViewCounters) {
        self.views.lock().unwrap_or_else(|poisoned| poisoned.into_inner()).insert(camera, counters);
    }

    fn retain(&self, mut is_drawn: impl FnMut(Entity) -> bool) {
        let mut views = self.views.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        views.retain(|camera, _| is_drawn(*camera));
    }
}

/// What is known of a view's counters without the GPU.
struct CounterTag {
    camera: Entity,
    frame: u64,
    tiles: TileCounts,
    quality: f32,
}

/// Staging of the counters.
#[derive(Resource)]
pub(super) struct CounterReadback {
    // Systems of several views may record at one time.
    ring: Mutex<ReadbackRing<CounterTag>>,
    frame: u64,
}

impl CounterReadback {
    /// Number of the frame in the making.
    pub fn frame(&self) -> u64 {
        self.frame
    }
}

impl FromWorld for CounterReadback {
    fn from_world(world: &mut World) -> Self {
        let counters = world.get_resource::<TreelineCounters>().cloned().unwrap_or_default();
        let overflow_reported = AtomicBool::new(false);
        let publish = move |CounterTag { camera, frame, tiles, quality }: CounterTag,
                            bytes: &[u8]| {
            let c: GpuCounters = bytemuck::pod_read_unaligned(bytes);
            if c.item_overflow > 0 && !overflow_reported.swap(true, Ordering::Relaxed) {
                warn!(
                    "{} of {} work items did not fit: this frame lacks their points, later ones are drawn with less \
                     quality until they fit; raise `TreelineSettings::point_capacity_millions` or lower `quality`",
                    c.item_overflow,
                    c.items + c.item_overflow
                );
            }
            counters.set(
                camera,
                ViewCounters {
                    frame,
                    quality,
                    instances_seen: c.instances_seen + tiles.culled_trees,
                    culled_tiles: tiles.culled_tiles,
                    culled_in_tiles: tiles.culled_trees,
                    culled_frustum: c.culled_frustum,
                    culled_small: c.culled_small,
                    culled_occluded: c.culled_occluded,
                    groves: c.groves,
                    second_points: c.second_points,
                    as_mesh: c.as_mesh,
                    in_fade: c.in_fade,
                    points: c.points,
                    items: c.items,
                    item_overflow: c.item_overflow,
                    covered_blocks: c.covered_blocks,
                    covered_pixels: c.covered_pixels,
                    waiting_forests: tiles.waiting,
                    pending_groves: tiles.pending_groves,
                    tree_bytes: tiles.tree_bytes,
                },
            );
        };
        let ring = ReadbackRing::new(size_of::<GpuCounters>() as u64, publish).into();
        Self { ring, frame: 0 }
    }
}

/// Records the copy of a view's counters, after everything that counts.
pub(super) fn copy_counters(
    view: ViewQuery<(&ViewTrees, &MainEntity)>,
    views: Res<Views>,
    readback: Res<CounterReadback>,
    device: Res<RenderDevice>,
    mut ctx: RenderContext,
) {
    let (trees, main_entity) = view.into_inner();
    let Some(buffers) = views.get(trees) else { return };
    let mut ring = readback.ring.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
    let tag = CounterTag {
        camera: main_entity.id(),
        frame: readback.frame,
        tiles: buffers.tile_counts,
        quality: buffers.quality,
    };
    ring.copy(&device, ctx.command_encoder(), &buffers.counters, tag);
}

/// Asks for this frame's counters, and forgets cameras that draw no trees any more.
pub(super) fn map_counters(
    mut readback: ResMut<CounterReadback>,
    counters: Res<TreelineCounters>,
    cameras: Query<&MainEntity, (With<ViewTrees>, With<ExtractedCamera>)>,
) {
    readback.frame += 1;
    let ring = readback.ring.get_mut().unwrap_or_else(|poisoned| poisoned.into_inner());
    ring.map_recorded();
    // Counters of earlier frames arrive after a camera has gone, too.
    let drawn: HashSet<Entity> = cameras.iter().map(|camera| camera.id()).collect();
    counters.retain(|camera| drawn.contains(&camera));
}
