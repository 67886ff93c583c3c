//! Pictures: what points look like in every kind of view, beside meshes, under lights and in fog.

mod common;

use bevy::{
    camera::{Hdr, RenderTarget, Viewport},
    core_pipeline::prepass::DepthPrepass,
    prelude::*,
    render::render_resource::Extent3d,
};
use bevy_treeline::{Forest, SplatPath, TreeImpostor, TreeInstance, lod::prefix_count};
use common::{Stage, baked, before, coverage, crop, flip, mean_color};
use image::{Rgba, RgbaImage};

const SIZE: UVec2 = UVec2::new(96, 80);
const TREE: &str = "oak";
/// Sun from the upper right, behind the camera.
const SUN: Vec3 = Vec3::new(-0.5, -0.7, -0.5);
/// Frames until everything is loaded and drawn.
const LOADED: u32 = 3;

/// A stage with the tree at the origin, as points, and a light.
fn planted(test: &str) -> Option<(Stage, Entity)> {
    let mut stage = Stage::new(test, SplatPath::Auto)?;
    let tree = stage.tree(TREE, false);
    stage.light(SUN, false);
    let tree = stage.world().spawn(TreeImpostor::new(tree)).id();
    Some((stage, tree))
}

fn is_covered(pixel: &Rgba<u8>) -> bool {
    pixel[3] > 0
}

/// The smallest box around what is covered: first and last column and row.
fn covered_box(image: &RgbaImage) -> (UVec2, UVec2) {
    let covered = image.enumerate_pixels().filter(|(_, _, p)| is_covered(p));
    covered.fold((UVec2::MAX, UVec2::ZERO), |(low, high), (x, y, _)| {
        (low.min(UVec2::new(x, y)), high.max(UVec2::new(x, y)))
    })
}

/// Sixty trees of three species at many distances, from the side.
fn grove(stage: &mut Stage) -> Handle<Image> {
    let species = ["oak", "birch", "spruce"].map(|name| stage.tree(name, true));
    let trees = (0..60).map(|i| {
        let place = Vec3::new((i % 10) as f32 * 5.0 - 22.0, 0.0, (i / 10) as f32 * -11.0);
        TreeInstance { seed: (i * 11) as u8, ..TreeInstance::at(place) }
            .with_yaw(i as f32)
            .with_species((i % 3) as u16)
            .with_scale(0.7 + 0.05 * (i % 7) as f32)
    });
    let single = Transform::from_xyz(3.0, 0.0, 8.0);
    stage.world().spawn((TreeImpostor::new(species[1].clone()), single));
    stage.world().spawn(Forest::new(species).with(trees));
    stage.light(SUN, true);
    let place = Transform::from_xyz(0.0, 9.0, 25.0).looking_at(Vec3::new(0.0, 5.0, 0.0), Vec3::Y);
    stage.view(UVec2::new(160, 100), place).1
}

#[test]
fn two_runs_give_the_same_bytes() {
    let pictures: Vec<RgbaImage> = (0..2)
        .map_while(|_| {
            let mut stage = Stage::new("two_runs", SplatPath::Auto)?;
            let image = grove(&mut stage);
            Some(stage.shoot(&image, 8))
        })
        .collect();
    let [first, second] = &pictures[..] else { return };
    assert!(coverage(first) > 2000.0);
    assert!(first == second, "FLIP {}", flip(first, second));
}

#[test]
fn both_splat_paths_give_one_picture() {
    let pictures: Vec<RgbaImage> = [SplatPath::U64, SplatPath::U32]
        .into_iter()
        .map_while(|path| {
            let mut stage = Stage::new("both_splat_paths", path)?;
            let image = grove(&mut stage);
            Some(stage.shoot(&image, 8))
        })
        .collect();
    let [wide, narrow] = &pictures[..] else { return };
    assert!(flip(wide, narrow) <= 0.002, "FLIP {}", flip(wide, narrow));
    let differing = wide.pixels().zip(narrow.pixels()).filter(|(a, b)| a != b).count();
    println!("{differing} pixels differ");
}

#[test]
fn points_and_meshes_hide_each_other() {
    for prepass in [false, true] {
        let Some((mut stage, tree)) = planted("points_and_meshes") else { return };
        let (camera, image) = stage.view(SIZE, before(TREE, 24.0));
        if prepass {
            stage.world().entity_mut(camera).insert(DepthPrepass);
        }
        let red =
            StandardMaterial { base_color: Color::srgb(1.0, 0.0, 0.0), unlit: true, ..default() };
        let middle = baked(TREE).data.bounds.center();
        let cube = stage.cuboid(Vec3::splat(4.0), red, middle);
        let mut shot = |tree_shown: bool, cube_at: Option<f32>| {
            let shown = |on| if on { Visibility::Visible } else { Visibility::Hidden };
            stage.world().entity_mut(tree).insert(shown(tree_shown));
            let place = Transform::from_translation(middle + Vec3::Z * cube_at.unwrap_or_default());
            stage.world().entity_mut(cube).insert((shown(cube_at.is_some()), place));
            stage.shoot(&image, LOADED)
        };
        let alone = shot(true, None);
        for (z, cube_in_front) in [(9.0, true), (-9.0, false)] {
            let (cube, both) = (shot(false, Some(z)), shot(true, Some(z)));
            let (front, back) = if cube_in_front { (&cube, &alone) } else { (&alone, &cube) };
            let mut overlap = 0;
            for (x, y, pixel) in both.enumerate_pixels() {
                let (front, back) = (front.get_pixel(x, y), back.get_pixel(x, y));
                overlap += u32::from(is_covered(front) && is_covered(back));
                let expected = if is_covered(front) { front } else { back };
                assert_eq!(pixel, expected, "({x}, {y}), cube at {z}, prepass {prepass}");
            }
            assert!(overlap > 100, "they overlap in {overlap} pixels only");
        }
        // A cube inside the crown shows between the leaves before it, and hides those behind it.
        let (cube, both) = (shot(false, Some(0.0)), shot(true, Some(0.0)));
        let reds = cube.pixels().zip(both.pixels()).filter(|(cube, _)| is_covered(cube));
        let (kept, hidden): (Vec<_>, Vec<_>) = reds.partition(|(cube, both)| cube == both);
        assert!(
            kept.len() > 50 && hidden.len() > 50,
            "{} kept, {} hidden",
            kept.len(),
            hidden.len()
        );
    }
}

#[test]
fn a_viewport_shows_what_a_whole_target_would() {
    let Some((mut stage, _)) = planted("a_viewport") else { return };
    // Sides and corners that are no multiples of the blocks of pixels.
    let (origin, size) = (UVec2::new(37, 21), UVec2::new(99, 75));
    let place = before(TREE, 22.0);
    let (camera, whole) = stage.view(size, place);
    let whole = stage.shoot(&whole, LOADED);
    stage.world().despawn(camera);

    let (camera, image) = stage.view(UVec2::new(170, 130), place);
    let viewport = Viewport { physical_position: origin, physical_size: size, ..default() };
    stage.world().get_mut::<Camera>(camera).expect("it is a camera").viewport = Some(viewport);
    for prepass in [false, true] {
        if prepass {
            stage.world().entity_mut(camera).insert(DepthPrepass);
        }
        let part = stage.shoot(&image, LOADED);
        let inside = crop(&part, origin, size);
        assert!(
            flip(&whole, &inside) <= 0.002,
            "prepass {prepass}: FLIP {}",
            flip(&whole, &inside)
        );
        assert_eq!(coverage(&inside), coverage(&part), "nothing is drawn around the viewport");
        assert!(coverage(&part) > 500.0);
    }
}

#[test]
fn two_cameras_share_a_target_side_by_side() {
    let Some((mut stage, _)) = planted("two_cameras") else { return };
    let half = UVec2::new(75, 90);
    let middle = baked(TREE).data.bounds.center();
    let front = before(TREE, 22.0);
    let side = Transform::from_translation(middle + Vec3::X * 28.0).looking_at(middle, Vec3::Y);
    let alone = [front, side].map(|place| {
        let (camera, image) = stage.view(half, place);
        let picture = stage.shoot(&image, LOADED);
        stage.world().despawn(camera);
        picture
    });
    let image = stage.target(UVec2::new(2 * half.x, half.y));
    let cameras = [front, side].map(|place| stage.camera(&image, place));
    for (i, camera) in cameras.into_iter().enumerate() {
        let physical_position = UVec2::new(i as u32 * half.x, 0);
        let mut camera = stage.world().get_mut::<Camera>(camera).expect("it is a camera");
        camera.order = i as isize;
        camera.viewport = Some(Viewport { physical_position, physical_size: half, ..default() });
    }
    let both = stage.shoot(&image, LOADED);
    for (i, alone) in alone.iter().enumerate() {
        let part = crop(&both, UVec2::new(i as u32 * half.x, 0), half);
        assert!(coverage(&part) > 400.0);
        assert!(flip(alone, &part) <= 0.002, "camera {i}: FLIP {}", flip(alone, &part));
        assert_eq!(stage.counters(cameras[i]).covered_pixels, coverage(alone) as u32);
    }
}

#[test]
fn a_picture_follows_its_target_through_every_size() {
    let Some((mut stage, _)) = planted("every_size") else { return };
    let place = before(TREE, 22.0);
    let sizes = [UVec2::new(64, 48), UVec2::new(130, 77), UVec2::new(33, 90)];
    let fresh = sizes.map(|size| {
        let (camera, image) = stage.view(size, place);
        let picture = stage.shoot(&image, LOADED);
        stage.world().despawn(camera);
        picture
    });
    let (camera, image) = stage.view(UVec2::new(100, 100), place);
    stage.step(LOADED);
    // The target itself changes its size, as a window does.
    for (size, fresh) in sizes.iter().zip(&fresh) {
        let extent = Extent3d { width: size.x, height: size.y, depth_or_array_layers: 1 };
        let mut images = stage.world().resource_mut::<Assets<Image>>();
        images.get_mut(&image).expect("it is there").resize(extent);
        let picture = stage.shoot(&image, LOADED);
        assert!(flip(fresh, &picture) <= 0.002, "{size}: FLIP {}", flip(fresh, &picture));
    }
    // The camera gets another target.
    for (size, fresh) in sizes.iter().zip(&fresh) {
        let image = stage.target(*size);
        stage.world().entity_mut(camera).insert(RenderTarget::from(image.clone()));
        let picture = stage.shoot(&image, LOADED);
        assert!(flip(fresh, &picture) <= 0.002, "{size}: FLIP {}", flip(fresh, &picture));
    }
    // The viewport changes.
    let image = stage.target(UVec2::new(200, 120));
    stage.world().entity_mut(camera).insert(RenderTarget::from(image.clone()));
    for (size, fresh) in sizes.iter().zip(&fresh) {
        let viewport = Viewport { physical_size: *size, ..default() };
        stage.world().get_mut::<Camera>(camera).expect("it is a camera").viewport = Some(viewport);
        let picture = crop(&stage.shoot(&image, LOADED), UVec2::ZERO, *size);
        assert!(flip(fresh, &picture) <= 0.002, "{size}: FLIP {}", flip(fresh, &picture));
    }
}

#[test]
fn hdr_and_multisampling_draw_the_same_tree() {
    let Some((mut stage, _)) = planted("hdr_and_multisampling") else { return };
    let (camera, image) = stage.view(SIZE, before(TREE, 22.0));
    let plain = stage.shoot(&image, LOADED);
    let (color, covered) = (mean_color(&plain), coverage(&plain));
    for (hdr, msaa) in [(true, Msaa::Off), (false, Msaa::Sample4), (true, Msaa::Sample4)] {
        let mut camera = stage.world().entity_mut(camera);
        camera.insert(msaa).remove::<Hdr>();
        if hdr {
            camera.insert(Hdr);
        }
        let picture = stage.shoot(&image, LOADED);
        let change = (mean_color(&picture) - color).abs().max_element() / color.max_element();
        assert!(change < 0.03, "HDR {hdr}, {msaa:?}: mean colour changes by {change}");
        let change = (coverage(&picture) / covered - 1.0).abs();
        assert!(change < 0.05, "HDR {hdr}, {msaa:?}: coverage changes by {change}");
    }
}

#[test]
fn a_moved_turned_and_scaled_tree_looks_like_a_moved_camera() {
    let Some((mut stage, tree)) = planted("a_moved_tree") else { return };
    let (camera, image) = stage.view(SIZE, before(TREE, 24.0));
    let still = stage.shoot(&image, LOADED);

    // To the right: the picture moves by the pixels that perspective says.
    stage.world().entity_mut(tree).insert(Transform::from_xyz(2.0, 0.0, 0.0));
    let moved = stage.shoot(&image, LOADED);
    let (before_move, after) = (covered_box(&still), covered_box(&moved));
    let pixels = 2.0 * prefix_count::z0(SIZE.y as f32, 1.0 / (22.5f32).to_radians().tan()) / 24.0;
    let shift =
        after.0.as_vec2() + after.1.as_vec2() - before_move.0.as_vec2() - before_move.1.as_vec2();
    assert!(
        (shift * 0.5 - Vec2::new(pixels, 0.0)).abs().max_element() < 1.5,
        "{shift} / 2, not {pixels}"
    );

    // Tree and camera moved alike, and scaled about the origin.
    for (offset, scale) in [(Vec3::new(7.0, -3.0, 5.0), 1.0), (Vec3::ZERO, 3.0)] {
        let place = Transform::from_translation(offset).with_scale(Vec3::splat(scale));
        stage.world().entity_mut(tree).insert(place);
        let mut eye = before(TREE, 24.0);
        eye.translation = eye.translation * scale + offset;
        stage.world().entity_mut(camera).insert(eye);
        let picture = stage.shoot(&image, LOADED);
        assert!(flip(&still, &picture) < 0.01, "{place:?}: FLIP {}", flip(&still, &picture));
    }

    // Without sun, a turned tree is what a camera sees that went round it the other way.
    stage.world().entity_mut(tree).insert(Transform::from_rotation(Quat::from_rotation_y(0.8)));
    let suns: Vec<Entity> = stage
        .world()
        .query_filtered::<Entity, With<DirectionalLight>>()
        .iter(stage.app.world())
        .collect();
    for sun in suns {
        stage.world().despawn(sun);
    }
    let eye = Vec3::new(0.0, 6.0, 24.0);
    let look = |eye: Vec3| Transform::from_translation(eye).looking_at(Vec3::Y * 6.0, Vec3::Y);
    stage.world().entity_mut(camera).insert(look(eye));
    let turned = stage.shoot(&image, LOADED);
    stage.world().entity_mut(tree).insert(Transform::default());
    stage.world().entity_mut(camera).insert(look(Quat::from_rotation_y(-0.8) * eye));
    let walked = stage.shoot(&image, LOADED);
    assert!(flip(&walked, &turned) < 0.003, "FLIP {}", flip(&walked, &turned));
    stage.world().entity_mut(camera).insert(look(eye));
    let other_side = stage.shoot(&image, LOADED);
    assert!(flip(&walked, &other_side) > 0.01, "a turn shows");
}

#[test]
fn a_forest_that_moves_is_a_single_tree_that_moves() {
    let Some((mut stage, tree)) = planted("a_forest_that_moves") else { return };
    let (_, image) = stage.view(SIZE, before(TREE, 26.0));
    let place = Transform::from_xyz(-2.0, 1.0, 3.0)
        .with_rotation(Quat::from_rotation_y(1.0) * Quat::from_rotation_x(0.2))
        .with_scale(Vec3::splat(0.8));
    let local = TreeInstance::at(Vec3::new(1.0, 0.5, -2.0)).with_yaw(0.7).with_scale(1.2);
    let inner = Transform::from_translation(local.position)
        .with_rotation(local.rotation)
        .with_scale(Vec3::splat(local.scale));
    stage.world().entity_mut(tree).insert(place * inner);
    let single = stage.shoot(&image, LOADED);
    let asset = stage.world().entity_mut(tree).take::<TreeImpostor>().expect("it is there").tree;
    let forest =
        stage.world().spawn((Forest::new([asset]).with([local]), Transform::default())).id();
    stage.step(LOADED);
    stage.world().entity_mut(forest).insert(place);
    let picture = stage.shoot(&image, LOADED);
    assert!(coverage(&single) > 300.0);
    assert!(flip(&single, &picture) < 0.01, "FLIP {}", flip(&single, &picture));
}

/// A blue sky behind a red wall: blue pixels are holes in both.
#[test]
fn a_tree_in_the_crossfade_band_has_no_holes_behind_a_depth_prepass() {
    for prepass in [false, true] {
        let Some(mut stage) = Stage::new("no_holes", SplatPath::Auto) else { return };
        stage.world().insert_resource(ClearColor(Color::srgb(0.0, 0.0, 1.0)));
        let red =
            StandardMaterial { base_color: Color::srgb(1.0, 0.0, 0.0), unlit: true, ..default() };
        stage.cuboid(Vec3::new(100.0, 100.0, 1.0), red, Vec3::Z * -20.0);
        let tree = stage.tree(TREE, true);
        stage.world().spawn((TreeImpostor::new(tree), Transform::from_scale(Vec3::splat(0.5))));
        stage.light(SUN, false);
        for distance in [13.6, 14.2, 14.8] {
            let middle = baked(TREE).data.bounds.center() * 0.5;
            let place = Transform::from_translation(middle + Vec3::Z * distance);
            let (camera, image) = stage.view(SIZE, place.looking_at(middle, Vec3::Y));
            if prepass {
                stage.world().entity_mut(camera).insert(DepthPrepass);
            }
            let picture = stage.shoot(&image, 9);
            assert_eq!(stage.counters(camera).in_fade, 1);
            let holes = picture.pixels().filter(|p| p[2] > 200 && p[0] < 50).count();
            assert_eq!(holes, 0, "at {distance}, prepass {prepass}");
            stage.world().despawn(camera);
        }
    }
}
