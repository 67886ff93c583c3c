//! One tree: as a mesh while the camera is near, as points while it is far.
//!
//! `cargo run --release --features app --example minimal` (`app` brings the window; in your game, Bevy's `bevy_winit` does).

use bevy::prelude::*;
use bevy_treeline::{TreeImpostor, TreelinePlugin, TreelineSettings};

fn main() {
    App::new()
        .add_plugins((DefaultPlugins, TreelinePlugin::default()))
        .add_systems(Startup, setup)
        .add_systems(Update, come_and_go)
        .run();
}

fn setup(
    mut commands: Commands,
    server: Res<AssetServer>,
    mut meshes: ResMut<Assets<Mesh>>,
    mut materials: ResMut<Assets<StandardMaterial>>,
) {
    // Any model will do. It is baked when it loads, in the background; the next start finds it in the cache.
    commands.spawn(TreeImpostor::new(server.load("trees/oak.glb")));
    commands.spawn((
        Mesh3d(meshes.add(Plane3d::default().mesh().size(200.0, 200.0))),
        MeshMaterial3d(materials.add(Color::srgb(0.32, 0.38, 0.22))),
    ));
    commands.spawn((
        DirectionalLight { shadow_maps_enabled: true, ..default() },
        Transform::from_xyz(2.0, 3.0, 1.0).looking_at(Vec3::ZERO, Vec3::Y),
    ));
    // Points are tested against each other, not antialiased: without MSAA they and meshes look alike.
    commands.spawn((Camera3d::default(), Msaa::Off, TreelineSettings::default()));
}

/// The camera swings between 12 and 90 metres, across the distance where mesh and points change.
fn come_and_go(time: Res<Time>, mut camera: Single<&mut Transform, With<Camera3d>>) {
    let distance = 51.0 - 39.0 * (0.4 * time.elapsed_secs()).cos();
    **camera = Transform::from_xyz(0.0, 3.0, distance).looking_at(Vec3::Y * 5.0, Vec3::Y);
}
