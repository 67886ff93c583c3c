//! What Bevy's prepass holds of meshes, for points: depth, normals and motion vectors, for cameras that have them.
//!
//! In: the visibility buffer and its covered blocks. Out: the camera's prepass textures, so that temporal antialiasing,
//! motion blur, ambient occlusion and depth of field see points. Trees that move have the camera's motion only. Cost:
//! nothing without a prepass; else covered blocks.

use super::{
    residency::{InstancePool, SurfelPool},
    resolve::block_constant,
    view::{ViewTrees, Views},
};
use crate::{forest::TreelineSettings, gpu::types::GpuIndirectArgs, shaders};
use bevy::{
    core_pipeline::{
        core_3d::CORE_3D_DEPTH_FORMAT,
        prepass::{
            DepthPrepass, MotionVectorPrepass, NormalPrepass, PreviousViewData,
            PreviousViewUniformOffset, PreviousViewUniforms, ViewPrepassTextures,
            prepass_target_descriptors,
        },
    },
    prelude::*,
    render::{
        camera::ExtractedCamera,
        diagnostic::RecordDiagnostics,
        render_resource::{binding_types::*, *},
        renderer::{RenderContext, RenderDevice, ViewQuery},
        view::{Msaa, ViewDepthTexture, ViewUniform, ViewUniformOffset, ViewUniforms},
    },
    shader::ShaderDefVal,
};

/// What these pipelines differ in.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) struct PrepassKey {
    normals: bool,
    motion: bool,
    /// Of the camera.
    msaa: u32,
    /// Of the visibility buffer, along a side of a pixel.
    samples_per_side: u32,
}

/// Makes the pipeline of each kind of view.
#[derive(Resource)]
pub(super) struct PrepassPipeline {
    view_layout: BindGroupLayoutDescriptor,
    /// Visibility and blocks.
    layout: BindGroupLayoutDescriptor,
    /// And what normals are read from.
    normal_layout: BindGroupLayoutDescriptor,
    shader: Handle<Shader>,
}

/// On cameras with a prepass.
#[derive(Component)]
pub(super) struct ViewPrepassPipeline {
    id: CachedRenderPipelineId,
    normals: bool,
}

/// On cameras that draw trees and have a prepass.
#[derive(Component)]
pub(super) struct PrepassGroups {
    view: BindGroup,
    points: BindGroup,
}

pub(super) fn init_prepass_pipeline(mut commands: Commands, asset_server: Res<AssetServer>) {
    let read = || storage_buffer_read_only_sized(false, None);
    let stages = ShaderStages::VERTEX_FRAGMENT;
    commands.insert_resource(PrepassPipeline {
        view_layout: BindGroupLayoutDescriptor::new(
            "treeline_prepass_view",
            &BindGroupLayoutEntries::sequential(
                stages,
                (uniform_buffer::<ViewUniform>(true), uniform_buffer::<PreviousViewData>(true)),
            ),
        ),
        layout: BindGroupLayoutDescriptor::new(
            "treeline_prepass",
            &BindGroupLayoutEntries::sequential(stages, (read(), read())),
        ),
        normal_layout: BindGroupLayoutDescriptor::new(
            "treeline_prepass_normals",
            &BindGroupLayoutEntries::sequential(
                stages,
                (read(), read(), read(), read(), read(), read(), read(), read()),
            ),
        ),
        shader: asset_server.load(shaders::WRITE_PREPASS),
    });
}

impl PrepassPipeline {
    fn points_layout(&self, normals: bool) -> &BindGroupLayoutDescriptor {
        if normals { &self.normal_layout } else { &self.layout }
    }
}

impl SpecializedRenderPipeline for PrepassPipeline {
    type Key = PrepassKey;

    fn specialize(&self, key: PrepassKey) -> RenderPipelineDescriptor {
        let mut shader_defs = vec![
            block_constant(),
            ShaderDefVal::UInt("SAMPLES_PER_SIDE".into(), key.samples_per_side),
        ];
        shader_defs.extend(key.normals.then(|| "NORMAL_PREPASS".into()));
        shader_defs.extend(key.motion.then(|| "MOTION_VECTOR_PREPASS".into()));
        let mut targets = prepass_target_descriptors(key.normals, key.motion, false);
        if targets.iter().all(Option::is_none) {
            targets.clear();
        }
        RenderPipelineDescriptor {
            label: Some("treeline_prepass".into()),
            layout: vec![self.view_layout.clone(), self.points_layout(key.normals).clone()],
            vertex: VertexState {
                shader: self.shader.clone(),
                shader_defs: shader_defs.clone(),
                entry_point: Some("write_prepass_vertex".into()),
                ..default()
            },
            fragment: Some(FragmentState {
                shader: self.shader.clone(),
                shader_defs,
                entry_point: Some("write_prepass".into()),
                targets,
            }),
            depth_stencil: Some(DepthStencilState {
                format: CORE_3D_DEPTH_FORMAT,
                depth_write_enabled: Some(true),
                depth_compare: Some(CompareFunction::GreaterEqual),
                stencil: default(),
                bias: default(),
            }),
            multisample: MultisampleState { count: key.msaa, ..default() },
            ..default()
        }
    }
}

#[expect(clippy::type_complexity, reason = "a query is its type")]
pub(super) fn specialize_prepass(
    mut commands: Commands,
    cameras: Query<
        (
            Entity,
            &Msaa,
            Option<&TreelineSettings>,
            Has<DepthPrepass>,
            Has<NormalPrepass>,
            Has<MotionVectorPrepass>,
        ),
        (With<ExtractedCamera>, With<Camera3d>),
    >,
    pipeline: Option<Res<PrepassPipeline>>,
    mut specialized: ResMut<SpecializedRenderPipelines<PrepassPipeline>>,
    cache: Res<PipelineCache>,
) {
    let Some(pipeline) = pipeline else { return };
    for (entity, msaa, settings, depth, normals, motion) in &cameras {
        if !(depth || normals || motion) {
            commands.entity(entity).remove::<(ViewPrepassPipeline, PrepassGroups)>();
            continue;
        }
        let has_samples = settings.is_some_and(|settings| settings.samples > 1);
        let samples_per_side = if has_samples { 2 } else { 1 };
        let key = PrepassKey { normals, motion, msaa: msaa.samples(), samples_per_side };
        let id = specialized.specialize(&cache, &pipeline, key);
        commands.entity(entity).insert(ViewPrepassPipeline { id, normals });
    }
}

#[expect(clippy::too_many_arguments, reason = "a system's parameters are its dependencies")]
pub(super) fn prepare_prepass_groups(
    mut commands: Commands,
    cameras: Query<(Entity, &ViewTrees, &ViewPrepassPipeline)>,
    views: Res<Views>,
    pipeline: Option<Res<PrepassPipeline>>,
    surfels: Res<SurfelPool>,
    instances: Res<InstancePool>,
    view_uniforms: Res<ViewUniforms>,
    previous_views: Res<PreviousViewUniforms>,
    cache: Res<PipelineCache>,
    device: Res<RenderDevice>,
) {
    let (Some(pipeline), Some(surfels), Some(buffers)) =
        (pipeline, &surfels.buffers, &instances.buffers)
    else {
        return;
    };
    let (Some(now), Some(before)) =
        (view_uniforms.uniforms.binding(), previous_views.uniforms.binding())
    else {
        return;
    };
    for (entity, trees, ViewPrepassPipeline { normals, .. }) in &cameras {
        let Some(view) = views.get(trees) else { continue };
        let view_group = device.create_bind_group(
            "treeline_prepass_view",
            &cache.get_bind_group_layout(&pipeline.view_layout),
            &BindGroupEntries::sequential((now.clone(), before.clone())),
        );
        let bound = [
            &view.visibility,
            &view.blocks,
            &buffers.looks,
            &view.items,
            &surfels.hot,
            &surfels.cold,
            &surfels.species,
            instances.samples(),
        ];
        let used = if *normals { &bound[..] } else { &bound[..2] };
        let entries: Vec<BindGroupEntry> = (0..)
            .zip(used)
            .map(|(binding, buffer)| BindGroupEntry {
                binding,
                resource: buffer.as_entire_binding(),
            })
            .collect();
        let points = device.create_bind_group(
            "treeline_prepass",
            &cache.get_bind_group_layout(pipeline.points_layout(*normals)),
            &entries[..],
        );
        commands.entity(entity).insert(PrepassGroups { view: view_group, points });
    }
}

/// Writes the points of a view into its prepass textures.
#[expect(clippy::type_complexity, reason = "a query is its type")]
pub(super) fn write_prepass(
    view: ViewQuery<(
        &ExtractedCamera,
        &ViewDepthTexture,
        &ViewPrepassTextures,
        &ViewUniformOffset,
        &PreviousViewUniformOffset,
        &ViewPrepassPipeline,
        &ViewTrees,
        &PrepassGroups,
    )>,
    views: Res<Views>,
    cache: Res<PipelineCache>,
    mut ctx: RenderContext,
) {
    let (camera, depth, textures, now, before, pipeline, trees, groups) = view.into_inner();
    let (Some(pipeline), Some(buffers)) =
        (cache.get_render_pipeline(pipeline.id), views.get(trees))
    else {
        return;
    };
    let mut colors = vec![
        textures.normal.as_ref().map(|texture| texture.get_attachment()),
        textures.motion_vectors.as_ref().map(|texture| texture.get_attachment()),
        None,
        None,
    ];
    if colors.iter().all(Option::is_none) {
        colors.clear();
    }
    // The prepass depth is a copy of the view's, made before there were points; resolve writes the view's own.
    let depth = match &textures.depth {
        Some(copy) => RenderPassDepthStencilAttachment {
            view: &copy.texture.default_view,
            depth_ops: Some(Operations { load: LoadOp::Load, store: StoreOp::Store }),
            stencil_ops: None,
        },
        None => depth.get_attachment(StoreOp::Store),
    };
    let diagnostics = ctx.diagnostic_recorder();
    let diagnostics = diagnostics.as_deref();
    let mut pass = ctx.begin_tracked_render_pass(RenderPassDescriptor {
        label: Some("treeline_prepass"),
        color_attachments: &colors,
        depth_stencil_attachment: Some(depth),
        ..default()
    });
    let span = diagnostics.pass_span(&mut pass, "treeline_prepass");
    if let Some(viewport) = &camera.viewport {
        pass.set_camera_viewport(viewport);
    }
    pass.set_render_pipeline(pipeline);
    pass.set_bind_group(0, &groups.view, &[now.offset, before.offset]);
    pass.set_bind_group(1, &groups.points, &[]);
    pass.draw_indirect(&buffers.args, std::mem::offset_of!(GpuIndirectArgs, resolve) as u64);
    span.end(&mut pass);
}
