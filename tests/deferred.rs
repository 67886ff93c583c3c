//! Near meshes in deferred views: they look as they do in forward views, and masked ones are drawn once.

mod common;

use bevy::{
    core_pipeline::{
        core_3d::AlphaMask3d,
        prepass::{DeferredPrepass, DepthPrepass},
    },
    pbr::DefaultOpaqueRendererMethod,
    prelude::*,
    render::{RenderApp, render_phase::ViewBinnedRenderPhases},
};
use bevy_treeline::{
    BakeSettings, SplatPath, TreeAsset, TreeImpostor,
    asset::{NearMesh, NearMeshPiece},
    bake::{
        BakeContext, bake_model, near_mesh_sources,
        source::{
            SourceAlpha, SourceImage, SourceMaterial, SourceMesh, SourceModel, SourceTexture,
            SourceWrap,
        },
    },
    forest::NearMeshPart,
};
use common::{Stage, mean_color};
use image::RgbaImage;
use std::sync::Arc;

const SIZE: UVec2 = UVec2::new(96, 80);
/// Frames until the mesh has taken the place of its points.
const FRAMES: u32 = 9;

/// Cards behind each other, a disc in each that its texture's alpha cuts out.
fn discs() -> SourceModel {
    let side = 32;
    let texel = |i: u32| {
        let place = Vec2::new((i % side) as f32, (i / side) as f32) + 0.5;
        [90, 160, 60, if place.distance(Vec2::splat(16.0)) < 10.0 { 255 } else { 0 }]
    };
    let image = SourceImage {
        width: side,
        height: side,
        rgba8: (0..side * side).flat_map(texel).collect(),
    };
    let texture = SourceTexture {
        image: 0,
        wrap: [SourceWrap::ClampToEdge; 2],
        nearest: false,
        uv_transform: Mat3::IDENTITY,
    };
    let material = SourceMaterial {
        base_color_texture: Some(texture),
        alpha: SourceAlpha::Mask(0.5),
        double_sided: true,
        is_leaf: true,
        ..default()
    };
    let card = |i: usize| {
        let origin = Vec3::new(0.3 * i as f32 - 1.6, 0.2 * i as f32, -0.4 * i as f32);
        [origin, origin + 2.0 * Vec3::X, origin + 2.0 * (Vec3::X + Vec3::Y), origin + 2.0 * Vec3::Y]
    };
    let normal = Vec3::new(0.3, 0.4, 1.0).normalize();
    let mesh = SourceMesh {
        positions: (0..4).flat_map(card).collect(),
        normals: vec![normal; 16],
        uvs: [Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y].repeat(4),
        triangles: (0..4)
            .flat_map(|i| [[0, 1, 2], [0, 2, 3]].map(|t| t.map(|k| k + 4 * i)))
            .collect(),
        ..default()
    };
    SourceModel { meshes: vec![mesh], materials: vec![material], images: vec![image], ..default() }
}

/// A stage with the discs and a sun that casts shadows, and its camera's picture.
fn planted(test: &str, deferred: bool) -> Option<(Stage, Entity, Handle<Image>)> {
    let mut stage = Stage::new(test, SplatPath::Auto)?;
    if deferred {
        stage.world().insert_resource(DefaultOpaqueRendererMethod::deferred());
    }
    stage.light(Vec3::new(-0.3, -0.5, -1.0), true);
    let model = discs();
    let sources = near_mesh_sources(&model, false);
    let settings = BakeSettings { ldi_size: 64, ambient_visibility: false, ..default() };
    let context = BakeContext::default();
    let baked = bake_model(Arc::new(model), None, &settings, &context, 0.0, &|_, _| ());
    let data = baked.expect("discs bake").data;
    let at = data.bounds.center() + Vec3::new(0.0, 0.0, 6.0);
    let world = stage.world();
    let parts = sources.into_iter().map(|source| {
        let mut material = source.material;
        material.base_color_texture =
            source.texture.map(|image| world.resource_mut::<Assets<Image>>().add(image));
        NearMeshPiece {
            mesh: world.resource_mut::<Assets<Mesh>>().add(source.mesh),
            material: world.resource_mut::<Assets<StandardMaterial>>().add(material),
            center: source.center,
            half_extents: source.half_extents,
        }
    });
    let near_mesh = NearMesh { parts: parts.collect() };
    let near_mesh = Some(world.resource_mut::<Assets<NearMesh>>().add(near_mesh));
    let tree = world.resource_mut::<Assets<TreeAsset>>().add(TreeAsset { data, near_mesh });
    world.spawn(TreeImpostor::new(tree));
    let (camera, image) = stage.view(SIZE, Transform::from_translation(at));
    let mut camera_entity = stage.world().entity_mut(camera);
    camera_entity.insert(DepthPrepass);
    if deferred {
        camera_entity.insert(DeferredPrepass);
    }
    Some((stage, camera, image))
}

/// The same light, but for what a deferred buffer rounds.
fn assert_alike(what: &str, forward: &RgbaImage, deferred: &RgbaImage) {
    let pairs = || forward.pixels().zip(deferred.pixels());
    assert!(pairs().all(|(a, b)| (a[3] > 0) == (b[3] > 0)), "{what}: other pixels are covered");
    let covered = pairs().filter(|(a, _)| a[3] > 0);
    let differences = covered.flat_map(|(a, b)| (0..3).map(|c| a[c].abs_diff(b[c])));
    let worst = differences.max().expect("something is drawn");
    assert!(worst <= 4, "{what}: a channel differs by {worst}");
}

#[test]
fn near_meshes_are_lit_as_in_forward_views() {
    type Change = fn(&mut Stage, Entity);
    let cases: [(&str, Change); 3] = [
        ("sun", |_, _| ()),
        ("a lamp", |stage, _| {
            let lamp = PointLight { intensity: 2e6, range: 40.0, ..default() };
            stage.world().spawn((lamp, Transform::from_xyz(2.0, 1.0, 3.0)));
        }),
        ("fog", |stage, camera| {
            let falloff = FogFalloff::ExponentialSquared { density: 0.1 };
            stage.world().entity_mut(camera).insert(DistanceFog { falloff, ..default() });
        }),
    ];
    let mut means = vec![];
    for (what, change) in cases {
        let mut pictures = vec![];
        for deferred in [false, true] {
            let Some((mut stage, camera, image)) = planted("near_meshes_are_lit", deferred) else {
                return;
            };
            change(&mut stage, camera);
            pictures.push(stage.shoot(&image, FRAMES));
            let parts = stage.world().query_filtered::<(), With<NearMeshPart>>();
            let world = stage.world();
            assert_eq!({ parts }.iter(world).count(), 1, "the tree is a mesh");
        }
        assert_alike(what, &pictures[0], &pictures[1]);
        means.push(mean_color(&pictures[1]));
    }
    assert!(means[0].distance(means[1]) > 5.0 && means[0].distance(means[2]) > 5.0, "{means:?}");
}

#[test]
fn masked_near_meshes_are_not_drawn_forward_as_well() {
    for (deferred, forward_draws) in [(false, 1), (true, 0)] {
        let Some((mut stage, _, _)) = planted("masked_near_meshes", deferred) else { return };
        stage.step(FRAMES);
        let render = stage.app.get_sub_app(RenderApp).expect("there is a renderer").world();
        let phases = render.resource::<ViewBinnedRenderPhases<AlphaMask3d>>();
        let draws = phases.values().filter(|phase| !phase.is_empty()).count();
        assert_eq!(draws, forward_draws, "deferred: {deferred}");
    }
}
