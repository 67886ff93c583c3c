//! Resolve: visibility buffer → lit colour and depth in the main pass, for the blocks of pixels that show points.
//!
//! `classify` → `size_resolve` → `resolve` (a render pass with Bevy's own lighting, shadows, fog and tone mapping); with four
//! samples a pixel, `resolve_edges` after the opaque pass.

mod classify;
mod variant;

pub(super) use classify::{classify, init_classify_pipelines, prepare_classify_groups};

use super::{
    residency::{InstancePool, SurfelPool},
    select::{bound_settings, settings_binding},
    view::{ViewTrees, Views},
};
use crate::{
    forest::{DebugView, TreelineSettings},
    gpu::types::{GpuIndirectArgs, RESOLVE_BLOCK},
    shaders,
};
use bevy::{
    mesh::{
        MeshVertexBufferLayout, MeshVertexBufferLayoutRef, MeshVertexBufferLayouts,
        VertexBufferLayout,
    },
    pbr::{
        ExtractedDirectionalLight, ExtractedPointLight, ExtractedRectLight,
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
pub(super) use variant::Sunlight;
use variant::{ResolveDraw, ResolveKey, SimpleFog};

/// Makes the draw pipeline of each kind of view.
#[derive(Resource, Clone)]
pub(super) struct ResolvePipeline {
    layout: BindGroupLayoutDescriptor,
    shader: Handle<Shader>,
    /// That for four samples a pixel.
    samples_shader: Handle<Shader>,
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
    mesh_pipeline: Res<MeshPipeline>,
) {
    let read = || storage_buffer_read_only_sized(false, None);
    let layout = BindGroupLayoutDescriptor::new(
        "treeline_resolve",
        &BindGroupLayoutEntries::sequential(
            ShaderStages::FRAGMENT,
            (
                read(),
                read(),
                read(),
                read(),
                read(),
                // Covered blocks: corners of quads, and nothing else.
                read().visibility(ShaderStages::VERTEX),
                read(),
                read(),
                read(),
                settings_binding().visibility(ShaderStages::VERTEX_FRAGMENT),
            ),
        ),
    );
    let no_vertices = VertexBufferLayout {
        array_stride: 0,
        step_mode: VertexStepMode::Vertex,
        attributes: vec![],
    };
    commands.insert_resource(ResolvePipeline {
        layout,
        shader: asset_server.load(shaders::RESOLVE),
        samples_shader: asset_server.load(shaders::RESOLVE_SAMPLES),
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
        let (label, shader, vertex_entry, entry) = match key.draw {
            ResolveDraw::Pixels => ("treeline_resolve", &self.shader, "resolve_vertex", "resolve"),
            ResolveDraw::Samples | ResolveDraw::Edges => (
                if key.draw == ResolveDraw::Edges {
                    "treeline_resolve_edges"
                } else {
                    "treeline_resolve"
                },
                &self.samples_shader,
                "resolve_samples_vertex",
                "resolve_samples",
            ),
        };
        descriptor.label = Some(label.into());
        descriptor.layout.truncate(2);
        descriptor.layout.push(self.layout.clone());
        descriptor.primitive = PrimitiveState::default();
        let defs = [
            ShaderDefVal::UInt("MATERIAL_BIND_GROUP".into(), MATERIAL_BIND_GROUP_INDEX as u32),
            block_constant(),
        ];
        descriptor.vertex.buffers.clear();
        descriptor.vertex.shader = shader.clone();
        descriptor.vertex.entry_point = Some(vertex_entry.into());
        descriptor.vertex.shader_defs.extend(defs.clone());
        if let Some(fragment) = &mut descriptor.fragment {
            fragment.shader = shader.clone();
            fragment.entry_point = Some(entry.into());
            fragment.shader_defs.extend(defs);
            fragment.shader_defs.extend(key.shader_defs());
            if key.draw == ResolveDraw::Edges {
                for target in fragment.targets.iter_mut().flatten() {
                    target.blend = Some(BlendState::PREMULTIPLIED_ALPHA_BLENDING);
                }
            }
        }
        if let Some(depth) = &mut descriptor.depth_stencil {
            depth.depth_write_enabled = Some(key.draw != ResolveDraw::Edges);
            depth.depth_compare = Some(CompareFunction::GreaterEqual);
        }
        descriptor
    }
}

#[expect(
    clippy::too_many_arguments,
    clippy::type_complexity,
    reason = "a system's parameters are its dependencies"
)]
pub(super) fn specialize_resolve(
    mut commands: Commands,
    cameras: Query<
        (Entity, &ExtractedView, Option<&DistanceFog>, Option<&TreelineSettings>),
        (With<ExtractedCamera>, With<Camera3d>),
    >,
    view_keys: Res<ViewKeyCache>,
    suns: Query<&ExtractedDirectionalLight>,
    lamps: Query<(), Or<(With<ExtractedPointLight>, With<ExtractedRectLight>)>>,
    pipeline: Option<Res<ResolvePipeline>>,
    mut specialized: ResMut<SpecializedRenderPipelines<ResolvePipeline>>,
    cache: Res<PipelineCache>,
) {
    let Some(pipeline) = pipeline else { return };
    let (lamps, shadows) = (!lamps.is_empty(), suns.iter().any(|sun| sun.shadow_maps_enabled));
    for (entity, view, fog, settings) in &cameras {
        let Some(&key) = view_keys.get(&view.retained_view_entity) else { continue };
        let topology = MeshPipelineKey::from_primitive_topology_and_strip_index(
            PrimitiveTopology::TriangleList,
            None,
        );
        let mut pipeline_of = |draw| {
            let (mesh, fog) = (key | topology, SimpleFog::of(fog));
            let sunlight = Sunlight::of(mesh, lamps, shadows);
            let debug_view = debug_view(settings);
            let contrast = has_contrast(settings);
            let key = ResolveKey { mesh, fog, debug_view, draw, sunlight, contrast };
            specialized.specialize(&cache, &pipeline, key)
        };
        let pipelines = if settings.is_some_and(|settings| settings.samples > 1) {
            ViewResolvePipelines {
                opaque: pipeline_of(ResolveDraw::Samples),
                edges: Some(pipeline_of(ResolveDraw::Edges)),
            }
        } else {
            ViewResolvePipelines { opaque: pipeline_of(ResolveDraw::Pixels), edges: None }
        };
        commands.entity(entity).insert(pipelines);
    }
}

/// The draws of a camera.
#[derive(Component)]
pub(super) struct ViewResolvePipelines {
    /// Before the opaque pass.
    opaque: CachedRenderPipelineId,
    /// After it.
    edges: Option<CachedRenderPipelineId>,
}

fn debug_view(settings: Option<&TreelineSettings>) -> DebugView {
    settings.map_or(DebugView::Off, |settings| settings.debug_view)
}

fn has_contrast(settings: Option<&TreelineSettings>) -> bool {
    let (settings, _) = settings.cloned().unwrap_or_default().clamped();
    settings.contrast > 0.0
}

/// On cameras that draw trees.
#[derive(Component)]
pub(super) struct ResolveGroup(BindGroup);

#[expect(clippy::too_many_arguments, reason = "a system's parameters are its dependencies")]
pub(super) fn prepare_resolve_group(
    mut commands: Commands,
    cameras: Query<(Entity, &ViewTrees)>,
    views: Res<Views>,
    resolve: Option<Res<ResolvePipeline>>,
    surfels: Res<SurfelPool>,
    instances: Res<InstancePool>,
    cache: Res<PipelineCache>,
    device: Res<RenderDevice>,
) {
    let (Some(resolve), Some(surfels), Some(buffers)) =
        (resolve, &surfels.buffers, &instances.buffers)
    else {
        return;
    };
    for (entity, trees) in &cameras {
        let Some(view) = views.get(trees) else { continue };
        let group = device.create_bind_group(
            "treeline_resolve",
            &cache.get_bind_group_layout(&resolve.layout),
            &BindGroupEntries::sequential((
                buffers.looks.as_entire_binding(),
                view.items.as_entire_binding(),
                surfels.hot.as_entire_binding(),
                surfels.cold.as_entire_binding(),
                view.visibility.as_entire_binding(),
                view.blocks.as_entire_binding(),
                surfels.species.as_entire_binding(),
                instances.samples().as_entire_binding(),
                buffers.places.as_entire_binding(),
                bound_settings(view),
            )),
        );
        commands.entity(entity).insert(ResolveGroup(group));
    }
}

/// What drawing the points of a view takes.
type ResolveView<'a> = (
    &'a ExtractedCamera,
    &'a ViewTarget,
    &'a ViewDepthTexture,
    &'a MeshViewBindGroup,
    &'a ViewResolvePipelines,
    &'a ViewTrees,
    &'a ResolveGroup,
);

/// Draws the points of a view into its colour and depth: before the opaque pass.
pub(super) fn resolve(
    view: ViewQuery<ResolveView<'static>>,
    views: Res<Views>,
    cache: Res<PipelineCache>,
    mut ctx: RenderContext,
) {
    let view = view.into_inner();
    let pipeline = Some(view.4.opaque);
    draw(view, pipeline, "treeline_resolve", &views, &cache, &mut ctx);
}

/// Draws pixels that points cover in part, where there are four samples: over what the opaque pass drew.
pub(super) fn resolve_edges(
    view: ViewQuery<ResolveView<'static>>,
    views: Res<Views>,
    cache: Res<PipelineCache>,
    mut ctx: RenderContext,
) {
    let view = view.into_inner();
    let pipeline = view.4.edges;
    draw(view, pipeline, "treeline_resolve_edges", &views, &cache, &mut ctx);
}

fn draw(
    (camera, target, depth, mesh_view, _, trees, ResolveGroup(group)): ResolveView,
    pipeline: Option<CachedRenderPipelineId>,
    label: &'static str,
    views: &Views,
    cache: &PipelineCache,
    ctx: &mut RenderContext,
) {
    let (Some(pipeline), Some(buffers)) =
        (pipeline.and_then(|id| cache.get_render_pipeline(id)), views.get(trees))
    else {
        return;
    };
    let diagnostics = ctx.diagnostic_recorder();
    let diagnostics = diagnostics.as_deref();
    let mut pass = ctx.begin_tracked_render_pass(RenderPassDescriptor {
        label: Some(label),
        color_attachments: &[Some(target.get_color_attachment())],
        depth_stencil_attachment: Some(depth.get_attachment(StoreOp::Store)),
        ..default()
    });
    let span = diagnostics.pass_span(&mut pass, label);
    if let Some(viewport) = &camera.viewport {
        pass.set_camera_viewport(viewport);
    }
    pass.set_render_pipeline(pipeline);
    pass.set_bind_group(0, &mesh_view.main, &mesh_view.main_offsets);
    pass.set_bind_group(1, &mesh_view.binding_array, &[]);
    pass.set_bind_group(2, group, &[]);
    pass.draw_indirect(&buffers.args, std::mem::offset_of!(GpuIndirectArgs, resolve) as u64);
    span.end(&mut pass);
}
