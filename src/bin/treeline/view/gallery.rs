//! `treeline view --gallery`: all species in one picture, drawn as a game would draw them.

use super::ViewArgs;
use crate::{
    headless::{capture, headless_app, render_target, step, target},
    options::{ToolError, ToolResult, write_png},
    plant::Source,
    scene,
    sheet::contact_sheet,
};
use bevy::{camera::Projection, light::NotShadowCaster, prelude::*};
use bevy_treeline::{
    TreeImpostor, TreelineSettings, bake::Baked, math::image_error::box_downsample_linear,
    species::species_names,
};
use image::RgbaImage;

/// Side of a plant's picture in pixels, and how many times as many are rendered along it.
const CELL_PX: u32 = 360;
const SUPERSAMPLE: u32 = 2;
const COLUMNS: u32 = 5;
const FOV_Y: f32 = 0.42;
/// Above the horizon, radians.
const ELEVATION: f32 = 0.13;
const AZIMUTH: f32 = 0.35;
const SKY: Color = Color::srgb(0.90, 0.95, 1.0);
const GROUND: Color = Color::srgb(0.50, 0.51, 0.42);
/// Assets upload, near meshes warm up.
const WARM_UP_FRAMES: u32 = 7;

pub fn run(args: &ViewArgs) -> ToolResult {
    let (settings, context) = (args.bake.settings(), args.bake.context()?);
    let mut app = headless_app(args.splat_path.into())?;
    let world = app.world_mut();
    scene::add_light(world, 120.0);
    // Brighter from all sides than in the other scenes: forms matter here, not the time of day.
    world.insert_resource(GlobalAmbientLight { brightness: 1300.0, ..default() });
    let ground = world.resource_mut::<Assets<Mesh>>().add(Plane3d::default().mesh().size(1.0, 1.0));
    let material = world.resource_mut::<Assets<StandardMaterial>>().add(StandardMaterial {
        base_color: GROUND,
        perceptual_roughness: 1.0,
        reflectance: 0.0,
        ..default()
    });
    let ground = world.spawn((Mesh3d(ground), MeshMaterial3d(material), Transform::default())).id();
    // A sky that goes through the same tone mapping as the fog on the ground: no horizon between them.
    let dome = world.resource_mut::<Assets<Mesh>>().add(Sphere::new(0.4));
    let material = world.resource_mut::<Assets<StandardMaterial>>().add(StandardMaterial {
        base_color: SKY,
        unlit: true,
        cull_mode: None,
        ..default()
    });
    let dome = (Mesh3d(dome), MeshMaterial3d(material), Transform::default(), NotShadowCaster);
    let stage = [ground, world.spawn(dome).id()];

    let mut cells = vec![];
    for name in species_names() {
        let source = Source::plant(name, &args.plant)?;
        let baked = source.bake(&settings, &context)?;
        let picture = picture(&mut app, &baked, stage, args.quality)?;
        let (triangles, points) = (baked.data.statistics.triangles, baked.data.point_count());
        let height = baked.data.bounds.max.y;
        cells.push((format!("{name}, {height:.1} m\n{triangles} tri, {points} pts"), picture));
    }
    let path = args.out.join("gallery.png");
    write_png(&path, &contact_sheet(&cells, COLUMNS, CELL_PX))?;
    println!("{} species in {}", cells.len(), path.display());
    Ok(())
}

/// One plant on the ground before the sky, filling the picture.
fn picture(
    app: &mut App,
    baked: &Baked,
    stage: [Entity; 2],
    quality: f32,
) -> ToolResult<RgbaImage> {
    let bounds = baked.data.bounds;
    let extent = bounds.extent();
    let span = extent.y.max(extent.x.max(extent.z)) * 1.1;
    let distance = span * 0.5 / (0.5 * FOV_Y).tan() + 0.5 * extent.x.max(extent.z);
    let center = Vec3::Y * (bounds.max.y * 0.5);
    let size = CELL_PX * SUPERSAMPLE;
    let image = target(app, size, size);
    let world = app.world_mut();
    for entity in stage {
        world.entity_mut(entity).insert(Transform::from_scale(Vec3::splat(distance * 60.0)));
    }
    let tree = scene::add_tree(world, baked, true);
    let tree = world.spawn(TreeImpostor::new(tree)).id();
    let from = Vec3::new(
        ELEVATION.cos() * AZIMUTH.sin(),
        ELEVATION.sin(),
        ELEVATION.cos() * AZIMUTH.cos(),
    );
    let near = distance * 0.02;
    let projection = PerspectiveProjection { fov: FOV_Y, near, ..default() };
    // The ground fades into the sky: no horizon, however large the plant is.
    let fog = DistanceFog {
        color: SKY,
        falloff: FogFalloff::Linear { start: distance * 1.25, end: distance * 5.0 },
        ..default()
    };
    let camera = world.spawn((
        scene::plain_camera(),
        render_target(&image),
        Projection::Perspective(projection),
        fog,
        Transform::from_translation(center + from * distance).looking_at(center, Vec3::Y),
        TreelineSettings { quality, ..default() },
    ));
    let camera = camera.id();
    for _ in 0..WARM_UP_FRAMES {
        step(app);
    }
    let mut large = capture(app, &image)?;
    let world = app.world_mut();
    world.despawn(camera);
    world.despawn(tree);
    world.resource_mut::<Assets<Image>>().remove(&image);
    large.pixels_mut().for_each(|p| p[3] = 255);
    let pixels = box_downsample_linear(&large, size, size, SUPERSAMPLE)
        .map_err(|error| ToolError::Message(error.to_string()))?;
    Ok(RgbaImage::from_raw(CELL_PX, CELL_PX, pixels).unwrap_or_default())
}
