//! The pass that blends a frame with its past.

use super::{
    TreelineTaa,
    history::{COLOR_FORMAT, DEPTH_FORMAT, Histories},
};
use crate::{gpu::types::GpuTemporalSettings, shaders};
use bevy::{
    core_pipeline::{
        FullscreenShader,
        prepass::{
            PreviousViewData, PreviousViewUniformOffset, PreviousViewUniforms, ViewPrepassTextures,
        },
    },
    prelude::*,
    render::{
        camera::ExtractedCamera,
        diagnostic::RecordDiagnostics,
        render_resource::{binding_types::*, *},
        renderer::{RenderContext, RenderDevice, ViewQuery},
        view::{ExtractedView, Msaa, ViewTarget, ViewUniform, ViewUniformOffset, ViewUniforms},
    },
};
use std::num::NonZeroU64;

/// Makes the pipeline of each kind of target.
#[derive(Resource)]
pub(in crate::render) struct AccumulatePipeline {
    layout: BindGroupLayoutDescriptor,
    sampler: Sampler,
    vertex: VertexState,
    shader: Handle<Shader>,
}

/// What these pipelines differ in.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(in crate::render) struct AccumulateKey {
    format: TextureFormat,
    hdr: bool,
}

/// The pipeline of a camera.
#[derive(Component)]
pub(in crate::render) struct ViewAccumulatePipeline(CachedRenderPipelineId);

pub(in crate::render) fn init_accumulate_pipeline(
    mut commands: Commands,
    asset_server: Res<AssetServer>,
    device: Res<RenderDevice>,
    fullscreen: Res<FullscreenShader>,
) {
    let filtered = || texture_2d(TextureSampleType::Float { filterable: true });
    let plain = || texture_2d(TextureSampleType::Float { filterable: false });
    commands.insert_resource(AccumulatePipeline {
        layout: BindGroupLayoutDescriptor::new(
            "treeline_accumulate",
            &BindGroupLayoutEntries::sequential(
                ShaderStages::FRAGMENT,
                (
                    uniform_buffer::<ViewUniform>(true),
                    uniform_buffer::<PreviousViewData>(true),
                    uniform_buffer_sized(
                        false,
                        NonZeroU64::new(size_of::<GpuTemporalSettings>() as u64),
                    ),
                    plain(),
                    plain(),
                    texture_depth_2d(),
                    filtered(),
                    plain(),
                    sampler(SamplerBindingType::Filtering),
                ),
            ),
        ),
        sampler: device.create_sampler(&SamplerDescriptor {
            label: Some("treeline_history"),
            mag_filter: FilterMode::Linear,
            min_filter: FilterMode::Linear,
            ..default()
        }),
        vertex: fullscreen.to_vertex_state(),
        shader: asset_server.load(shaders::ACCUMULATE),
    });
}

impl SpecializedRenderPipeline for AccumulatePipeline {
    type Key = AccumulateKey;

    fn specialize(&self, key: AccumulateKey) -> RenderPipelineDescriptor {
        let target =
            |format| Some(ColorTargetState { format, blend: None, write_mask: ColorWrites::ALL });
        RenderPipelineDescriptor {
            label: Some("treeline_accumulate".into()),
            layout: vec![self.layout.clone()],
            vertex: self.vertex.clone(),
            fragment: Some(FragmentState {
                shader: self.shader.clone(),
                shader_defs: key.hdr.then(|| "HIGH_DYNAMIC_RANGE".into()).into_iter().collect(),
                entry_point: Some("accumulate".into()),
                targets: vec![target(key.format), target(COLOR_FORMAT), target(DEPTH_FORMAT)],
            }),
            ..default()
        }
    }
}

pub(in crate::render) fn specialize_accumulate(
    mut commands: Commands,
    cameras: Query<(Entity, &ExtractedView, &ExtractedCamera), With<TreelineTaa>>,
    pipeline: Option<Res<AccumulatePipeline>>,
    mut specialized: ResMut<SpecializedRenderPipelines<AccumulatePipeline>>,
    cache: Res<PipelineCache>,
) {
    let Some(pipeline) = pipeline else { return };
    for (entity, view, camera) in &cameras {
        let key = AccumulateKey { format: view.target_format, hdr: camera.hdr };
        let id = specialized.specialize(&cache, &pipeline, key);
        commands.entity(entity).insert(ViewAccumulatePipeline(id));
    }
}

/// Blends the picture of a view with its past.
#[expect(clippy::type_complexity, reason = "a query is its type")]
#[expect(clippy::too_many_arguments, reason = "a system's parameters are its dependencies")]
pub(in crate::render) fn accumulate(
    view: ViewQuery<
        (
            &ExtractedView,
            &ExtractedCamera,
            &ViewTarget,
            &ViewPrepassTextures,
            &ViewUniformOffset,
            &PreviousViewUniformOffset,
            &ViewAccumulatePipeline,
            &Msaa,
        ),
        With<TreelineTaa>,
    >,
    histories: Res<Histories>,
    pipelines: Res<AccumulatePipeline>,
    view_uniforms: Res<ViewUniforms>,
    previous_views: Res<PreviousViewUniforms>,
    cache: Res<PipelineCache>,
    device: Res<RenderDevice>,
    mut ctx: RenderContext,
) {
    let (view, camera, target, prepass, now, before, pipeline, msaa) = view.into_inner();
    if *msaa != Msaa::Off {
        warn_once!("TreelineTaa does nothing on a camera with MSAA: give it `Msaa::Off`");
        return;
    }
    let (Some(pipeline), Some(history), Some(motion), Some(depth)) = (
        cache.get_render_pipeline(pipeline.0),
        histories.0.get(&view.retained_view_entity),
        prepass.motion_vectors_view(),
        prepass.depth_view(),
    ) else {
        return;
    };
    let (Some(view_binding), Some(previous_binding)) =
        (view_uniforms.uniforms.binding(), previous_views.uniforms.binding())
    else {
        return;
    };
    let (past, present) = (history.past(), history.present());
    let post_process = target.post_process_write();
    let group = device.create_bind_group(
        "treeline_accumulate",
        &cache.get_bind_group_layout(&pipelines.layout),
        &BindGroupEntries::sequential((
            view_binding,
            previous_binding,
            history.settings.as_entire_binding(),
            post_process.source,
            motion,
            depth,
            &past.color,
            &past.depth,
            &pipelines.sampler,
        )),
    );
    let attachment = |view| {
        Some(RenderPassColorAttachment {
            view,
            depth_slice: None,
            resolve_target: None,
            ops: Operations::default(),
        })
    };
    let diagnostics = ctx.diagnostic_recorder();
    let diagnostics = diagnostics.as_deref();
    let mut pass = ctx.begin_tracked_render_pass(RenderPassDescriptor {
        label: Some("treeline_accumulate"),
        color_attachments: &[
            attachment(post_process.destination),
            attachment(&present.color),
            attachment(&present.depth),
        ],
        ..default()
    });
    let span = diagnostics.pass_span(&mut pass, "treeline_accumulate");
    if let Some(viewport) = &camera.viewport {
        pass.set_camera_viewport(viewport);
    }
    pass.set_render_pipeline(pipeline);
    pass.set_bind_group(0, &group, &[now.offset, before.offset]);
    pass.draw(0..3, 0..1);
    span.end(&mut pass);
}
