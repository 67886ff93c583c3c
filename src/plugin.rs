//! The plugin a game adds.

use crate::{
    asset::CacheLocation,
    bake::{BakePlugin, BakeSettings},
    diagnostics::TreelineDiagnosticsPlugin,
    forest::{ForestPlugin, SplatPath},
    governor::GovernorPlugin,
    render::TreelineRenderPlugin,
    shaders,
};
use bevy::{prelude::*, render::RenderApp};

/// Bakes and draws trees as points: add it after `DefaultPlugins`.
///
/// Works without a renderer too: assets load and bake (on the CPU), nothing is drawn.
#[derive(Clone, Debug, Default)]
pub struct TreelinePlugin {
    /// Which kernels draw the points. Default: auto.
    pub splat_path: SplatPath,
    /// Where baked trees are kept. Default: the user's cache folder.
    pub cache: CacheLocation,
    /// Settings of trees that are baked when they load, unless the load says otherwise.
    pub bake: BakeSettings,
}

impl Plugin for TreelinePlugin {
    fn build(&self, app: &mut App) {
        shaders::embed(app);
        if app.get_sub_app(RenderApp).is_some() {
            shaders::load_libraries(app);
        }
        app.add_plugins((
            ForestPlugin,
            BakePlugin { cache: self.cache.clone(), settings: self.bake.clone() },
            TreelineRenderPlugin { splat_path: self.splat_path },
            TreelineDiagnosticsPlugin,
            GovernorPlugin,
        ));
    }
}
