//! Splatting: work items → visibility buffer, which keeps the nearest point of each pixel.
//!
//! `init_visibility` → `splat_u64`, or `splat_depth` → `splat_payload` without 64-bit atomics.

use super::{
    residency::{InstancePool, SurfelPool},
    select::{constants, settings_binding},
    view::{ViewTrees, Views},
};
use crate::{forest::SplatPath, gpu::types::GpuCounters, shaders};
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
use std::num::NonZeroU64;

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
    /// Run one after the other.
    passes: Vec<CachedComputePipelineId>,
    no_depth: TextureView,
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
                settings_binding(),
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
    let pipeline = |entry: &'static str, path: &'static str, second: &BindGroupLayoutDescriptor| {
        cache.queue_compute_pipeline(ComputePipelineDescriptor {
            label: Some(format!("treeline_{entry}").into()),
            layout: vec![layout.clone(), second.clone()],
            shader: asset_server.load(path),
            shader_defs: constants(),
            entry_point: Some(entry.into()),
            ..default()
        })
    };
    let passes = match support {
        SplatSupport::U64 => vec![pipeline("splat_u64", shaders::SPLAT_U64, &visibility_layout)],
        SplatSupport::U32 { .. } => vec![
            pipeline("splat_depth", shaders::SPLAT_DEPTH, &visibility_layout),
            pipeline("splat_payload", shaders::SPLAT_PAYLOAD, &visibility_layout),
        ],
        SplatSupport::Off { .. } => vec![],
    };
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
        init_visibility: pipeline("init_visibility", shaders::INIT_VISIBILITY, &init_layout),
        passes,
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
    let (Some(pipelines), Some(surfels), Some(instances), Some(uniforms)) =
        (pipelines, &surfels.buffers, &instances.buffer, view_uniforms.uniforms.binding())
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
                view.settings.as_entire_binding(),
                surfels.species.as_entire_binding(),
                instances.as_entire_binding(),
                view.items.as_entire_binding(),
                surfels.hot.as_entire_binding(),
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

/// Draws the selected points of a view into its visibility buffer.
pub(super) fn splat(
    view: ViewQuery<(&ViewTrees, &SplatGroups, &ViewUniformOffset)>,
    views: Res<Views>,
    pipelines: Res<SplatPipelines>,
    cache: Res<PipelineCache>,
    mut ctx: RenderContext,
) {
    let (trees, groups, view_offset) = view.into_inner();
    let (Some(init), Some(buffers)) =
        (cache.get_compute_pipeline(pipelines.init_visibility), views.get(trees))
    else {
        return;
    };
    let passes: Option<Vec<_>> =
        pipelines.passes.iter().map(|id| cache.get_compute_pipeline(*id)).collect();
    let diagnostics = ctx.diagnostic_recorder();
    let diagnostics = diagnostics.as_deref();
    let encoder = ctx.command_encoder();
    let mut pass = encoder.begin_compute_pass(&ComputePassDescriptor {
        label: Some("treeline_splat"),
        timestamp_writes: None,
    });
    let span = diagnostics.pass_span(&mut pass, "treeline_splat");
    pass.set_bind_group(0, &groups.main, &[view_offset.offset]);
    pass.set_pipeline(init);
    pass.set_bind_group(1, &groups.init, &[]);
    let grid = buffers.size * if buffers.samples > 1 { 2 } else { 1 };
    pass.dispatch_workgroups(grid.x.div_ceil(64), grid.y, 1);
    pass.set_bind_group(1, &groups.visibility, &[]);
    for pipeline in passes.into_iter().flatten() {
        pass.set_pipeline(pipeline);
        pass.dispatch_workgroups_indirect(&buffers.args, 0);
    }
    span.end(&mut pass);
}
