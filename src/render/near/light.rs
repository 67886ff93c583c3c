//! Light of near meshes in deferred views.
//!
//! Near meshes have a lighting pass id of their own ([`NEAR_LIGHTING_PASS`]), so that Bevy's pass leaves them alone. Where there is nothing but directional and
//! ambient light, `near/light_near.wgsl` lights them as resolve lights points; else Bevy's own pipeline does, with that id.
//! Cost: a pass over the pixels that near meshes show; none without near meshes.

use super::{super::resolve::Sunlight, NearMeshParts};
use crate::{asset::NEAR_LIGHTING_PASS, shaders};
use bevy::{
    core_pipeline::{
        deferred::copy_lighting_id::DeferredLightingIdDepthTexture, prepass::DeferredPrepass,
    },
    pbr::{
        ExtractedDirectionalLight, ExtractedPointLight, ExtractedRectLight, MeshPipelineKey,
        MeshViewBindGroup, ViewKeyCache,
        deferred::{DeferredLightingLayout, DeferredLightingPipeline, PbrDeferredLightingDepthId},
    },
    platform::collections::HashMap,
    prelude::*,
    render::{
        diagnostic::RecordDiagnostics,
        render_resource::*,
        renderer::{RenderContext, RenderDevice, RenderQueue, ViewQuery},
        view::{ExtractedView, ViewTarget},
    },
};

/// What Bevy's deferred lighting adds to light, and the shader has no code for.
const OTHER_EFFECTS: MeshPipelineKey = MeshPipelineKey::SCREEN_SPACE_AMBIENT_OCCLUSION
    .union(MeshPipelineKey::SCREEN_SPACE_REFLECTIONS);

/// Pipelines for views without lamps, and what all draws share.
#[derive(Resource)]
pub(in crate::render) struct NearLightPipelines {
    shader: Handle<Shader>,
    pass_id: UniformBuffer<PbrDeferredLightingDepthId>,
    /// Of what holds the pass id.
    layout: BindGroupLayoutDescriptor,
    known: HashMap<(MeshPipelineKey, Sunlight), CachedRenderPipelineId>,
}

/// Nothing without Bevy's deferred lighting.
pub(in crate::render) fn init_near_light(
    mut commands: Commands,
    bevys: Option<Res<DeferredLightingLayout>>,
    asset_server: Res<AssetServer>,
    device: Res<RenderDevice>,
    queue: Res<RenderQueue>,
) {
    let Some(bevys) = bevys else { return };
    // The field is private; the group is the last of every key's pipeline.
    let Some(layout) = bevys.specialize(MeshPipelineKey::NONE).layout.pop() else { return };
    let mut pass_id = UniformBuffer::from(PbrDeferredLightingDepthId::new(NEAR_LIGHTING_PASS));
    pass_id.set_label(Some("treeline_near_lighting_pass"));
    pass_id.write_buffer(&device, &queue);
    let shader = asset_server.load(shaders::LIGHT_NEAR);
    let known = HashMap::default();
    commands.insert_resource(NearLightPipelines { shader, pass_id, layout, known });
}

/// On deferred views: how near meshes are lit where there are no lamps.
#[derive(Component)]
pub(in crate::render) struct SunlitNear(CachedRenderPipelineId);

#[expect(clippy::too_many_arguments, reason = "a system's parameters are its dependencies")]
pub(in crate::render) fn specialize_near_light(
    mut commands: Commands,
    views: Query<(Entity, &ExtractedView), With<DeferredPrepass>>,
    view_keys: Res<ViewKeyCache>,
    suns: Query<&ExtractedDirectionalLight>,
    lamps: Query<(), Or<(With<ExtractedPointLight>, With<ExtractedRectLight>)>>,
    bevys: Option<Res<DeferredLightingLayout>>,
    pipelines: Option<ResMut<NearLightPipelines>>,
    cache: Res<PipelineCache>,
) {
    let (Some(bevys), Some(mut pipelines)) = (bevys, pipelines) else { return };
    let (lamps, shadows) = (!lamps.is_empty(), suns.iter().any(|sun| sun.shadow_maps_enabled));
    for (entity, view) in &views {
        let Some(&key) = view_keys.get(&view.retained_view_entity) else { continue };
        let sunlight = Sunlight::of(key, lamps, shadows).filter(|_| !key.intersects(OTHER_EFFECTS));
        let Some(sunlight) = sunlight else {
            commands.entity(entity).remove::<SunlitNear>();
            continue;
        };
        let NearLightPipelines { shader, known, .. } = &mut *pipelines;
        let id = known.entry((key, sunlight)).or_insert_with(|| {
            // Bevy's own descriptor brings the layouts, every shader def of the view and the test against the pass id.
            let mut descriptor = bevys.specialize(key);
            descriptor.label = Some("treeline_light_near".into());
            if let Some(fragment) = &mut descriptor.fragment {
                fragment.shader = shader.clone();
                fragment.entry_point = Some("light_near".into());
                fragment.shader_defs.extend(sunlight.shader_defs());
            }
            cache.queue_render_pipeline(descriptor)
        });
        commands.entity(entity).insert(SunlitNear(*id));
    }
}

/// A view with a deferred buffer, and what lights it.
type LitView = (
    &'static MeshViewBindGroup,
    &'static ViewTarget,
    &'static DeferredLightingIdDepthTexture,
    &'static DeferredLightingPipeline,
    Option<&'static SunlitNear>,
);

/// Before Bevy's lighting: that does not keep the pass ids.
pub(in crate::render) fn light_near(
    view: ViewQuery<LitView>,
    parts: Res<NearMeshParts>,
    pipelines: Option<Res<NearLightPipelines>>,
    cache: Res<PipelineCache>,
    mut ctx: RenderContext,
) {
    let (mesh_view, target, pass_ids, bevy_pipeline, sunlit) = view.into_inner();
    let Some(pipelines) = pipelines.filter(|_| !parts.0.is_empty()) else { return };
    let sunlit = sunlit.and_then(|SunlitNear(id)| cache.get_render_pipeline(*id));
    let pipeline = sunlit.or_else(|| cache.get_render_pipeline(bevy_pipeline.pipeline_id));
    let (Some(pipeline), Some(pass_id)) = (pipeline, pipelines.pass_id.binding()) else { return };
    let group = ctx.render_device().create_bind_group(
        "treeline_light_near",
        &cache.get_bind_group_layout(&pipelines.layout),
        &BindGroupEntries::single(pass_id),
    );
    let diagnostics = ctx.diagnostic_recorder();
    let diagnostics = diagnostics.as_deref();
    let label = "treeline_light_near";
    let mut pass = ctx.begin_tracked_render_pass(RenderPassDescriptor {
        label: Some(label),
        color_attachments: &[Some(target.get_color_attachment())],
        depth_stencil_attachment: Some(RenderPassDepthStencilAttachment {
            view: &pass_ids.texture.default_view,
            depth_ops: Some(Operations { load: LoadOp::Load, store: StoreOp::Store }),
            stencil_ops: None,
        }),
        ..default()
    });
    let span = diagnostics.pass_span(&mut pass, label);
    pass.set_render_pipeline(pipeline);
    pass.set_bind_group(0, &mesh_view.main, &mesh_view.main_offsets);
    pass.set_bind_group(1, &mesh_view.binding_array, &[]);
    pass.set_bind_group(2, &group, &[]);
    pass.draw(0..3, 0..1);
    span.end(&mut pass);
}
