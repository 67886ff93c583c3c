//! Selection: which points of which instances a view draws, as work items of up to 64 points.
//!
//! Twice a frame, before and after the depth pyramid: `cull_blocks` → `list_blocks` → `cull_instances` → `size_clusters` →
//! `cull_clusters` → `scan_blocks` → `emit_runs` → `expand_items`, `expand_groves`. Every tree is asked once: what culling finds
//! out stands in a `TreeDraw`, which `emit_runs` and the second phase read. What a work item draws is a run of the surfel pool: a
//! piece of a cluster's list, or samples of a grove; a view's own list or a cut through a hierarchy would emit other runs and
//! nothing after this stage would change.

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

/// A buffer that passes bind besides those of group 0.
#[derive(Clone, Copy, PartialEq)]
enum Bound {
    Args,
    Blocks,
    Clusters,
    Draws,
    Items,
    Looks,
    Places,
    Pyramid,
    Runs,
    Species,
    SplatItems,
    ViewBlocks,
}

/// How often a pass runs.
#[derive(Clone, Copy)]
enum Size {
    /// A workgroup of 64 threads for each 64 blocks of the view.
    Blocks,
    /// One workgroup.
    One,
    /// As an earlier pass has found, at this offset of the arguments.
    Indirect(usize),
}

/// A pass: what it is called, what it binds (group 1; `true`: and writes), how often it runs. With the counters of group 0 none
/// needs more than 8 storage buffers.
struct Pass {
    entry: &'static str,
    shader: &'static str,
    bound: &'static [(Bound, bool)],
    size: Size,
}

const PASS_COUNT: usize = 9;

/// In their order.
const PASSES: [Pass; PASS_COUNT] = [
    Pass {
        entry: "cull_blocks",
        shader: shaders::CULL_BLOCKS,
        bound: &[(Bound::Pyramid, false), (Bound::Blocks, false), (Bound::ViewBlocks, true)],
        size: Size::Blocks,
    },
    Pass {
        entry: "list_blocks",
        shader: shaders::LIST_BLOCKS,
        bound: &[(Bound::Args, true), (Bound::ViewBlocks, true)],
        size: Size::One,
    },
    Pass {
        entry: "cull_instances",
        shader: shaders::CULL_INSTANCES,
        bound: &[
            (Bound::Pyramid, false),
            (Bound::Blocks, false),
            (Bound::ViewBlocks, true),
            (Bound::Species, false),
            (Bound::Places, false),
            (Bound::Looks, false),
            (Bound::Draws, true),
        ],
        size: Size::Indirect(offset_of!(GpuIndirectArgs, cull)),
    },
    Pass {
        entry: "size_clusters",
        shader: shaders::SIZE_CLUSTERS,
        bound: &[(Bound::Args, true)],
        size: Size::One,
    },
    Pass {
        entry: "cull_clusters",
        shader: shaders::CULL_CLUSTERS,
        bound: &[
            (Bound::Pyramid, false),
            (Bound::Clusters, false),
            (Bound::ViewBlocks, true),
            (Bound::Species, false),
            (Bound::Places, false),
            (Bound::Looks, false),
            (Bound::Draws, true),
        ],
        size: Size::Indirect(offset_of!(GpuIndirectArgs, clusters)),
    },
    Pass {
        entry: "scan_blocks",
        shader: shaders::SCAN_BLOCKS,
        bound: &[
            (Bound::Args, true),
            (Bound::ViewBlocks, true),
            (Bound::Runs, true),
            (Bound::Blocks, false),
        ],
        size: Size::One,
    },
    Pass {
        entry: "emit_runs",
        shader: shaders::EMIT_RUNS,
        bound: &[
            (Bound::Runs, true),
            (Bound::Clusters, false),
            (Bound::ViewBlocks, true),
            (Bound::Species, false),
            (Bound::Looks, false),
            (Bound::Draws, false),
            (Bound::Items, true),
        ],
        size: Size::Indirect(offset_of!(GpuIndirectArgs, emit)),
    },
    Pass {
        entry: "expand_items",
        shader: shaders::EXPAND_ITEMS,
        bound: &[
            (Bound::Species, false),
            (Bound::Places, false),
            (Bound::Looks, false),
            (Bound::Runs, false),
            (Bound::Items, true),
            (Bound::SplatItems, true),
        ],
        size: Size::Indirect(offset_of!(GpuIndirectArgs, expand)),
    },
    Pass {
        entry: "expand_groves",
        shader: shaders::EXPAND_GROVES,
        bound: &[
            (Bound::Blocks, false),
            (Bound::Runs, false),
            (Bound::Items, true),
            (Bound::SplatItems, true),
        ],
        size: Size::Indirect(offset_of!(GpuIndirectArgs, expand_groves)),
    },
];

#[derive(Resource)]
pub(super) struct SelectPipelines {
    common: BindGroupLayoutDescriptor,
    /// Group 1 of each pass.
    bound: [BindGroupLayoutDescriptor; PASS_COUNT],
    /// Of each phase.
    passes: [[CachedComputePipelineId; PASS_COUNT]; 2],
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
    let stage = ShaderStages::COMPUTE;
    let counters = storage_buffer_sized(false, NonZeroU64::new(size_of::<GpuCounters>() as u64));
    let common = BindGroupLayoutDescriptor::new(
        "treeline_select",
        &BindGroupLayoutEntries::sequential(
            stage,
            (uniform_buffer::<ViewUniform>(true), phase_settings_binding(), counters),
        ),
    );
    let bound = PASSES.map(|pass| {
        let entries = pass.bound.iter().zip(0..).map(|((_, is_written), binding)| {
            let buffer = match is_written {
                true => storage_buffer_sized(false, None),
                false => storage_buffer_read_only_sized(false, None),
            };
            buffer.build(binding, stage)
        });
        BindGroupLayoutDescriptor::new(pass.entry, &entries.collect::<Vec<_>>())
    });
    let passes = [0, 1].map(|phase| {
        std::array::from_fn(|i| {
            cache.queue_compute_pipeline(ComputePipelineDescriptor {
                label: Some(format!("treeline_{}", PASSES[i].entry).into()),
                layout: vec![common.clone(), bound[i].clone()],
                shader: asset_server.load(PASSES[i].shader),
                shader_defs: phase_constants(phase),
                entry_point: Some(PASSES[i].entry.into()),
                ..default()
            })
        })
    });
    commands.insert_resource(SelectPipelines { common, bound, passes });
}

/// On cameras that draw trees.
#[derive(Component)]
pub(super) struct SelectGroups {
    common: BindGroup,
    /// Group 1 of each pass.
    bound: [BindGroup; PASS_COUNT],
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
        (pipelines, &surfels.buffers, &instances.buffers, view_uniforms.uniforms.binding())
    else {
        return;
    };
    for (entity, view_trees) in &cameras {
        let Some(view) = views.get(view_trees) else { continue };
        let common = device.create_bind_group(
            "treeline_select",
            &cache.get_bind_group_layout(&pipelines.common),
            &BindGroupEntries::sequential((
                uniforms.clone(),
                bound_settings(view),
                view.counters.as_entire_binding(),
            )),
        );
        let buffer = |bound: Bound| match bound {
            Bound::Args => &view.args,
            Bound::Blocks => instances.blocks.buffer(),
            Bound::Clusters => &surfels.clusters,
            Bound::Draws => &view.draws,
            Bound::Items => &view.items,
            Bound::Looks => &trees.looks,
            Bound::Places => &trees.places,
            Bound::Pyramid => &view.pyramid,
            Bound::Runs => &view.runs,
            Bound::Species => &surfels.species,
            Bound::SplatItems => &view.splat_items,
            Bound::ViewBlocks => &view.view_blocks,
        };
        let bound = std::array::from_fn(|i| {
            let entries = PASSES[i].bound.iter().zip(0..).map(|((bound, _), binding)| {
                BindGroupEntry { binding, resource: buffer(*bound).as_entire_binding() }
            });
            device.create_bind_group(
                PASSES[i].entry,
                &cache.get_bind_group_layout(&pipelines.bound[i]),
                &entries.collect::<Vec<_>>(),
            )
        });
        commands.entity(entity).insert(SelectGroups { common, bound });
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
    for ((pipeline, group), Pass { size, .. }) in passes.iter().zip(&groups.bound).zip(&PASSES) {
        pass.set_bind_group(1, group, &[]);
        pass.set_pipeline(pipeline);
        match size {
            Size::Blocks => pass.dispatch_workgroups(buffers.block_count.div_ceil(64), 1, 1),
            Size::One => pass.dispatch_workgroups(1, 1, 1),
            Size::Indirect(at) => pass.dispatch_workgroups_indirect(&buffers.args, *at as u64),
        }
    }
    span.end(&mut pass);
}
