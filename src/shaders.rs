//! Every shader of the crate: the only file with `.wgsl` paths.
//!
//! In: the files below `shaders/`, compiled in; out: constants with their asset paths, `embedded://` assets, and the
//! importable modules kept loaded. Cost: one copy of the sources in the binary.

use bevy::{
    app::App,
    asset::{AssetServer, Handle, io::embedded::EmbeddedAssetRegistry},
    ecs::resource::Resource,
    shader::Shader,
};
use std::path::{Path, PathBuf};

macro_rules! shader_files {
    ($($(#[$meta:meta])* $name:ident = $path:literal),* $(,)?) => {
        $(
            $(#[$meta])*
            pub const $name: &str = concat!("embedded://", env!("CARGO_PKG_NAME"), "/shaders/", $path);
        )*
        /// Path below `shaders/` and source of every file.
        pub const ALL: &[(&str, &str)] = &[$(($path, include_str!(concat!("../shaders/", $path)))),*];
    };
}

shader_files! {
    /// Structs shared with Rust.
    TYPES = "lib/types.wgsl",
    /// Twin of `math::octahedral`.
    OCTAHEDRAL = "lib/octahedral.wgsl",
    /// Twin of `math::hash`.
    HASH = "lib/hash.wgsl",
    /// Twin of `asset::surfel`.
    SURFEL = "lib/surfel.wgsl",
    /// Twin of `lod`.
    LOD = "lib/lod.wgsl",
    /// Twin of `lod::contrast`.
    CONTRAST = "lib/contrast.wgsl",
    /// Twin of `forest::TreeInstance`.
    INSTANCE = "lib/instance.wgsl",
    /// Twin of `forest::select_instance`.
    SELECTION = "lib/selection.wgsl",
    /// Twin of `math::occlusion`.
    OCCLUSION = "lib/occlusion.wgsl",
    /// How the points of a work item come to the screen.
    SPLAT_ITEM = "lib/splat_item.wgsl",
    /// Quads over covered blocks of pixels.
    BLOCK_QUAD = "lib/block_quad.wgsl",
    /// Depth peeling.
    PEEL = "bake/peel.wgsl",
    /// Bindings of selection.
    SELECT_BINDINGS = "select/bindings.wgsl",
    /// Frustum and occlusion.
    CULLING = "select/culling.wgsl",
    /// Sums over the threads of a workgroup.
    PREFIX_SUM = "select/prefix_sum.wgsl",
    /// Culls blocks of instances.
    CULL_BLOCKS = "select/cull_blocks.wgsl",
    /// Lists the blocks whose trees are looked at.
    LIST_BLOCKS = "select/list_blocks.wgsl",
    /// Culls instances and counts their runs and items.
    CULL_INSTANCES = "select/cull_instances.wgsl",
    /// Sizes what looks at near trees.
    SIZE_CLUSTERS = "select/size_clusters.wgsl",
    /// Culls the clusters of near trees.
    CULL_CLUSTERS = "select/cull_clusters.wgsl",
    /// Scans the runs and items of blocks of instances.
    SCAN_BLOCKS = "select/scan_blocks.wgsl",
    /// Writes runs.
    EMIT_RUNS = "select/emit_runs.wgsl",
    /// Cuts runs of trees into work items.
    EXPAND_ITEMS = "select/expand_items.wgsl",
    /// Cuts runs of groves into work items.
    EXPAND_GROVES = "select/expand_groves.wgsl",
    /// Bindings of splatting.
    SPLAT_BINDINGS = "splat/bindings.wgsl",
    /// Samples of groves.
    GROVE = "splat/grove.wgsl",
    /// A point on the screen.
    PROJECT = "splat/project.wgsl",
    /// Clears the visibility buffer.
    INIT_VISIBILITY = "splat/init_visibility.wgsl",
    /// 64-bit splats.
    SPLAT_U64 = "splat/splat_u64.wgsl",
    /// First pass of 32-bit splats.
    SPLAT_DEPTH = "splat/splat_depth.wgsl",
    /// Second pass of 32-bit splats.
    SPLAT_PAYLOAD = "splat/splat_payload.wgsl",
    /// Light of near meshes in deferred views.
    LIGHT_NEAR = "near/light_near.wgsl",
    /// Finest level of the depth pyramid.
    BUILD_PYRAMID = "pyramid/build_pyramid.wgsl",
    /// Its other levels.
    REDUCE_PYRAMID = "pyramid/reduce_pyramid.wgsl",
    /// Lists covered blocks.
    CLASSIFY = "resolve/classify.wgsl",
    /// Sizes the resolve draw.
    SIZE_RESOLVE = "resolve/size_resolve.wgsl",
    /// Bevy's lighting without lamps.
    SUNLIGHT = "resolve/sunlight.wgsl",
    /// Debug views of resolve.
    DEBUG_VIEW = "resolve/debug_view.wgsl",
    /// A point's lit colour.
    SHADE = "resolve/shade.wgsl",
    /// Lights what the visibility buffer holds, of four samples a pixel.
    RESOLVE_SAMPLES = "resolve/resolve_samples.wgsl",
    /// Lights what the visibility buffer holds.
    RESOLVE = "resolve/resolve.wgsl",
    /// Depth, normals and motion of points for Bevy's prepass textures.
    WRITE_PREPASS = "prepass/write_prepass.wgsl",
    /// Blends a frame with its past.
    ACCUMULATE = "temporal/accumulate.wgsl",
    /// Bindings, sky and haze of landscapes.
    LANDSCAPE = "landscape/bindings.wgsl",
    /// Ground and water.
    GROUND = "landscape/ground.wgsl",
    /// Ground in prepasses and shadow maps.
    GROUND_PREPASS = "landscape/ground_prepass.wgsl",
    /// Clear sky.
    SKY = "landscape/sky.wgsl",
}

/// The importable modules. A handle each, because an import resolves only while its module is loaded.
#[derive(Resource, Debug)]
pub struct ShaderLibraries(pub Vec<Handle<Shader>>);

/// True for sources that others import (`#define_import_path`) rather than run.
fn is_library(source: &str) -> bool {
    source.lines().any(|line| line.trim_start().starts_with("#define_import_path"))
}

/// Registers every shader under its `embedded://` path. Needs `AssetPlugin`; without it, nothing happens.
pub fn embed(app: &mut App) {
    let Some(registry) = app.world_mut().get_resource_mut::<EmbeddedAssetRegistry>() else {
        return;
    };
    for (path, source) in ALL {
        registry.insert_asset(
            // Only read by Bevy's `embedded_watcher` feature, for hot reloading.
            PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/shaders")).join(path),
            &Path::new(concat!(env!("CARGO_PKG_NAME"), "/shaders")).join(path),
            source.as_bytes(),
        );
    }
}

/// Loads every importable module and keeps it, so that `#import bevy_treeline::..` resolves. Call after [`embed`], once
/// the `Shader` asset exists (`RenderPlugin` adds it); without an asset server, nothing happens.
///
/// A pipeline whose import is not loaded waits without a word: this is what Bevy's `load_shader_library!` is for, which
/// cannot be used here since it takes paths below `src/` only.
pub fn load_libraries(app: &mut App) {
    let Some(server) = app.world().get_resource::<AssetServer>() else { return };
    let prefix = concat!("embedded://", env!("CARGO_PKG_NAME"), "/shaders/");
    let libraries = ALL.iter().filter(|(_, source)| is_library(source));
    let handles = libraries.map(|(path, _)| server.load(format!("{prefix}{path}"))).collect();
    app.insert_resource(ShaderLibraries(handles));
}

/// The source of a file of [`ALL`], for passes that run without an app; `path` is one of the constants.
pub(crate) fn source(path: &str) -> &'static str {
    let name = path
        .strip_prefix(concat!("embedded://", env!("CARGO_PKG_NAME"), "/shaders/"))
        .unwrap_or(path);
    ALL.iter().find(|(file, _)| *file == name).map_or("", |(_, source)| source)
}
