//! Bevy as it comes: one entity a tree and material, with the full mesh.

use super::{CameraVariants, Made, Technique, Work};
use crate::options::ToolResult;
use bevy::prelude::*;

struct Stock {
    camera: CameraVariants,
}

pub fn make(variants: &[&str]) -> Made {
    Ok(Box::new(Stock { camera: CameraVariants::parse(variants)? }))
}

impl Technique for Stock {
    fn plant(&mut self, app: &mut App, work: &mut Work) -> ToolResult {
        let world = app.world_mut();
        let parts = work.tree.parts(world);
        let mut drawn = vec![];
        for part in parts {
            let mesh = world.resource_mut::<Assets<Mesh>>().add(part.mesh);
            drawn.push((Mesh3d(mesh), MeshMaterial3d(part.material)));
        }
        let entities = work.trees().iter().flat_map(|place| {
            drawn.iter().map(|(mesh, material)| (mesh.clone(), material.clone(), *place))
        });
        world.spawn_batch(entities.collect::<Vec<_>>());
        Ok(())
    }

    fn set_up_camera(&self, camera: &mut EntityWorldMut) {
        self.camera.apply(camera);
    }
}
