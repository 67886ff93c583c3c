//! CPU twin of selection (`shaders/select/`): the same functions in the same order, over plain data.

use super::{instance::TreeInstance, settings::TreelineSettings};
use crate::{
    asset::{TreeAsset, TreeClusters, TreeData},
    gpu::types::{GpuWorkItem, POINTS_PER_ITEM},
    lod::{
        clusters::{CLUSTERS, FIRST_CLUSTER, cluster_points, level_of},
        fade::{FadeBand, ViewRange, fade_band, fade_state},
        prefix_count::{d0, prefix_count, round_count, z0},
        splat_size::disc_radius,
        thinning::{FACTOR_STEPS, factor_of},
    },
    math::hash::unit_from_bits,
};
use bevy::math::{Mat4, Vec3};

/// What selection knows of a view.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ViewPoint {
    /// Eye, world space.
    pub position: Vec3,
    /// Pixels per world unit at distance 1.
    pub z0: f32,
    /// Parallel projection: the scale is the same everywhere and no meshes are drawn.
    pub orthographic: bool,
}

impl ViewPoint {
    /// From a camera's projection and viewport height in pixels.
    pub fn new(position: Vec3, clip_from_view: &Mat4, height_px: f32) -> Self {
        Self {
            position,
            z0: z0(height_px, clip_from_view.y_axis.y),
            orthographic: clip_from_view.w_axis.w == 1.0,
        }
    }
}

/// The part of a baked tree that selection reads.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpeciesShape {
    /// Centre of the model's box.
    pub center: Vec3,
    /// `N0`.
    pub point_count: u32,
    /// `s`.
    pub pixel: f32,
    /// `A`.
    pub surface_area: f32,
    /// `L`.
    pub mean_leaf_area: f32,
    /// Factors on `A` of one point to all.
    pub area_factors: [f32; FACTOR_STEPS],
}

impl From<&TreeData> for SpeciesShape {
    fn from(tree: &TreeData) -> Self {
        Self {
            center: tree.bounds.center(),
            point_count: tree.point_count() as u32,
            pixel: tree.pixel,
            surface_area: tree.surface_area,
            mean_leaf_area: tree.mean_leaf_area,
            area_factors: tree.area_factors,
        }
    }
}

impl TreeAsset {
    /// The part that selection reads.
    pub(crate) fn shape(&self) -> SpeciesShape {
        SpeciesShape::from(&*self.data)
    }
}

/// Points of an instance.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PointDraw {
    /// How many of its points are drawn.
    pub count: u32,
    /// Splat radius in world units; 0 for none.
    pub radius: f32,
}

/// What is drawn of an instance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Selection {
    /// From the eye to the middle of the tree.
    pub distance: f32,
    /// The instance's crossfade band.
    pub band: FadeBand,
    /// Coverage of the mesh, 0 without one.
    pub mesh: f32,
    /// Its points.
    pub draw: PointDraw,
}

/// Decides what is drawn of an instance (world space) of a forest with a view range, apart from culling. Twin of
/// `wanted_points` in `shaders/lib/selection.wgsl`.
pub fn select_instance(
    view: &ViewPoint,
    settings: &TreelineSettings,
    shape: &SpeciesShape,
    instance: &TreeInstance,
    view_range: ViewRange,
    has_mesh: bool,
) -> Selection {
    let center = instance.position + instance.rotation * (shape.center * instance.scale);
    let d = if view.orthographic { 1.0 } else { center.distance(view.position) };
    let s = shape.pixel * instance.scale;
    let n = prefix_count(shape.point_count as f32, s, view.z0, d, settings.quality);
    let hash = unit_from_bits(u32::from(instance.seed));
    let band = fade_band(
        d0(s, view.z0),
        settings.min_mesh_distance,
        settings.fade_width,
        settings.fade_jitter,
        hash,
    );
    let mut wanted = n;
    let mut mesh = 0.0;
    if has_mesh && !view.orthographic {
        let state = fade_state(band, d);
        mesh = state.mesh;
        wanted *= state.points;
        if state.points <= 0.0 {
            return Selection { distance: d, band, mesh, draw: PointDraw::default() };
        }
    }
    if !view.orthographic {
        wanted *= view_range.share(d);
    }
    let count = round_count(wanted, instance.hash()).min(shape.point_count);
    let scale2 = instance.scale * instance.scale;
    let area =
        shape.surface_area * scale2 * factor_of(&shape.area_factors, n, shape.point_count as f32);
    let radius = if count == 0 { 0.0 } else { disc_radius(area, n) };
    Selection { distance: d, band, mesh, draw: PointDraw { count, radius } }
}

/// Work items of the draws, in the order of instances, clusters and points, cut at `capacity`; and how many did not fit.
/// `tree_of` gives the clusters of an instance's species and the place of its first point in the pool. Twin of
/// `scan_blocks`, `emit_runs` and `expand_items`, without occlusion and groves.
pub fn emit_items<'a>(
    draws: &[PointDraw],
    tree_of: impl Fn(usize) -> (&'a TreeClusters, u32),
    capacity: usize,
) -> (Vec<GpuWorkItem>, usize) {
    let mut items = vec![];
    let mut overflow = 0;
    for (index, draw) in draws.iter().enumerate().filter(|(_, draw)| draw.count > 0) {
        let (layout, pool_first) = tree_of(index);
        let level = level_of(draw.count, layout.level_count) as usize;
        let clusters =
            &layout.clusters[FIRST_CLUSTER[level] as usize..][..CLUSTERS[level] as usize];
        let all = clusters.iter().map(|cluster| cluster.count).sum();
        for cluster in clusters {
            let points = match level {
                0 => draw.count,
                _ => cluster_points(draw.count, cluster.count, all),
            };
            let mut first = 0;
            while first < points {
                if items.len() < capacity {
                    items.push(GpuWorkItem {
                        instance: index as u32,
                        first_point: pool_first + cluster.first + first,
                        count: (points - first).min(POINTS_PER_ITEM),
                        radius: draw.radius,
                    });
                } else {
                    overflow += 1;
                }
                first += POINTS_PER_ITEM;
            }
        }
    }
    (items, overflow)
}

#[cfg(test)]
mod tests {
    use super::*;

    const ALWAYS: ViewRange = ViewRange { begin: f32::MAX, end: f32::MAX };

    fn shape() -> SpeciesShape {
        SpeciesShape {
            center: Vec3::Y * 5.0,
            point_count: 100_000,
            pixel: 0.02,
            surface_area: 60.0,
            mean_leaf_area: 0.006,
            area_factors: [1.0; FACTOR_STEPS],
        }
    }

    #[test]
    fn points_cover_the_same_area_at_every_distance() {
        let settings = TreelineSettings::default();
        let view = ViewPoint { position: Vec3::ZERO, z0: 869.0, orthographic: false };
        for d in [30.0, 60.0, 120.0, 500.0, 1500.0] {
            let tree = TreeInstance::at(Vec3::new(0.0, -5.0, -d)).with_scale(1.0);
            let draw = select_instance(&view, &settings, &shape(), &tree, ALWAYS, false).draw;
            let area = draw.count as f32 * draw.radius * draw.radius * std::f32::consts::PI;
            // Whole points, of a size for as many as are wanted.
            let allowed = 0.05 + 1.0 / draw.count as f32;
            assert!((area / 60.0 - 1.0).abs() < allowed, "{area} m² at {d} m");
        }
    }

    #[test]
    fn without_a_mesh_points_stay_however_near() {
        let settings = TreelineSettings::default();
        let view = ViewPoint { position: Vec3::ZERO, z0: 869.0, orthographic: false };
        let tree = TreeInstance::at(Vec3::new(0.0, -5.0, -3.0));
        assert_eq!(
            select_instance(&view, &settings, &shape(), &tree, ALWAYS, false).draw.count,
            100_000
        );
        let near = select_instance(&view, &settings, &shape(), &tree, ALWAYS, true);
        assert_eq!((near.draw.count, near.mesh), (0, 1.0));
    }

    #[test]
    fn beyond_its_view_range_a_tree_loses_points_but_not_their_size() {
        let settings = TreelineSettings::default();
        let view = ViewPoint { position: Vec3::ZERO, z0: 869.0, orthographic: false };
        let tree = TreeInstance::at(Vec3::new(0.0, -5.0, -150.0));
        let select = |range, view| select_instance(view, &settings, &shape(), &tree, range, false);
        let whole = select(ALWAYS, &view).draw;
        let half = select(ViewRange::new(100.0, 200.0), &view).draw;
        assert!(half.count.abs_diff(whole.count / 2) <= 1 && half.radius == whole.radius);
        assert_eq!(select(ViewRange::new(100.0, 150.0), &view).draw.count, 0);
        let parallel = ViewPoint { z0: 5.0, orthographic: true, ..view };
        let range = ViewRange::new(0.0, 0.5);
        assert_eq!(select(range, &parallel).draw, select(ALWAYS, &parallel).draw);
    }

    #[test]
    fn items_are_in_order_and_overflow_is_counted() {
        let draw = |count| PointDraw { count, radius: 1.0 };
        let layout = TreeClusters::of(&crate::asset::synthetic::synthetic_tree(500, 1));
        let tree = |i: usize| (&layout, i as u32 * 10_000);
        let (items, overflow) = emit_items(&[draw(70), draw(0), draw(128)], tree, 3);
        let short: Vec<_> = items.iter().map(|i| (i.instance, i.first_point, i.count)).collect();
        assert_eq!(short, [(0, 0, 64), (0, 64, 6), (2, 20_000, 64)]);
        assert_eq!(overflow, 1);
        // From 257 points on by cluster, all of them together as many.
        let (items, _) = emit_items(&[draw(480)], tree, 1000);
        let first = layout.clusters[1].first;
        assert_eq!(items.len(), 8);
        assert!(items.iter().all(|item| item.count == 60 && item.first_point >= first));
    }
}
