//! Two players, one forest: each camera has its own viewport and settings, the trees are there once.
//!
//! `cargo run --release --features app --example split_screen`

use bevy::{camera::Viewport, prelude::*, window::PrimaryWindow};
use bevy_treeline::{
    Forest, TreeInstance, TreelinePlugin, TreelineSettings, math::hash::unit_from_bits,
};
use std::f32::consts::TAU;

/// 0 on the left, 1 on the right.
#[derive(Component)]
struct Player(u32);

fn main() {
    App::new()
        .add_plugins((DefaultPlugins, TreelinePlugin::default()))
        .insert_resource(ClearColor(Color::srgb(0.68, 0.79, 0.91)))
        .add_systems(Startup, setup)
        .add_systems(Update, (split, walk))
        .run();
}

fn setup(
    mut commands: Commands,
    server: Res<AssetServer>,
    mut meshes: ResMut<Assets<Mesh>>,
    mut materials: ResMut<Assets<StandardMaterial>>,
) {
    let trees = (0..40_000u32).map(|i| {
        let random = |what: u32| unit_from_bits(i * 4 + what);
        let at = Vec3::new(random(0) - 0.5, 0.0, random(1) - 0.5) * 1800.0;
        TreeInstance::at(at).with_yaw(random(2) * TAU).with_species((random(3) * 2.0) as u16)
    });
    let species = [server.load("trees/oak.glb"), server.load("trees/birch.glb")];
    commands.spawn(Forest::new(species).with(trees));
    commands.spawn((
        Mesh3d(meshes.add(Plane3d::default().mesh().size(1800.0, 1800.0))),
        MeshMaterial3d(materials.add(Color::srgb(0.25, 0.31, 0.16))),
    ));
    commands.spawn((
        DirectionalLight::default(),
        Transform::from_xyz(2.0, 2.0, 1.0).looking_at(Vec3::ZERO, Vec3::Y),
    ));
    for player in 0..2 {
        // The right player looks more closely.
        let settings = TreelineSettings { quality: [1.0, 4.0][player as usize], ..default() };
        let clear_color =
            if player == 0 { ClearColorConfig::Default } else { ClearColorConfig::None };
        commands.spawn((
            Camera3d::default(),
            Camera { order: player, clear_color, ..default() },
            Msaa::Off,
            settings,
            Player(player as u32),
        ));
    }
}

/// Each camera has its half of the window, whatever its size.
fn split(window: Single<&Window, With<PrimaryWindow>>, mut cameras: Query<(&mut Camera, &Player)>) {
    let half = UVec2::new(window.physical_width() / 2, window.physical_height());
    if half.x == 0 || half.y == 0 {
        return; // Minimised.
    }
    for (mut camera, player) in &mut cameras {
        let physical_position = UVec2::new(player.0 * half.x, 0);
        let viewport = Viewport { physical_position, physical_size: half, ..default() };
        let same = camera
            .viewport
            .as_ref()
            .is_some_and(|v| v.physical_position == physical_position && v.physical_size == half);
        if !same {
            camera.viewport = Some(viewport);
        }
    }
}

/// The left player walks under the crowns, the right one flies above them.
fn walk(time: Res<Time>, mut cameras: Query<(&mut Transform, &Player)>) {
    for (mut camera, player) in &mut cameras {
        let high = player.0 as f32;
        let angle = time.elapsed_secs() * 0.02 * (1.0 + high);
        let at = |angle: f32| Vec3::new(angle.cos(), 0.0, angle.sin()) * 500.0;
        *camera = Transform::from_translation(at(angle) + Vec3::Y * (2.5 + 60.0 * high))
            .looking_at(at(angle + 0.3) + Vec3::Y * 3.0, Vec3::Y);
    }
}
