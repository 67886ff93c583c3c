//! L3: the render world. extract → residency → cull_tiles → view → select → splat → pyramid → select → splat →
//! resolve, prepass; counters flow back.
//!
//! In: forests, single trees and settings of the main world. Out: lit pixels and depth in the main pass of every
//! `Camera3d`, and [`TreelineCounters`]. Each stage sees only the stages before it. Cost: a look at each forest, plus instances
//! of forests in sight, plus points drawn, plus pixels covered.

mod counters;
mod cull_tiles;
mod extract;
mod near;
mod prepass;
mod pyramid;
mod residency;
mod resolve;
mod select;
mod splat;
mod temporal;
mod view;

pub use counters::{TreelineCounters, ViewCounters};
pub use splat::SplatSupport;
pub use temporal::TreelineTaa;

use crate::forest::{QualityFactor, SplatPath, TreelineSettings};
use bevy::{
    core_pipeline::{
        Core3d, Core3dSystems,
        core_3d::{main_opaque_pass_3d, main_transparent_pass_3d},
        deferred::node::late_deferred_prepass,
    },
    pbr::{
        MeshPipelineSystems,
        deferred::{deferred_lighting, init_deferred_lighting_layout},
    },
    prelude::*,
    render::{
        ExtractSchedule, GpuResourceAppExt, Render, RenderApp, RenderStartup, RenderSystems,
        extract_component::ExtractComponentPlugin,
        render_resource::{
            CachedPipelineState, Pipeline, PipelineCache, SpecializedComputePipelines,
            SpecializedRenderPipelines,
        },
        sync_component::SyncComponentPlugin,
    },
};

/// Draws what the main world holds. Part of `TreelinePlugin`; does nothing without a renderer.
pub(crate) struct TreelineRenderPlugin {
    /// Kernels asked for.
    pub splat_path: SplatPath,
}

impl Plugin for TreelineRenderPlugin {
    fn build(&self, app: &mut App) {
        let counters = TreelineCounters::default();
        app.insert_resource(counters.clone()).add_plugins((
            ExtractComponentPlugin::<TreelineSettings>::default(),
            ExtractComponentPlugin::<QualityFactor>::default(),
            SyncComponentPlugin::<TreelineTaa>::default(),
        ));
        let Some(render_app) = app.get_sub_app_mut(RenderApp) else { return };
        render_app
            .insert_resource(counters)
            .insert_resource(splat::RequestedSplatPath(self.splat_path))
            .init_resource::<extract::ExtractedTrees>()
            .init_resource::<near::NearMeshParts>()
            .init_gpu_resource::<residency::SurfelPool>()
            .init_gpu_resource::<residency::InstancePool>()
            .init_gpu_resource::<view::Views>()
            .init_gpu_resource::<counters::CounterReadback>()
            .init_gpu_resource::<SpecializedRenderPipelines<resolve::ResolvePipeline>>()
            .init_gpu_resource::<SpecializedComputePipelines<splat::SplatPipelines>>()
            .init_gpu_resource::<SpecializedRenderPipelines<prepass::PrepassPipeline>>()
            .init_gpu_resource::<SpecializedRenderPipelines<temporal::AccumulatePipeline>>()
            .init_gpu_resource::<temporal::Histories>()
            .add_systems(
                RenderStartup,
                (
                    select::init_select_pipelines,
                    pyramid::init_pyramid_pipelines,
                    splat::init_splat_pipelines,
                    resolve::init_classify_pipelines,
                    resolve::init_resolve_pipelines.after(MeshPipelineSystems),
                    prepass::init_prepass_pipeline,
                    near::init_near_light.after(init_deferred_lighting_layout),
                    temporal::init_accumulate_pipeline,
                ),
            )
            .add_systems(
                ExtractSchedule,
                (extract::extract_trees, near::extract_near_mesh_parts, temporal::extract_temporal),
            )
            .add_systems(
                Render,
                (
                    temporal::prepare_jitter.in_set(RenderSystems::PrepareViews),
                    near::leave_forward_pass
                        .in_set(RenderSystems::Queue)
                        .after(RenderSystems::QueueMeshes)
                        .before(RenderSystems::QueueSweep),
                    (
                        resolve::specialize_resolve,
                        prepass::specialize_prepass,
                        temporal::specialize_accumulate,
                        near::specialize_near_light,
                    )
                        .in_set(RenderSystems::Queue),
                    temporal::prepare_history.in_set(RenderSystems::PrepareResources),
                    (
                        residency::prepare_surfels,
                        residency::prepare_instances,
                        view::prepare_views,
                        splat::specialize_splat,
                    )
                        .chain()
                        .in_set(RenderSystems::PrepareResources),
                    (
                        select::prepare_select_groups,
                        pyramid::prepare_pyramid_groups,
                        splat::prepare_splat_groups,
                        resolve::prepare_classify_groups,
                        resolve::prepare_resolve_group,
                        prepass::prepare_prepass_groups,
                    )
                        .in_set(RenderSystems::PrepareBindGroups),
                    counters::map_counters.in_set(RenderSystems::Cleanup),
                ),
            )
            .add_systems(
                Core3d,
                (
                    // In the prepass, so that ambient occlusion, which comes after it, sees the points.
                    (
                        select::select::<0>,
                        splat::splat::<0>,
                        pyramid::build_pyramid,
                        select::select::<1>,
                        splat::splat::<1>,
                        resolve::classify,
                        counters::copy_counters,
                        prepass::write_prepass,
                    )
                        .chain()
                        .after(late_deferred_prepass)
                        .in_set(Core3dSystems::Prepass),
                    // Before the opaque pass, so that terrain behind trees is never shaded.
                    near::light_near.before(deferred_lighting).in_set(Core3dSystems::MainPass),
                    resolve::resolve
                        .after(deferred_lighting)
                        .before(main_opaque_pass_3d)
                        .in_set(Core3dSystems::MainPass),
                    resolve::resolve_edges
                        .after(main_opaque_pass_3d)
                        .before(main_transparent_pass_3d)
                        .in_set(Core3dSystems::MainPass),
                    temporal::accumulate.in_set(Core3dSystems::EarlyPostProcess),
                ),
            );
    }
}

/// Whether every pipeline of this crate has compiled: the number that are ready, and what is wrong with the others
/// (empty if they are still compiling). For tests and `treeline doctor`; `render_world` is that of [`RenderApp`].
pub fn pipeline_states(render_world: &World) -> (usize, Vec<String>) {
    let Some(cache) = render_world.get_resource::<PipelineCache>() else {
        return (0, vec!["there is no renderer".into()]);
    };
    let mut ready = 0;
    let mut problems = vec![];
    for pipeline in cache.pipelines() {
        let label = match &pipeline.descriptor {
            bevy::render::render_resource::PipelineDescriptor::RenderPipelineDescriptor(d) => {
                d.label.clone()
            }
            bevy::render::render_resource::PipelineDescriptor::ComputePipelineDescriptor(d) => {
                d.label.clone()
            }
        };
        let label = label.unwrap_or_default();
        if !label.starts_with("treeline_") {
            continue;
        }
        match &pipeline.state {
            CachedPipelineState::Ok(Pipeline::ComputePipeline(_) | Pipeline::RenderPipeline(_)) => {
                ready += 1
            }
            CachedPipelineState::Err(error) => problems.push(format!("{label}: {error}")),
            CachedPipelineState::Queued | CachedPipelineState::Creating(_) => {
                problems.push(format!(
                    "{label}: not ready (a missing shader import stays here for ever)"
                ));
            }
        }
    }
    (ready, problems)
}
