//! The depth pyramid of a view: what has been drawn so far, as the farthest depths of squares of pixels.
//!
//! `build_pyramid` → `reduce_pyramid`, between the two phases of selection. In: the visibility buffer, which holds meshes of
//! the prepass and splats. Out: the pyramid that the second phase asks, and the first of the next frame. O(pixels).

use super::{
    select::{bound_settings, constants, settings_binding},
    view::{ViewTrees, Views},
};
use crate::{math::occlusion::pyramid_size, shaders};
use bevy::{
    prelude::*,
    render::{
        diagnostic::RecordDiagnostics,
        render_resource::{binding_types::*, *},
        renderer::{RenderContext, RenderDevice, ViewQuery},
    },
};

#[derive(Resource)]
pub(super) struct PyramidPipelines {
    layout: BindGroupLayoutDescriptor,
    build: CachedComputePipelineId,
    reduce: CachedComputePipelineId,
}

pub(super) fn init_pyramid_pipelines(
    mut commands: Commands,
    asset_server: Res<AssetServer>,
    cache: Res<PipelineCache>,
) {
    let layout = BindGroupLayoutDescriptor::new(
        "treeline_pyramid",
        &BindGroupLayoutEntries::sequential(
            ShaderStages::COMPUTE,
            (
                settings_binding(),
                storage_buffer_read_only_sized(false, None),
                storage_buffer_sized(false, None),
            ),
        ),
    );
    let pipeline = |entry: &'static str, path: &'static str| {
        cache.queue_compute_pipeline(ComputePipelineDescriptor {
            label: Some(format!("treeline_{entry}").into()),
            layout: vec![layout.clone()],
            shader: asset_server.load(path),
            shader_defs: constants(),
            entry_point: Some(entry.into()),
            ..default()
        })
    };
    commands.insert_resource(PyramidPipelines {
        build: pipeline("build_pyramid", shaders::BUILD_PYRAMID),
        reduce: pipeline("reduce_pyramid", shaders::REDUCE_PYRAMID),
        layout,
    });
}

/// On cameras that draw trees.
#[derive(Component)]
pub(super) struct PyramidGroup(BindGroup);

pub(super) fn prepare_pyramid_groups(
    mut commands: Commands,
    cameras: Query<(Entity, &ViewTrees)>,
    views: Res<Views>,
    pipelines: Option<Res<PyramidPipelines>>,
    cache: Res<PipelineCache>,
    device: Res<RenderDevice>,
) {
    let Some(pipelines) = pipelines else { return };
    for (entity, trees) in &cameras {
        let Some(view) = views.get(trees) else { continue };
        let group = device.create_bind_group(
            "treeline_pyramid",
            &cache.get_bind_group_layout(&pipelines.layout),
            &BindGroupEntries::sequential((
                bound_settings(view),
                view.visibility.as_entire_binding(),
                view.pyramid.as_entire_binding(),
            )),
        );
        commands.entity(entity).insert(PyramidGroup(group));
    }
}

/// Makes the pyramid of a view from what its first phase has drawn.
pub(super) fn build_pyramid(
    view: ViewQuery<(&ViewTrees, &PyramidGroup)>,
    views: Res<Views>,
    pipelines: Res<PyramidPipelines>,
    cache: Res<PipelineCache>,
    mut ctx: RenderContext,
) {
    let (trees, group) = view.into_inner();
    let (Some(build), Some(reduce), Some(buffers)) = (
        cache.get_compute_pipeline(pipelines.build),
        cache.get_compute_pipeline(pipelines.reduce),
        views.get(trees),
    ) else {
        return;
    };
    if !buffers.occlusion {
        return;
    }
    let diagnostics = ctx.diagnostic_recorder();
    let diagnostics = diagnostics.as_deref();
    let mut pass = ctx.command_encoder().begin_compute_pass(&ComputePassDescriptor {
        label: Some("treeline_pyramid"),
        timestamp_writes: None,
    });
    let span = diagnostics.pass_span(&mut pass, "treeline_pyramid");
    let texels = pyramid_size(buffers.size, 0).element_product();
    pass.set_bind_group(0, &group.0, &[]);
    pass.set_pipeline(build);
    pass.dispatch_workgroups(texels.div_ceil(64), 1, 1);
    pass.set_pipeline(reduce);
    pass.dispatch_workgroups(1, 1, 1);
    span.end(&mut pass);
}
