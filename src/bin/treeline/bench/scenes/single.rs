//! One tree before a plain background, framed as `treeline compare` frames it.

use super::{BenchScene, Scenery};
use crate::{scene, subject::z0};
use bevy::prelude::*;
use bevy_treeline::math::bounding::Aabb;

/// Where from: about the vertical and above the horizon, degrees. The defaults of `compare`.
const AZIMUTH_DEG: f32 = 30.0;
const ELEVATION_DEG: f32 = 10.0;

/// The scene, as modelled: distances are in units of the model.
pub struct Single {
    center: Vec3,
    distance: f32,
    trees: [Transform; 1],
}

impl Single {
    pub fn new(bounds: &Aabb, distance: f32) -> Self {
        Self { center: bounds.center(), distance, trees: [Transform::IDENTITY] }
    }
}

impl BenchScene for Single {
    fn set_up(&self, world: &mut World) -> Scenery {
        scene::add_light(world, 0.0);
        world.insert_resource(ClearColor(scene::SKY));
        Scenery { ground: None, sky: scene::SKY }
    }

    fn trees(&self) -> &[Transform] {
        &self.trees
    }

    fn place(&self, _steps: u32) -> Transform {
        let ((sin, cos), azimuth) =
            (ELEVATION_DEG.to_radians().sin_cos(), AZIMUTH_DEG.to_radians());
        let from = Vec3::new(cos * azimuth.sin(), sin, cos * azimuth.cos());
        Transform::from_translation(self.center + from * self.distance)
            .looking_at(self.center, Vec3::Y)
    }

    fn field_of_view(&self, height: u32) -> f32 {
        // The same scale as on the screen that distances refer to, whatever the size of the picture.
        2.0 * (0.5 * height as f32 / z0()).atan()
    }
}
