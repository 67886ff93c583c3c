//! Counters as Bevy diagnostics: sums over all views, under `treeline/…`.
//!
//! GPU and CPU time of the passes come with Bevy's `RenderDiagnosticsPlugin`, as `render/treeline_select/…`,
//! `render/treeline_splat/…`, `render/treeline_classify/…` and `render/treeline_resolve/…`.

use crate::{forest::NearMeshes, render::TreelineCounters};
use bevy::{
    diagnostic::{Diagnostic, DiagnosticPath, Diagnostics, RegisterDiagnostic},
    prelude::*,
};

/// Publishes [`TreelineCounters`] as diagnostics. Part of `TreelinePlugin`.
pub struct TreelineDiagnosticsPlugin;

macro_rules! paths {
    ($($(#[$doc:meta])* $name:ident = $path:literal),* $(,)?) => {
        impl TreelineDiagnosticsPlugin {
            $($(#[$doc])* pub const $name: DiagnosticPath = DiagnosticPath::const_new(concat!("treeline/", $path));)*
            /// Every diagnostic of this plugin.
            pub const ALL: &[DiagnosticPath] = &[$(Self::$name),*];
        }
    };
}

paths! {
    /// Trees of the scene, in sight or not, whose species is loaded.
    INSTANCES_SEEN = "instances_seen",
    /// Trees in forests that were skipped whole, outside the frustum, or deserving no point.
    INSTANCES_CULLED = "instances_culled",
    /// Forests that were skipped whole.
    CULLED_TILES = "culled_tiles",
    /// Forests that are not on the GPU yet.
    WAITING_FORESTS = "waiting_forests",
    /// Trees drawn by their mesh alone.
    INSTANCES_AS_MESH = "instances_as_mesh",
    /// Trees in the crossfade band.
    INSTANCES_IN_FADE = "instances_in_fade",
    /// Points splatted.
    POINTS = "points",
    /// Work items.
    WORK_ITEMS = "work_items",
    /// Work items that did not fit.
    OVERFLOW = "overflow",
    /// Pixels that show a point.
    COVERED_PIXELS = "covered_pixels",
    /// Bytes read of instances, items and surfels.
    BYTES_READ = "bytes_read",
    /// Trees in the near-mesh pool.
    NEAR_MESHES = "near_meshes",
}

impl Plugin for TreelineDiagnosticsPlugin {
    fn build(&self, app: &mut App) {
        for path in Self::ALL {
            app.register_diagnostic(Diagnostic::new(path.clone()));
        }
        app.add_systems(Last, publish_counters);
    }
}

fn publish_counters(
    counters: Res<TreelineCounters>,
    near: Res<NearMeshes>,
    mut diagnostics: Diagnostics,
) {
    let all = counters.all();
    let sum =
        |of: &dyn Fn(&crate::render::ViewCounters) -> u64| all.values().map(of).sum::<u64>() as f64;
    type Plugin = TreelineDiagnosticsPlugin;
    diagnostics.add_measurement(&Plugin::INSTANCES_SEEN, || sum(&|c| c.instances_seen.into()));
    diagnostics.add_measurement(&Plugin::INSTANCES_CULLED, || {
        sum(&|c| {
            u64::from(c.culled_in_tiles) + u64::from(c.culled_frustum) + u64::from(c.culled_small)
        })
    });
    diagnostics.add_measurement(&Plugin::CULLED_TILES, || sum(&|c| c.culled_tiles.into()));
    // The same for every view.
    diagnostics.add_measurement(&Plugin::WAITING_FORESTS, || {
        all.values().map(|c| c.waiting_forests).max().unwrap_or_default().into()
    });
    diagnostics.add_measurement(&Plugin::INSTANCES_AS_MESH, || sum(&|c| c.as_mesh.into()));
    diagnostics.add_measurement(&Plugin::INSTANCES_IN_FADE, || sum(&|c| c.in_fade.into()));
    diagnostics.add_measurement(&Plugin::POINTS, || sum(&|c| c.points.into()));
    diagnostics.add_measurement(&Plugin::WORK_ITEMS, || sum(&|c| c.items.into()));
    diagnostics.add_measurement(&Plugin::OVERFLOW, || sum(&|c| c.item_overflow.into()));
    diagnostics.add_measurement(&Plugin::COVERED_PIXELS, || sum(&|c| c.covered_pixels.into()));
    diagnostics.add_measurement(&Plugin::BYTES_READ, || sum(&|c| c.bytes_read()));
    diagnostics.add_measurement(&Plugin::NEAR_MESHES, || near.len() as f64);
}
