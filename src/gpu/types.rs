//! Rust mirrors of `shaders/lib/types.wgsl`. `tests/shader_layout.rs` compares them field by field.

use crate::{gpu::mirror::gpu_types, math::compact::scale_from_bits};
use bevy::math::Vec3;

/// Bit of [`GpuTreeLook::species_scale`]: a near mesh of this instance is in the scene, so points may fade out.
pub const INSTANCE_HAS_MESH: u32 = 1 << 12;
/// Species index of an instance whose species is not resident: it is not drawn.
pub const SPECIES_NOT_RESIDENT: u32 = 0xfff;
/// Points of a work item at most: one workgroup of the splat pass.
pub const POINTS_PER_ITEM: u32 = 64;
/// Threads of a selection workgroup.
pub const SELECT_WORKGROUP: u32 = 256;
/// Side of the square of pixels that resolve draws as one quad.
pub const RESOLVE_BLOCK: u32 = 8;

/// A tree in 24 bytes, as it goes to the GPU (`forest::TreeInstance::compact`).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct GpuTreeInstance {
    /// Where it stands.
    pub place: GpuTreePlace,
    /// What it looks like.
    pub look: GpuTreeLook,
}

impl GpuTreeInstance {
    /// World space.
    pub fn position(&self) -> Vec3 {
        Vec3::new(self.place.x, self.place.y, self.place.z)
    }

    /// Index of its species on the GPU.
    pub fn species(&self) -> u32 {
        self.look.species_scale & SPECIES_NOT_RESIDENT
    }

    /// Its scale.
    pub fn scale(&self) -> f32 {
        scale_from_bits(self.look.species_scale >> 16)
    }
}

gpu_types! {
    /// A baked tree in the surfel pool.
    #[derive(PartialEq)]
    pub struct GpuSpecies as "Species" {
        /// Smallest corner of the model's box.
        pub lo: [f32; 3],
        /// Index of its first surfel in the pool.
        pub first_point: u32,
        /// Extent of the model's box.
        pub extent: [f32; 3],
        /// `N0`.
        pub point_count: u32,
        /// Centre of the box: distances are measured to it.
        pub center: [f32; 3],
        /// Radius of the sphere around the box.
        pub radius: f32,
        /// `s`: side of an LDI pixel.
        pub pixel: f32,
        /// `A`.
        pub surface_area: f32,
        /// `L`, 0 without leaves.
        pub mean_leaf_area: f32,
        /// `N0 s² / A`: the mean share of its area that a point shows to its peeling direction; 0 if it was peeled
        /// from more directions than X, Y and Z.
        pub sample_share: f32,
        /// Index of its first cluster.
        pub first_cluster: u32,
        /// Levels of clusters, 1 to 3.
        pub level_count: u32,
        /// Mean of what is seen of it (`pack_seen_mean`).
        pub seen_mean: [u32; 2],
        /// Factors on `A` of one point to all (`lod::thinning::pack_factors`).
        pub area_factors: [u32; 16],
        /// Factors on the colour.
        pub light_factors: [u32; 16],
    }

    /// Neighbouring points of a species: a list of its own in the surfel pool.
    #[derive(PartialEq)]
    pub struct GpuCluster as "Cluster" {
        /// Smallest corner of the box of its points, model space.
        pub lo: [f32; 3],
        /// Index of its first surfel in the pool.
        pub first_point: u32,
        /// Extent of the box.
        pub extent: [f32; 3],
        /// Its points.
        pub count: u32,
    }

    /// Where a tree stands. Apart from the rest, so that ten million trees fit devices that bind 128 MiB.
    #[derive(Default, PartialEq)]
    pub struct GpuTreePlace as "TreePlace" {
        /// World space.
        pub x: f32,
        /// World space.
        pub y: f32,
        /// World space.
        pub z: f32,
    }

    /// What a tree looks like.
    #[derive(Default, PartialEq)]
    pub struct GpuTreeLook as "TreeLook" {
        /// Lower 32 bits of the rotation (`math::compact`).
        pub rotation: u32,
        /// Colour factor per channel, 128 = 1 | seed << 24.
        pub tint_seed: u32,
        /// Species (12 bits) | whether a mesh of it is in the scene << 12 | upper bits of the rotation << 13 | scale << 16.
        pub species_scale: u32,
    }

    /// Up to [`SELECT_WORKGROUP`] neighbouring instances of one forest: the work of a workgroup, and a grove.
    #[derive(PartialEq)]
    pub struct GpuInstanceBlock as "InstanceBlock" {
        /// Smallest corner of the box around all that they may draw, world space.
        pub lo: [f32; 3],
        /// Index of the first instance.
        pub first_instance: u32,
        /// Extent of the box.
        pub extent: [f32; 3],
        /// Instances | those with a resident species << 16.
        pub counts: u32,
        /// Distance from which points thin out.
        pub fade_begin: f32,
        /// Distance from which none is left.
        pub fade_end: f32,
        /// Index of the grove's first sample.
        pub first_sample: u32,
        /// The grove has every point for view scales below this; 0 without a grove.
        pub complete_below: f32,
        /// Threshold of the grove's last sample.
        pub top: f32,
        /// Zero.
        pub pad: [u32; 3],
        /// Lengths of the grove's prefixes, by octave of the view scale (`forest::GroveList`).
        pub marks: [u32; 16],
    }

    /// A block that a view selects from.
    #[derive(PartialEq)]
    pub struct GpuViewBlock as "ViewBlock" {
        /// Index of the block.
        pub block: u32,
        /// Index of its first instance.
        pub first_instance: u32,
        /// What `cull_blocks` decided.
        pub state: u32,
        /// Runs of the block; then the index of its first.
        pub runs: u32,
        /// Work items of the block; then the index of its first.
        pub items: u32,
        /// Of no block: a list of those whose trees are looked at.
        pub listed: u32,
    }

    /// What selection found out about a tree of a listed block, for each thread that looked at one.
    #[derive(PartialEq)]
    pub struct GpuTreeDraw as "TreeDraw" {
        /// Points of the whole tree | whether some of them were not drawn in the first phase << 31.
        pub count: u32,
        /// Of its splats, world units.
        pub radius: f32,
        /// Clusters that are drawn in this phase; until `cull_clusters`, those that may be.
        pub mask: u32,
        /// Of no tree: a list of those that are looked at cluster by cluster.
        pub near: u32,
    }

    /// Consecutive points of one instance, or samples of a grove, as many as are drawn.
    #[derive(PartialEq)]
    pub struct GpuRun as "Run" {
        /// Index of its first work item in this phase.
        pub first_item: u32,
        /// Index of the instance; of the block for a grove.
        pub instance: u32,
        /// First point in the pool; first sample for a grove.
        pub first_point: u32,
        /// Points, or samples of a grove.
        pub points: u32,
        /// Splat radius in world units; 0 for a grove.
        pub radius: f32,
    }

    /// Up to 64 consecutive points of one instance, or samples of a grove.
    #[derive(PartialEq)]
    pub struct GpuWorkItem as "WorkItem" {
        /// Index of the instance; of the block's first for a grove.
        pub instance: u32,
        /// First point in the pool; first sample for a grove.
        pub first_point: u32,
        /// Points, 1 to 64 | for a grove, its window << 8 | 1 << 31.
        pub count: u32,
        /// Splat radius in world units; 0 for a grove.
        pub radius: f32,
    }

    /// How the points of a work item come to the screen: all that the splat pass reads besides the points.
    #[derive(PartialEq)]
    pub struct GpuSplatItem as "SplatItem" {
        /// View x of a point is the product with (x, y, z, 1), its place in the grid of the model's box.
        pub row_x: [f32; 4],
        /// The same for y.
        pub row_y: [f32; 4],
        /// The same for z.
        pub row_z: [f32; 4],
        /// Steps of the grid per world unit.
        pub inverse_step: [f32; 3],
        /// First point in the pool; first sample for a grove.
        pub first_point: u32,
        /// Area of a splat before overlap, world units²: of the disc, or of the cell as its peeling direction sees it. Of a grove:
        /// the distance from which its points thin out.
        pub area: f32,
        /// What leaves overlap for their size. Of a grove: the distance from which none is left.
        pub leaf_overlap: f32,
        /// 1 / (2 spacing), the mean distance of drawn points in LDI pixels.
        pub half_inverse_spacing: f32,
        /// Points (7 bits) | as discs << 7, or of a grove: points | its first instance / 32 << 8.
        pub count_flags: u32,
    }

    /// Per view and frame.
    #[derive(PartialEq)]
    pub struct GpuSelectSettings as "SelectSettings" {
        /// Viewport in pixels.
        pub size: [u32; 2],
        /// Its upper left corner in the target.
        pub origin: [u32; 2],
        /// Blocks of instances that the view selects from.
        pub block_count: u32,
        /// Work items of both phases that fit, and runs of each.
        pub item_capacity: u32,
        /// `Z0`: pixels per world unit at distance 1 (naga_oil mangles names that end in a digit).
        pub pixels_per_unit: f32,
        /// `q`.
        pub quality: f32,
        /// Least distance up to which meshes are drawn.
        pub min_mesh_distance: f32,
        /// Width of the crossfade band.
        pub fade_width: f32,
        /// Spread of the switch distance.
        pub fade_jitter: f32,
        /// Gain of the area rule.
        pub overlap_gain: f32,
        /// 1 for an orthographic projection.
        pub orthographic: u32,
        /// 0 = cells, 1 = discs, 2 = squares.
        pub splat_shape: u32,
        /// 1 if the depth prepass of this view may be read.
        pub has_prepass: u32,
        /// 1 if another view decides what is drawn: the planes and the eye below.
        pub culling_frozen: u32,
        /// Side planes of that view (normal, distance), looking inwards.
        pub culling_planes: [[f32; 4]; 4],
        /// Its eye.
        pub culling_eye: [f32; 3],
        /// 0 in the first phase, 1 in the second.
        pub phase: u32,
        /// View of the frame before.
        pub previous_clip_from_world: [[f32; 4]; 4],
        /// 0 without occlusion culling, 1 exact, 2 with holes of a pixel closed.
        pub occlusion: u32,
        /// 1 if the pyramid of the frame before may be asked.
        pub previous_valid: u32,
        /// Place of its first texel.
        pub pyramid_previous: u32,
        /// Place of the first texel of this frame's.
        pub pyramid_current: u32,
        /// Of the view's blocks, the first so many may be looked at tree by tree.
        pub listable_blocks: u32,
        /// Place of the first run of a grove in the list of runs.
        pub first_grove_run: u32,
        /// 0: trees show prefixes of their lists; else windows, those of this turn plus 1.
        pub window: u32,
        /// Samples along each side of a pixel, 1 or 2.
        pub samples_per_side: u32,
        /// Strength of the contrast correction, 0 to 1.
        pub contrast: f32,
        /// Zero.
        pub pad: u32,
        /// Zero.
        pub pad_pair: [u32; 2],
    }

    /// What happened, per view and frame.
    #[derive(PartialEq)]
    pub struct GpuCounters as "Counters" {
        /// Instances in the view's blocks, with a resident species.
        pub instances_seen: u32,
        /// Outside the frustum.
        pub culled_frustum: u32,
        /// Deserving no point at their distance.
        pub culled_small: u32,
        /// Wholly hidden.
        pub culled_occluded: u32,
        /// Drawn by their mesh alone.
        pub as_mesh: u32,
        /// In the crossfade band.
        pub in_fade: u32,
        /// Points given to work items that fitted.
        pub points: u32,
        /// Work items that fitted.
        pub items: u32,
        /// Work items that did not fit.
        pub item_overflow: u32,
        /// 16×16 blocks with any point.
        pub covered_blocks: u32,
        /// Pixels that show a point.
        pub covered_pixels: u32,
        /// Blocks drawn as groves.
        pub groves: u32,
        /// Work items of the phase in progress.
        pub phase_items: u32,
        /// Its runs.
        pub phase_runs: u32,
        /// Its work items of groves, which are not among the others.
        pub phase_grove_items: u32,
        /// Its runs of groves.
        pub phase_grove_runs: u32,
        /// Place of its first work item in the list of both phases.
        pub first_item: u32,
        /// Place of its first work item of groves, counted from the end of the list.
        pub first_grove_item: u32,
        /// Points of the second phase.
        pub second_points: u32,
        /// Trees that are looked at cluster by cluster, of the phase in progress.
        pub near_trees: u32,
    }

    /// Arguments of the indirect commands, one buffer a view.
    #[derive(PartialEq)]
    pub struct GpuIndirectArgs as "IndirectArgs" {
        /// Trees of listed blocks: workgroups x, y, z.
        pub cull: [u32; 3],
        /// Zero.
        pub pad: u32,
        /// Trees that are looked at cluster by cluster: workgroups x, y, z.
        pub clusters: [u32; 3],
        /// Zero.
        pub pad_clusters: u32,
        /// Trees of blocks with a run: workgroups x, y, z.
        pub emit: [u32; 3],
        /// Zero.
        pub pad_emit: u32,
        /// Work items of trees: workgroups x, y, z.
        pub expand: [u32; 3],
        /// Zero.
        pub pad_expand: u32,
        /// Work items of groves: workgroups x, y, z.
        pub expand_groves: [u32; 3],
        /// Zero.
        pub pad_expand_groves: u32,
        /// Splat: workgroups x, y, z.
        pub splat: [u32; 3],
        /// Zero.
        pub pad_splat: u32,
        /// Splats of groves: workgroups x, y, z.
        pub groves: [u32; 3],
        /// Zero.
        pub pad_groves: u32,
        /// Resolve: vertices, instances, first vertex, first instance.
        pub resolve: [u32; 4],
    }

    /// Temporal antialiasing of a view, per frame.
    #[derive(PartialEq)]
    pub struct GpuTemporalSettings as "TemporalSettings" {
        /// Frames that a pixel averages where nothing moves.
        pub frames_at_rest: f32,
        /// Frames that it averages in motion.
        pub frames_in_motion: f32,
        /// Standard deviations that the past may differ by.
        pub clip: f32,
        /// 1: there is no past.
        pub reset: u32,
    }
}
