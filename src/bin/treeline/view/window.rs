//! The window of `treeline view`: the mesh on the left, what a game draws or the points alone on the right, one orbit
//! camera.

use crate::{headless::bevy_plugins, options::ToolResult, scene};
use bevy::{
    camera::{Projection, Viewport, visibility::RenderLayers},
    input::mouse::{AccumulatedMouseMotion, AccumulatedMouseScroll},
    prelude::*,
    render::{
        diagnostic::RenderDiagnosticsPlugin,
        view::screenshot::{Screenshot, save_to_disk},
    },
    window::PrimaryWindow,
};
use bevy_treeline::{
    CacheLocation, LodState, SplatPath, TreeImpostor, TreelinePlugin, TreelineSettings,
    asset::NearMesh, bake::Baked,
};
use std::path::{Path, PathBuf};

#[derive(Resource)]
struct Orbit {
    center: Vec3,
    distance: f32,
    azimuth: f32,
    elevation: f32,
}

#[derive(Resource)]
struct Shots(PathBuf);

#[derive(Component)]
enum Side {
    Mesh,
    Points,
}

#[derive(Component)]
struct Sample {
    crossfade: bool,
}

pub fn run(baked: &Baked, splat_path: SplatPath, quality: f32, out: &Path) -> ToolResult {
    println!(
        "drag: turn · wheel: distance · P: points only / as in a game · + and -: quality · F12: screenshot · Esc: quit"
    );
    let window =
        Window { title: "treeline view".into(), resolution: (1280, 720).into(), ..default() };
    let mut app = App::new();
    app.add_plugins((bevy_plugins(Some(window)), RenderDiagnosticsPlugin))
        .add_plugins(TreelinePlugin { splat_path, cache: CacheLocation::Off, ..default() });
    app.insert_resource(ClearColor(scene::SKY)).insert_resource(Shots(out.to_path_buf()));
    let world = app.world_mut();
    scene::add_light(world, 0.0);
    let center = baked.data.bounds.center();
    // Layer 1 is seen by the left camera only.
    let near: NearMesh = scene::add_near_mesh(world, baked);
    for part in &near.parts {
        world.spawn((
            Mesh3d(part.mesh.clone()),
            MeshMaterial3d(part.material.clone()),
            Transform::from_translation(center),
            bevy::camera::primitives::Aabb {
                center: part.center.into(),
                half_extents: part.half_extents.into(),
            },
            RenderLayers::layer(1),
        ));
    }
    for crossfade in [true, false] {
        let tree = scene::add_tree(world, baked, crossfade);
        let visibility = if crossfade { Visibility::Visible } else { Visibility::Hidden };
        world.spawn((TreeImpostor::new(tree), visibility, Sample { crossfade }));
    }
    let light_layers = RenderLayers::from_layers(&[0, 1]);
    let lights: Vec<Entity> =
        world.query_filtered::<Entity, With<DirectionalLight>>().iter(world).collect();
    for light in lights {
        world.entity_mut(light).insert(light_layers.clone());
    }
    let radius = baked.data.bounds.radius();
    world.insert_resource(Orbit { center, distance: radius * 2.6, azimuth: 0.4, elevation: 0.15 });
    let near_plane = radius * 0.01;
    for (order, side) in [Side::Mesh, Side::Points].into_iter().enumerate() {
        let mesh_side = matches!(side, Side::Mesh);
        world.spawn((
            scene::plain_camera(),
            Camera {
                order: order as isize,
                clear_color: if order == 0 {
                    ClearColorConfig::Default
                } else {
                    ClearColorConfig::None
                },
                ..default()
            },
            Projection::Perspective(PerspectiveProjection { near: near_plane, ..default() }),
            side,
            RenderLayers::layer(usize::from(mesh_side)),
            TreelineSettings { enabled: !mesh_side, quality, ..default() },
        ));
    }
    app.add_systems(Update, (turn, keys, split, title));
    app.run();
    Ok(())
}

fn turn(
    mut orbit: ResMut<Orbit>,
    buttons: Res<ButtonInput<MouseButton>>,
    motion: Res<AccumulatedMouseMotion>,
    scroll: Res<AccumulatedMouseScroll>,
    mut cameras: Query<&mut Transform, With<Side>>,
) {
    if buttons.pressed(MouseButton::Left) || buttons.pressed(MouseButton::Right) {
        orbit.azimuth -= motion.delta.x * 0.008;
        orbit.elevation = (orbit.elevation + motion.delta.y * 0.008).clamp(-1.5, 1.5);
    }
    // A wheel step is about one unit; touchpads send pixels.
    let steps = scroll.delta.y.clamp(-3.0, 3.0);
    orbit.distance *= (-0.12 * steps).exp();
    let (sin, cos) = orbit.elevation.sin_cos();
    let from = Vec3::new(cos * orbit.azimuth.sin(), sin, cos * orbit.azimuth.cos());
    for mut camera in &mut cameras {
        *camera = Transform::from_translation(orbit.center + from * orbit.distance)
            .looking_at(orbit.center, Vec3::Y);
    }
}

#[expect(clippy::too_many_arguments, reason = "a system's parameters are its dependencies")]
fn keys(
    mut commands: Commands,
    keys: Res<ButtonInput<KeyCode>>,
    shots: Res<Shots>,
    mut samples: Query<(&Sample, &mut Visibility)>,
    mut settings: Query<&mut TreelineSettings>,
    mut points_only: Local<bool>,
    mut count: Local<u32>,
    mut exit: MessageWriter<AppExit>,
) {
    if keys.just_pressed(KeyCode::KeyP) {
        *points_only = !*points_only;
        for (sample, mut visibility) in &mut samples {
            *visibility = if sample.crossfade == *points_only {
                Visibility::Hidden
            } else {
                Visibility::Visible
            };
        }
    }
    let step =
        i32::from(keys.just_pressed(KeyCode::Equal) || keys.just_pressed(KeyCode::NumpadAdd))
            - i32::from(
                keys.just_pressed(KeyCode::Minus) || keys.just_pressed(KeyCode::NumpadSubtract),
            );
    if step != 0 {
        for mut settings in &mut settings {
            settings.quality = (settings.quality * 1.25f32.powi(step)).clamp(0.05, 16.0);
        }
    }
    if keys.just_pressed(KeyCode::F12) {
        *count += 1;
        let path = shots.0.join(format!("view{:03}.png", *count));
        match std::fs::create_dir_all(&shots.0) {
            Ok(()) => {
                commands.spawn(Screenshot::primary_window()).observe(save_to_disk(path));
            }
            Err(error) => error!("no screenshot: cannot write {}: {error}", shots.0.display()),
        }
    }
    if keys.just_pressed(KeyCode::Escape) {
        exit.write(AppExit::Success);
    }
}

fn split(window: Single<&Window, With<PrimaryWindow>>, mut cameras: Query<(&mut Camera, &Side)>) {
    let size = window.physical_size();
    if size.x < 2 || size.y < 1 {
        return;
    }
    let half = size.x / 2;
    for (mut camera, side) in &mut cameras {
        let (left, width) = match side {
            Side::Mesh => (0, half),
            Side::Points => (half, size.x - half),
        };
        let viewport = Viewport {
            physical_position: UVec2::new(left, 0),
            physical_size: UVec2::new(width, size.y),
            ..default()
        };
        let same = |v: &Viewport| {
            v.physical_position == viewport.physical_position
                && v.physical_size == viewport.physical_size
        };
        if !camera.viewport.as_ref().is_some_and(same) {
            camera.viewport = Some(viewport);
        }
    }
}

fn title(
    mut window: Single<&mut Window, With<PrimaryWindow>>,
    trees: Query<(&LodState, &Visibility)>,
    settings: Query<&TreelineSettings>,
) {
    let Some((state, _)) = trees.iter().find(|(_, v)| **v == Visibility::Visible) else { return };
    let quality = settings.iter().find(|s| s.enabled).map_or(0.0, |s| s.quality);
    let title = format!(
        "treeline view: mesh | {} of {} points, mesh {:.0} %, distance {:.1} (d0 {:.1}), q {quality:.2}",
        state.points,
        state.points_baked,
        state.mesh * 100.0,
        state.distance,
        state.d0
    );
    if window.title != title {
        window.title = title;
    }
}
