//! Antialiasing of points: what averages frames, and four samples a pixel, against many samples.

mod common;

#[cfg(feature = "app")]
use bevy::{anti_alias::taa::TemporalAntiAliasing, camera::Hdr};
use bevy::{camera::Viewport, prelude::*};
use bevy_treeline::{
    Forest, Occlusion, SplatPath, TemporalSampling, TreeInstance, TreelineSettings, TreelineTaa,
    math::image_error::box_downsample_linear,
};
use common::{Stage, crop, flip};
use image::RgbaImage;

const SIZE: UVec2 = UVec2::new(128, 80);
/// Frames until everything is loaded and the past is long enough.
const SETTLED: u32 = 40;
/// Side of a pixel of the truth in its samples.
const TRUTH: u32 = 4;

fn settings() -> TreelineSettings {
    // All points, so that the truth and the pictures differ in samples only.
    TreelineSettings { quality: 16.0, ..default() }
}

/// Trees before a blue sky, as points, and a place to look at them from.
fn grove(test: &str) -> Option<(Stage, Transform)> {
    let mut stage = Stage::new(test, SplatPath::Auto)?;
    stage.world().insert_resource(ClearColor(Color::srgb(0.5, 0.7, 0.9)));
    let species = ["oak", "birch"].map(|name| stage.tree(name, false));
    let trees = (0..12).map(|i| {
        let place = Vec3::new((i % 4) as f32 * 9.0 - 13.0, 0.0, (i / 4) as f32 * -14.0);
        TreeInstance { seed: i as u8, ..TreeInstance::at(place) }
            .with_yaw(i as f32)
            .with_species((i % 2) as u16)
    });
    stage.world().spawn(Forest::new(species).with(trees));
    stage.light(Vec3::new(-0.5, -0.7, -0.5), false);
    let place = Transform::from_xyz(0.0, 7.0, 32.0).looking_at(Vec3::Y * 5.0, Vec3::Y);
    Some((stage, place))
}

/// The picture with 16 samples a pixel of what `place` sees.
fn truth(stage: &mut Stage, place: Transform) -> RgbaImage {
    let (camera, image) = stage.view(SIZE * TRUTH, place);
    // The points of the small picture.
    let quality = settings().quality / (TRUTH * TRUTH) as f32;
    stage.world().entity_mut(camera).insert(TreelineSettings { quality, ..settings() });
    let large = stage.shoot(&image, 4);
    stage.world().despawn(camera);
    let small = box_downsample_linear(large.as_raw(), SIZE.x * TRUTH, SIZE.y * TRUTH, TRUTH);
    let small = small.expect("the picture has its size");
    RgbaImage::from_raw(SIZE.x, SIZE.y, small).expect("the size is right")
}

#[test]
fn four_samples_and_time_come_closer_to_the_truth() {
    let Some((mut stage, place)) = grove("four_samples_and_time") else { return };
    let truth = truth(&mut stage, place);
    let (camera, image) = stage.view(SIZE, place);
    stage.world().entity_mut(camera).insert(settings());
    let plain = flip(&truth, &stage.shoot(&image, 4));
    let four = TreelineSettings { samples: 4, ..settings() };
    stage.world().entity_mut(camera).insert(four);
    let samples = flip(&truth, &stage.shoot(&image, 4));
    stage.world().entity_mut(camera).insert((settings(), TreelineTaa::default()));
    let time = flip(&truth, &stage.shoot(&image, SETTLED));
    println!("FLIP: 1 sample {plain}, 4 samples {samples}, over time {time}");
    assert!(samples < 0.75 * plain, "4 samples: {samples}, 1 sample: {plain}");
    assert!(time < 0.7 * plain, "over time: {time}, 1 sample: {plain}");
}

/// Flies to `place` in some frames, and takes the picture of the last.
fn fly_to(
    stage: &mut Stage,
    camera: Entity,
    image: &Handle<Image>,
    place: Transform,
    frames: u32,
) -> RgbaImage {
    for left in (1..frames).rev() {
        let mut at = place;
        at.translation.z += 0.3 * left as f32;
        at.rotate_y(0.01 * left as f32);
        stage.world().entity_mut(camera).insert(at);
        stage.step(1);
    }
    stage.world().entity_mut(camera).insert(place);
    stage.shoot(image, 1)
}

#[test]
fn time_does_not_spoil_a_flight() {
    let Some((mut stage, place)) = grove("time_does_not_spoil") else { return };
    let truth = truth(&mut stage, place);
    let (camera, image) = stage.view(SIZE, place);
    stage.world().entity_mut(camera).insert(settings());
    let plain = flip(&truth, &stage.shoot(&image, 4));
    stage.world().entity_mut(camera).insert(TreelineTaa::default());
    // Frames of different jitter: a picture that moves with it is far off in some.
    for frames in [16, 17, 18, 19, 20] {
        let time = flip(&truth, &fly_to(&mut stage, camera, &image, place, frames));
        println!("FLIP: 1 sample {plain}, over time, in flight {time}");
        assert!(time < 0.75 * plain, "in flight: {time}, 1 sample: {plain}");
    }
}

#[test]
fn windows_show_other_points_in_each_of_eight_frames_and_then_the_same() {
    let Some((mut stage, place)) = grove("windows_show_other_points") else { return };
    let (camera, image) = stage.view(SIZE, place);
    // What a closed pyramid hides depends on the frame before.
    let windows = TreelineSettings {
        quality: 1.0,
        temporal: TemporalSampling::Windows,
        occlusion: Occlusion::Off,
        ..default()
    };
    stage.world().entity_mut(camera).insert(windows.clone());
    stage.step(4);
    let frames: Vec<RgbaImage> = (0..16).map(|_| stage.shoot(&image, 1)).collect();
    for i in 1..8 {
        assert!(frames[0] != frames[i], "frames 0 and {i} show the same points");
    }
    let next = stage.shoot(&image, 1);
    assert!(frames[0] == next, "the cycle is 16 frames long at most");
    let prefix = TreelineSettings { temporal: TemporalSampling::Prefix, ..windows };
    stage.world().entity_mut(camera).insert(prefix);
    let still = stage.shoot(&image, 1);
    assert!(still == stage.shoot(&image, 1), "prefixes are the same in every frame");
}

#[test]
fn a_reset_forgets_the_past() {
    let Some((mut stage, place)) = grove("a_reset_forgets") else { return };
    let (camera, image) = stage.view(SIZE, place);
    stage.world().entity_mut(camera).insert(TreelineTaa::default());
    stage.step(SETTLED);
    // A cut to the other side.
    let elsewhere = Transform::from_xyz(0.0, 7.0, -60.0).looking_at(Vec3::Y * 5.0, Vec3::Y);
    stage.world().entity_mut(camera).insert((elsewhere, TreelineTaa::default()));
    let after_cut = stage.shoot(&image, 1);
    let (alone, fresh) = stage.view(SIZE, elsewhere);
    stage
        .world()
        .entity_mut(alone)
        .insert(TreelineSettings { temporal: TemporalSampling::Windows, ..default() });
    let fresh = stage.shoot(&fresh, 1);
    // Other windows and jitter, but nothing of the other place.
    assert!(flip(&fresh, &after_cut) < 0.25, "FLIP {}", flip(&fresh, &after_cut));
    let taa = stage.app.world().get::<TreelineTaa>(camera).expect("it is there");
    assert!(!taa.reset, "a reset is for one frame");
}

#[test]
fn cameras_side_by_side_have_a_past_each() {
    let Some((mut stage, place)) = grove("cameras_side_by_side") else { return };
    let (camera, image) = stage.view(SIZE, place);
    stage.world().entity_mut(camera).insert(TreelineTaa::default());
    let alone = stage.shoot(&image, SETTLED);
    stage.world().despawn(camera);
    let both = stage.target(UVec2::new(2 * SIZE.x, SIZE.y));
    for side in 0..2 {
        let camera = stage.camera(&both, place);
        let physical_position = UVec2::new(side * SIZE.x, 0);
        let viewport = Viewport { physical_position, physical_size: SIZE, ..default() };
        stage.world().entity_mut(camera).insert(TreelineTaa::default());
        let mut settings = stage.world().get_mut::<Camera>(camera).expect("it is a camera");
        settings.order = side as isize;
        settings.viewport = Some(viewport);
    }
    let both = stage.shoot(&both, SETTLED);
    for side in 0..2 {
        let part = crop(&both, UVec2::new(side * SIZE.x, 0), SIZE);
        assert!(flip(&alone, &part) < 0.03, "camera {side}: FLIP {}", flip(&alone, &part));
    }
}

/// Bevy's own comes with the feature `app`.
#[cfg(feature = "app")]
#[test]
fn time_averages_high_dynamic_range_and_bevys_own_antialiasing_works() {
    let Some((mut stage, place)) = grove("time_averages_hdr") else { return };
    let (camera, image) = stage.view(SIZE, place);
    stage.world().entity_mut(camera).insert((TreelineTaa::default(), Hdr));
    let own = stage.shoot(&image, SETTLED);
    stage.world().entity_mut(camera).remove::<TreelineTaa>();
    stage.world().entity_mut(camera).insert(TemporalAntiAliasing::default());
    let bevy = stage.shoot(&image, SETTLED);
    assert!(flip(&own, &bevy) < 0.1, "FLIP {}", flip(&own, &bevy));
}

#[test]
fn pixels_covered_in_part_blend_with_what_is_behind() {
    let Some((mut stage, place)) = grove("pixels_covered_in_part") else { return };
    let red = StandardMaterial { base_color: Color::srgb(1.0, 0.0, 0.0), unlit: true, ..default() };
    stage.cuboid(Vec3::new(400.0, 400.0, 1.0), red, Vec3::Z * -80.0);
    let (camera, image) = stage.view(SIZE, place);
    stage.world().entity_mut(camera).insert(TreelineSettings { samples: 4, ..settings() });
    let picture = stage.shoot(&image, 4);
    // Between the tree's green and the wall's red: more than without samples, and none of the sky's blue.
    let mixed = |picture: &RgbaImage| {
        picture.pixels().filter(|p| (70..240).contains(&p[0]) && p[1] < p[0] && p[1] > 10).count()
    };
    let blue = picture.pixels().filter(|p| p[2] > 150).count();
    assert_eq!(blue, 0, "the clear colour shows through");
    stage.world().entity_mut(camera).insert(settings());
    let plain = stage.shoot(&image, 4);
    assert!(mixed(&picture) > 2 * mixed(&plain), "{} and {}", mixed(&picture), mixed(&plain));
}
