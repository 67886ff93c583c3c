//! Pictures: how points take light, shadow, fog and tint, and how much they cover.

mod common;

use bevy::{
    core_pipeline::tonemapping::Tonemapping, light::CascadeShadowConfigBuilder, prelude::*,
};
use bevy_treeline::{
    Forest, SplatPath, TreeImpostor, TreeInstance, TreelineSettings, lod::prefix_count,
    math::quantize::srgb8_to_linear,
};
use common::{Stage, baked, before, coverage, mean_color};

const SIZE: UVec2 = UVec2::new(96, 80);
const TREE: &str = "oak";

fn planted(test: &str, sun: Vec3, shadows: bool) -> Option<(Stage, Entity)> {
    let mut stage = Stage::new(test, SplatPath::Auto)?;
    let tree = stage.tree(TREE, false);
    let sun = stage.light(sun, shadows);
    let cascades =
        CascadeShadowConfigBuilder { num_cascades: 1, maximum_distance: 80.0, ..default() };
    stage.world().entity_mut(sun).insert(cascades.build());
    let tree = stage.world().spawn(TreeImpostor::new(tree)).id();
    Some((stage, tree))
}

#[test]
fn fog_takes_far_points_and_leaves_near_ones() {
    let Some((mut stage, _)) = planted("fog", Vec3::new(-0.5, -0.7, -0.5), false) else { return };
    let (camera, image) = stage.view(SIZE, before(TREE, 25.0));
    let fog = DistanceFog {
        color: Color::srgb(0.9, 0.2, 0.9),
        falloff: FogFalloff::Linear { start: 40.0, end: 100.0 },
        ..default()
    };
    let mut shot = |distance: f32, foggy: bool| {
        let mut camera = stage.world().entity_mut(camera);
        camera.insert(before(TREE, distance)).remove::<DistanceFog>();
        if foggy {
            camera.insert(fog.clone());
        }
        stage.shoot(&image, 3)
    };
    assert!(shot(25.0, true) == shot(25.0, false), "there is no fog up to 40 m");
    let lost = shot(120.0, true);
    let fog_color = mean_color(&lost);
    let uniform = lost
        .pixels()
        .filter(|p| p[3] == 255)
        .all(|p| (0..3).all(|c| (f32::from(p[c]) - fog_color[c]).abs() < 2.0));
    assert!(uniform, "beyond 100 m there is only fog");
    let (hazy, clear) = (mean_color(&shot(70.0, true)), mean_color(&shot(70.0, false)));
    let share = hazy.distance(fog_color) / clear.distance(fog_color);
    assert!((0.2..0.8).contains(&share), "half way {share} of the tree's own colour is left");
}

#[test]
fn a_box_above_the_tree_takes_its_sun() {
    let mut brightness = vec![];
    for (boxed, shadows) in [(false, true), (true, false), (true, true)] {
        let Some((mut stage, _)) = planted("a_box_above", Vec3::NEG_Y, shadows) else { return };
        if boxed {
            stage.cuboid(Vec3::new(24.0, 1.0, 24.0), default(), Vec3::Y * 32.0);
        }
        let (_, image) = stage.view(SIZE, before(TREE, 40.0));
        let picture = stage.shoot(&image, 4);
        // The box is above the picture.
        assert!((0..SIZE.x).all(|x| picture.get_pixel(x, 0)[3] == 0), "the box is in the picture");
        brightness.push(mean_color(&picture).element_sum());
    }
    let [sunny, unshadowed, dark] = brightness[..] else { return };
    assert!((unshadowed / sunny - 1.0).abs() < 0.01, "without shadow maps a box takes nothing");
    assert!(dark < 0.75 * sunny, "{dark} in the shadow, {sunny} in the sun");
}

#[test]
fn a_lamp_brightens_the_side_it_stands_on() {
    let Some((mut stage, _)) = planted("a_lamp", Vec3::NEG_Y, false) else { return };
    let (_, image) = stage.view(SIZE, before(TREE, 24.0));
    let without = stage.shoot(&image, 3);
    let middle = baked(TREE).data.bounds.center();
    let lamp = PointLight { intensity: 4e6, range: 60.0, shadow_maps_enabled: false, ..default() };
    let place = Transform::from_translation(middle + Vec3::new(9.0, 0.0, 6.0));
    stage.world().spawn((lamp, place));
    let with = stage.shoot(&image, 3);
    let half = |image: &image::RgbaImage, x: u32| {
        mean_color(&common::crop(image, UVec2::new(x, 0), UVec2::new(SIZE.x / 2, SIZE.y)))
            .element_sum()
    };
    let gain = |x| half(&with, x) / half(&without, x);
    let (left, right) = (gain(0), gain(SIZE.x / 2));
    assert!(right > 1.2 && right > left * 1.05, "×{left} on the left, ×{right} on the right");
    assert_eq!(coverage(&with), coverage(&without));
}

/// Mean and variance of the luminance of what is covered, linear light.
fn luminance(image: &image::RgbaImage) -> (f32, f32) {
    let linear = |p: &image::Rgba<u8>| {
        let [r, g, b] = [p[0], p[1], p[2]].map(srgb8_to_linear);
        0.2126 * r + 0.7152 * g + 0.0722 * b
    };
    let all: Vec<f32> = image.pixels().filter(|p| p[3] > 0).map(linear).collect();
    let mean = all.iter().sum::<f32>() / all.len() as f32;
    (mean, all.iter().map(|l| (l - mean) * (l - mean)).sum::<f32>() / all.len() as f32)
}

#[test]
fn contrast_correction_keeps_the_mean_and_lowers_the_variance() {
    for (distance, lowered) in [(300.0, 0.0..0.9), (60.0, 0.7..1.01)] {
        let Some(mut stage) = Stage::new("contrast", SplatPath::Auto) else { return };
        let tree = stage.tree(TREE, false);
        stage.light(Vec3::new(-0.5, -0.7, -0.5), false);
        // Turned every way: the mean is that of the tree, not of one side of it.
        let bounds = baked(TREE).data.bounds;
        let trees = (0..64).map(|i| {
            let rotation = Quat::from_rotation_y(i as f32 * 2.399_963);
            let place = Vec3::new((i % 8) as f32 - 3.5, (i / 8) as f32 - 3.5, 0.0);
            let middle = bounds.center() + place * 2.0 * bounds.radius();
            TreeInstance { rotation, ..TreeInstance::at(middle - rotation * bounds.center()) }
        });
        stage.world().spawn(Forest::new([tree]).with(trees));
        let (camera, image) = stage.view(SIZE * 4, before(TREE, distance));
        // What display takes is reckoned for Bevy's default.
        stage.world().entity_mut(camera).insert(Tonemapping::TonyMcMapface);
        let mut shot = |contrast: f32, samples: u32| {
            let settings = TreelineSettings { contrast, samples, ..default() };
            stage.world().entity_mut(camera).insert(settings);
            luminance(&stage.shoot(&image, 3))
        };
        let ((mean, variance), (corrected_mean, corrected)) = (shot(0.0, 1), shot(1.0, 1));
        let shift = corrected_mean / mean - 1.0;
        println!(
            "{distance} m: mean {:+.1} %, variance × {:.3}",
            shift * 100.0,
            corrected / variance
        );
        assert!(shift.abs() < 0.02, "{distance} m: the mean shifts by {shift}");
        let ratio = corrected / variance;
        assert!(lowered.contains(&ratio), "{distance} m: variance × {ratio}");
        // Samples average what the correction then leaves alone.
        let ((_, sampled), (_, both)) = (shot(0.0, 4), shot(1.0, 4));
        assert!(both / sampled > ratio - 0.02, "× {} with four samples", both / sampled);
    }
}

#[test]
fn a_tint_changes_the_colour_and_nothing_else() {
    let Some((mut stage, tree)) = planted("a_tint", Vec3::NEG_ONE, false) else { return };
    let (_, image) = stage.view(SIZE, before(TREE, 24.0));
    let plain = stage.shoot(&image, 3);
    stage.world().get_mut::<TreeImpostor>(tree).expect("it is there").tint = [255, 64, 128];
    let tinted = stage.shoot(&image, 3);
    let (a, b) = (mean_color(&plain), mean_color(&tinted));
    assert!(b.x > a.x * 1.1 && b.y < a.y * 0.85, "{a} became {b}");
    assert!((b.z / a.z - 1.0).abs() < 0.1, "{a} became {b}");
    assert_eq!(coverage(&plain), coverage(&tinted));
}

/// Both have the same ambient visibility, points in their surfels and meshes in their vertex colours.
#[test]
fn points_are_as_bright_as_the_mesh() {
    // Needles are thinner than a pixel of their LDI here (see `points_cover_what_the_mesh_covers`).
    for (name, tolerance) in [("oak", 0.04), ("birch", 0.04), ("spruce", 0.08)] {
        let sun = Vec3::new(-0.5, -0.7, -0.5);
        let Some((mut stage, tree)) = planted("as_bright_as_the_mesh", sun, false) else { return };
        let asset = stage.tree(name, false);
        stage.world().get_mut::<TreeImpostor>(tree).expect("it is there").tree = asset;
        let middle = baked(name).data.bounds.center();
        let parts = stage.near_mesh(name).parts;
        let parts: Vec<Entity> = parts
            .into_iter()
            .map(|part| {
                let drawn = (Mesh3d(part.mesh), MeshMaterial3d(part.material));
                let place = Transform::from_translation(middle);
                stage.world().spawn((drawn, place, Visibility::Hidden)).id()
            })
            .collect();
        let (_, image) = stage.view(SIZE * 2, before(name, 45.0));
        let brightness = |picture: &image::RgbaImage| mean_color(picture).element_sum();
        let points = brightness(&stage.shoot(&image, 3));
        let world = stage.world();
        world.entity_mut(tree).insert(Visibility::Hidden);
        parts.iter().for_each(|part| {
            world.entity_mut(*part).insert(Visibility::Visible);
        });
        let mesh = brightness(&stage.shoot(&image, 3));
        let error = points / mesh - 1.0;
        println!("{name}: points {:.1} % brighter than the mesh", error * 100.0);
        assert!(error.abs() < tolerance, "{name}: {error}");
        assert!(baked(name).data.is_shaded());
    }
}

#[test]
fn points_cover_what_the_mesh_covers() {
    let sun = Vec3::new(-0.5, -0.7, -0.5);
    // Needles are thinner than a pixel of the LDIs of the other tests, whose spruce covers 5 to 9 % too much (at 256
    // pixels 3 to 5 %). Half the picture's side in pixels, and samples of the mesh along each side of one.
    for (name, half, samples) in [("oak", 80, 3), ("birch", 80, 3), ("fine spruce", 272, 2)] {
        let Some((mut stage, tree)) = planted("points_cover", sun, false) else { return };
        let asset = stage.tree(name, false);
        stage.world().get_mut::<TreeImpostor>(tree).expect("it is there").tree = asset;
        let middle = baked(name).data.bounds.center();
        let parts = stage.near_mesh(name).parts;
        let parts: Vec<Entity> = parts
            .into_iter()
            .map(|part| {
                let bounds = bevy::camera::primitives::Aabb {
                    center: part.center.into(),
                    half_extents: part.half_extents.into(),
                };
                let place = Transform::from_translation(middle);
                let drawn = (Mesh3d(part.mesh), MeshMaterial3d(part.material), place, bounds);
                stage.world().spawn((drawn, Visibility::Hidden)).id()
            })
            .collect();
        // The screen of which `d0` is meant: 720 rows, 45°.
        let z0 = prefix_count::z0(720.0, 1.0 / 22.5f32.to_radians().tan());
        let d0 = prefix_count::d0(baked(name).data.pixel, z0);
        let projection =
            PerspectiveProjection { fov: 2.0 * (half as f32 / z0).atan(), ..default() };
        for times in [1.0, 2.0, 4.0] {
            // The same piece of that screen whatever the number of pixels.
            let mut shot = |azimuth: f32, size: u32, shown: &[Entity], hidden: &[Entity]| {
                let turn = Quat::from_rotation_y(azimuth) * Quat::from_rotation_x(-0.1);
                let eye = middle + turn * Vec3::Z * d0 * times;
                let place = Transform::from_translation(eye).looking_at(middle, Vec3::Y);
                let world = stage.world();
                for entity in shown {
                    world.entity_mut(*entity).insert(Visibility::Visible);
                }
                for entity in hidden {
                    world.entity_mut(*entity).insert(Visibility::Hidden);
                }
                let (camera, image) = stage.view(UVec2::splat(size), place);
                let projection = Projection::Perspective(projection.clone());
                stage.world().entity_mut(camera).insert(projection);
                let picture = stage.shoot(&image, 3);
                stage.world().despawn(camera);
                coverage(&picture) / (size * size) as f32
            };
            let (mut points, mut mesh) = (0.0, 0.0);
            for azimuth in [0.4, 2.3, 4.4] {
                let (p, m) = (
                    shot(azimuth, 2 * half, &[tree], &parts),
                    shot(azimuth, 2 * half * samples, &parts, &[tree]),
                );
                points += p;
                mesh += m;
            }
            let error = points / mesh - 1.0;
            println!("{name} at {times} d0: {:.1} %", error * 100.0);
            assert!(error.abs() < 0.05, "{name} at {times} d0: {error}");
        }
    }
}
