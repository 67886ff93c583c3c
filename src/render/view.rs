//! Buffers and settings of each camera's view.

mod buffers;
mod fit;

use super::{
    counters::{CounterReadback, TreelineCounters},
    cull_tiles::{SeenTiles, TileCounts, TileView, cull_tiles},
    residency::{InstancePool, SurfelPool},
};
use crate::{
    forest::{Occlusion, QualityFactor, SplatShape, TemporalSampling, TreelineSettings},
    gpu::types::{GpuSelectSettings, GpuSplatItem, GpuViewBlock, POINTS_PER_ITEM},
    lod::{prefix_count::z0, window::WINDOW_CYCLE},
    math::occlusion::{PYRAMID_LEVELS, pyramid_offset},
};
use bevy::{
    camera::{primitives::Frustum, visibility::RenderLayers},
    core_pipeline::prepass::ViewPrepassTextures,
    math::primitives::ViewFrustum,
    platform::collections::HashMap,
    prelude::*,
    render::{
        camera::{ExtractedCamera, TemporalJitter},
        render_resource::Buffer,
        renderer::{RenderDevice, RenderQueue},
        sync_world::MainEntity,
        view::{ExtractedView, Msaa, RetainedViewEntity},
    },
};

pub(super) use buffers::PHASE_STRIDE;
use buffers::{
    DRAW_BYTES, block_buffer, draw_buffer, fixed_buffers, item_buffers, pixel_buffers, run_buffer,
};
use fit::Fit;

/// GPU side of one view.
pub(super) struct ViewBuffers {
    /// One for each phase, [`PHASE_STRIDE`] bytes apart.
    pub settings: Buffer,
    pub view_blocks: Buffer,
    /// What selection finds out about each tree of the blocks that it may look into.
    pub draws: Buffer,
    pub runs: Buffer,
    pub items: Buffer,
    pub splat_items: Buffer,
    pub counters: Buffer,
    pub args: Buffer,
    /// Two words a sample: payload, depth bits.
    pub visibility: Buffer,
    pub blocks: Buffer,
    /// Farthest depths: of the frame before and of this one, in turn.
    pub pyramid: Buffer,
    /// Pixels.
    pub size: UVec2,
    /// Samples of a pixel, 1 or 4.
    pub samples: u32,
    /// Makes a pyramid.
    pub occlusion: bool,
    /// Asks that of the frame before, so that there is a second phase.
    pub two_phases: bool,
    /// Blocks of instances that the view selects from.
    pub block_count: u32,
    /// Of these, the first so many may be looked at tree by tree.
    pub listable_blocks: u32,
    pub tile_counts: TileCounts,
    /// `q` as drawn: the camera's, times its governor's factor and what fits.
    pub quality: f32,
    /// What `view_blocks` begins with.
    written_blocks: Vec<GpuViewBlock>,
    block_capacity: u32,
    draw_capacity: u32,
    item_capacity: u32,
    /// View of the frame before, if it left a pyramid.
    previous_clip_from_world: Option<Mat4>,
    /// Which half of `pyramid` is this frame's.
    pyramid_half: u32,
    /// Share of `quality` that is drawn: less than 1 after frames whose items did not fit.
    fit: Fit,
    used: bool,
    warned: Vec<&'static str>,
    /// Frames in which trees showed windows, counted up to the cycle.
    window_turn: u32,
}

/// Name of a warning beside those of settings.
const TOO_MANY_BLOCKS: &str = "blocks";

impl ViewBuffers {
    /// For a view that selects from nothing yet.
    fn new(device: &RenderDevice, size: UVec2, samples: u32, item_capacity: u32) -> Self {
        let [visibility, blocks, pyramid] = pixel_buffers(device, size, samples);
        let [items, splat_items] = item_buffers(device, item_capacity);
        let [settings, counters, args] = fixed_buffers(device);
        Self {
            settings,
            view_blocks: block_buffer(device, 0),
            draws: draw_buffer(device, 0),
            runs: run_buffer(device, item_capacity, 0),
            items,
            splat_items,
            counters,
            args,
            visibility,
            blocks,
            pyramid,
            size,
            samples,
            occlusion: false,
            two_phases: false,
            block_count: 0,
            listable_blocks: 0,
            tile_counts: default(),
            quality: 1.0,
            written_blocks: vec![],
            block_capacity: 0,
            draw_capacity: 0,
            item_capacity,
            previous_clip_from_world: None,
            pyramid_half: 0,
            fit: default(),
            used: true,
            warned: vec![],
            window_turn: 0,
        }
    }

    /// Makes these the blocks that the view selects from. At most `most` fit, and room for the trees of `most_listable`.
    fn select_from(
        &mut self,
        seen: SeenTiles,
        (most, most_listable): (u32, u32),
        device: &RenderDevice,
        queue: &RenderQueue,
    ) {
        let SeenTiles { blocks, listable, .. } = seen;
        self.block_count = blocks.len() as u32;
        self.listable_blocks = listable;
        // Room for more, so that turning the camera does not make new buffers each frame.
        let with_room = |count: u32, most: u32| count.saturating_add(count / 2).min(most);
        if self.block_count > self.block_capacity {
            self.block_capacity = with_room(self.block_count, most);
            self.view_blocks = block_buffer(device, self.block_capacity);
            self.runs = run_buffer(device, self.item_capacity, self.block_capacity);
            self.written_blocks.clear();
        }
        // All trees are looked at until their groves are made: that room is given back.
        if listable > self.draw_capacity || listable < self.draw_capacity / 4 {
            self.draw_capacity = with_room(listable, most_listable);
            self.draws = draw_buffer(device, self.draw_capacity);
        }
        if self.written_blocks != blocks {
            queue.write_buffer(&self.view_blocks, 0, bytemuck::cast_slice(&blocks));
            self.written_blocks = blocks;
        }
    }

    /// `GpuSelectSettings::window` of a frame.
    fn next_window(&mut self, sampling: TemporalSampling, is_jittered: bool) -> u32 {
        let has_windows = match sampling {
            TemporalSampling::Auto => is_jittered,
            TemporalSampling::Prefix => false,
            TemporalSampling::Windows => true,
        };
        if !has_windows {
            return 0;
        }
        self.window_turn = (self.window_turn + 1) % (2 * WINDOW_CYCLE);
        self.window_turn + 1
    }
}

/// Buffers by view; a view that is not drawn any more gives them back.
#[derive(Resource, Default)]
pub(super) struct Views {
    all: HashMap<RetainedViewEntity, ViewBuffers>,
}

impl Views {
    pub fn get(&self, view: &ViewTrees) -> Option<&ViewBuffers> {
        self.all.get(&view.key)
    }
}

/// On cameras that draw trees this frame.
#[derive(Component, Clone, Copy)]
pub(super) struct ViewTrees {
    pub key: RetainedViewEntity,
    pub has_prepass: bool,
    pub splat: SplatVariant,
}

/// What the splat pipelines of views differ in.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) struct SplatVariant {
    pub shape: SplatShape,
    /// Discs for some of the trees, where the others are cells.
    pub mixed: bool,
    pub parallel: bool,
}

/// Makes and sizes the buffers of every camera's view, and writes its settings.
#[expect(
    clippy::too_many_arguments,
    clippy::type_complexity,
    reason = "a system's parameters are its dependencies"
)]
pub(super) fn prepare_views(
    mut commands: Commands,
    mut views: ResMut<Views>,
    cameras: Query<
        (
            Entity,
            &ExtractedView,
            &ExtractedCamera,
            &Msaa,
            (Option<&TreelineSettings>, Option<&QualityFactor>),
            Option<&ViewPrepassTextures>,
            Option<&Frustum>,
            Option<&RenderLayers>,
            (&MainEntity, Option<&TemporalJitter>),
        ),
        With<Camera3d>,
    >,
    (instances, surfels): (Res<InstancePool>, Res<SurfelPool>),
    counters: Res<TreelineCounters>,
    readback: Res<CounterReadback>,
    device: Res<RenderDevice>,
    queue: Res<RenderQueue>,
) {
    for view in views.all.values_mut() {
        view.used = false;
    }
    let limits = device.limits();
    let binding_limit = limits.max_storage_buffer_binding_size;
    let everyone = RenderLayers::default();
    for (
        entity,
        view,
        camera,
        msaa,
        (settings, factor),
        prepass,
        frustum,
        layers,
        (main_entity, jitter),
    ) in &cameras
    {
        let size = camera.physical_viewport_size.unwrap_or_default();
        let (settings, moved) = settings.cloned().unwrap_or_default().clamped();
        let samples = u64::from(size.x) * u64::from(size.y) * u64::from(settings.samples);
        let has_pixels = samples > 0 && samples * 8 <= binding_limit;
        if !settings.enabled || !has_pixels || instances.count == 0 {
            commands.entity(entity).remove::<ViewTrees>();
            continue;
        }
        let key = view.retained_view_entity;
        let most = (binding_limit / size_of::<GpuSplatItem>() as u64).min((1 << 26) - 1) as u32;
        let wanted = (settings.point_capacity_millions * 1e6 / POINTS_PER_ITEM as f32) as u32;
        let item_capacity = wanted.clamp(1, most);
        let buffers = views
            .all
            .entry(key)
            .or_insert_with(|| ViewBuffers::new(&device, size, settings.samples, item_capacity));
        buffers.used = true;
        if (buffers.size, buffers.samples) != (size, settings.samples) {
            [buffers.visibility, buffers.blocks, buffers.pyramid] =
                pixel_buffers(&device, size, settings.samples);
            (buffers.size, buffers.samples) = (size, settings.samples);
            buffers.previous_clip_from_world = None;
        }
        if buffers.item_capacity != item_capacity {
            [buffers.items, buffers.splat_items] = item_buffers(&device, item_capacity);
            buffers.runs = run_buffer(&device, item_capacity, buffers.block_capacity);
            buffers.item_capacity = item_capacity;
            buffers.fit = default();
        }
        if let Some(counters) = counters.of(main_entity.id()) {
            buffers.fit.update(&counters, item_capacity, readback.frame());
        }
        let factor = factor.copied().unwrap_or_default().get();
        buffers.quality = settings.quality * factor * buffers.fit.factor;
        let pixels_per_unit = z0(size.y as f32, view.clip_from_view.y_axis.y);
        let orthographic = view.clip_from_view.w_axis.w == 1.0;
        let frozen = settings.culling_view;
        let frozen_frustum =
            frozen.map(|frozen| ViewFrustum::from_clip_from_world(&frozen.clip_from_world));
        let half_spaces = match (frozen_frustum, frustum) {
            (Some(frozen), _) => Some(frozen.half_spaces),
            (None, Some(frustum)) => Some(frustum.half_spaces),
            (None, None) => None,
        };
        let planes = half_spaces.map(|planes| planes.map(|plane| plane.normal_d()));
        let tile_view = TileView {
            planes: planes.as_ref().map_or(&[], |planes| &planes[..5]),
            eye: frozen.map_or(view.world_from_view.translation(), |frozen| frozen.eye),
            orthographic,
            layers: layers.unwrap_or(&everyone),
            quality: buffers.quality,
            pixels_per_unit,
        };
        let mut seen = cull_tiles(&instances, &tile_view);
        let most_blocks = (binding_limit / size_of::<GpuViewBlock>() as u64) as u32;
        let most_listable = (binding_limit / DRAW_BYTES) as u32;
        if seen.blocks.len() > most_blocks as usize || seen.listable > most_listable {
            if !buffers.warned.contains(&TOO_MANY_BLOCKS) {
                warn!(
                    "a view sees more trees than this device can select from: the farthest are not drawn"
                );
                buffers.warned.push(TOO_MANY_BLOCKS);
            }
            seen.blocks.truncate(most_blocks as usize);
            seen.listable = seen.listable.min(most_listable);
        }
        buffers.tile_counts = seen.counts;
        buffers.select_from(seen, (most_blocks, most_listable), &device, &queue);
        for name in moved {
            if !buffers.warned.contains(&name) {
                warn!(
                    "TreelineSettings::{name} of a camera is out of its range and was moved into it"
                );
                buffers.warned.push(name);
            }
        }
        // A multisampled prepass has one depth per sample; points test against each other only.
        let has_prepass = msaa.samples() == 1 && prepass.is_some_and(|p| p.depth_view().is_some());
        // A frozen view looks at what another would cull: nothing is behind what this one draws.
        let occlusion = match settings.occlusion {
            _ if frozen.is_some() => 0,
            Occlusion::Off => 0,
            Occlusion::Exact => 1,
            Occlusion::Closed => 2,
        };
        let texels = pyramid_offset(size, PYRAMID_LEVELS);
        let previous = buffers.previous_clip_from_world.filter(|_| occlusion > 0);
        buffers.occlusion = occlusion > 0;
        buffers.two_phases = previous.is_some();
        buffers.pyramid_half = 1 - buffers.pyramid_half;
        let clip_from_world = view
            .clip_from_world
            .unwrap_or_else(|| view.clip_from_view * view.world_from_view.to_matrix().inverse());
        buffers.previous_clip_from_world = buffers.occlusion.then_some(clip_from_world);
        let first_phase = GpuSelectSettings {
            size: size.to_array(),
            origin: camera
                .viewport
                .as_ref()
                .map_or(UVec2::ZERO, |v| v.physical_position)
                .to_array(),
            block_count: buffers.block_count,
            item_capacity,
            pixels_per_unit,
            quality: buffers.quality,
            min_mesh_distance: settings.min_mesh_distance,
            fade_width: settings.fade_width,
            fade_jitter: settings.fade_jitter,
            overlap_gain: settings.overlap_gain,
            orthographic: u32::from(orthographic),
            splat_shape: match settings.splat_shape {
                SplatShape::Cells => 0,
                SplatShape::Discs => 1,
                SplatShape::Squares => 2,
            },
            has_prepass: u32::from(has_prepass),
            culling_frozen: u32::from(frozen.is_some()),
            culling_planes: planes
                .map_or([[0.0; 4]; 4], |planes| [0, 1, 2, 3].map(|side| planes[side].to_array())),
            culling_eye: tile_view.eye.to_array(),
            phase: 0,
            previous_clip_from_world: previous.unwrap_or_default().to_cols_array_2d(),
            occlusion,
            previous_valid: u32::from(previous.is_some()),
            pyramid_previous: (1 - buffers.pyramid_half) * texels,
            pyramid_current: buffers.pyramid_half * texels,
            listable_blocks: buffers.listable_blocks,
            first_grove_run: item_capacity,
            window: buffers.next_window(settings.temporal, jitter.is_some()),
            samples_per_side: if settings.samples > 1 { 2 } else { 1 },
            contrast: settings.contrast,
            pad: 0,
            pad_pair: [0; 2],
        };
        let second_phase = GpuSelectSettings { phase: 1, ..first_phase };
        for (phase, settings) in [first_phase, second_phase].iter().enumerate() {
            let at = phase as u64 * u64::from(PHASE_STRIDE);
            queue.write_buffer(&buffers.settings, at, bytemuck::bytes_of(settings));
        }
        let splat = SplatVariant {
            shape: settings.splat_shape,
            mixed: settings.splat_shape == SplatShape::Cells && surfels.has_discs,
            parallel: orthographic,
        };
        commands.entity(entity).insert(ViewTrees { key, has_prepass, splat });
    }
    views.all.retain(|_, view| view.used);
}
