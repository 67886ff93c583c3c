//! What deferred views do for near meshes: masked leaves are drawn once, and light costs what the scene's lights cost.
//!
//! Views that are drawn forward leave near meshes to Bevy altogether.

mod light;
mod masked_once;

pub(super) use light::{init_near_light, light_near, specialize_near_light};
pub(super) use masked_once::leave_forward_pass;

use crate::forest::NearMeshPart;
use bevy::{
    prelude::*,
    render::{Extract, sync_world::MainEntity},
};

/// Mesh entities of near trees.
#[derive(Resource, Default)]
pub(super) struct NearMeshParts(Vec<MainEntity>);

pub(super) fn extract_near_mesh_parts(
    mut extracted: ResMut<NearMeshParts>,
    parts: Extract<Query<Entity, With<NearMeshPart>>>,
) {
    extracted.0.clear();
    extracted.0.extend(parts.iter().map(MainEntity::from));
}
