//! Resolve: visibility buffer → lit colour and depth in the main pass, for the blocks of pixels that show points.
//!
//! `classify` → `size_resolve` → `resolve` (a render pass with Bevy's own lighting, shadows, fog and tone mapping).

mod variant;

use super::{
    residency::{InstancePool, SurfelPool},
    select::{grid, settings_binding},
    view::{ViewResolvePipeline, ViewTrees, Views},
};
use crate::{
    forest::{DebugView, TreelineSettings},
    gpu::types::{GpuCounters, RESOLVE_BLOCK},
    shaders,
};
use bevy::{
    mesh::{
        MeshVertexBufferLayout, MeshVertexBufferLayoutRef, MeshVertexBufferLayouts,
        VertexBufferLayout,
    },
    pbr::{
        MATERIAL_BIND_GROUP_INDEX, MeshPipeline, MeshPipelineKey, MeshViewBindGroup, ViewKeyCache,
    },
    prelude::*,
    render::{
        camera::ExtractedCamera,
        diagnostic::RecordDiagnostics,
        render_resource::{binding_types::*, *},
        renderer::{RenderContext, RenderDevice, ViewQuery},
        view::{ExtractedView, ViewDepthTexture, ViewTarget},
    },
    shader::ShaderDefVal,
};
use std::num::NonZeroU64;
use variant::{ResolveKey, SimpleFog};

/// Compute pipelines before the draw.
#[derive(Resource)]
pub(super) struct ClassifyPipelines {
    layout: BindGroupLayoutDescriptor,
    size_layout: BindGroupLayoutDescriptor,
    classify: CachedComputePipelineId,
    size_resolve: CachedComputePipelineId,
}

/// Makes the draw pipeline of each kind of view.
#[derive(Resource, Clone)]
pub(super) struct ResolvePipeline {
    layout: BindGroupLayoutDescriptor,
    /// With what debug views read besides.
    debug_layout: BindGroupLayoutDescriptor,
    shader: Handle<Shader>,
    mesh_pipeline: MeshPipeline,
    empty_mesh_layout: MeshVertexBufferLayoutRef,
}

/// Side of a block, for shaders.
pub(super) fn block_constant() -> ShaderDefVal {
    ShaderDefVal::UInt("RESOLVE_BLOCK".into(), RESOLVE_BLOCK)
}

pub(super) fn init_resolve_pipelines(
    mut commands: Commands,
    asset_server: Res<AssetServer>,
    cache: Res<PipelineCache>,
    mesh_pipeline: Res<MeshPipeline>,
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
    let layout = BindGroupLayoutDescriptor::new(
        "treeline_resolve",
        &BindGroupLayoutEntries::sequential(
            ShaderStages::VERTEX_FRAGMENT,
            (read(), read(), read(), read(), read(), read()),
        ),
    );
    let debug_layout = BindGroupLayoutDescriptor::new(
        "treeline_resolve_debug",
        &BindGroupLayoutEntries::sequential(
            ShaderStages::VERTEX_FRAGMENT,
            (read(), read(), read(), read(), read(), read(), read(), settings_binding()),
        ),
    );
    let no_vertices = VertexBufferLayout {
        array_stride: 0,
        step_mode: VertexStepMode::Vertex,
        attributes: vec![],
    };
    commands.insert_resource(ResolvePipeline {
        layout,
        debug_layout,
        shader: asset_server.load(shaders::RESOLVE),
        mesh_pipeline: mesh_pipeline.clone(),
        empty_mesh_layout: MeshVertexBufferLayouts::default()
            .insert(MeshVertexBufferLayout::new(vec![], no_vertices)),
    });
}

impl SpecializedRenderPipeline for ResolvePipeline {
    type Key = ResolveKey;

    fn specialize(&self, key: ResolveKey) -> RenderPipelineDescriptor {
        // Bevy's own descriptor brings the view layouts, every shader def of the view, sample count and format.
        let mut descriptor = self
            .mesh_pipeline
            .specialize(key.mesh, &self.empty_mesh_layout)
            .expect("no vertex attribute is asked for, so none can be missing");
        descriptor.label = Some("treeline_resolve".into());
        descriptor.layout.truncate(2);
        descriptor.layout.push(match key.debug_view {
            DebugView::Off => self.layout.clone(),
            _ => self.debug_layout.clone(),
        });
        descriptor.primitive = PrimitiveState::default();
        let defs = [
            ShaderDefVal::UInt("MATERIAL_BIND_GROUP".into(), MATERIAL_BIND_GROUP_INDEX as u32),
            block_constant(),
        ];
        descriptor.vertex.buffers.clear();
        descriptor.vertex.shader = self.shader.clone();
        descriptor.vertex.entry_point = Some("resolve_vertex".into());
        descriptor.vertex.shader_defs.extend(defs.clone());
        if let Some(fragment) = &mut descriptor.fragment {
            fragment.shader = self.shader.clone();
            fragment.entry_point = Some("resolve".into());
            fragment.shader_defs.extend(defs);
            fragment.shader_defs.extend(key.shader_defs());
        }
        if let Some(depth) = &mut descriptor.depth_stencil {
            depth.depth_write_enabled = Some(true);
            depth.depth_compare = Some(CompareFunction::GreaterEqual);
        }
        descriptor
    }
}

#[expect(clippy::type_complexity, reason = "a query is its type")]
pub(super) fn specialize_resolve(
    mut commands: Commands,
    cameras: Query<
        (Entity, &ExtractedView, Option<&DistanceFog>, Option<&TreelineSettings>),
        (With<ExtractedCamera>, With<Camera3d>),
    >,
    view_keys: Res<ViewKeyCache>,
    pipeline: Option<Res<ResolvePipeline>>,
    mut specialized: ResMut<SpecializedRenderPipelines<ResolvePipeline>>,
    cache: Res<PipelineCache>,
) {
    let Some(pipeline) = pipeline else { return };
    for (entity, view, fog, settings) in &cameras {
        let Some(&key) = view_keys.get(&view.retained_view_entity) else { continue };
        let topology = MeshPipelineKey::from_primitive_topology_and_strip_index(
            PrimitiveTopology::TriangleList,
            None,
        );
        let key = ResolveKey {
            mesh: key | topology,
            fog: SimpleFog::of(fog),
            debug_view: debug_view(settings),
        };
        let id = specialized.specialize(&cache, &pipeline, key);
        commands.entity(entity).insert(ViewResolvePipeline(id));
    }
}

fn debug_view(settings: Option<&TreelineSettings>) -> DebugView {
    settings.map_or(DebugView::Off, |settings| settings.debug_view)
}

/// On cameras that draw trees.
#[derive(Component)]
pub(super) struct ResolveGroups {
    classify: BindGroup,
    size: BindGroup,
    resolve: BindGroup,
}

#[expect(clippy::too_many_arguments, reason = "a system's parameters are its dependencies")]
pub(super) fn prepare_resolve_groups(
    mut commands: Commands,
    cameras: Query<(Entity, &ViewTrees, Option<&TreelineSettings>)>,
    views: Res<Views>,
    classify: Option<Res<ClassifyPipelines>>,
    resolve: Option<Res<ResolvePipeline>>,
    surfels: Res<SurfelPool>,
    instances: Res<InstancePool>,
    cache: Res<PipelineCache>,
    device: Res<RenderDevice>,
) {
    let (Some(classify), Some(resolve), Some(surfels), Some(instances)) =
        (classify, resolve, &surfels.buffers, &instances.buffer)
    else {
        return;
    };
    for (entity, trees, settings) in &cameras {
        let Some(view) = views.get(trees) else { continue };
        let classify_group = device.create_bind_group(
            "treeline_classify",
            &cache.get_bind_group_layout(&classify.layout),
            &BindGroupEntries::sequential((
                view.settings.as_entire_binding(),
                view.visibility.as_entire_binding(),
                view.blocks.as_entire_binding(),
                view.counters.as_entire_binding(),
            )),
        );
        let size = device.create_bind_group(
            "treeline_size_resolve",
            &cache.get_bind_group_layout(&classify.size_layout),
            &BindGroupEntries::sequential((
                view.counters.as_entire_binding(),
                view.args.as_entire_binding(),
            )),
        );
        let drawn = [
            instances.as_entire_binding(),
            view.items.as_entire_binding(),
            surfels.hot.as_entire_binding(),
            surfels.cold.as_entire_binding(),
            view.visibility.as_entire_binding(),
            view.blocks.as_entire_binding(),
        ];
        let debugged = [surfels.species.as_entire_binding(), view.settings.as_entire_binding()];
        let (layout, debugged) = match debug_view(settings) {
            DebugView::Off => (&resolve.layout, None),
            _ => (&resolve.debug_layout, Some(debugged)),
        };
        let entries: Vec<BindGroupEntry> = drawn
            .into_iter()
            .chain(debugged.into_iter().flatten())
            .zip(0..)
            .map(|(resource, binding)| BindGroupEntry { binding, resource })
            .collect();
        let group = device.create_bind_group(
            "treeline_resolve",
            &cache.get_bind_group_layout(layout),
            &entries[..],
        );
        commands.entity(entity).insert(ResolveGroups {
            classify: classify_group,
            size,
            resolve: group,
        });
    }
}

/// Lists the blocks that show points.
pub(super) fn classify(
    view: ViewQuery<(&ViewTrees, &ResolveGroups)>,
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

/// Draws the points of a view into its colour and depth.
pub(super) fn resolve(
    view: ViewQuery<(
        &ExtractedCamera,
        &ViewTarget,
        &ViewDepthTexture,
        &MeshViewBindGroup,
        &ViewResolvePipeline,
        &ViewTrees,
        &ResolveGroups,
    )>,
    views: Res<Views>,
    cache: Res<PipelineCache>,
    mut ctx: RenderContext,
) {
    let (camera, target, depth, mesh_view, pipeline, trees, groups) = view.into_inner();
    let (Some(pipeline), Some(buffers)) = (cache.get_render_pipeline(pipeline.0), views.get(trees))
    else {
        return;
    };
    let diagnostics = ctx.diagnostic_recorder();
    let diagnostics = diagnostics.as_deref();
    let mut pass = ctx.begin_tracked_render_pass(RenderPassDescriptor {
        label: Some("treeline_resolve"),
        color_attachments: &[Some(target.get_color_attachment())],
        depth_stencil_attachment: Some(depth.get_attachment(StoreOp::Store)),
        ..default()
    });
    let span = diagnostics.pass_span(&mut pass, "treeline_resolve");
    if let Some(viewport) = &camera.viewport {
        pass.set_camera_viewport(viewport);
    }
    pass.set_render_pipeline(pipeline);
    pass.set_bind_group(0, &mesh_view.main, &mesh_view.main_offsets);
    pass.set_bind_group(1, &mesh_view.binding_array, &[]);
    pass.set_bind_group(2, &groups.resolve, &[]);
    pass.draw_indirect(
        &buffers.args,
        std::mem::offset_of!(crate::gpu::types::GpuIndirectArgs, resolve) as u64,
    );
    span.end(&mut pass);
}
