//! Pictures against those in `tests/golden`. `UPDATE_GOLDEN=1` writes them anew: look at them before committing.

mod common;

use bevy::{
    core_pipeline::prepass::DepthPrepass,
    light::{CascadeShadowConfigBuilder, DirectionalLightShadowMap},
    prelude::*,
};
use bevy_treeline::{Forest, SplatPath, TreeImpostor, TreeInstance, math::hash::SplitMix64};
use common::{Stage, before, flip_map};
use image::RgbaImage;
use std::path::{Path, PathBuf};

const SIZE: UVec2 = UVec2::new(160, 120);
const SKY: Color = Color::srgb(0.68, 0.79, 0.91);
/// Mean FLIP error that drivers may differ by.
const TOLERANCE: f32 = 0.02;

/// Compares a picture with the golden one of that name, or writes it.
fn assert_golden(name: &str, picture: &RgbaImage) {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden").join(name);
    let file = file.with_extension("png");
    // Alpha is coverage here and of no use in a file.
    let mut picture = picture.clone();
    picture.pixels_mut().for_each(|pixel| pixel[3] = 255);
    if std::env::var("UPDATE_GOLDEN").as_deref() == Ok("1") {
        picture.save(&file).expect("the golden picture can be written");
        println!("wrote {}", file.display());
        return;
    }
    let golden = match image::open(&file) {
        Ok(golden) => golden.to_rgba8(),
        Err(error) => panic!("{}: {error}; make it with UPDATE_GOLDEN=1", file.display()),
    };
    let (error, map) = flip_map(&golden, &picture);
    if error > TOLERANCE {
        let out = PathBuf::from(env!("CARGO_TARGET_TMPDIR"));
        let (actual, difference) =
            (out.join(format!("{name}_actual.png")), out.join(format!("{name}_error.png")));
        picture.save(&actual).expect("the target folder can be written");
        map.save(&difference).expect("the target folder can be written");
        panic!(
            "FLIP {error} against {}: see {} and {}; if it is right, UPDATE_GOLDEN=1",
            file.display(),
            actual.display(),
            difference.display()
        );
    }
}

/// A stage under an open sky with sun and shadows.
fn outdoors(path: SplatPath) -> Option<Stage> {
    let mut stage = Stage::new("golden", path)?;
    let sun = stage.light(Vec3::new(-0.55, -0.75, -0.45), true);
    let cascades = CascadeShadowConfigBuilder {
        num_cascades: 2,
        maximum_distance: 120.0,
        first_cascade_far_bound: 30.0,
        ..default()
    };
    stage.world().entity_mut(sun).insert(cascades.build());
    stage.world().insert_resource(DirectionalLightShadowMap { size: 1024 });
    stage.world().insert_resource(ClearColor(SKY));
    Some(stage)
}

fn ground(stage: &mut Stage) {
    let color = Color::srgb(0.38, 0.36, 0.22);
    let soil = StandardMaterial { base_color: color, perceptual_roughness: 1.0, ..default() };
    stage.cuboid(Vec3::new(600.0, 1.0, 600.0), soil, Vec3::new(0.0, -0.5, -200.0));
}

fn one_tree(path: SplatPath) -> Option<RgbaImage> {
    let mut stage = outdoors(path)?;
    let tree = stage.tree("oak", false);
    stage.world().spawn(TreeImpostor::new(tree));
    let (_, image) = stage.view(SIZE, before("oak", 30.0));
    Some(stage.shoot(&image, 3))
}

fn forest(path: SplatPath) -> Option<RgbaImage> {
    let mut stage = outdoors(path)?;
    ground(&mut stage);
    let species = ["oak", "birch", "spruce"].map(|name| stage.tree(name, true));
    let mut random = SplitMix64(7);
    let trees = (0..200u32).map(|i| {
        // A jittered grid.
        let cell = Vec3::new((i % 16) as f32 * 7.0 - 52.0, 0.0, (i / 16) as f32 * -8.0 - 6.0);
        let jitter = Vec3::new(random.range(-2.5, 2.5), 0.0, random.range(-2.5, 2.5));
        TreeInstance {
            tint: std::array::from_fn(|_| random.range(115.0, 140.0) as u8),
            seed: random.below(256) as u8,
            ..TreeInstance::at(cell + jitter)
        }
        .with_yaw(random.range(-3.0, 3.0))
        .with_scale(random.range(0.38, 0.6))
        .with_species(random.below(3) as u16)
    });
    stage.world().spawn(Forest::new(species).with(trees));
    // A tower between sun and trees.
    let stone = StandardMaterial { base_color: Color::srgb(0.5, 0.47, 0.44), ..default() };
    stage.cuboid(Vec3::new(5.0, 36.0, 5.0), stone, Vec3::new(13.0, 0.0, -4.0));
    let place =
        Transform::from_xyz(2.0, 17.0, 22.0).looking_at(Vec3::new(0.0, 3.0, -22.0), Vec3::Y);
    let (camera, image) = stage.view(SIZE, place);
    let falloff = FogFalloff::from_visibility_squared(170.0);
    let fog = DistanceFog { color: SKY, falloff, ..default() };
    stage.world().entity_mut(camera).insert((DepthPrepass, fog));
    Some(stage.shoot(&image, 9))
}

fn crossfade_band() -> Option<RgbaImage> {
    let mut stage = outdoors(SplatPath::Auto)?;
    ground(&mut stage);
    let tree = stage.tree("spruce", true);
    // From meshes through the band (11 to 15 m) to points.
    for i in 0..6 {
        let (bearing, distance) = (i as f32 * 0.2 - 0.5, 10.8 + 1.1 * i as f32);
        let at = Vec3::new(bearing.sin(), 0.0, -bearing.cos()) * distance;
        let place = Transform::from_translation(at).with_scale(Vec3::splat(0.25));
        stage.world().spawn((TreeImpostor::new(tree.clone()), place));
    }
    let place =
        Transform::from_xyz(0.0, 3.65, 0.0).looking_to(Vec3::new(0.0, -0.05, -1.0), Vec3::Y);
    // Without a prepass: Bevy 0.19 tears holes into dithered meshes behind a `DepthPrepass` alone.
    let (_, image) = stage.view(SIZE, place);
    Some(stage.shoot(&image, 9))
}

#[test]
fn a_tree_looks_as_it_did() {
    if let Some(picture) = one_tree(SplatPath::Auto) {
        assert_golden("tree", &picture);
    }
}

#[test]
fn a_forest_in_fog_looks_as_it_did() {
    if let Some(picture) = forest(SplatPath::Auto) {
        assert_golden("forest", &picture);
    }
}

#[test]
fn the_crossfade_band_looks_as_it_did() {
    if let Some(picture) = crossfade_band() {
        assert_golden("crossfade_band", &picture);
    }
}

/// Against the same files, which it does not write.
#[test]
fn the_32_bit_path_looks_the_same() {
    if std::env::var("UPDATE_GOLDEN").as_deref() == Ok("1") {
        return;
    }
    if let (Some(tree), Some(forest)) = (one_tree(SplatPath::U32), forest(SplatPath::U32)) {
        assert_golden("tree", &tree);
        assert_golden("forest", &forest);
    }
}
