//! The flight in a window.

use super::{FlyArgs, world};
use crate::{headless::bevy_plugins, options::ToolResult};
use bevy::{
    input::mouse::{AccumulatedMouseMotion, AccumulatedMouseScroll},
    prelude::*,
    render::{
        diagnostic::RenderDiagnosticsPlugin,
        view::screenshot::{Screenshot, save_to_disk},
    },
    window::PrimaryWindow,
};
use bevy_treeline::{
    CacheLocation, NearMeshes, TreelineCounters, TreelinePlugin, TreelineSettings, bake::Baked,
};
use std::path::PathBuf;

/// Metres per second along the path.
const SPEED: f32 = 14.0;

#[derive(Resource)]
struct Pilot {
    t: f32,
    paused: bool,
    free: bool,
    speed: f32,
    out: PathBuf,
    shots: u32,
}

pub fn run(args: &FlyArgs, baked: &[Baked]) -> ToolResult {
    println!(
        "Space: pause · F: fly yourself (WASD, Q and E, right mouse, wheel: speed) · + and -: quality · F12: screenshot · Esc: quit"
    );
    let window = Window { title: "treeline fly".into(), resolution: args.size.into(), ..default() };
    let mut app = App::new();
    app.add_plugins((bevy_plugins(Some(window)), RenderDiagnosticsPlugin)).add_plugins(
        TreelinePlugin {
            splat_path: args.splat_path.into(),
            cache: CacheLocation::Off,
            ..default()
        },
    );
    world::build(app.world_mut(), args, baked)?;
    let start = world::place(app.world().resource::<world::Flight>(), args.start);
    app.world_mut().spawn((world::camera(args), start));
    app.insert_resource(Pilot {
        t: args.start,
        paused: false,
        free: false,
        speed: SPEED,
        out: args.out.clone(),
        shots: 0,
    });
    app.add_systems(Update, (keys, fly, title).chain());
    app.run();
    Ok(())
}

fn keys(
    mut commands: Commands,
    keys: Res<ButtonInput<KeyCode>>,
    mut pilot: ResMut<Pilot>,
    mut settings: Query<&mut TreelineSettings>,
    mut exit: MessageWriter<AppExit>,
) {
    if keys.just_pressed(KeyCode::Space) {
        pilot.paused = !pilot.paused;
    }
    if keys.just_pressed(KeyCode::KeyF) {
        pilot.free = !pilot.free;
    }
    let step =
        i32::from(keys.just_pressed(KeyCode::Equal) || keys.just_pressed(KeyCode::NumpadAdd))
            - i32::from(
                keys.just_pressed(KeyCode::Minus) || keys.just_pressed(KeyCode::NumpadSubtract),
            );
    if step != 0 {
        for mut settings in &mut settings {
            settings.quality = (settings.quality * 1.25f32.powi(step)).clamp(0.05, 16.0);
        }
    }
    if keys.just_pressed(KeyCode::F12) {
        pilot.shots += 1;
        let path = pilot.out.join(format!("fly{:03}.png", pilot.shots));
        match std::fs::create_dir_all(&pilot.out) {
            Ok(()) => {
                commands.spawn(Screenshot::primary_window()).observe(save_to_disk(path));
            }
            Err(error) => error!("no screenshot: cannot write {}: {error}", pilot.out.display()),
        }
    }
    if keys.just_pressed(KeyCode::Escape) {
        exit.write(AppExit::Success);
    }
}

#[expect(clippy::too_many_arguments, reason = "a system's parameters are its dependencies")]
fn fly(
    time: Res<Time>,
    mut pilot: ResMut<Pilot>,
    flight: Res<world::Flight>,
    keys: Res<ButtonInput<KeyCode>>,
    buttons: Res<ButtonInput<MouseButton>>,
    motion: Res<AccumulatedMouseMotion>,
    scroll: Res<AccumulatedMouseScroll>,
    mut camera: Single<&mut Transform, With<Camera3d>>,
) {
    // A slow frame must not throw the camera far.
    let seconds = time.delta_secs().min(0.25);
    if !pilot.free {
        if !pilot.paused {
            pilot.t = (pilot.t + seconds * SPEED / flight.0.length_m()).fract();
            **camera = world::place(&flight, pilot.t);
        }
        return;
    }
    pilot.speed = (pilot.speed * (0.15 * scroll.delta.y.clamp(-3.0, 3.0)).exp()).clamp(0.5, 500.0);
    if buttons.pressed(MouseButton::Right) {
        let (yaw, pitch, _) = camera.rotation.to_euler(EulerRot::YXZ);
        let pitch = (pitch - motion.delta.y * 0.003).clamp(-1.54, 1.54);
        camera.rotation = Quat::from_euler(EulerRot::YXZ, yaw - motion.delta.x * 0.003, pitch, 0.0);
    }
    let axis =
        |plus, minus| f32::from(i8::from(keys.pressed(plus)) - i8::from(keys.pressed(minus)));
    let local = Vec3::new(
        axis(KeyCode::KeyD, KeyCode::KeyA),
        axis(KeyCode::KeyE, KeyCode::KeyQ),
        axis(KeyCode::KeyS, KeyCode::KeyW),
    );
    let step = camera.rotation * local * (pilot.speed * seconds);
    camera.translation += step;
}

fn title(
    mut window: Single<&mut Window, With<PrimaryWindow>>,
    time: Res<Time<Real>>,
    counters: Res<TreelineCounters>,
    near: Res<NearMeshes>,
    settings: Query<&TreelineSettings>,
    mut last: Local<f32>,
    mut frames: Local<u32>,
) {
    *frames += 1;
    let now = time.elapsed_secs();
    if now - *last < 0.5 {
        return;
    }
    let rate = *frames as f32 / (now - *last);
    (*last, *frames) = (now, 0);
    let all = counters.all();
    let Some(c) = all.values().next() else { return };
    let quality = settings.iter().next().map_or(0.0, |s| s.quality);
    window.title = format!(
        "treeline fly: {rate:.0} fps · {:.2} M points · {} trees, {} as mesh, {} fading · {} near meshes · q {quality:.2}",
        f64::from(c.points) / 1e6,
        c.instances_seen,
        c.as_mesh,
        c.in_fade,
        near.len()
    );
}
