//! What is flown over: ground, forest, sun, and the path.

use super::FlyArgs;
use crate::{
    options::{ToolError, ToolResult},
    scene,
};
use bevy::{
    asset::RenderAssetUsages,
    core_pipeline::prepass::{DepthPrepass, NormalPrepass},
    mesh::{Indices, PrimitiveTopology},
    prelude::*,
};
use bevy_treeline::{
    Forest, TreeInstance, TreelineSettings,
    bake::Baked,
    landscape::{
        BiomeSettings, Biomes, Crown, FlightPath, FlightSettings,
        heightfield::Heightfield,
        scatter::{ScatterSettings, scatter},
    },
};

/// The way of the camera.
#[derive(Resource)]
pub struct Flight(pub FlightPath);

/// Plants everything.
pub fn build(world: &mut World, args: &FlyArgs, baked: &[Baked]) -> ToolResult {
    let cells = ((args.side / 4.0) as u32).clamp(32, 512);
    let field = Heightfield::rolling(args.side, cells, args.seed);
    let ground = field.mesh_data();
    let mesh = Mesh::new(PrimitiveTopology::TriangleList, RenderAssetUsages::RENDER_WORLD)
        .with_inserted_attribute(Mesh::ATTRIBUTE_POSITION, ground.positions)
        .with_inserted_attribute(Mesh::ATTRIBUTE_NORMAL, ground.normals)
        .with_inserted_attribute(Mesh::ATTRIBUTE_COLOR, ground.colors)
        .with_inserted_indices(Indices::U32(ground.triangles.into_iter().flatten().collect()));
    let mesh = world.resource_mut::<Assets<Mesh>>().add(mesh);
    let soil = StandardMaterial { perceptual_roughness: 1.0, reflectance: 0.2, ..default() };
    let material = world.resource_mut::<Assets<StandardMaterial>>().add(soil);
    world.spawn((Mesh3d(mesh), MeshMaterial3d(material), Name::new("ground")));

    let settings =
        ScatterSettings { count: args.count, species: baked.len(), seed: args.seed, ..default() };
    let places =
        scatter(&field, &settings).map_err(|error| ToolError::Message(error.to_string()))?;
    // Models of any unit get the height asked for; the ground is in metres.
    let units: Vec<f32> = baked
        .iter()
        .map(|b| b.data.bounds.extent().y)
        .map(|height| if args.height > 0.0 && height > 0.0 { args.height / height } else { 1.0 })
        .collect();
    let trees = places.iter().map(|place| TreeInstance {
        position: place.position,
        rotation: Quat::from_rotation_y(place.yaw),
        scale: place.scale * units[place.species],
        species: place.species as u16,
        tint: [place.tint[0], place.tint[1], place.tint[2]].map(|t| t.div_ceil(2)),
        seed: place.seed,
    });
    let species: Vec<_> = baked.iter().map(|b| scene::add_tree(world, b, true)).collect();
    let forest = Forest::new(species).with(trees);
    if !args.no_points {
        world.spawn((forest, Name::new("forest")));
    }
    let biomes = Biomes::new(&field, &BiomeSettings { seed: args.seed, ..default() });
    let crowns = |min: Vec2, max: Vec2| {
        let inside = |p: Vec3| p.x >= min.x && p.x < max.x && p.z >= min.y && p.z < max.y;
        let near = places.iter().filter(|place| inside(place.position));
        near.map(|place| Crown {
            position: place.position,
            radius_m: 4.0 * place.scale,
            height_m: 16.0 * place.scale,
        })
        .collect()
    };
    let flight = FlightSettings { seed: args.seed, ..default() };
    world.insert_resource(Flight(FlightPath::over(&field, &biomes, &crowns, &flight)));
    world.insert_resource(ClearColor(scene::SKY));
    scene::add_light(world, 120.0);
    Ok(())
}

/// A camera with haze in the colour of the sky.
pub fn camera(args: &FlyArgs) -> impl Bundle {
    (
        scene::plain_camera(),
        // Trees behind hills and near meshes are rejected point by point, and hidden ground is not shaded.
        DepthPrepass,
        // A prepass of depth alone cannot dither, so meshes would not fade in.
        NormalPrepass,
        Projection::Perspective(PerspectiveProjection {
            fov: std::f32::consts::FRAC_PI_4 * 1.15,
            ..default()
        }),
        DistanceFog {
            color: scene::SKY,
            falloff: FogFalloff::from_visibility_squared(args.side * 1.6),
            ..default()
        },
        TreelineSettings {
            quality: args.quality,
            min_mesh_distance: args.mesh_distance,
            ..default()
        },
    )
}

/// Where the camera is at share `t` of the way.
pub fn place(flight: &Flight, t: f32) -> Transform {
    let (eye, target) = flight.0.look(t);
    Transform::from_translation(eye).looking_at(target, Vec3::Y)
}
