//! L2: what a game says: components, settings, and the systems of the main world that serve them.
//!
//! In: [`TreeImpostor`] and [`Forest`] entities, [`TreelineSettings`] of cameras. Out: [`LodState`] of single trees, and the
//! pool of meshes near the cameras ([`NearMeshes`]). `select` is the CPU twin of what the GPU decides for every tree
//! ([`select_instance`], [`emit_items`]), `grove` the list that a block of far trees becomes ([`grove_list`]). Cost: trees near a camera, not all trees.

mod components;
mod debug_view;
mod forest_index;
mod grove;
mod instance;
mod lod_state;
mod near_mesh;
mod select;
mod settings;

pub use components::{Forest, LodState, TreeImpostor};
pub use grove::{GroveList, MOST_SAMPLES, OCTAVES, SAMPLES_PER_TREE, grove_list, view_scale};
pub(crate) use instance::PackedTree;
pub use instance::TreeInstance;
pub(crate) use lod_state::impostor_instance;
pub use near_mesh::{NearMeshPart, NearMeshes, NearTree};
pub use select::{PointDraw, Selection, SpeciesShape, ViewPoint, emit_items, select_instance};
pub use settings::{
    CullingView, DebugView, GroveSettings, Occlusion, QualityFactor, SplatPath, SplatShape,
    TemporalSampling, TreelineSettings, UploadBudget,
};

use crate::asset::{NearMesh, TreeAsset};
use bevy::{camera::visibility::VisibilitySystems, prelude::*, transform::TransformSystems};

/// Order of this crate's work in the main world, in `PostUpdate`.
#[derive(SystemSet, Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum TreelineSystems {
    /// Near meshes are placed: before transforms propagate.
    NearMeshes,
    /// [`LodState`] is written: after transforms propagated.
    LodState,
}

/// Components, near-mesh pool and level-of-detail state. Part of `TreelinePlugin`.
pub(crate) struct ForestPlugin;

impl Plugin for ForestPlugin {
    fn build(&self, app: &mut App) {
        // Without a renderer nobody else has made the assets that near meshes consist of.
        init_missing_asset::<Mesh>(app);
        init_missing_asset::<StandardMaterial>(app);
        init_missing_asset::<Image>(app);
        app.init_asset::<TreeAsset>()
            .init_asset::<NearMesh>()
            .init_resource::<NearMeshes>()
            .init_resource::<UploadBudget>()
            .init_resource::<GroveSettings>()
            .register_type::<TreeImpostor>()
            .register_type::<LodState>()
            .register_type::<TreelineSettings>()
            .register_type::<QualityFactor>()
            .register_type::<UploadBudget>()
            .register_type::<GroveSettings>()
            .configure_sets(
                PostUpdate,
                (
                    TreelineSystems::NearMeshes
                        .before(TransformSystems::Propagate)
                        .before(VisibilitySystems::CalculateBounds),
                    TreelineSystems::LodState.after(TransformSystems::Propagate),
                ),
            )
            .add_systems(
                PostUpdate,
                (
                    (
                        forest_index::index_forests,
                        near_mesh::update_near_meshes,
                        debug_view::paint_near_meshes,
                    )
                        .chain()
                        .in_set(TreelineSystems::NearMeshes),
                    lod_state::update_lod_state.in_set(TreelineSystems::LodState),
                ),
            );
    }
}

/// A second `init_asset` would drop every asset of the type.
fn init_missing_asset<A: Asset>(app: &mut App) {
    if !app.world().contains_resource::<Assets<A>>() {
        app.init_asset::<A>();
    }
}
