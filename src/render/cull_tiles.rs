//! Which forests a view may see: the blocks of instances that its selection looks at, front to back.
//!
//! In: resident tiles and single trees, a view. Out: [`SeenTiles`]. A forest is skipped whole if its box is outside the
//! frustum or beyond its view range, or if the camera has no layer with it in common. The order depends on what is seen,
//! not on when it came. Cost: O(tiles + seen log seen).

use super::residency::{InstancePool, Tile};
use crate::{
    forest::view_scale, gpu::types::GpuViewBlock, lod::fade::ViewRange, math::bounding::Aabb,
};
use bevy::{camera::visibility::RenderLayers, math::Vec4, prelude::*};
use std::ops::Range;

/// What culling knows of a view.
pub(super) struct TileView<'a> {
    /// Planes (normal, distance) that look inwards. Without the far plane: projections are infinite.
    pub planes: &'a [Vec4],
    pub eye: Vec3,
    pub orthographic: bool,
    pub layers: &'a RenderLayers,
    /// `q`.
    pub quality: f32,
    /// Of a world unit at distance 1.
    pub pixels_per_unit: f32,
}

/// Forests and trees, before the GPU looks at them one by one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct TileCounts {
    /// Forests that were skipped whole.
    pub culled_tiles: u32,
    /// Trees of these, with a resident species.
    pub culled_trees: u32,
    /// Forests that are not on the GPU yet.
    pub waiting: u32,
    /// Forests without groves yet.
    pub pending_groves: u32,
    /// Bytes on the GPU that trees take.
    pub tree_bytes: u64,
}

/// What a view selects from.
#[derive(Debug, Default)]
pub(super) struct SeenTiles {
    pub blocks: Vec<GpuViewBlock>,
    /// Of the blocks, the first so many may have to be looked at tree by tree; the others are groves for certain.
    pub listable: u32,
    pub counts: TileCounts,
}

impl TileView<'_> {
    /// Whether a tile may show a point. What is not a number may.
    fn sees(&self, bounds: &Aabb, view_range: ViewRange, layers: &RenderLayers) -> bool {
        let (center, half) = (bounds.center(), bounds.extent() * 0.5);
        // The GPU rounds, too: far from the origin, more.
        let slack = 1e-3 + 1e-6 * (center.abs().max_element() + half.max_element());
        let outside = self.planes.iter().any(|plane| {
            let normal = plane.truncate();
            normal.dot(center) + plane.w < -normal.abs().dot(half) - slack
        });
        let beyond = !self.orthographic
            && view_range.is_bounded()
            && bounds.distance_squared(self.eye).sqrt() - slack > view_range.end;
        !outside && !beyond && layers.intersects(self.layers)
    }

    /// Whether a block of a tile may be so near that its grove lacks points.
    fn lists(&self, tile: &Tile) -> bool {
        let nearest = match self.orthographic {
            true => 1.0,
            false => tile.bounds.distance_squared(self.eye).sqrt(),
        };
        // The GPU rounds, too.
        let k = view_scale(self.quality, self.pixels_per_unit, nearest) * 1.001;
        let is_grove = k < tile.blocks.complete_below();
        !is_grove
    }

    /// Tiles by these numbers come in the order in which they are drawn. No two tiles have the same, but for tiles at one
    /// place.
    fn order(&self, tile: &Tile) -> [f32; 5] {
        let center = tile.bounds.center();
        let to_center = center.distance_squared(self.eye);
        [tile.bounds.distance_squared(self.eye), to_center, center.x, center.y, center.z]
    }
}

fn push_blocks(blocks: &mut Vec<GpuViewBlock>, range: Range<u32>) {
    blocks.extend(range.map(|block| GpuViewBlock { block, ..bytemuck::Zeroable::zeroed() }));
}

/// Lists what a view selects from.
pub(super) fn cull_tiles(pool: &InstancePool, view: &TileView) -> SeenTiles {
    let mut out = SeenTiles::default();
    out.counts.waiting = pool.waiting;
    out.counts.pending_groves = pool.pending_groves();
    out.counts.tree_bytes = pool.bytes();
    // Single trees move, and are looked at one by one.
    for run in pool.impostors.iter().filter(|run| run.layers.intersects(view.layers)) {
        push_blocks(&mut out.blocks, run.blocks.clone());
    }
    out.listable = out.blocks.len() as u32;
    let mut seen: Vec<([f32; 5], Entity, &Tile)> = vec![];
    for (entity, tile) in &pool.tiles {
        // Nothing of it is loaded, or it is empty.
        if tile.resident == 0 {
            continue;
        }
        if view.sees(&tile.bounds, tile.view_range, &tile.layers) {
            seen.push((view.order(tile), *entity, tile));
        } else {
            out.counts.culled_tiles += 1;
            out.counts.culled_trees += tile.resident;
        }
    }
    seen.sort_unstable_by(|(a, a_entity, _), (b, b_entity, _)| {
        let by_place = a.iter().zip(b).map(|(a, b)| a.total_cmp(b)).find(|order| order.is_ne());
        by_place.unwrap_or_else(|| a_entity.cmp(b_entity))
    });
    for (_, _, tile) in seen {
        push_blocks(&mut out.blocks, tile.blocks.range());
        if view.lists(tile) {
            out.listable = out.blocks.len() as u32;
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Looks along -z from the origin, 90 degrees wide, from 1 on.
    const PLANES: [Vec4; 5] = [
        Vec4::new(0.707_106_77, 0.0, -0.707_106_77, 0.0),
        Vec4::new(-0.707_106_77, 0.0, -0.707_106_77, 0.0),
        Vec4::new(0.0, 0.707_106_77, -0.707_106_77, 0.0),
        Vec4::new(0.0, -0.707_106_77, -0.707_106_77, 0.0),
        Vec4::new(0.0, 0.0, -1.0, -1.0),
    ];

    fn around(center: Vec3) -> Aabb {
        Aabb { min: center - 10.0, max: center + 10.0 }
    }

    fn looking(layers: &RenderLayers) -> TileView<'_> {
        TileView {
            planes: &PLANES,
            eye: Vec3::ZERO,
            orthographic: false,
            layers,
            quality: 1.0,
            pixels_per_unit: 500.0,
        }
    }

    fn sees(bounds: Aabb, view_range: ViewRange, orthographic: bool) -> bool {
        let everyone = RenderLayers::default();
        let view = TileView { orthographic, ..looking(&everyone) };
        view.sees(&bounds, view_range, &everyone)
    }

    #[test]
    fn boxes_outside_the_frustum_are_not_seen() {
        for (center, seen) in [
            (Vec3::NEG_Z * 50.0, true),
            (Vec3::Z * 50.0, false),
            (Vec3::Z * 8.5, true),
            (Vec3::Z * 9.5, false),
            (Vec3::new(65.0, 0.0, -50.0), true),
            (Vec3::new(75.0, 0.0, -50.0), false),
            (Vec3::new(0.0, -75.0, -50.0), false),
            (Vec3::splat(f32::NAN), true),
        ] {
            assert_eq!(sees(around(center), ViewRange::default(), false), seen, "at {center}");
        }
    }

    #[test]
    fn boxes_beyond_their_view_range_are_not_seen_in_perspective() {
        for (distance, end, seen) in [(50.0, 39.0, false), (50.0, 41.0, true), (5.0, 0.0, true)] {
            let bounds = around(Vec3::NEG_Z * distance);
            assert_eq!(sees(bounds, ViewRange::new(0.0, end), false), seen, "{distance} {end}");
            assert!(sees(bounds, ViewRange::new(0.0, end), true));
        }
    }

    #[test]
    fn layers_have_to_meet() {
        let (camera, forest) = (RenderLayers::from_layers(&[0, 3]), RenderLayers::layer(3));
        let bounds = around(Vec3::NEG_Z * 50.0);
        let view = looking(&camera);
        assert!(view.sees(&bounds, default(), &forest));
        assert!(!view.sees(&bounds, default(), &RenderLayers::layer(2)));
    }
}
