//! A landscape in Bevy: a [`Landscape`] and cameras in; chunks of ground and water, sky and haze out.
//!
//! `stream` (which chunks, made in background tasks) → `material` (pipelines) and `sky` (sun, sky and haze by time of day).
//! Every active `Camera3d` gets ground around it. The main thread does what [`TerrainLod::main_thread_ms`] allows a frame.

mod grain;
mod material;
mod sky;
mod stream;

pub use material::{GroundMaterial, GroundMaterialKey, SkyMaterial};
pub use sky::{Sky, SkyKind, SkySupport, Sun};

use super::{Biomes, Ground, ShadeSource};
use crate::shaders;
use bevy::{
    asset::AssetEventSystems, camera::visibility::VisibilitySystems, prelude::*,
    transform::TransformSystems,
};
use std::sync::Arc;

/// Draws the [`Landscape`] and the [`Sky`]. Needs what `DefaultPlugins` bring, `PbrPlugin` above all; add it after them.
#[derive(Clone, Copy, Debug, Default)]
pub struct TerrainPlugin;

/// What is drawn. Insert it to begin, insert another to begin anew, remove it to end.
#[derive(Resource, Clone)]
pub struct Landscape {
    /// Heights and water.
    pub ground: Arc<dyn Ground>,
    /// What colours the ground.
    pub biomes: Arc<Biomes>,
    /// Trees that throw shadows on the ground. Default: none.
    pub shade: Option<Arc<dyn ShadeSource>>,
}

impl Landscape {
    /// A landscape without shadows of trees.
    pub fn new(ground: Arc<dyn Ground>, biomes: Arc<Biomes>) -> Self {
        Self { ground, biomes, shade: None }
    }

    /// With trees that throw shadows.
    #[must_use]
    pub fn with_shade(mut self, shade: Arc<dyn ShadeSource>) -> Self {
        self.shade = Some(shade);
        self
    }
}

/// How much ground is drawn.
#[derive(Resource, Clone, Debug, PartialEq)]
pub struct TerrainLod {
    /// Largest error of the ground's shape in pixels, 0.5 to 16. Default: 3.
    pub error_px: f32,
    /// Most triangles in view a frame; beyond it the error grows. Default: 300,000.
    pub max_triangles: usize,
    /// Memory of chunks in MB, at least 16; those not needed longest go first, and what does not fit stays coarse.
    /// Default: 192.
    pub memory_mb: u32,
    /// Work of the main thread a frame in milliseconds. Default: 4.
    pub main_thread_ms: f32,
    /// Make everything needed before a frame is drawn, however long it takes: the same pictures every time. Default:
    /// false.
    pub wait: bool,
    /// Receive Bevy's shadow maps on the ground, for meshes that stand on it; costs a lookup a pixel. Default: false.
    pub receive_shadows: bool,
}

impl Default for TerrainLod {
    fn default() -> Self {
        Self {
            error_px: 3.0,
            max_triangles: 300_000,
            memory_mb: 192,
            main_thread_ms: 4.0,
            wait: false,
            receive_shadows: false,
        }
    }
}

/// What the last frame drew.
#[derive(Resource, Clone, Copy, Debug, Default, PartialEq)]
pub struct TerrainCounters {
    /// Chunks kept.
    pub chunks: usize,
    /// Chunks of the last cut, in view or not.
    pub drawn: usize,
    /// Triangles in view.
    pub triangles: usize,
    /// Chunks and textures still to be made for this view.
    pub pending: usize,
    /// Work of the main thread, milliseconds.
    pub main_thread_ms: f32,
    /// Memory of the chunks, MB.
    pub memory_mb: f32,
}

/// When the plugin works, in `PostUpdate`; move cameras before it.
#[derive(SystemSet, Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum TerrainSystems {
    /// Sun, sky and haze follow the time of day.
    Light,
    /// Chunks are chosen, made and shown.
    Stream,
}

impl Plugin for TerrainPlugin {
    fn build(&self, app: &mut App) {
        if !app.world().contains_resource::<shaders::ShaderLibraries>() {
            shaders::embed(app);
            shaders::load_libraries(app);
        }
        app.add_plugins((
            MaterialPlugin::<GroundMaterial>::default(),
            MaterialPlugin::<SkyMaterial>::default(),
        ))
        .init_resource::<TerrainLod>()
        .init_resource::<TerrainCounters>()
        .init_resource::<Sky>()
        .init_resource::<sky::CurrentLight>()
        .init_resource::<stream::Chunks>()
        .init_resource::<stream::Frame>()
        .configure_sets(PostUpdate, (TerrainSystems::Light, TerrainSystems::Stream).chain())
        .add_systems(
            PostUpdate,
            (
                (sky::light_by_time, sky::haze_cameras)
                    .chain()
                    .in_set(TerrainSystems::Light)
                    .before(TransformSystems::Propagate),
                (stream::begin_anew, stream::stream_chunks, sky::draw_sky, stream::tell_shaders)
                    .chain()
                    .in_set(TerrainSystems::Stream)
                    .after(TransformSystems::Propagate)
                    .before(VisibilitySystems::VisibilityPropagate)
                    .before(AssetEventSystems),
            ),
        );
    }
}
