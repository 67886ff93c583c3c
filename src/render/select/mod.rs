//! Selection: which points of which instances a view draws, as work items of up to 64 points.
//!
//! Twice a frame, before and after the depth pyramid: `cull_blocks` → `list_blocks` → `cull_instances` → `scan_blocks` →
//! `emit_runs` → `expand_items`. What a work item draws is a run of the surfel pool: a piece of a cluster's list, or
//! samples of a grove; a view's own list or a cut through a hierarchy would emit other runs and nothing after this stage
//! would change.

use super::{
    residency::{InstancePool, SurfelPool},
    view::{PHASE_STRIDE, ViewBuffers, ViewTrees, Views},
};
use crate::{
    gpu::types::{
        GpuCounters, GpuIndirectArgs, GpuSelectSettings, POINTS_PER_ITEM, SELECT_WORKGROUP,
    },
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
use std::{mem::offset_of, num::NonZeroU64};

/// The passes, in their order.
const PASSES: [(&str, &str, Bindings); 6] = [
    ("cull_blocks", shaders::CULL_BLOCKS, Bindings::Cull),
    ("list_blocks", shaders::LIST_BLOCKS, Bindings::Scan),
    ("cull_instances", shaders::CULL_INSTANCES, Bindings::Cull),
    ("scan_blocks", shaders::SCAN_BLOCKS, Bindings::Scan),
    ("emit_runs", shaders::EMIT_RUNS, Bindings::Emit),
    ("expand_items", shaders::EXPAND_ITEMS, Bindings::Expand),
];

/// What a pass binds besides group 0, so that none needs more than 8 storage buffers.
#[derive(Clone, Copy)]
enum Bindings {
    /// Trees, clusters, pyramids.
    Cull,
    /// Arguments of what follows, runs.
    Scan,
    /// As `Cull`, and the runs.
    Emit,
    /// Runs and items.
    Expand,
}

#[derive(Resource)]
pub(super) struct SelectPipelines {
    common: BindGroupLayoutDescriptor,
    cull: BindGroupLayoutDescriptor,
    scan: BindGroupLayoutDescriptor,
    runs: BindGroupLayoutDescriptor,
    expand: BindGroupLayoutDescriptor,
    /// Of each phase.
    passes: [[CachedComputePipelineId; 6]; 2],
}

/// Constants that WGSL gets from Rust.
pub(super) fn constants() -> Vec<ShaderDefVal> {
    vec![
        ShaderDefVal::UInt("SELECT_WORKGROUP".into(), SELECT_WORKGROUP),
        ShaderDefVal::UInt("POINTS_PER_ITEM".into(), POINTS_PER_ITEM),
    ]
}

/// The same for a phase.
fn phase_constants(phase: u32) -> Vec<ShaderDefVal> {
    let mut defs = constants();
    if phase == 1 {
        defs.push("SELECT_SECOND".into());
    }
    defs
}

/// Bytes of the settings of a phase.
const SETTINGS_SIZE: Option<NonZeroU64> = NonZeroU64::new(size_of::<GpuSelectSettings>() as u64);

/// The settings of a view, without a phase.
pub(super) fn settings_binding() -> BindGroupLayoutEntryBuilder {
    uniform_buffer_sized(false, SETTINGS_SIZE)
}

/// Those of a phase: a dynamic offset.
pub(super) fn phase_settings_binding() -> BindGroupLayoutEntryBuilder {
    uniform_buffer_sized(true, SETTINGS_SIZE)
}

/// The settings as they are bound, whichever phase.
pub(super) fn bound_settings(view: &ViewBuffers) -> BindingResource<'_> {
    BindingResource::Buffer(BufferBinding {
        buffer: &view.settings,
        offset: 0,
        size: SETTINGS_SIZE,
    })
}

pub(super) fn init_select_pipelines(
    mut commands: Commands,
    asset_server: Res<AssetServer>,
    cache: Res<PipelineCache>,
) {
    let read = || storage_buffer_read_only_sized(false, None);
    let write = || storage_buffer_sized(false, None);
    let group = |label: &'static str, entries: &[BindGroupLayoutEntry]| {
        BindGroupLayoutDescriptor::new(label, entries)
    };
    let stage = ShaderStages::COMPUTE;
    let counters = storage_buffer_sized(false, NonZeroU64::new(size_of::<GpuCounters>() as u64));
    let common = group(
        "treeline_select",
        &BindGroupLayoutEntries::sequential(
            stage,
            (
                uniform_buffer::<ViewUniform>(true),
                phase_settings_binding(),
                read(),
                write(),
                counters,
            ),
        ),
    );
    let cull = group(
        "treeline_cull",
        &BindGroupLayoutEntries::sequential(stage, (read(), read(), read(), read())),
    );
    let scan =
        group("treeline_scan", &BindGroupLayoutEntries::sequential(stage, (write(), write())));
    let runs = group("treeline_runs", &BindGroupLayoutEntries::single(stage, write()));
    let expand = group(
        "treeline_expand",
        &BindGroupLayoutEntries::sequential(stage, (read(), read(), read(), write(), write())),
    );
    let pipeline = |(entry, path, bindings): (&'static str, &'static str, Bindings), phase| {
        let layout = match bindings {
            Bindings::Cull => vec![common.clone(), cull.clone()],
            Bindings::Scan => vec![common.clone(), scan.clone()],
            Bindings::Emit => vec![common.clone(), cull.clone(), runs.clone()],
            Bindings::Expand => vec![common.clone(), expand.clone()],
        };
        cache.queue_compute_pipeline(ComputePipelineDescriptor {
            label: Some(format!("treeline_{entry}").into()),
            layout,
            shader: asset_server.load(path),
            shader_defs: phase_constants(phase),
            entry_point: Some(entry.into()),
            ..default()
        })
    };
    let passes = [0, 1].map(|phase| PASSES.map(|pass| pipeline(pass, phase)));
    commands.insert_resource(SelectPipelines { common, cull, scan, runs, expand, passes });
}

/// On cameras that draw trees.
#[derive(Component)]
pub(super) struct SelectGroups {
    common: BindGroup,
    cull: BindGroup,
    scan: BindGroup,
    runs: BindGroup,
    expand: BindGroup,
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
    let (Some(pipelines), Some(surfels), Some(trees), Some(uniforms)) =
        (pipelines, &surfels.buffers, &instances.buffer, view_uniforms.uniforms.binding())
    else {
        return;
    };
    let group = |label, layout: &BindGroupLayoutDescriptor, entries: &[BindGroupEntry]| {
        device.create_bind_group(label, &cache.get_bind_group_layout(layout), entries)
    };
    for (entity, view_trees) in &cameras {
        let Some(view) = views.get(view_trees) else { continue };
        let common = group(
            "treeline_select",
            &pipelines.common,
            &BindGroupEntries::sequential((
                uniforms.clone(),
                bound_settings(view),
                instances.blocks.buffer().as_entire_binding(),
                view.view_blocks.as_entire_binding(),
                view.counters.as_entire_binding(),
            )),
        );
        let cull = group(
            "treeline_cull",
            &pipelines.cull,
            &BindGroupEntries::sequential((
                surfels.species.as_entire_binding(),
                surfels.clusters.as_entire_binding(),
                trees.as_entire_binding(),
                view.pyramid.as_entire_binding(),
            )),
        );
        let scan = group(
            "treeline_scan",
            &pipelines.scan,
            &BindGroupEntries::sequential((
                view.args.as_entire_binding(),
                view.runs.as_entire_binding(),
            )),
        );
        let runs = group(
            "treeline_runs",
            &pipelines.runs,
            &BindGroupEntries::single(view.runs.as_entire_binding()),
        );
        let expand = group(
            "treeline_expand",
            &pipelines.expand,
            &BindGroupEntries::sequential((
                surfels.species.as_entire_binding(),
                trees.as_entire_binding(),
                view.runs.as_entire_binding(),
                view.items.as_entire_binding(),
                view.splat_items.as_entire_binding(),
            )),
        );
        commands.entity(entity).insert(SelectGroups { common, cull, scan, runs, expand });
    }
}

/// Workgroups in x and y for `count` workgroups: a side ends at 65,535.
pub(super) fn grid(count: u32) -> (u32, u32) {
    let rows = count.div_ceil(65_535).max(1);
    (count.div_ceil(rows), rows)
}

/// Runs a phase of the selection of a view: what the frame before does not hide, and then what it hid and this frame
/// does not.
pub(super) fn select<const PHASE: u32>(
    view: ViewQuery<(&ViewTrees, &SelectGroups, &ViewUniformOffset)>,
    views: Res<Views>,
    pipelines: Res<SelectPipelines>,
    cache: Res<PipelineCache>,
    mut ctx: RenderContext,
) {
    let (trees, groups, view_offset) = view.into_inner();
    let passes = &pipelines.passes[PHASE as usize];
    let passes: Option<Vec<_>> = passes.iter().map(|id| cache.get_compute_pipeline(*id)).collect();
    let (Some(passes), Some(buffers)) = (passes, views.get(trees)) else { return };
    if PHASE == 1 && !buffers.two_phases {
        return;
    }
    let diagnostics = ctx.diagnostic_recorder();
    let diagnostics = diagnostics.as_deref();
    let encoder = ctx.command_encoder();
    if PHASE == 0 {
        encoder.clear_buffer(&buffers.counters, 0, None);
    }
    let label = if PHASE == 0 { "treeline_select" } else { "treeline_select_second" };
    let mut pass = encoder
        .begin_compute_pass(&ComputePassDescriptor { label: Some(label), timestamp_writes: None });
    let span = diagnostics.pass_span(&mut pass, label);
    pass.set_bind_group(0, &groups.common, &[view_offset.offset, PHASE * PHASE_STRIDE]);
    for ((entry, _, bindings), pipeline) in PASSES.iter().zip(passes) {
        match bindings {
            Bindings::Cull | Bindings::Emit => pass.set_bind_group(1, &groups.cull, &[]),
            Bindings::Scan => pass.set_bind_group(1, &groups.scan, &[]),
            Bindings::Expand => pass.set_bind_group(1, &groups.expand, &[]),
        }
        if let Bindings::Emit = bindings {
            pass.set_bind_group(2, &groups.runs, &[]);
        }
        pass.set_pipeline(pipeline);
        match *entry {
            "cull_blocks" => {
                pass.dispatch_workgroups(buffers.block_count.div_ceil(64), 1, 1);
            }
            "cull_instances" | "emit_runs" => {
                let at = offset_of!(GpuIndirectArgs, cull) as u64;
                pass.dispatch_workgroups_indirect(&buffers.args, at);
            }
            "expand_items" => {
                let at = offset_of!(GpuIndirectArgs, expand) as u64;
                pass.dispatch_workgroups_indirect(&buffers.args, at);
            }
            _ => pass.dispatch_workgroups(1, 1, 1),
        }
    }
    span.end(&mut pass);
}
