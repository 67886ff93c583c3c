//! A forest that is felled and replanted: trees are added, moved and removed while the game runs.
//!
//! `cargo run --release --features app --example edit_at_runtime`

use bevy::prelude::*;
use bevy_treeline::{Forest, TreeInstance, TreelinePlugin, math::hash::unit_from_bits};
use std::f32::consts::TAU;

/// Trees a side.
const ROW: usize = 120;
/// Metres between trees.
const SPACING: f32 = 6.0;

/// Felled every second: the trees nearest to here, then replanted.
#[derive(Component)]
struct Beaver;

fn main() {
    App::new()
        .add_plugins((DefaultPlugins, TreelinePlugin::default()))
        .insert_resource(ClearColor(Color::srgb(0.68, 0.79, 0.91)))
        .add_systems(Startup, setup)
        .add_systems(Update, (wander, gnaw, regrow).chain())
        .run();
}

fn setup(
    mut commands: Commands,
    server: Res<AssetServer>,
    mut meshes: ResMut<Assets<Mesh>>,
    mut materials: ResMut<Assets<StandardMaterial>>,
) {
    let middle = Vec3::new(1.0, 0.0, 1.0) * (ROW as f32 * 0.5);
    let trees = (0..ROW * ROW).map(|i| {
        let random = |what: usize| unit_from_bits((i * 3 + what) as u32);
        let cell = Vec3::new((i % ROW) as f32 + random(0), 0.0, (i / ROW) as f32 + random(1));
        TreeInstance::at((cell - middle) * SPACING).with_yaw(random(2) * TAU).with_scale(0.7)
    });
    commands.spawn(Forest::new([server.load("trees/birch.glb")]).with(trees));
    let side = ROW as f32 * SPACING;
    commands.spawn((
        Mesh3d(meshes.add(Plane3d::default().mesh().size(side, side))),
        MeshMaterial3d(materials.add(Color::srgb(0.25, 0.31, 0.16))),
    ));
    commands.spawn((
        Beaver,
        Mesh3d(meshes.add(Sphere::new(2.0))),
        MeshMaterial3d(materials.add(Color::srgb(0.5, 0.2, 0.1))),
        Transform::default(),
    ));
    commands.spawn((
        DirectionalLight::default(),
        Transform::from_xyz(2.0, 2.0, 1.0).looking_at(Vec3::ZERO, Vec3::Y),
    ));
    commands.spawn((
        Camera3d::default(),
        Msaa::Off,
        Transform::from_xyz(0.0, 160.0, 300.0).looking_at(Vec3::ZERO, Vec3::Y),
    ));
}

fn wander(time: Res<Time>, mut beaver: Single<&mut Transform, With<Beaver>>) {
    let t = time.elapsed_secs() * 0.3;
    beaver.translation = Vec3::new((1.3 * t).sin(), 0.01, (0.9 * t).cos()) * 180.0;
}

/// Removes what stands within 12 m. `swap_remove` is O(1) and puts the last tree in the gap, so we go backwards.
fn gnaw(beaver: Single<&Transform, With<Beaver>>, mut forest: Single<&mut Forest>) {
    let at = beaver.translation;
    let near = |tree: &TreeInstance| tree.position.distance(at) < 12.0;
    let felled: Vec<usize> =
        forest.iter().enumerate().filter(|(_, tree)| near(tree)).map(|(i, _)| i).collect();
    for index in felled.into_iter().rev() {
        forest.swap_remove(index);
    }
}

/// Plants a sapling anywhere four times a second, and lets one tree grow a little.
fn regrow(
    time: Res<Time>,
    mut forest: Single<&mut Forest>,
    mut last: Local<f32>,
    mut n: Local<u32>,
) {
    if time.elapsed_secs() - *last < 0.25 {
        return;
    }
    *last = time.elapsed_secs();
    *n += 1;
    let random = |what: u32| unit_from_bits(*n * 3 + what) - 0.5;
    let side = ROW as f32 * SPACING;
    let at = Vec3::new(random(0) * side, 0.0, random(1) * side);
    forest.push(TreeInstance::at(at).with_yaw(random(2) * TAU).with_scale(0.3));
    let index = forest.len() - 1;
    if let Some(tree) = forest.get(index.saturating_sub(40)) {
        forest.set(index.saturating_sub(40), tree.with_scale(tree.scale.max(0.65)));
    }
}
