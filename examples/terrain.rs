//! Sixteen kilometres of ground: mountains, lakes, sky and haze, without a tree.
//!
//! `cargo run --release --features app --example terrain` (`app` brings the window; in your game, Bevy's `bevy_winit` does).

use bevy::{pbr::DistanceFog, prelude::*};
use bevy_treeline::landscape::{
    BiomeSettings, Biomes, NoiseTerrain, TerrainError, TerrainSettings, TimeOfDay,
    draw::{Landscape, Sky, Sun, TerrainCounters, TerrainPlugin},
};
use std::sync::Arc;

fn main() -> Result<(), TerrainError> {
    let ground = Arc::new(NoiseTerrain::new(&TerrainSettings { seed: 7, ..default() })?);
    let biomes = Arc::new(Biomes::new(&*ground, &BiomeSettings::default()));
    App::new()
        .add_plugins((DefaultPlugins, TerrainPlugin))
        .insert_resource(Landscape::new(ground, biomes))
        .insert_resource(Sky { time: TimeOfDay::at(17.5), ..default() })
        .add_systems(Startup, setup)
        .add_systems(Update, (fly, report))
        .run();
    Ok(())
}

fn setup(mut commands: Commands) {
    // The plugin gives the sun its place and colour, and fog the colour of the sky.
    commands.spawn(Sun);
    commands.spawn((Camera3d::default(), DistanceFog::default()));
}

/// A wide circle, 120 m over the ground.
fn fly(
    time: Res<Time>,
    landscape: Res<Landscape>,
    mut camera: Single<&mut Transform, With<Camera3d>>,
) {
    let ground = &landscape.ground;
    let at = |seconds: f32| {
        let (z, x) = (seconds * 0.008).sin_cos();
        let (x, z) = (x * 0.3 * ground.side_m(), z * 0.3 * ground.side_m());
        // The highest of what lies around: no sudden climbs.
        let around = [(0.0, 0.0), (200.0, 0.0), (-200.0, 0.0), (0.0, 200.0), (0.0, -200.0)];
        let top =
            around.map(|(dx, dz)| ground.height(x + dx, z + dz)).into_iter().fold(0.0, f32::max);
        Vec3::new(x, top + 120.0, z)
    };
    let (here, ahead) = (at(time.elapsed_secs()), at(time.elapsed_secs() + 3.0));
    camera.translation = if camera.translation == Vec3::ZERO {
        here
    } else {
        let slow = 1.0 - (-time.delta_secs()).exp();
        Vec3::new(here.x, camera.translation.y.lerp(here.y, slow), here.z)
    };
    camera.look_to((ahead - here).with_y(-12.0), Vec3::Y);
}

fn report(counters: Res<TerrainCounters>, time: Res<Time>, mut since: Local<f32>) {
    *since += time.delta_secs();
    if *since >= 2.0 {
        *since = 0.0;
        info!("{:?}", *counters);
    }
}
