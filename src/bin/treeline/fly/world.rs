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
        BiomeSettings, Biomes, FlightPath, Heightfield, Scatter, ScatterSettings, ScatterSpecies,
        ScatteredTree, TreeAmount,
    },
};
use std::sync::Arc;

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

    // Models of any unit get the height asked for; the ground is in metres.
    let units: Vec<f32> = baked
        .iter()
        .map(|b| b.data.bounds.extent().y)
        .map(|height| if args.height > 0.0 && height > 0.0 { args.height / height } else { 1.0 })
        .collect();
    let settings = ScatterSettings {
        amount: TreeAmount::Total(args.count as u64),
        seed: args.seed,
        ..default()
    };
    let kinds = std::iter::zip(baked, &units).map(|(b, unit)| {
        let [x, y, z] = b.data.bounds.extent().to_array().map(|v| v * unit);
        ScatterSpecies::new("tree", y.max(0.1), (0.25 * (x + z)).max(0.1))
    });
    let biomes = BiomeSettings { seed: args.seed, ..default() };
    let biomes = biomes.for_trees(args.count as u64, args.side);
    let biomes = Arc::new(Biomes::new(&field, &biomes));
    let scatter = Scatter::new(Arc::new(field.clone()), biomes, kinds.collect(), settings)
        .map_err(|error| ToolError::Message(error.to_string()))?;
    let places: Vec<ScatteredTree> = scatter.tiles().flat_map(|t| scatter.tile(t)).collect();
    let trees = places.iter().map(|place| TreeInstance {
        position: place.position,
        rotation: place.rotation,
        scale: place.scale * units[usize::from(place.species)],
        species: place.species,
        tint: place.tint,
        seed: place.seed,
    });
    let species: Vec<_> = baked.iter().map(|b| scene::add_tree(world, b, true)).collect();
    let forest = Forest::new(species).with(trees);
    if !args.no_points {
        world.spawn((forest, Name::new("forest")));
    }
    world.insert_resource(Flight(FlightPath::over_forest(&field, &places, args.seed)));
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
