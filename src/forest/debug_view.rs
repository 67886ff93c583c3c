//! Blue near meshes for [`DebugView::PointsAndTriangles`]. Cost: nothing while no camera shows it.

use super::{
    near_mesh::NearMeshPart,
    settings::{DebugView, TreelineSettings},
};
use bevy::{platform::collections::HashMap, prelude::*};

/// On painted parts: what they look like otherwise.
#[derive(Component)]
pub(super) struct Unpainted(Handle<StandardMaterial>);

/// A part of the pool and its material.
type Part = (Entity, &'static MeshMaterial3d<StandardMaterial>);

/// Paints all near meshes while a camera shows [`DebugView::PointsAndTriangles`], and gives their materials back after.
pub(super) fn paint_near_meshes(
    mut commands: Commands,
    mut blue: Local<HashMap<AssetId<StandardMaterial>, Handle<StandardMaterial>>>,
    cameras: Query<(&Camera, &TreelineSettings)>,
    plain: Query<Part, (With<NearMeshPart>, Without<Unpainted>)>,
    painted: Query<(Entity, &Unpainted)>,
    mut materials: ResMut<Assets<StandardMaterial>>,
) {
    let shown = |(camera, settings): (&Camera, &TreelineSettings)| {
        camera.is_active && settings.debug_view == DebugView::PointsAndTriangles
    };
    if !cameras.iter().any(shown) {
        for (entity, unpainted) in &painted {
            let own = MeshMaterial3d(unpainted.0.clone());
            commands.entity(entity).try_insert(own).try_remove::<Unpainted>();
        }
        blue.clear();
        return;
    }
    for (entity, material) in &plain {
        if !blue.contains_key(&material.id()) {
            let Some(own) = materials.get(material) else { continue };
            let paint = blue_material(own);
            blue.insert(material.id(), materials.add(paint));
        }
        let paint = MeshMaterial3d(blue[&material.id()].clone());
        commands.entity(entity).try_insert((paint, Unpainted(material.0.clone())));
    }
}

/// Blue in any light, with the holes of the mask: a black surface without reflection that glows.
fn blue_material(own: &StandardMaterial) -> StandardMaterial {
    StandardMaterial {
        base_color: Color::BLACK.with_alpha(own.base_color.alpha()),
        emissive: LinearRgba::BLUE,
        reflectance: 0.0,
        metallic: 0.0,
        unlit: false,
        fog_enabled: false,
        ..own.clone()
    }
}
