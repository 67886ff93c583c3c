//! Which blocks of pixels show points: a list, and the number of quads that resolve and the prepass draw.

use super::block_constant;
use crate::{
    gpu::types::{GpuCounters, RESOLVE_BLOCK},
    render::{
        select::{bound_settings, grid, settings_binding},
        view::{ViewTrees, Views},
    },
    shaders,
};
use bevy::{
    prelude::*,
    render::{
        diagnostic::RecordDiagnostics,
        render_resource::{binding_types::*, *},
        renderer::{RenderContext, RenderDevice, ViewQuery},
    },
};
use std::num::NonZeroU64;

/// Compute pipelines before the draw.
#[derive(Resource)]
pub(in crate::render) struct ClassifyPipelines {
    layout: BindGroupLayoutDescriptor,
    size_layout: BindGroupLayoutDescriptor,
    classify: CachedComputePipelineId,
    size_resolve: CachedComputePipelineId,
}

pub(in crate::render) fn init_classify_pipelines(
    mut commands: Commands,
    asset_server: Res<AssetServer>,
    cache: Res<PipelineCache>,
) {
    let read = || storage_buffer_read_only_sized(false, None);
    let write = || storage_buffer_sized(false, None);
    let counters = || storage_buffer_sized(false, NonZeroU64::new(size_of::<GpuCounters>() as u64));
    let classify_layout = BindGroupLayoutDescriptor::new(
        "treeline_classify",
        &BindGroupLayoutEntries::sequential(
            ShaderStages::COMPUTE,
            (settings_binding(), read(), write(), counters()),
        ),
    );
    let size_layout = BindGroupLayoutDescriptor::new(
        "treeline_size_resolve",
        &BindGroupLayoutEntries::sequential(ShaderStages::COMPUTE, (counters(), write())),
    );
    let pipeline = |entry: &'static str, path: &'static str, layout: &BindGroupLayoutDescriptor| {
        cache.queue_compute_pipeline(ComputePipelineDescriptor {
            label: Some(format!("treeline_{entry}").into()),
            layout: vec![layout.clone()],
            shader: asset_server.load(path),
            shader_defs: vec![block_constant()],
            entry_point: Some(entry.into()),
            ..default()
        })
    };
    commands.insert_resource(ClassifyPipelines {
        classify: pipeline("classify", shaders::CLASSIFY, &classify_layout),
        size_resolve: pipeline("size_resolve", shaders::SIZE_RESOLVE, &size_layout),
        layout: classify_layout,
        size_layout,
    });
}

/// On cameras that draw trees.
#[derive(Component)]
pub(in crate::render) struct ClassifyGroups {
    classify: BindGroup,
    size: BindGroup,
}

pub(in crate::render) fn prepare_classify_groups(
    mut commands: Commands,
    cameras: Query<(Entity, &ViewTrees)>,
    views: Res<Views>,
    pipelines: Option<Res<ClassifyPipelines>>,
    cache: Res<PipelineCache>,
    device: Res<RenderDevice>,
) {
    let Some(pipelines) = pipelines else { return };
    for (entity, trees) in &cameras {
        let Some(view) = views.get(trees) else { continue };
        let classify = device.create_bind_group(
            "treeline_classify",
            &cache.get_bind_group_layout(&pipelines.layout),
            &BindGroupEntries::sequential((
                bound_settings(view),
                view.visibility.as_entire_binding(),
                view.blocks.as_entire_binding(),
                view.counters.as_entire_binding(),
            )),
        );
        let size = device.create_bind_group(
            "treeline_size_resolve",
            &cache.get_bind_group_layout(&pipelines.size_layout),
            &BindGroupEntries::sequential((
                view.counters.as_entire_binding(),
                view.args.as_entire_binding(),
            )),
        );
        commands.entity(entity).insert(ClassifyGroups { classify, size });
    }
}

/// Lists the blocks that show points.
pub(in crate::render) fn classify(
    view: ViewQuery<(&ViewTrees, &ClassifyGroups)>,
    views: Res<Views>,
    pipelines: Res<ClassifyPipelines>,
    cache: Res<PipelineCache>,
    mut ctx: RenderContext,
) {
    let (trees, groups) = view.into_inner();
    let (Some(classify), Some(size), Some(buffers)) = (
        cache.get_compute_pipeline(pipelines.classify),
        cache.get_compute_pipeline(pipelines.size_resolve),
        views.get(trees),
    ) else {
        return;
    };
    let diagnostics = ctx.diagnostic_recorder();
    let diagnostics = diagnostics.as_deref();
    let mut pass = ctx.command_encoder().begin_compute_pass(&ComputePassDescriptor {
        label: Some("treeline_classify"),
        timestamp_writes: None,
    });
    let span = diagnostics.pass_span(&mut pass, "treeline_classify");
    let blocks = buffers.size.x.div_ceil(RESOLVE_BLOCK) * buffers.size.y.div_ceil(RESOLVE_BLOCK);
    pass.set_pipeline(classify);
    pass.set_bind_group(0, &groups.classify, &[]);
    let (x, y) = grid(blocks.div_ceil(64));
    debug_assert_eq!(y, 1, "a viewport has fewer than 4 million blocks");
    pass.dispatch_workgroups(x, y, 1);
    pass.set_pipeline(size);
    pass.set_bind_group(0, &groups.size, &[]);
    pass.dispatch_workgroups(1, 1, 1);
    span.end(&mut pass);
}
