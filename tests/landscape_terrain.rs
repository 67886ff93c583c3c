//! The ground of a landscape, drawn: no holes, the same picture twice, and pictures to look at.
#![cfg(feature = "landscape")]

mod common;

use bevy::{
    core_pipeline::prepass::{DepthPrepass, NormalPrepass},
    pbr::DistanceFog,
    prelude::*,
};
use bevy_treeline::{
    SplatPath,
    landscape::{
        BiomeSettings, Biomes, Ground, NoiseTerrain, TerrainSettings, TimeOfDay,
        draw::{Landscape, Sky, SkyKind, Sun, TerrainCounters, TerrainLod, TerrainPlugin},
    },
};
use common::Stage;
use std::{fs, sync::Arc, time::Instant};

/// A stage with ground; the eye is put where asked.
fn scene(test: &str, side_m: f32, sky: Sky) -> Option<(Stage, Arc<NoiseTerrain>)> {
    let add = |app: &mut App| {
        app.add_plugins(TerrainPlugin);
    };
    let mut stage = Stage::with(test, SplatPath::Auto, add)?;
    let settings = TerrainSettings { side_m, ..default() };
    let ground = Arc::new(NoiseTerrain::new(&settings).expect("the settings are good"));
    let biomes = Arc::new(Biomes::new(&*ground, &BiomeSettings::default()));
    stage.app.insert_resource(Landscape::new(ground.clone(), biomes));
    stage.app.insert_resource(TerrainLod { wait: true, ..default() });
    stage.app.insert_resource(sky);
    stage.world().spawn(Sun);
    Some((stage, ground))
}

/// At `up` metres over the ground at (x, z), looking along `yaw` and `pitch` in degrees.
fn place(ground: &dyn Ground, [x, z, up, yaw, pitch]: [f32; 5]) -> Transform {
    let y = ground.height(x, z).max(ground.water_level().unwrap_or(f32::MIN)) + up;
    let turn = Quat::from_euler(EulerRot::YXZ, yaw.to_radians(), pitch.to_radians(), 0.0);
    Transform::from_xyz(x, y, z).with_rotation(turn)
}

#[test]
fn the_ground_has_no_holes_and_is_the_same_every_time() {
    let sky = Sky { kind: SkyKind::None, drives_lights: true, ..default() };
    let Some((mut stage, ground)) = scene("landscape_terrain::holes", 4096.0, sky) else { return };
    let size = UVec2::new(160, 90);
    for look in [[0.0, 0.0, 60.0, 30.0, -35.0], [-700.0, 500.0, 300.0, 200.0, -50.0]] {
        let at = place(&*ground, look);
        let (camera, image) = stage.view(size, at);
        stage.world().resource_mut::<ClearColor>().0 = Color::srgb(1.0, 0.0, 1.0);
        let picture = stage.shoot(&image, 6);
        stage.world().resource_mut::<ClearColor>().0 = Color::srgb(1.0, 0.0, 1.0);
        let picture_again = stage.shoot(&image, 2);
        assert_eq!(picture.as_raw(), picture_again.as_raw(), "{look:?}: the same twice");
        let holes = picture
            .enumerate_pixels()
            .filter(|(_, y, p)| *y > 4 && p[0] > 200 && p[1] < 60 && p[2] > 200)
            .count();
        assert_eq!(holes, 0, "{look:?}: pixels of the clear colour");
        let counters = *stage.world().resource::<TerrainCounters>();
        assert!(counters.pending == 0 && counters.triangles <= 300_000, "{counters:?}");
        stage.world().despawn(camera);
    }
}

#[test]
#[ignore = "writes pictures to look at: LOOK=\"x z up yaw pitch hour; ..\" LOOK_SIZE=\"1280 720\" LOOK_SIDE=16384 LOOK_OUT=folder"]
fn pictures_to_look_at() {
    let env = |name: &str, otherwise: &str| std::env::var(name).unwrap_or(otherwise.into());
    let numbers = |text: &str| -> Vec<f32> {
        text.split_whitespace().map(|n| n.parse().expect("a number")).collect()
    };
    let side = numbers(&env("LOOK_SIDE", "16384"))[0];
    let size = numbers(&env("LOOK_SIZE", "1280 720"));
    let frames = numbers(&env("LOOK_FRAMES", "0"))[0] as u32;
    let prepass = env("LOOK_PREPASS", "none");
    let kind = if env("LOOK_SKY", "1") == "1" { SkyKind::Gradient } else { SkyKind::None };
    let out = env("LOOK_OUT", "/tmp");
    let sky = Sky { kind, ..default() };
    let Some((mut stage, ground)) = scene("landscape_terrain::look", side, sky) else { return };
    let image = stage.target(UVec2::new(size[0] as u32, size[1] as u32));
    let camera = stage.camera(&image, Transform::default());
    let projection = PerspectiveProjection { fov: 0.9, ..default() };
    stage.world().entity_mut(camera).insert(Projection::Perspective(projection));
    if env("LOOK_FOG", "1") == "1" {
        stage.world().entity_mut(camera).insert(DistanceFog::default());
    }
    if prepass != "none" {
        stage.world().entity_mut(camera).insert(DepthPrepass);
    }
    if prepass == "normal" {
        stage.world().entity_mut(camera).insert(NormalPrepass);
    }
    for (i, look) in env("LOOK", "0 0 60 30 -10 15").split(';').enumerate() {
        let n = numbers(look);
        let at = place(&*ground, [n[0], n[1], n[2], n[3], n[4]]);
        *stage.world().get_mut::<Transform>(camera).expect("it is there") = at;
        stage.world().resource_mut::<Sky>().time = TimeOfDay::at(n[5]);
        let began = Instant::now();
        let picture = stage.shoot(&image, 5);
        let made = began.elapsed().as_secs_f32();
        let counters = *stage.world().resource::<TerrainCounters>();
        println!("{i}: {look} {made:.2} s, {counters:?}");
        picture.save(format!("{out}/look_{i}.png")).expect("the folder can be written");
        if frames > 0 {
            let cpu = cpu_seconds();
            stage.step(frames);
            println!(
                "{i}: {:.1} ms of CPU a frame",
                (cpu_seconds() - cpu) / f64::from(frames) * 1e3
            );
        }
    }
}

/// User and system time of this process, where the system tells.
fn cpu_seconds() -> f64 {
    let stat = fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let fields: Vec<&str> = stat.rsplit(')').next().unwrap_or("").split_whitespace().collect();
    let ticks = |i: usize| fields.get(i).and_then(|f| f.parse::<f64>().ok()).unwrap_or(0.0);
    (ticks(11) + ticks(12)) / 100.0
}
