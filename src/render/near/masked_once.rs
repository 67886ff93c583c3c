//! Near meshes with masked leaves are drawn once in deferred views.
//!
//! Bevy 0.19 queues an opaque mesh of a deferred material for the deferred buffer alone, but a masked one for the forward pass as
//! well (`queue_material_meshes` in `bevy_pbr`). That pass then shades all leaves anew, over what deferred lighting has lit, to the same
//! picture: three quarters of the cost of an oak seen from near. Here such meshes are taken out of the forward pass again.
//!
//! In: the mesh entities of near trees, and the views with a deferred prepass. Cost: a look-up each.

use super::NearMeshParts;
use bevy::{
    core_pipeline::{core_3d::AlphaMask3d, prepass::DeferredPrepass},
    material::OpaqueRendererMethod,
    pbr::{PreparedMaterial, RenderMaterialInstances},
    prelude::*,
    render::{
        erased_render_asset::ErasedRenderAssets, render_phase::ViewBinnedRenderPhases,
        sync_world::MainEntity, view::ExtractedView,
    },
};

/// After Bevy has queued meshes, before it batches them.
pub(in crate::render) fn leave_forward_pass(
    parts: Res<NearMeshParts>,
    instances: Res<RenderMaterialInstances>,
    materials: Res<ErasedRenderAssets<PreparedMaterial>>,
    mut phases: ResMut<ViewBinnedRenderPhases<AlphaMask3d>>,
    views: Query<&ExtractedView, With<DeferredPrepass>>,
) {
    let is_deferred = |part: &&MainEntity| {
        let instance = instances.instances.get(*part);
        let material = instance.and_then(|instance| materials.get(instance.asset_id));
        material.is_some_and(|material| {
            let properties = &material.properties;
            properties.prepass_enabled && properties.render_method == OpaqueRendererMethod::Deferred
        })
    };
    for view in &views {
        let Some(phase) = phases.get_mut(&view.retained_view_entity) else { continue };
        parts.0.iter().filter(is_deferred).for_each(|part| phase.remove(*part));
    }
}
