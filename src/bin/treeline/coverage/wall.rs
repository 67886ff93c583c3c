//! A wall of one tree, each turned another way, before an empty background: what coverage and light are measured on.
//!
//! The camera stands so far away that all trees are seen from the same direction; a distance is a number of pixels a
//! metre. So the truth is one picture, whatever the distance.

use crate::{
    headless::{capture, headless_app, render_target, step, target},
    options::ToolResult,
    scene,
};
use bevy::{camera::Projection, prelude::*};
use bevy_treeline::{
    Forest, SplatPath, TreeInstance, TreelineCounters, TreelineSettings, asset::NearMesh,
    bake::Baked, math::quantize::srgb8_to_linear,
};
use image::RgbaImage;

/// Above the horizon, radians: trees of a landscape are seen a little from above.
const ELEVATION: f32 = 0.17;
/// The camera's distance in halves of the wall's side.
const FAR: f32 = 24.0;

/// What is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Technique {
    Mesh,
    Points,
}

/// A picture of the wall.
pub struct Picture {
    /// Alpha is coverage.
    pub image: RgbaImage,
    /// Trees in it.
    pub trees: u32,
    /// Points drawn.
    pub points: u32,
    /// World units a pixel.
    pub unit: f32,
}

impl Picture {
    /// World units² of the screen that a tree covers.
    pub fn coverage(&self) -> f64 {
        let alpha: u64 = self.image.pixels().map(|p| u64::from(p[3])).sum();
        let unit = f64::from(self.unit);
        alpha as f64 / 255.0 * unit * unit / f64::from(self.trees)
    }

    /// Mean luminance of what is covered, linear light.
    pub fn luminance(&self) -> f64 {
        let table: [f64; 256] = std::array::from_fn(|b| f64::from(srgb8_to_linear(b as u8)));
        let (mut sum, mut weight) = (0.0, 0.0);
        for p in self.image.pixels().filter(|p| p[3] > 0) {
            let [r, g, b] = [p[0], p[1], p[2]].map(|byte| table[usize::from(byte)]);
            sum += 0.2126 * r + 0.7152 * g + 0.0722 * b;
            weight += 1.0;
        }
        if weight > 0.0 { sum / weight } else { 0.0 }
    }
}

/// An app in which walls are drawn.
pub struct Wall {
    app: App,
    near: NearMesh,
    tree: Handle<bevy_treeline::TreeAsset>,
    center: Vec3,
    /// Side of a tree's place in the wall, world units.
    pub cell: f32,
    settings: TreelineSettings,
}

impl Wall {
    pub fn new(
        baked: &Baked,
        splat_path: SplatPath,
        settings: TreelineSettings,
    ) -> ToolResult<Self> {
        let mut app = headless_app(splat_path)?;
        let world = app.world_mut();
        scene::add_light(world, 0.0);
        // Alpha 0 where nothing is drawn, so that pictures carry their coverage.
        world.insert_resource(ClearColor(Color::NONE));
        let near = scene::add_near_mesh(world, baked);
        let tree = scene::add_tree(world, baked, false);
        let bounds = baked.data.bounds;
        Ok(Self { app, near, tree, center: bounds.center(), cell: bounds.radius() * 2.0, settings })
    }

    /// Draws a wall of `side` × `side` trees, each in a cell of `cell_px` pixels.
    pub fn draw(&mut self, technique: Technique, side: u32, cell_px: f32) -> ToolResult<Picture> {
        let pixels = (cell_px * side as f32).ceil().max(1.0);
        let unit = self.cell / cell_px;
        let distance = FAR * 0.5 * unit * pixels;
        let view = Transform::from_rotation(Quat::from_rotation_x(-ELEVATION));
        let (right, up, back) = (*view.right(), *view.up(), *view.back());
        let trees: Vec<TreeInstance> = (0..side * side)
            .map(|i| {
                let (column, row) = ((i % side) as f32, (i / side) as f32);
                let middle = 0.5 * (side as f32 - 1.0);
                // Each at another part of a pixel (Roberts' R2 sequence), or all of a row would meet the grid alike.
                let offset = (Vec2::new(0.754_877_7, 0.569_840_3) * i as f32).fract() * unit;
                let place = (right * (column - middle) + up * (row - middle)) * self.cell
                    + right * offset.x
                    + up * offset.y;
                // Turned by the golden angle: even over any number of trees.
                let rotation = Quat::from_rotation_y(i as f32 * 2.399_963);
                TreeInstance { rotation, ..TreeInstance::at(place - rotation * self.center) }
            })
            .collect();
        let image = target(&mut self.app, pixels as u32, pixels as u32);
        let world = self.app.world_mut();
        let mut spawned = vec![];
        if technique == Technique::Points {
            spawned.push(world.spawn(Forest::new([self.tree.clone()]).with(trees)).id());
        } else {
            for tree in &trees {
                for part in &self.near.parts {
                    let at = tree.position + tree.rotation * self.center;
                    let bundle = (
                        Mesh3d(part.mesh.clone()),
                        MeshMaterial3d(part.material.clone()),
                        Transform::from_translation(at).with_rotation(tree.rotation),
                    );
                    spawned.push(world.spawn(bundle).id());
                }
            }
        }
        let fov = 2.0 * (1.0 / FAR).atan();
        let projection = PerspectiveProjection { fov, near: distance * 0.1, ..default() };
        let camera = world.spawn((
            scene::plain_camera(),
            render_target(&image),
            Projection::Perspective(projection),
            view.with_translation(back * distance),
            self.settings.clone(),
        ));
        let camera = camera.id();
        for _ in 0..4 {
            step(&mut self.app);
        }
        let picture = capture(&self.app, &image)?;
        let world = self.app.world_mut();
        let counters = world.resource::<TreelineCounters>().of(camera).unwrap_or_default();
        for entity in spawned.into_iter().chain([camera]) {
            world.despawn(entity);
        }
        world.resource_mut::<Assets<Image>>().remove(&image);
        Ok(Picture { image: picture, trees: side * side, points: counters.points, unit })
    }
}
