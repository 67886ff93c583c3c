//! Pictures: debug views, and fog computed by resolve instead of by Bevy.

mod common;

use bevy::{
    light::{CascadeShadowConfigBuilder, NotShadowCaster},
    prelude::*,
};
use bevy_treeline::{
    BakeSettings, DebugView, Forest, SplatPath, TreeAsset, TreeImpostor, TreeInstance,
    TreelineSettings,
    bake::{
        BakeContext, bake_model, near_mesh_sources,
        source::{SourceMaterial, SourceMesh, SourceModel},
    },
};
use common::{Stage, before, coverage, mean_color};
use image::RgbaImage;
use std::sync::Arc;

const SIZE: UVec2 = UVec2::new(96, 80);

fn settings(debug_view: DebugView) -> TreelineSettings {
    TreelineSettings { debug_view, ..default() }
}

/// Colours of the wholly covered pixels.
fn colors(picture: &RgbaImage) -> Vec<[u8; 3]> {
    picture.pixels().filter(|p| p[3] == 255).map(|p| [p[0], p[1], p[2]]).collect()
}

#[test]
fn every_debug_view_shows_what_it_is_named_for() {
    let Some(mut stage) = Stage::new("every_debug_view", SplatPath::Auto) else { return };
    let tree = stage.tree("oak", false);
    stage.world().spawn(TreeImpostor::new(tree));
    stage.light(Vec3::new(-0.5, -0.7, -0.5), false);
    let (camera, image) = stage.view(SIZE, before("oak", 70.0));
    let mut shot = |view: DebugView, distance: f32| {
        let place = before("oak", distance);
        stage.world().entity_mut(camera).insert((settings(view), place));
        let picture = stage.shoot(&image, 3);
        assert_eq!(stage.pipelines().1, Vec::<String>::new(), "{view:?}");
        picture
    };
    let plain = shot(DebugView::Off, 70.0);
    let mut seen = vec![plain.clone()];
    for view in [
        DebugView::PointsAndTriangles,
        DebugView::PrefixLength,
        DebugView::PointsPerPixel,
        DebugView::FadeBand,
        DebugView::Tiles,
        DebugView::SurfelNormals,
        DebugView::AmbientVisibility,
        DebugView::Albedo,
    ] {
        let picture = shot(view, 70.0);
        assert_eq!(coverage(&picture), coverage(&plain), "{view:?} changes what is covered");
        assert!(!seen.contains(&picture), "{view:?} looks like another");
        let found = colors(&picture);
        let all = |test: &dyn Fn(&[u8; 3]) -> bool| found.iter().all(test);
        let distinct = found.iter().collect::<std::collections::BTreeSet<_>>().len();
        let expected = match view {
            DebugView::PointsAndTriangles => all(&|c| *c == [255, 0, 0]),
            // No mesh, so no band.
            DebugView::FadeBand => all(&|c| c[0] == 0 && c[1] > 100 && c[2] == 0),
            DebugView::PrefixLength | DebugView::Tiles => distinct == 1,
            DebugView::PointsPerPixel => distinct > 1,
            DebugView::AmbientVisibility => all(&|c| c[0] == c[1] && c[1] == c[2]) && distinct > 20,
            DebugView::SurfelNormals | DebugView::Albedo => distinct > 20,
            DebugView::Off => false,
        };
        assert!(expected, "{view:?}: {distinct} colours, such as {:?}", &found[..4]);
        seen.push(picture);
    }
    // Farther away, fewer points: the colour goes from red to blue.
    let redness = |c: Vec3| c.x - c.z;
    let near = mean_color(&shot(DebugView::PrefixLength, 20.0));
    let far = mean_color(&shot(DebugView::PrefixLength, 260.0));
    assert!(redness(near) > redness(far) + 50.0, "{near} near, {far} far");
    // q = 2 points a pixel: green. Far away fewer, which is bluer.
    let green = mean_color(&shot(DebugView::PointsPerPixel, 40.0));
    assert!(green.y > 240.0 && green.x < 150.0 && green.z < 150.0, "{green}");
}

#[test]
fn near_meshes_turn_blue_and_back() {
    let Some(mut stage) = Stage::new("near_meshes_turn_blue", SplatPath::Auto) else { return };
    let tree = stage.tree("spruce", true);
    stage.world().spawn(TreeImpostor::new(tree));
    let ground = StandardMaterial { base_color: Color::WHITE, ..default() };
    stage.cuboid(Vec3::new(3.0, 3.0, 0.1), ground, Vec3::new(-6.0, 12.0, 0.0));
    stage.light(Vec3::new(-0.5, -0.7, -0.5), false);
    let (camera, image) = stage.view(SIZE, before("spruce", 15.0));
    let plain = stage.shoot(&image, 8);
    assert_eq!(stage.counters(camera).as_mesh, 1, "the tree is a mesh");
    stage.world().entity_mut(camera).insert(settings(DebugView::PointsAndTriangles));
    let blue = stage.shoot(&image, 5);
    let changed: Vec<_> = plain.pixels().zip(blue.pixels()).filter(|(a, b)| a != b).collect();
    assert!(changed.len() > 200, "{} pixels changed", changed.len());
    let is_blue = |p: &image::Rgba<u8>| p[2] > 100 && p[0] < 60 && p[1] < 60;
    assert!(changed.iter().all(|(_, b)| is_blue(b)), "the mesh is blue, and only the mesh");
    stage.world().entity_mut(camera).remove::<TreelineSettings>();
    assert!(stage.shoot(&image, 5) == plain, "materials come back");
}

#[test]
fn the_crossfade_band_is_orange() {
    let Some(mut stage) = Stage::new("the_crossfade_band", SplatPath::Auto) else { return };
    let tree = stage.tree("spruce", true);
    let trees = [(-3.0, 16.0), (20.0, 58.0)].map(|(x, d)| TreeInstance::at(Vec3::new(x, 0.0, -d)));
    stage.world().spawn(Forest::new([tree]).with(trees));
    stage.light(Vec3::NEG_Y, false);
    let place = Transform::from_xyz(0.0, 8.0, 0.0).looking_to(Vec3::NEG_Z, Vec3::Y);
    let (camera, image) = stage.view(SIZE, place);
    let band =
        TreelineSettings { fade_width: 0.6, fade_jitter: 0.0, ..settings(DebugView::FadeBand) };
    stage.world().entity_mut(camera).insert(band);
    let found = colors(&stage.shoot(&image, 8));
    assert_eq!(stage.counters(camera).in_fade, 1);
    let orange = found.iter().filter(|c| c[0] == 255 && c[1] > 100 && c[1] < 180 && c[2] == 0);
    let green = found.iter().filter(|c| c[0] == 0 && c[1] > 100 && c[2] == 0);
    let (orange, green) = (orange.count(), green.count());
    assert!(orange > 200 && green > 50, "{orange} orange pixels, {green} green");
}

/// A wall without light, as points and as the mesh they are made from, both hidden.
fn wall(stage: &mut Stage) -> (Entity, Entity) {
    let corners = [(-12.0, 0.0), (12.0, 0.0), (12.0, 6.0), (-12.0, 6.0)];
    let mesh = SourceMesh {
        // Seen at a slant, so that distances differ.
        positions: corners.map(|(x, y)| Vec3::new(x, y, 0.9 * x)).to_vec(),
        normals: vec![Vec3::new(-0.9, 0.0, 1.0).normalize(); 4],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        ..default()
    };
    let material = SourceMaterial {
        base_color: Vec4::new(0.02, 0.5, 0.02, 1.0),
        unlit: true,
        double_sided: true,
        ..default()
    };
    let model = SourceModel { meshes: vec![mesh], materials: vec![material], ..default() };
    let sources = near_mesh_sources(&model, true);
    let settings = BakeSettings { ldi_size: 512, ..default() };
    let center = model.bounds().center();
    let context = BakeContext::default();
    let baked = bake_model(Arc::new(model), None, &settings, &context, 0.0, &|_, _| ());
    let data = baked.expect("a wall bakes").data;
    let world = stage.world();
    let tree = world.resource_mut::<Assets<TreeAsset>>().add(TreeAsset { data, near_mesh: None });
    let points = world.spawn((TreeImpostor::new(tree), Visibility::Hidden)).id();
    let source = sources.into_iter().next().expect("it has one part");
    let mesh = world.resource_mut::<Assets<Mesh>>().add(source.mesh);
    let material = world.resource_mut::<Assets<StandardMaterial>>().add(source.material);
    let at = Transform::from_translation(center);
    // Points cast no shadows.
    let drawn = (Mesh3d(mesh), MeshMaterial3d(material), NotShadowCaster);
    let mesh = world.spawn((drawn, at, Visibility::Hidden)).id();
    (points, mesh)
}

/// Bevy fogs a plane of the same colour: the kinds of fog that resolve computes itself give the same.
#[test]
fn fog_of_points_is_bevys() {
    for (falloff, glow) in [
        (FogFalloff::Exponential { density: 0.02 }, false),
        (FogFalloff::Exponential { density: 0.02 }, true),
        (FogFalloff::ExponentialSquared { density: 0.02 }, false),
        (FogFalloff::ExponentialSquared { density: 0.02 }, true),
        (FogFalloff::Linear { start: 5.0, end: 80.0 }, true),
    ] {
        let Some(mut stage) = Stage::new("fog_of_points", SplatPath::Auto) else { return };
        // One model, as a mesh and as points, without light: what differs is fog.
        let (points, mesh) = wall(&mut stage);
        let sun = stage.light(Vec3::new(0.2, -0.1, 1.0), true);
        let cascades =
            CascadeShadowConfigBuilder { num_cascades: 1, maximum_distance: 80.0, ..default() };
        stage.world().entity_mut(sun).insert(cascades.build());
        // Takes the sun, and with it the glow, from a part of the wall.
        stage.cuboid(Vec3::new(6.0, 4.0, 1.0), default(), Vec3::new(-2.0, 5.0, -20.0));
        let place =
            Transform::from_xyz(2.0, 3.0, 30.0).looking_at(Vec3::new(0.0, 2.0, 0.0), Vec3::Y);
        let (camera, image) = stage.view(SIZE, place);
        let fog = DistanceFog {
            color: Color::srgba(0.5, 0.6, 0.8, 0.9),
            directional_light_color: if glow {
                Color::srgba(1.0, 0.8, 0.4, 0.7)
            } else {
                Color::NONE
            },
            directional_light_exponent: 8.0,
            falloff,
        };
        stage.world().entity_mut(camera).insert(fog);
        let mut shot = |shown: Option<Entity>| {
            for entity in [points, mesh] {
                let visible =
                    if shown == Some(entity) { Visibility::Visible } else { Visibility::Hidden };
                stage.world().entity_mut(entity).insert(visible);
            }
            stage.shoot(&image, 4)
        };
        let (a, b, without) = (shot(Some(points)), shot(Some(mesh)), shot(None));
        let both: Vec<_> = a
            .pixels()
            .zip(b.pixels())
            .zip(without.pixels())
            .filter(|((a, b), box_)| a[3] == 255 && b[3] == 255 && box_[3] == 0)
            .map(|(walls, _)| walls)
            .collect();
        assert!(both.len() > 500, "{} pixels show both", both.len());
        let is_equal =
            |a: &image::Rgba<u8>, b: &image::Rgba<u8>| (0..3).all(|c| a[c].abs_diff(b[c]) <= 1);
        let different = both.iter().filter(|(a, b)| !is_equal(a, b)).count();
        let reds: std::collections::BTreeSet<_> = both.iter().map(|(a, _)| a[0]).collect();
        println!(
            "glow {glow}: {different} of {} differ, red {:?} to {:?}",
            both.len(),
            reds.first(),
            reds.last()
        );
        assert!(reds.len() > 10, "there is fog, and more of it farther away");
        // A splat has one depth, so a shadow in the fog ends up to half a splat beside that of the mesh.
        let most = if glow { both.len() / 25 } else { 0 };
        assert!(different <= most, "{different} of {} pixels differ, glow {glow}", both.len());
    }
}
