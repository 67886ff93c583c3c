//! Splatting: work items → visibility buffer, which keeps the nearest point of each pixel.
//!
//! `init_visibility`, then in each phase `splat_u64`, or `splat_depth` → `splat_payload` without 64-bit atomics.

use super::{
    residency::{InstancePool, SurfelPool},
    select::{bound_settings, constants, phase_settings_binding},
    view::{PHASE_STRIDE, SplatVariant, ViewTrees, Views},
};
use crate::{
    forest::{SplatPath, SplatShape},
    gpu::types::{GpuCounters, GpuIndirectArgs},
    shaders,
};
use bevy::{
    core_pipeline::{core_3d::CORE_3D_DEPTH_FORMAT, prepass::ViewPrepassTextures},
    prelude::*,
    render::{
        diagnostic::RecordDiagnostics,
        render_resource::{binding_types::*, *},
        renderer::{RenderContext, RenderDevice, ViewQuery},
        settings::WgpuFeatures,
        view::{ViewUniform, ViewUniformOffset, ViewUniforms},
    },
};
use std::{mem::offset_of, num::NonZeroU64};

/// What the plugin was told.
#[derive(Resource, Clone, Copy)]
pub(super) struct RequestedSplatPath(pub SplatPath);

/// Which splat path a device runs, and why.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum SplatSupport {
    /// One pass of 64-bit atomics.
    U64,
    /// Two passes of 32-bit atomics, for this reason.
    U32 {
        /// Why not 64.
        reason: String,
    },
    /// Nothing is drawn, for this reason.
    Off {
        /// What lacks, and what to do.
        reason: String,
    },
}

impl SplatSupport {
    /// Decides for a device's features and limits.
    pub fn of(requested: SplatPath, features: WgpuFeatures, limits: &WgpuLimits) -> Self {
        let needed_buffers = 8;
        if limits.max_storage_buffers_per_shader_stage < needed_buffers {
            let found = limits.max_storage_buffers_per_shader_stage;
            return Self::Off {
                reason: format!(
                    "the device allows {found} storage buffers per shader stage and {needed_buffers} are needed; use a \
                     Vulkan, Metal or DX12 device"
                ),
            };
        }
        let needed = WgpuFeatures::SHADER_INT64 | WgpuFeatures::SHADER_INT64_ATOMIC_MIN_MAX;
        let missing = needed - features;
        match (requested, missing.is_empty()) {
            (SplatPath::Auto | SplatPath::U64, true) => Self::U64,
            (SplatPath::U32, _) => Self::U32 { reason: "it was asked for".into() },
            (SplatPath::Auto, false) => {
                Self::U32 { reason: format!("the device lacks {missing:?}") }
            }
            (SplatPath::U64, false) => Self::Off {
                reason: format!(
                    "the 64-bit splat path was asked for, but the device lacks {missing:?}; use `auto` or `u32`"
                ),
            },
        }
    }
}

#[derive(Resource)]
pub(super) struct SplatPipelines {
    layout: BindGroupLayoutDescriptor,
    visibility_layout: BindGroupLayoutDescriptor,
    init_layout: BindGroupLayoutDescriptor,
    init_visibility: CachedComputePipelineId,
    /// Entry points with their shaders, run one after the other.
    entries: Vec<(&'static str, Handle<Shader>)>,
    no_depth: TextureView,
}

/// A splat pipeline: everything that a software driver would else pay for in every point.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) struct SplatKey {
    /// Index of the entry point.
    entry: usize,
    variant: SplatVariant,
    drawn: Drawn,
}

/// What a splat pipeline draws.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Drawn {
    /// Points of trees in the first phase, whose items begin the list.
    Trees,
    /// Those of the second.
    SecondTrees,
    /// Samples of groves, in both.
    Groves,
}

impl SpecializedComputePipeline for SplatPipelines {
    type Key = SplatKey;

    fn specialize(&self, key: SplatKey) -> ComputePipelineDescriptor {
        let (entry, shader) = self.entries[key.entry].clone();
        let mut shader_defs = constants();
        match key.variant.shape {
            SplatShape::Cells => {}
            SplatShape::Discs => shader_defs.push("SPLAT_DISCS".into()),
            SplatShape::Squares => shader_defs.push("SPLAT_SQUARES".into()),
        }
        for (is_on, def) in [
            (key.variant.mixed, "SPLAT_MIXED"),
            (key.variant.parallel, "SPLAT_PARALLEL"),
            (key.drawn == Drawn::SecondTrees, "SPLAT_SECOND"),
            (key.drawn == Drawn::Groves, "SPLAT_GROVES"),
        ] {
            if is_on {
                shader_defs.push(def.into());
            }
        }
        ComputePipelineDescriptor {
            label: Some(format!("treeline_{entry}").into()),
            layout: vec![self.layout.clone(), self.visibility_layout.clone()],
            shader,
            shader_defs,
            entry_point: Some(entry.into()),
            ..default()
        }
    }
}

/// The splat pipelines of a camera by phase, in the order in which they run: of trees and of groves in turn.
#[derive(Component)]
pub(super) struct ViewSplatPipelines([Vec<CachedComputePipelineId>; 2]);

pub(super) fn specialize_splat(
    mut commands: Commands,
    cameras: Query<(Entity, &ViewTrees)>,
    pipelines: Option<Res<SplatPipelines>>,
    mut specialized: ResMut<SpecializedComputePipelines<SplatPipelines>>,
    cache: Res<PipelineCache>,
) {
    let Some(pipelines) = pipelines else { return };
    for (entity, trees) in &cameras {
        let ids = [Drawn::Trees, Drawn::SecondTrees].map(|of_phase| {
            let keys = (0..pipelines.entries.len()).flat_map(|entry| {
                let variant = trees.splat;
                [of_phase, Drawn::Groves].map(|drawn| SplatKey { entry, variant, drawn })
            });
            keys.map(|key| specialized.specialize(&cache, &pipelines, key)).collect()
        });
        commands.entity(entity).insert(ViewSplatPipelines(ids));
    }
}

pub(super) fn init_splat_pipelines(
    mut commands: Commands,
    asset_server: Res<AssetServer>,
    cache: Res<PipelineCache>,
    requested: Res<RequestedSplatPath>,
    device: Res<RenderDevice>,
) {
    let support = SplatSupport::of(requested.0, device.features(), &device.limits());
    match &support {
        SplatSupport::U64 => debug!("splatting with 64-bit atomics"),
        SplatSupport::U32 { reason } => info!("splatting in two passes of 32 bits: {reason}"),
        SplatSupport::Off { reason } => error!("trees are drawn near the camera only: {reason}"),
    }
    let read = || storage_buffer_read_only_sized(false, None);
    let write = || storage_buffer_sized(false, None);
    let layout = BindGroupLayoutDescriptor::new(
        "treeline_splat",
        &BindGroupLayoutEntries::sequential(
            ShaderStages::COMPUTE,
            (
                uniform_buffer::<ViewUniform>(true),
                phase_settings_binding(),
                read(),
                read(),
                read(),
                read(),
                read(),
                read(),
                storage_buffer_sized(false, NonZeroU64::new(size_of::<GpuCounters>() as u64)),
            ),
        ),
    );
    let visibility_layout = BindGroupLayoutDescriptor::new(
        "treeline_visibility",
        &BindGroupLayoutEntries::single(ShaderStages::COMPUTE, write()),
    );
    let init_layout = BindGroupLayoutDescriptor::new(
        "treeline_init_visibility",
        &BindGroupLayoutEntries::sequential(ShaderStages::COMPUTE, (write(), texture_depth_2d())),
    );
    let init_visibility = cache.queue_compute_pipeline(ComputePipelineDescriptor {
        label: Some("treeline_init_visibility".into()),
        layout: vec![layout.clone(), init_layout.clone()],
        shader: asset_server.load(shaders::INIT_VISIBILITY),
        shader_defs: constants(),
        entry_point: Some("init_visibility".into()),
        ..default()
    });
    let entries: &[(&'static str, &'static str)] = match support {
        SplatSupport::U64 => &[("splat_u64", shaders::SPLAT_U64)],
        SplatSupport::U32 { .. } => {
            &[("splat_depth", shaders::SPLAT_DEPTH), ("splat_payload", shaders::SPLAT_PAYLOAD)]
        }
        SplatSupport::Off { .. } => &[],
    };
    let entries = entries.iter().map(|(entry, path)| (*entry, asset_server.load(*path))).collect();
    let no_depth = device.create_texture(&TextureDescriptor {
        label: Some("treeline_no_depth"),
        size: Extent3d { width: 1, height: 1, depth_or_array_layers: 1 },
        mip_level_count: 1,
        sample_count: 1,
        dimension: TextureDimension::D2,
        format: CORE_3D_DEPTH_FORMAT,
        usage: TextureUsages::TEXTURE_BINDING,
        view_formats: &[],
    });
    commands.insert_resource(SplatPipelines {
        init_visibility,
        entries,
        no_depth: no_depth.create_view(&default()),
        layout,
        visibility_layout,
        init_layout,
    });
}

/// On cameras that draw trees.
#[derive(Component)]
pub(super) struct SplatGroups {
    main: BindGroup,
    visibility: BindGroup,
    init: BindGroup,
}

#[expect(clippy::too_many_arguments, reason = "a system's parameters are its dependencies")]
pub(super) fn prepare_splat_groups(
    mut commands: Commands,
    cameras: Query<(Entity, &ViewTrees, Option<&ViewPrepassTextures>)>,
    views: Res<Views>,
    pipelines: Option<Res<SplatPipelines>>,
    surfels: Res<SurfelPool>,
    instances: Res<InstancePool>,
    view_uniforms: Res<ViewUniforms>,
    cache: Res<PipelineCache>,
    device: Res<RenderDevice>,
) {
    let (Some(pipelines), Some(surfels), Some(buffers), Some(uniforms)) =
        (pipelines, &surfels.buffers, &instances.buffers, view_uniforms.uniforms.binding())
    else {
        return;
    };
    for (entity, trees, prepass) in &cameras {
        let Some(view) = views.get(trees) else { continue };
        let main = device.create_bind_group(
            "treeline_splat",
            &cache.get_bind_group_layout(&pipelines.layout),
            &BindGroupEntries::sequential((
                uniforms.clone(),
                bound_settings(view),
                surfels.species.as_entire_binding(),
                buffers.places.as_entire_binding(),
                buffers.looks.as_entire_binding(),
                view.splat_items.as_entire_binding(),
                surfels.hot.as_entire_binding(),
                instances.samples().as_entire_binding(),
                view.counters.as_entire_binding(),
            )),
        );
        let visibility = device.create_bind_group(
            "treeline_visibility",
            &cache.get_bind_group_layout(&pipelines.visibility_layout),
            &BindGroupEntries::single(view.visibility.as_entire_binding()),
        );
        let depth = prepass.filter(|_| trees.has_prepass).and_then(|p| p.depth_view());
        let init = device.create_bind_group(
            "treeline_init_visibility",
            &cache.get_bind_group_layout(&pipelines.init_layout),
            &BindGroupEntries::sequential((
                view.visibility.as_entire_binding(),
                depth.unwrap_or(&pipelines.no_depth),
            )),
        );
        commands.entity(entity).insert(SplatGroups { main, visibility, init });
    }
}

/// Draws the points that a phase has selected into the visibility buffer; the first makes it, too.
pub(super) fn splat<const PHASE: u32>(
    view: ViewQuery<(&ViewTrees, &SplatGroups, &ViewSplatPipelines, &ViewUniformOffset)>,
    views: Res<Views>,
    pipelines: Res<SplatPipelines>,
    cache: Res<PipelineCache>,
    mut ctx: RenderContext,
) {
    let (trees, groups, splat_pipelines, view_offset) = view.into_inner();
    let (Some(init), Some(buffers)) =
        (cache.get_compute_pipeline(pipelines.init_visibility), views.get(trees))
    else {
        return;
    };
    if PHASE == 1 && !buffers.two_phases {
        return;
    }
    let passes: Option<Vec<_>> = splat_pipelines.0[PHASE as usize]
        .iter()
        .map(|id| cache.get_compute_pipeline(*id))
        .collect();
    let diagnostics = ctx.diagnostic_recorder();
    let diagnostics = diagnostics.as_deref();
    let label = if PHASE == 0 { "treeline_splat" } else { "treeline_splat_second" };
    let encoder = ctx.command_encoder();
    let mut pass = encoder
        .begin_compute_pass(&ComputePassDescriptor { label: Some(label), timestamp_writes: None });
    let span = diagnostics.pass_span(&mut pass, label);
    pass.set_bind_group(0, &groups.main, &[view_offset.offset, PHASE * PHASE_STRIDE]);
    if PHASE == 0 {
        pass.set_pipeline(init);
        pass.set_bind_group(1, &groups.init, &[]);
        let grid = buffers.size * if buffers.samples > 1 { 2 } else { 1 };
        pass.dispatch_workgroups(grid.x.div_ceil(64), grid.y, 1);
    }
    pass.set_bind_group(1, &groups.visibility, &[]);
    let of_what = [offset_of!(GpuIndirectArgs, splat), offset_of!(GpuIndirectArgs, groves)];
    for (pipeline, args) in passes.into_iter().flatten().zip(of_what.into_iter().cycle()) {
        pass.set_pipeline(pipeline);
        pass.dispatch_workgroups_indirect(&buffers.args, args as u64);
    }
    span.end(&mut pass);
}
