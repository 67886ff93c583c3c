//! The baked tree as Bevy assets.

use super::tree_data::TreeData;
use bevy::{
    asset::Asset, math::Vec3, mesh::Mesh, pbr::StandardMaterial, prelude::Handle, reflect::TypePath,
};
use std::sync::Arc;

/// A baked tree: points in progressive order, and the mesh drawn near the camera.
#[derive(Asset, TypePath, Clone, Debug)]
pub struct TreeAsset {
    /// The points. Shared with the render world.
    pub data: Arc<TreeData>,
    /// The source model as meshes. `None`: the tree stays points however near.
    #[dependency]
    pub near_mesh: Option<Handle<NearMesh>>,
}

/// A model as meshes and materials, centred on the middle of its box so that level-of-detail distances agree with
/// those of the points.
#[derive(Asset, TypePath, Clone, Debug, Default)]
pub struct NearMesh {
    /// One per material of the model.
    #[dependency]
    pub parts: Vec<NearMeshPiece>,
}

/// `deferred_lighting_pass_id` of near meshes' materials: cameras with a deferred prepass light those apart from the rest of
/// the scene, at the cost of the lights that there are. A material of yours that has it is lit so, too.
pub const NEAR_LIGHTING_PASS: u8 = 84;

/// A mesh with its material.
#[derive(Clone, Debug)]
pub struct NearMeshPiece {
    /// Triangles, relative to the centre of the model's box.
    pub mesh: Handle<Mesh>,
    /// What it looks like.
    pub material: Handle<StandardMaterial>,
    /// Centre of the part's own box, relative to the model's.
    pub center: Vec3,
    /// Half the extent of the part's box.
    pub half_extents: Vec3,
}

impl bevy::asset::VisitAssetDependencies for NearMeshPiece {
    fn visit_dependencies(&self, visit: &mut impl FnMut(bevy::asset::UntypedAssetId)) {
        visit(self.mesh.id().untyped());
        visit(self.material.id().untyped());
    }
}
