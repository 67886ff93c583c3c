//! Trees where a function says so: a forest on a hill of your own mesh, with a clearing cut into it.
//!
//! `cargo run --release --features app --example custom_scatter` (your game needs the feature `landscape` for this).

use bevy::{
    mesh::{Indices, VertexAttributeValues},
    prelude::*,
};
use bevy_treeline::{
    Forest, TreeInstance, TreelinePlugin,
    landscape::{MeshGround, scatter_on},
    math::hash::unit_from_bits,
};
use std::f32::consts::TAU;

/// Side of the ground, metres.
const SIDE: f32 = 400.0;

fn main() {
    App::new()
        .add_plugins((DefaultPlugins, TreelinePlugin::default()))
        .insert_resource(ClearColor(Color::srgb(0.68, 0.79, 0.91)))
        .add_systems(Startup, setup)
        .add_systems(Update, turn)
        .run();
}

/// Any mesh will do; this one is a plane with a hill.
fn hill() -> Mesh {
    let mut mesh = Plane3d::default().mesh().size(SIDE, SIDE).subdivisions(80).build();
    if let Some(VertexAttributeValues::Float32x3(at)) = mesh.attribute_mut(Mesh::ATTRIBUTE_POSITION)
    {
        for [x, y, z] in at {
            *y = 45.0 * (-(*x * *x + *z * *z) / 9000.0).exp();
        }
    }
    mesh.compute_smooth_normals();
    mesh
}

fn setup(
    mut commands: Commands,
    server: Res<AssetServer>,
    mut meshes: ResMut<Assets<Mesh>>,
    mut materials: ResMut<Assets<StandardMaterial>>,
) -> Result {
    let mesh = hill();
    let positions: Vec<Vec3> = match mesh.attribute(Mesh::ATTRIBUTE_POSITION) {
        Some(VertexAttributeValues::Float32x3(at)) => at.iter().copied().map(Vec3::from).collect(),
        _ => vec![],
    };
    let corners: Vec<u32> =
        mesh.indices().into_iter().flat_map(Indices::iter).map(|i| i as u32).collect();
    let triangles: Vec<[u32; 3]> = corners.chunks_exact(3).map(|t| [t[0], t[1], t[2]]).collect();
    let ground = MeshGround::new(&positions, &triangles)?;

    // Trees per square metre: none on steep ground or in the clearing, denser higher up.
    let density = |at: Vec3, normal: Vec3| {
        let in_clearing = at.xz().distance(Vec2::new(60.0, 20.0)) < 35.0;
        if in_clearing || normal.y < 0.8 { 0.0 } else { 0.01 + 0.001 * at.y }
    };
    let area = Rect::from_center_size(Vec2::ZERO, Vec2::splat(SIDE * 0.96));
    let places = scatter_on(&ground, area, density, 4.0, 7)?;
    info!("{} trees", places.len());
    let trees = places.iter().map(|place| {
        let random = |what: u32| unit_from_bits(place.random.wrapping_add(what));
        TreeInstance { seed: place.random as u8, ..TreeInstance::at(place.position) }
            .with_yaw(random(1) * TAU)
            .with_scale(0.6 + 0.5 * random(2))
    });
    commands.spawn(Forest::new([server.load("trees/oak.glb")]).with(trees));
    commands.spawn((
        Mesh3d(meshes.add(mesh)),
        MeshMaterial3d(materials.add(Color::srgb(0.25, 0.31, 0.16))),
    ));
    commands.spawn((
        DirectionalLight::default(),
        Transform::from_xyz(2.0, 2.0, 1.0).looking_at(Vec3::ZERO, Vec3::Y),
    ));
    commands.spawn((Camera3d::default(), Msaa::Off));
    Ok(())
}

fn turn(time: Res<Time>, mut camera: Single<&mut Transform, With<Camera3d>>) {
    let around = Quat::from_rotation_y(0.1 * time.elapsed_secs());
    **camera = Transform::from_translation(around * Vec3::new(0.0, 110.0, 260.0))
        .looking_at(Vec3::Y * 20.0, Vec3::Y);
}
