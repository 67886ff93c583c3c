//! Which tiles get groves, and for which view scales: what [`Groves`](super::Groves) is asked for, and what becomes of it.

use super::{
    super::{
        grove_order::{Onlooker, largest_view_scale},
        groves::{Request, wanted_scale},
    },
    InstancePool, SurfelPool,
    buffers::Writer,
};
use crate::{forest::TreelineSettings, lod::prefix_count::z0};
use bevy::{
    camera::primitives::Frustum,
    ecs::query::QueryData,
    prelude::*,
    render::{camera::ExtractedCamera, view::ExtractedView},
};

/// What is read of a camera.
pub(super) type OnlookerQuery = (
    &'static ExtractedView,
    &'static ExtractedCamera,
    &'static Frustum,
    Option<&'static TreelineSettings>,
);

/// What groves are made for, of a camera.
fn onlooker(
    (view, camera, frustum, settings): <OnlookerQuery as QueryData>::Item<'_, '_>,
) -> Onlooker {
    let size = camera.physical_viewport_size.unwrap_or_default();
    let settings = settings.map_or_else(Default::default, |settings| settings.clamped().0);
    let frozen = settings.culling_view;
    Onlooker {
        eye: frozen.map_or(view.world_from_view.translation(), |frozen| frozen.eye),
        // Not the far plane: projections are infinite.
        planes: frustum.half_spaces[..5].iter().map(|plane| plane.normal_d()).collect(),
        quality: settings.quality,
        pixels_per_unit: z0(size.y as f32, view.clip_from_view.y_axis.y),
        orthographic: view.clip_from_view.w_axis.w == 1.0,
    }
}

impl InstancePool {
    /// Asks for the groves that cameras want, and takes over those that are made.
    pub(super) fn grow_groves(
        &mut self,
        surfels: &SurfelPool,
        cameras: &Query<OnlookerQuery, With<Camera3d>>,
        samples_per_tree: usize,
        writer: &Writer,
    ) {
        let onlookers: Vec<Onlooker> = cameras.iter().map(onlooker).collect();
        // Without cameras nothing is drawn, and what there is will do for those that come.
        if samples_per_tree > 0 && !onlookers.is_empty() {
            self.request_groves(&onlookers, samples_per_tree);
        }
        if self.pending_groves() > 0 {
            self.update_groves(surfels, &onlookers, writer);
        }
    }

    /// Asks for groves where there are none, or where cameras have come nearer than they were made for. O(tiles · cameras).
    fn request_groves(&mut self, onlookers: &[Onlooker], samples_per_tree: usize) {
        for (&entity, tile) in self.tiles.iter_mut().filter(|(_, tile)| !tile.is_growing) {
            let k = largest_view_scale(&tile.bounds, onlookers);
            let Some(up_to) = wanted_scale(&tile.blocks, k) else { continue };
            tile.is_growing = true;
            self.groves.request(Request {
                tile: entity,
                revision: tile.packed_revision,
                bounds: tile.bounds,
                trees: tile.trees.clone(),
                samples_per_tree,
                up_to,
                fade_end: tile.view_range.end,
            });
        }
    }

    /// Takes over what is ready.
    fn update_groves(&mut self, surfels: &SurfelPool, onlookers: &[Onlooker], writer: &Writer) {
        let (device, queue) = (writer.device, writer.queue);
        for grown in self.groves.update(surfels, onlookers) {
            let Some(tile) = self.tiles.get_mut(&grown.tile) else { continue };
            if tile.packed_revision != grown.revision {
                continue;
            }
            tile.is_growing = false;
            if self.groves.place(grown, &mut tile.blocks, device, queue) {
                self.blocks.write(tile.blocks.first, bytemuck::cast_slice(&tile.blocks.all), queue);
            }
        }
    }
}
