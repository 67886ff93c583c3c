//! Buffers and settings of each camera's view.

mod fit;

use super::{
    counters::{CounterReadback, TreelineCounters},
    cull_tiles::{TileCounts, TileView, cull_tiles},
    residency::{InstancePool, SurfelPool},
};
use crate::{
    forest::{Occlusion, QualityFactor, SplatShape, TemporalSampling, TreelineSettings},
    gpu::types::{
        GpuCounters, GpuIndirectArgs, GpuRun, GpuSelectSettings, GpuSplatItem, GpuViewBlock,
        GpuWorkItem, POINTS_PER_ITEM, RESOLVE_BLOCK,
    },
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
        render_resource::{Buffer, BufferDescriptor, BufferUsages},
        renderer::{RenderDevice, RenderQueue},
        sync_world::MainEntity,
        view::{ExtractedView, Msaa, RetainedViewEntity},
    },
};

use fit::Fit;

/// GPU side of one view.
pub(super) struct ViewBuffers {
    /// One for each phase, [`PHASE_STRIDE`] bytes apart.
    pub settings: Buffer,
    pub view_blocks: Buffer,
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
    pub tile_counts: TileCounts,
    /// `q` as drawn: the camera's, times its governor's factor and what fits.
    pub quality: f32,
    /// What `view_blocks` begins with.
    written_blocks: Vec<GpuViewBlock>,
    block_capacity: u32,
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

/// Bytes from the settings of one phase to those of the next: the largest alignment that devices ask for.
pub(super) const PHASE_STRIDE: u32 = 512;
const _: () = assert!(size_of::<GpuSelectSettings>() <= PHASE_STRIDE as usize);

/// Name of a warning beside those of settings.
const TOO_MANY_BLOCKS: &str = "blocks";

impl ViewBuffers {
    /// Makes these the blocks that the view selects from. At most `most` fit.
    fn select_from(
        &mut self,
        blocks: Vec<GpuViewBlock>,
        most: u32,
        device: &RenderDevice,
        queue: &RenderQueue,
    ) {
        self.block_count = blocks.len() as u32;
        if self.block_count > self.block_capacity {
            // Room for more, so that turning the camera does not make new buffers each frame.
            self.block_capacity = self.block_count.saturating_add(self.block_count / 2).min(most);
            self.view_blocks = block_buffer(device, self.block_capacity);
            self.runs = run_buffer(device, self.item_capacity, self.block_capacity);
            self.written_blocks.clear();
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

fn buffer(device: &RenderDevice, label: &'static str, size: u64, usage: BufferUsages) -> Buffer {
    // A binding holds one element at least.
    let size = size.max(256);
    device.create_buffer(&BufferDescriptor {
        label: Some(label),
        size,
        usage,
        mapped_at_creation: false,
    })
}

fn pixel_buffers(device: &RenderDevice, size: UVec2, samples: u32) -> [Buffer; 3] {
    let pixels = u64::from(size.x) * u64::from(size.y) * u64::from(samples);
    let blocks =
        u64::from(size.x.div_ceil(RESOLVE_BLOCK)) * u64::from(size.y.div_ceil(RESOLVE_BLOCK));
    let storage = BufferUsages::STORAGE | BufferUsages::COPY_DST | BufferUsages::COPY_SRC;
    let texels = u64::from(pyramid_offset(size, PYRAMID_LEVELS));
    [
        buffer(device, "treeline_visibility", pixels * 8, storage),
        buffer(device, "treeline_blocks", blocks * 4, BufferUsages::STORAGE),
        buffer(device, "treeline_pyramid", 2 * texels * 4, storage),
    ]
}

fn block_buffer(device: &RenderDevice, blocks: u32) -> Buffer {
    let size = u64::from(blocks) * size_of::<GpuViewBlock>() as u64;
    let written = BufferUsages::STORAGE | BufferUsages::COPY_DST;
    buffer(device, "treeline_view_blocks", size, written)
}

/// Runs of trees, each with an item, and of groves, one a block.
fn run_buffer(device: &RenderDevice, items: u32, blocks: u32) -> Buffer {
    let size = (u64::from(items) + u64::from(blocks)) * size_of::<GpuRun>() as u64;
    buffer(device, "treeline_runs", size, BufferUsages::STORAGE | BufferUsages::COPY_SRC)
}

/// Items, and how they come to the screen.
fn item_buffers(device: &RenderDevice, capacity: u32) -> [Buffer; 2] {
    let of = |label, bytes: usize| {
        let size = u64::from(capacity) * bytes as u64;
        buffer(device, label, size, BufferUsages::STORAGE | BufferUsages::COPY_SRC)
    };
    [
        of("treeline_items", size_of::<GpuWorkItem>()),
        of("treeline_splat_items", size_of::<GpuSplatItem>()),
    ]
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
        let buffers = views.all.entry(key).or_insert_with(|| {
            let [visibility, blocks, pyramid] = pixel_buffers(&device, size, settings.samples);
            let [items, splat_items] = item_buffers(&device, item_capacity);
            let counters = BufferUsages::STORAGE | BufferUsages::COPY_SRC | BufferUsages::COPY_DST;
            let args = BufferUsages::STORAGE | BufferUsages::INDIRECT;
            let uniform = BufferUsages::UNIFORM | BufferUsages::COPY_DST;
            ViewBuffers {
                settings: buffer(
                    &device,
                    "treeline_settings",
                    2 * u64::from(PHASE_STRIDE),
                    uniform,
                ),
                view_blocks: block_buffer(&device, 0),
                runs: run_buffer(&device, item_capacity, 0),
                items,
                splat_items,
                counters: buffer(
                    &device,
                    "treeline_counters",
                    size_of::<GpuCounters>() as u64,
                    counters,
                ),
                args: buffer(&device, "treeline_args", size_of::<GpuIndirectArgs>() as u64, args),
                visibility,
                blocks,
                pyramid,
                size,
                occlusion: false,
                two_phases: false,
                previous_clip_from_world: None,
                pyramid_half: 0,
                fit: default(),
                samples: settings.samples,
                block_count: 0,
                tile_counts: default(),
                quality: settings.quality,
                written_blocks: vec![],
                block_capacity: 0,
                item_capacity,
                used: true,
                warned: vec![],
                window_turn: 0,
            }
        });
        buffers.used = true;
        if (buffers.size, buffers.samples) != (size, settings.samples) {
            [buffers.visibility, buffers.blocks, buffers.pyramid] =
                pixel_buffers(&device, size, settings.samples);
            (buffers.size, buffers.samples) = (size, settings.samples);
            buffers.previous_clip_from_world = None;
        }
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
        };
        let mut seen = cull_tiles(&instances, &tile_view);
        let most_blocks = (binding_limit / size_of::<GpuViewBlock>() as u64) as usize;
        if seen.blocks.len() > most_blocks {
            if !buffers.warned.contains(&TOO_MANY_BLOCKS) {
                warn!(
                    "a view sees more trees than this device can select from: the farthest are not drawn"
                );
                buffers.warned.push(TOO_MANY_BLOCKS);
            }
            seen.blocks.truncate(most_blocks);
        }
        buffers.select_from(seen.blocks, most_blocks as u32, &device, &queue);
        buffers.tile_counts = seen.counts;
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
            pixels_per_unit: z0(size.y as f32, view.clip_from_view.y_axis.y),
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
            contrast: settings.contrast,
            first_grove_run: item_capacity,
            window: buffers.next_window(settings.temporal, jitter.is_some()),
            samples_per_side: if settings.samples > 1 { 2 } else { 1 },
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
