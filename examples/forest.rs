//! 100,489 trees from one model, without an entity each.
//!
//! `cargo run --release --features app --example forest` (`app` brings the window; in your game, Bevy's `bevy_winit` does).

use bevy::{core_pipeline::prepass::DepthPrepass, prelude::*};
use bevy_treeline::{
    Forest, TreeInstance, TreelineCounters, TreelinePlugin, TreelineSettings,
    math::hash::unit_from_bits,
};
use std::f32::consts::TAU;

/// Trees a row, and rows.
const ROW: u32 = 317;
const TREES: u32 = ROW * ROW;
/// Metres a tree.
const SPACING: f32 = 9.0;
const SIDE: f32 = ROW as f32 * SPACING;

fn main() {
    App::new()
        .add_plugins((DefaultPlugins, TreelinePlugin::default()))
        .insert_resource(ClearColor(Color::srgb(0.68, 0.79, 0.91)))
        .insert_resource(GlobalAmbientLight { brightness: 600.0, ..default() })
        .add_systems(Startup, setup)
        .add_systems(Update, (fly, report))
        .run();
}

/// One tree in each cell of a grid, anywhere in it.
fn tree(i: u32) -> TreeInstance {
    let random = |what: u32| unit_from_bits(i * 5 + what);
    let cell = Vec3::new((i % ROW) as f32 + random(0), 0.0, (i / ROW) as f32 + random(1));
    TreeInstance {
        // Decides, within its range, where this tree changes between mesh and points: no ring sweeps the forest.
        seed: (random(2) * 256.0) as u8,
        ..TreeInstance::at((cell - Vec3::new(ROW as f32, 0.0, ROW as f32) * 0.5) * SPACING)
    }
    .with_yaw(random(3) * TAU)
    .with_scale(0.7 + 0.6 * random(4))
}

fn setup(
    mut commands: Commands,
    server: Res<AssetServer>,
    mut meshes: ResMut<Assets<Mesh>>,
    mut materials: ResMut<Assets<StandardMaterial>>,
) {
    // More species: more handles here, and `with_species` on the trees.
    let species = [server.load("trees/oak.glb")];
    commands.spawn(Forest::new(species).with((0..TREES).map(tree)));
    commands.spawn((
        Mesh3d(meshes.add(Plane3d::default().mesh().size(SIDE, SIDE))),
        MeshMaterial3d(materials.add(Color::srgb(0.25, 0.31, 0.16))),
    ));
    commands.spawn((
        DirectionalLight { shadow_maps_enabled: true, ..default() },
        Transform::from_xyz(2.0, 3.0, 1.0).looking_at(Vec3::ZERO, Vec3::Y),
    ));
    // A point per pixel of surface, as in the paper: half of the default. The depth prepass lets points behind meshes
    // be rejected before they are drawn.
    let settings = TreelineSettings { quality: 1.0, ..default() };
    commands.spawn((Camera3d::default(), Msaa::Off, DepthPrepass, settings));
}

/// Once around the forest in two minutes, above the crowns.
fn fly(time: Res<Time>, mut camera: Single<&mut Transform, With<Camera3d>>) {
    let at = |angle: f32| Vec3::new(angle.cos(), 0.0, angle.sin()) * 0.35 * SIDE;
    let angle = time.elapsed_secs() * TAU / 120.0;
    **camera = Transform::from_translation(at(angle) + Vec3::Y * 28.0)
        .looking_at(at(angle + 0.2) + Vec3::Y * 5.0, Vec3::Y);
}

/// What the GPU drew, once a second.
fn report(time: Res<Time>, counters: Res<TreelineCounters>, mut last: Local<f32>) {
    if time.elapsed_secs() - *last < 1.0 {
        return;
    }
    *last = time.elapsed_secs();
    for c in counters.all().values() {
        info!(
            "{} of {TREES} trees in view, {} million points",
            c.instances_seen - c.culled_frustum,
            c.points / 1_000_000
        );
    }
}
