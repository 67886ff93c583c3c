//! An app with a scene, and a camera that draws it into a picture.

use super::scenes::{BenchScene, Scenery};
use crate::{
    headless::{capture, render_target, target},
    options::ToolResult,
};
use bevy::{
    camera::{Projection, SubCameraView},
    prelude::*,
};
use image::RgbaImage;

/// See the module.
pub struct Stand {
    pub app: App,
    pub camera: Entity,
    scenery: Scenery,
    image: Handle<Image>,
    size: UVec2,
}

impl Stand {
    /// Adds a camera with Bevy's defaults but without multisampling, where it stands in the last frame.
    pub fn new(mut app: App, scene: &dyn BenchScene, scenery: Scenery, size: (u32, u32)) -> Self {
        let image = target(&mut app, size.0, size.1);
        let fov = scene.field_of_view(size.1);
        let camera = app.world_mut().spawn((
            Camera3d::default(),
            Msaa::Off,
            Projection::Perspective(PerspectiveProjection { fov, ..default() }),
            render_target(&image),
            scene.place(0),
        ));
        let camera = camera.id();
        Self { app, camera, scenery, image, size: size.into() }
    }

    /// Moves the camera.
    pub fn go(&mut self, place: Transform) {
        self.app.world_mut().entity_mut(self.camera).insert(place);
    }

    /// What was drawn last.
    pub fn picture(&self) -> ToolResult<RgbaImage> {
        capture(&self.app, &self.image)
    }

    /// From now on pictures are of trees alone, before nothing: their alpha is what trees cover.
    pub fn show_trees_alone(&mut self) {
        let world = self.app.world_mut();
        if let Some(ground) = self.scenery.ground {
            world.entity_mut(ground).insert(Visibility::Hidden);
        }
        world.insert_resource(ClearColor(self.scenery.sky.with_alpha(0.0)));
    }

    /// From now on the camera draws only a part of its picture, of `size` pixels at `offset`, `enlarged` times.
    pub fn show_part(&mut self, offset: UVec2, size: UVec2, enlarged: u32) {
        let UVec2 { x: width, y: height } = size * enlarged;
        let part = target(&mut self.app, width, height);
        let world = self.app.world_mut();
        world.resource_mut::<Assets<Image>>().remove(&self.image);
        let full_size = self.size;
        let mut camera = world.entity_mut(self.camera);
        camera.insert(render_target(&part));
        if let Some(mut camera) = camera.get_mut::<Camera>() {
            let offset = offset.as_vec2();
            camera.sub_camera_view = Some(SubCameraView { full_size, offset, size });
        }
        self.image = part;
    }

    /// Whether the camera draws at all.
    pub fn set_active(&mut self, active: bool) {
        let mut camera = self.app.world_mut().entity_mut(self.camera);
        if let Some(mut camera) = camera.get_mut::<Camera>() {
            camera.is_active = active;
        }
    }
}
