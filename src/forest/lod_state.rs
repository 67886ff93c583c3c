//! Writes what was chosen for single trees into their [`LodState`].

use super::{
    components::{LodState, TreeImpostor},
    instance::TreeInstance,
    near_mesh::NearMeshes,
    select::{ViewPoint, select_instance},
    settings::TreelineSettings,
};
use crate::asset::TreeAsset;
use bevy::prelude::*;

/// The active 3D cameras with their settings, as selection sees them.
pub(super) fn view_points<'a>(
    cameras: impl Iterator<Item = (&'a Camera, &'a GlobalTransform, Option<&'a TreelineSettings>)>,
) -> Vec<(ViewPoint, TreelineSettings)> {
    cameras
        .filter(|(camera, _, settings)| camera.is_active && settings.is_none_or(|s| s.enabled))
        .filter_map(|(camera, transform, settings)| {
            let height = camera.physical_viewport_size()?.y as f32;
            let view = ViewPoint::new(transform.translation(), &camera.clip_from_view(), height);
            Some((view, settings.cloned().unwrap_or_default().clamped().0))
        })
        .collect()
}

/// The instance that a single tree is.
pub(crate) fn impostor_instance(
    impostor: &TreeImpostor,
    transform: &GlobalTransform,
) -> TreeInstance {
    TreeInstance { tint: impostor.tint, seed: impostor.seed, ..TreeInstance::default() }
        .in_world(&transform.affine())
}

pub(super) fn update_lod_state(
    mut trees: Query<(Entity, &TreeImpostor, &GlobalTransform, &mut LodState)>,
    cameras: Query<(&Camera, &GlobalTransform, Option<&TreelineSettings>), With<Camera3d>>,
    assets: Res<Assets<TreeAsset>>,
    near: Res<NearMeshes>,
) {
    if trees.is_empty() {
        return;
    }
    let views = view_points(cameras.iter());
    for (entity, impostor, transform, mut state) in &mut trees {
        let chosen = assets.get(&impostor.tree).map(|tree| {
            let instance = impostor_instance(impostor, transform);
            let has_mesh = near.is_ready(entity, 0);
            let selections = views.iter().map(|(view, settings)| {
                let selection =
                    select_instance(view, settings, &tree.shape(), &instance, default(), has_mesh);
                (selection, view.z0)
            });
            let largest =
                selections.max_by(|a, b| (a.1 / a.0.distance).total_cmp(&(b.1 / b.0.distance)));
            largest.map_or(LodState::default(), |(selection, z0)| LodState {
                distance: selection.distance,
                d0: tree.data.pixel * instance.scale * z0,
                points: selection.draw.count,
                points_baked: tree.data.point_count() as u32,
                mesh: selection.mesh,
            })
        });
        state.set_if_neq(chosen.unwrap_or_default());
    }
}
