//! Light, sky and trees of the tool's scenes.

use bevy::{
    core_pipeline::tonemapping::{DebandDither, Tonemapping},
    light::{CascadeShadowConfigBuilder, DirectionalLightShadowMap, ShadowFilteringMethod},
    prelude::*,
};
use bevy_treeline::{
    TreeAsset,
    asset::{NearMesh, TreeData},
    bake::{Baked, near_mesh_sources, source::SourceModel},
};

/// Colour of the sky at the horizon.
pub const SKY: Color = Color::srgb(0.68, 0.79, 0.91);

/// A baked model as an asset, with or without the mesh for near.
pub fn add_tree(world: &mut World, baked: &Baked, with_mesh: bool) -> Handle<TreeAsset> {
    let near_mesh = with_mesh.then(|| {
        let mesh = add_near_mesh(world, baked);
        world.resource_mut::<Assets<NearMesh>>().add(mesh)
    });
    world.resource_mut::<Assets<TreeAsset>>().add(TreeAsset { data: baked.data.clone(), near_mesh })
}

/// The model's meshes and materials.
pub fn add_near_mesh(world: &mut World, baked: &Baked) -> NearMesh {
    near_mesh(world, &baked.model, &baked.data)
}

/// Meshes and materials of the model that `data` was baked from.
pub fn near_mesh(world: &mut World, model: &SourceModel, data: &TreeData) -> NearMesh {
    let parts = near_mesh_sources(model, data.is_shaded()).into_iter().map(|source| {
        let mut material = source.material;
        material.base_color_texture =
            source.texture.map(|texture| world.resource_mut::<Assets<Image>>().add(texture));
        bevy_treeline::asset::NearMeshPiece {
            mesh: world.resource_mut::<Assets<Mesh>>().add(source.mesh),
            material: world.resource_mut::<Assets<StandardMaterial>>().add(material),
            center: source.center,
            half_extents: source.half_extents,
        }
    });
    let parts = parts.collect();
    NearMesh { parts }
}

/// Sun and sky light. `shadow_distance` in metres; 0 for none.
pub fn add_light(world: &mut World, shadow_distance: f32) {
    world.insert_resource(GlobalAmbientLight {
        color: Color::srgb(0.78, 0.88, 1.0),
        brightness: 700.0,
        ..default()
    });
    world.insert_resource(DirectionalLightShadowMap { size: 2048 });
    let shadows = shadow_distance > 0.0;
    world.spawn((
        DirectionalLight {
            illuminance: 9_000.0,
            color: Color::srgb(1.0, 0.95, 0.86),
            shadow_maps_enabled: shadows,
            ..default()
        },
        CascadeShadowConfigBuilder {
            num_cascades: 2,
            maximum_distance: shadow_distance.max(1.0),
            first_cascade_far_bound: (shadow_distance * 0.25).max(0.5),
            ..default()
        }
        .build(),
        Transform::from_xyz(0.55, 0.75, 0.45).looking_at(Vec3::ZERO, Vec3::Y),
    ));
}

/// A camera whose pictures are the same each time: no dither, no multisampling.
pub fn plain_camera() -> impl Bundle {
    // The default Gaussian filter takes twice as long on software drivers and looks the same under leaves.
    let filter = ShadowFilteringMethod::Hardware2x2;
    (Camera3d::default(), Msaa::Off, Tonemapping::TonyMcMapface, DebandDither::Disabled, filter)
}
