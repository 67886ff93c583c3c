//! One tree before a plain background, as mesh or as points: what `view` and `compare` picture.

use crate::{
    headless::{capture, headless_app, render_target, step, target},
    options::ToolResult,
    scene,
};
use bevy::{camera::Projection, prelude::*};
use bevy_treeline::{
    SplatPath, TreeAsset, TreeImpostor, TreelineCounters, TreelineSettings, ViewCounters,
    asset::NearMesh, bake::Baked, lod::prefix_count, math::image_error::box_downsample_linear,
};
use image::RgbaImage;

/// Height in pixels and vertical field of view of the screen whose `Z0` all distances refer to.
const SCREEN_HEIGHT: f32 = 720.0;
const SCREEN_FOV_Y: f32 = std::f32::consts::FRAC_PI_4;
/// Widest picture of one render; larger ones are cut (a tree that fills more than the screen).
const LARGEST: u32 = 1440;

/// What is drawn of the tree.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Technique {
    /// Its triangles, one sample a pixel.
    Mesh,
    /// Its points, however near.
    Points,
    /// What a game gets: mesh near, points far, both in between.
    Crossfade,
}

/// Where it is seen from.
#[derive(Clone, Copy, Debug)]
pub struct Shot {
    /// From the middle of the tree, model units.
    pub distance: f32,
    /// About the vertical, radians.
    pub azimuth: f32,
    /// Above the horizon, radians.
    pub elevation: f32,
    /// Pixels.
    pub size: UVec2,
}

/// An app with one tree.
pub struct Subject {
    app: App,
    mesh: Vec<Entity>,
    points: Entity,
    crossfade: Entity,
    center: Vec3,
    radius: f32,
    /// `d0 = s Z0` on the screen that distances refer to.
    pub d0: f32,
}

/// `Z0` of that screen.
pub fn z0() -> f32 {
    prefix_count::z0(SCREEN_HEIGHT, 1.0 / (0.5 * SCREEN_FOV_Y).tan())
}

impl Subject {
    /// A scene around a baked tree.
    pub fn new(
        baked: &Baked,
        splat_path: SplatPath,
        settings: TreelineSettings,
    ) -> ToolResult<Self> {
        let mut app = headless_app(splat_path)?;
        let world = app.world_mut();
        scene::add_light(world, 0.0);
        // Alpha 0 where nothing is drawn, so that pictures carry their coverage.
        world.insert_resource(ClearColor(scene::SKY.with_alpha(0.0)));
        world.insert_resource(SubjectSettings(settings));
        let center = baked.data.bounds.center();
        let near: NearMesh = scene::add_near_mesh(world, baked);
        let mesh = near.parts.iter().map(|part| {
            let bundle = (
                Mesh3d(part.mesh.clone()),
                MeshMaterial3d(part.material.clone()),
                Transform::from_translation(center),
                bevy::camera::primitives::Aabb {
                    center: part.center.into(),
                    half_extents: part.half_extents.into(),
                },
                Visibility::Hidden,
            );
            world.spawn(bundle).id()
        });
        let mesh: Vec<Entity> = mesh.collect();
        let points_tree = scene::add_tree(world, baked, false);
        let near = world.resource_mut::<Assets<NearMesh>>().add(near);
        let full_tree = world
            .resource_mut::<Assets<TreeAsset>>()
            .add(TreeAsset { data: baked.data.clone(), near_mesh: Some(near) });
        let points = world.spawn((TreeImpostor::new(points_tree), Visibility::Hidden)).id();
        let crossfade = world.spawn((TreeImpostor::new(full_tree), Visibility::Hidden)).id();
        let d0 = prefix_count::d0(baked.data.pixel, z0());
        Ok(Self { app, mesh, points, crossfade, center, radius: baked.data.bounds.radius(), d0 })
    }

    /// Size in pixels at which the tree fits at a distance, with a margin of 8, at most [`LARGEST`] a side.
    pub fn fitting_size(&self, distance: f32) -> UVec2 {
        // A sphere nearer than its radius fills any picture.
        let height = if distance > self.radius * 1.05 {
            2.0 * z0() * self.radius / (distance * distance - self.radius * self.radius).sqrt()
        } else {
            LARGEST as f32
        };
        UVec2::splat((height.ceil() as u32 + 16).min(LARGEST))
    }

    /// Draws one picture. `supersample` renders this many times as many pixels along each side and averages them in
    /// linear light.
    pub fn render(
        &mut self,
        technique: Technique,
        shot: Shot,
        supersample: u32,
    ) -> ToolResult<(RgbaImage, ViewCounters)> {
        let size = shot.size * supersample;
        let image = target(&mut self.app, size.x, size.y);
        let world = self.app.world_mut();
        let show = |world: &mut World, entity: Entity, on: bool| {
            world.entity_mut(entity).insert(if on {
                Visibility::Visible
            } else {
                Visibility::Hidden
            });
        };
        for entity in self.mesh.clone() {
            show(world, entity, technique == Technique::Mesh);
        }
        show(world, self.points, technique == Technique::Points);
        show(world, self.crossfade, technique == Technique::Crossfade);

        let (sin, cos) = shot.elevation.sin_cos();
        let from = Vec3::new(cos * shot.azimuth.sin(), sin, cos * shot.azimuth.cos());
        // The same scale as on the screen that distances refer to, whatever the size of the picture.
        let fov = 2.0 * (0.5 * shot.size.y as f32 / z0()).atan();
        let settings = world.resource::<SubjectSettings>().0.clone();
        let projection =
            PerspectiveProjection { fov, near: (shot.distance * 0.01).min(0.1), ..default() };
        let camera = world.spawn((
            scene::plain_camera(),
            render_target(&image),
            Projection::Perspective(projection),
            Transform::from_translation(self.center + from * shot.distance)
                .looking_at(self.center, Vec3::Y),
            settings,
        ));
        let camera = camera.id();
        // Assets upload, near meshes warm up, counters come back.
        let frames = if technique == Technique::Crossfade { 7 } else { 4 };
        for _ in 0..frames {
            step(&mut self.app);
        }
        let picture = capture(&self.app, &image)?;
        let counters =
            self.app.world().resource::<TreelineCounters>().of(camera).unwrap_or_default();
        self.app.world_mut().despawn(camera);
        self.app.world_mut().resource_mut::<Assets<Image>>().remove(&image);
        if supersample == 1 {
            return Ok((picture, counters));
        }
        let pixels = box_downsample_linear(&picture, size.x, size.y, supersample)
            .map_err(|error| crate::options::ToolError::Message(error.to_string()))?;
        let small = RgbaImage::from_raw(shot.size.x, shot.size.y, pixels).unwrap_or_default();
        Ok((small, counters))
    }
}

#[derive(Resource, Clone)]
struct SubjectSettings(TreelineSettings);
