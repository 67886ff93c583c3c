//! Selection: which points of which instances a view draws, as work items of up to 64 points.
//!
//! `cull_instances` → `scan_blocks` → `emit_items`. What a work item draws is a run of the surfel pool: today a piece
//! of the prefix; a view's own list or a cut through a hierarchy would emit other runs and nothing after this stage
//! would change.

use super::{
    residency::{InstancePool, SurfelPool},
    view::{ViewTrees, Views},
};
use crate::{
    gpu::types::{GpuCounters, GpuSelectSettings, POINTS_PER_ITEM, SELECT_WORKGROUP},
    shaders,
};
use bevy::{
    prelude::*,
    render::{
        diagnostic::RecordDiagnostics,
        render_resource::{binding_types::*, *},
        renderer::{RenderContext, RenderDevice, ViewQuery},
        view::{ViewUniform, ViewUniformOffset, ViewUniforms},
    },
    shader::ShaderDefVal,
};
use std::num::NonZeroU64;

#[derive(Resource)]
pub(super) struct SelectPipelines {
    layout: BindGroupLayoutDescriptor,
    args_layout: BindGroupLayoutDescriptor,
    cull_instances: CachedComputePipelineId,
    scan_blocks: CachedComputePipelineId,
    emit_items: CachedComputePipelineId,
}

/// Constants that WGSL gets from Rust.
pub(super) fn constants() -> Vec<ShaderDefVal> {
    vec![
        ShaderDefVal::UInt("SELECT_WORKGROUP".into(), SELECT_WORKGROUP),
        ShaderDefVal::UInt("POINTS_PER_ITEM".into(), POINTS_PER_ITEM),
    ]
}

pub(super) fn settings_binding() -> BindGroupLayoutEntryBuilder {
    uniform_buffer_sized(false, NonZeroU64::new(size_of::<GpuSelectSettings>() as u64))
}

pub(super) fn init_select_pipelines(
    mut commands: Commands,
    asset_server: Res<AssetServer>,
    cache: Res<PipelineCache>,
) {
    let read = || storage_buffer_read_only_sized(false, None);
    let write = || storage_buffer_sized(false, None);
    let layout = BindGroupLayoutDescriptor::new(
        "treeline_select",
        &BindGroupLayoutEntries::sequential(
            ShaderStages::COMPUTE,
            (
                uniform_buffer::<ViewUniform>(true),
                settings_binding(),
                read(),
                read(),
                read(),
                write(),
                write(),
                write(),
                storage_buffer_sized(false, NonZeroU64::new(size_of::<GpuCounters>() as u64)),
            ),
        ),
    );
    let args_layout = BindGroupLayoutDescriptor::new(
        "treeline_args",
        &BindGroupLayoutEntries::single(ShaderStages::COMPUTE, write()),
    );
    let pipeline =
        |entry: &'static str, path: &'static str, layout: Vec<BindGroupLayoutDescriptor>| {
            cache.queue_compute_pipeline(ComputePipelineDescriptor {
                label: Some(format!("treeline_{entry}").into()),
                layout,
                shader: asset_server.load(path),
                shader_defs: constants(),
                entry_point: Some(entry.into()),
                ..default()
            })
        };
    commands.insert_resource(SelectPipelines {
        cull_instances: pipeline("cull_instances", shaders::CULL_INSTANCES, vec![layout.clone()]),
        scan_blocks: pipeline(
            "scan_blocks",
            shaders::SCAN_BLOCKS,
            vec![layout.clone(), args_layout.clone()],
        ),
        emit_items: pipeline("emit_items", shaders::EMIT_ITEMS, vec![layout.clone()]),
        layout,
        args_layout,
    });
}

/// On cameras that draw trees.
#[derive(Component)]
pub(super) struct SelectGroups {
    main: BindGroup,
    args: BindGroup,
}

#[expect(clippy::too_many_arguments, reason = "a system's parameters are its dependencies")]
pub(super) fn prepare_select_groups(
    mut commands: Commands,
    cameras: Query<(Entity, &ViewTrees)>,
    views: Res<Views>,
    pipelines: Option<Res<SelectPipelines>>,
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
    for (entity, trees) in &cameras {
        let Some(view) = views.get(trees) else { continue };
        let main = device.create_bind_group(
            "treeline_select",
            &cache.get_bind_group_layout(&pipelines.layout),
            &BindGroupEntries::sequential((
                uniforms.clone(),
                view.settings.as_entire_binding(),
                surfels.species.as_entire_binding(),
                instances.as_entire_binding(),
                view.view_blocks.as_entire_binding(),
                view.draws.as_entire_binding(),
                view.block_items.as_entire_binding(),
                view.items.as_entire_binding(),
                view.counters.as_entire_binding(),
            )),
        );
        let args = device.create_bind_group(
            "treeline_args",
            &cache.get_bind_group_layout(&pipelines.args_layout),
            &BindGroupEntries::single(view.args.as_entire_binding()),
        );
        commands.entity(entity).insert(SelectGroups { main, args });
    }
}

/// Workgroups in x and y for `count` workgroups: a side ends at 65,535.
pub(super) fn grid(count: u32) -> (u32, u32) {
    let rows = count.div_ceil(65_535).max(1);
    (count.div_ceil(rows), rows)
}

/// Runs the selection of a view.
pub(super) fn select(
    view: ViewQuery<(&ViewTrees, &SelectGroups, &ViewUniformOffset)>,
    views: Res<Views>,
    pipelines: Res<SelectPipelines>,
    cache: Res<PipelineCache>,
    mut ctx: RenderContext,
) {
    let (trees, groups, view_offset) = view.into_inner();
    let (Some(cull), Some(scan), Some(emit), Some(buffers)) = (
        cache.get_compute_pipeline(pipelines.cull_instances),
        cache.get_compute_pipeline(pipelines.scan_blocks),
        cache.get_compute_pipeline(pipelines.emit_items),
        views.get(trees),
    ) else {
        return;
    };
    let diagnostics = ctx.diagnostic_recorder();
    let diagnostics = diagnostics.as_deref();
    let encoder = ctx.command_encoder();
    encoder.clear_buffer(&buffers.counters, 0, None);
    let mut pass = encoder.begin_compute_pass(&ComputePassDescriptor {
        label: Some("treeline_select"),
        timestamp_writes: None,
    });
    let span = diagnostics.pass_span(&mut pass, "treeline_select");
    let (x, y) = grid(buffers.block_count);
    pass.set_bind_group(0, &groups.main, &[view_offset.offset]);
    pass.set_pipeline(cull);
    pass.dispatch_workgroups(x, y, 1);
    pass.set_pipeline(scan);
    pass.set_bind_group(1, &groups.args, &[]);
    pass.dispatch_workgroups(1, 1, 1);
    pass.set_pipeline(emit);
    pass.dispatch_workgroups(x, y, 1);
    span.end(&mut pass);
}
