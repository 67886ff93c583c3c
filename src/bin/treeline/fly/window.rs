//! The flight in a window.

use super::{
    FlyArgs,
    camera::{FlyCamera, Pilot, steer},
    graph::FrameTimes,
    panel, roster, world,
};
use crate::{headless::bevy_plugins, options::ToolResult};
use bevy::{
    prelude::*,
    render::{
        diagnostic::RenderDiagnosticsPlugin,
        view::screenshot::{Screenshot, save_to_disk},
    },
    window::PrimaryWindow,
};
use bevy_egui::{EguiPlugin, EguiPrimaryContextPass, input::EguiWantsInput};
use bevy_treeline::{CacheLocation, TreelineCounters, TreelinePlugin, TreelineSettings};
use std::{
    path::PathBuf,
    sync::{Mutex, PoisonError, mpsc::Receiver},
};

/// Every key, for the panel and the terminal; README.md holds the same list (checked by a test).
pub const KEYS: &[(&str, &str)] = &[
    ("F1", "panel"),
    ("F", "fly yourself / back to the path"),
    ("W A S D", "fly"),
    ("Q E", "down, up"),
    ("mouse drag", "look around"),
    ("wheel", "speed"),
    ("Shift", "five times as fast"),
    ("Space", "pause on the path"),
    ("+ -", "more or fewer points"),
    ("V", "next debug view"),
    ("C", "freeze culling"),
    ("[ ]", "time of day"),
    ("F12", "screenshot"),
    ("Esc", "quit"),
];

/// Where screenshots go.
#[derive(Resource)]
pub struct Shots {
    folder: PathBuf,
    taken: u32,
}

pub fn run(args: &FlyArgs) -> ToolResult {
    let keys: Vec<String> = KEYS.iter().map(|(key, does)| format!("{key}: {does}")).collect();
    println!("{}", keys.join(" · "));
    let plan = world::prepare(args, true)?;
    let window = Window { title: "treeline fly".into(), resolution: args.size.into(), ..default() };
    let mut app = App::new();
    app.add_plugins((bevy_plugins(Some(window)), RenderDiagnosticsPlugin, EguiPlugin::default()))
        .add_plugins(TreelinePlugin {
            splat_path: args.splat_path.into(),
            cache: CacheLocation::Off,
            ..default()
        });
    world::build(&mut app, args, plan, false);
    let start = app.world().resource::<world::Flight>().place(args.start);
    let camera = world::camera(app.world_mut(), args);
    app.world_mut().entity_mut(camera).insert((FlyCamera, start));
    app.insert_resource(Pilot::at(args.start))
        .insert_resource(Shots { folder: args.out.clone(), taken: 0 })
        .insert_resource(panel::Panel::new(args))
        .init_resource::<FrameTimes>()
        .add_systems(Update, (count_frame, keys_pressed, steer, title).chain())
        .add_systems(EguiPrimaryContextPass, panel::show);
    if let Some(receive) = roster::bake_in_background(args)? {
        app.insert_resource(Kitchen(Mutex::new(receive))).add_systems(First, serve);
    }
    app.run();
    Ok(())
}

/// Plants that are baked while the small ones are shown.
#[derive(Resource)]
struct Kitchen(Mutex<Receiver<roster::Ready>>);

/// Takes what is ready, one a frame: its meshes go to the GPU.
fn serve(world: &mut World) {
    let ready = {
        let kitchen = world.resource::<Kitchen>();
        let receive = kitchen.0.lock().unwrap_or_else(PoisonError::into_inner);
        receive.try_recv().ok()
    };
    let Some(ready) = ready else { return };
    world.resource_scope(|world, kinds: Mut<world::Kinds>| {
        roster::replace(world, &kinds.kinds, &kinds.has_mesh, &ready);
    });
}

fn count_frame(time: Res<Time<Real>>, mut times: ResMut<FrameTimes>) {
    times.push(time.delta_secs() * 1e3);
}

#[expect(clippy::too_many_arguments, reason = "a system's parameters are its dependencies")]
fn keys_pressed(
    mut commands: Commands,
    keys: Res<ButtonInput<KeyCode>>,
    typing: Res<EguiWantsInput>,
    mut pilot: ResMut<Pilot>,
    mut shots: ResMut<Shots>,
    mut panel: ResMut<panel::Panel>,
    mut settings: Query<&mut TreelineSettings>,
    mut exit: MessageWriter<AppExit>,
) {
    if typing.wants_any_keyboard_input() {
        return;
    }
    if keys.just_pressed(KeyCode::F1) {
        panel.open = !panel.open;
    }
    if keys.just_pressed(KeyCode::Space) {
        pilot.paused = !pilot.paused;
    }
    if keys.just_pressed(KeyCode::KeyF) {
        pilot.free = !pilot.free;
    }
    if keys.just_pressed(KeyCode::KeyC) {
        panel.frozen = !panel.frozen;
    }
    let pressed =
        |plus, minus| i32::from(keys.just_pressed(plus)) - i32::from(keys.just_pressed(minus));
    let hours = pressed(KeyCode::BracketRight, KeyCode::BracketLeft);
    if hours != 0 {
        panel.hour = (panel.hour + 0.5 * hours as f32).rem_euclid(24.0);
    }
    let step = pressed(KeyCode::Equal, KeyCode::Minus)
        + pressed(KeyCode::NumpadAdd, KeyCode::NumpadSubtract);
    for mut settings in &mut settings {
        if step != 0 {
            settings.quality = (settings.quality * 1.25f32.powi(step)).clamp(0.05, 16.0);
        }
        if keys.just_pressed(KeyCode::KeyV) {
            settings.debug_view = panel::next_view(settings.debug_view);
        }
    }
    if keys.just_pressed(KeyCode::F12) {
        shots.taken += 1;
        let path = shots.folder.join(format!("fly{:03}.png", shots.taken));
        match std::fs::create_dir_all(&shots.folder) {
            Ok(()) => {
                info!("screenshot {}", path.display());
                commands.spawn(Screenshot::primary_window()).observe(save_to_disk(path));
            }
            Err(error) => error!("no screenshot: cannot write {}: {error}", shots.folder.display()),
        }
    }
    if keys.just_pressed(KeyCode::Escape) {
        exit.write(AppExit::Success);
    }
}

fn title(
    mut window: Single<&mut Window, With<PrimaryWindow>>,
    times: Res<FrameTimes>,
    counters: Res<TreelineCounters>,
    mut wait: Local<u32>,
) {
    *wait += 1;
    if !wait.is_multiple_of(30) {
        return;
    }
    let (median, _) = times.median_and_worst();
    let all = counters.all();
    let Some(c) = all.values().next() else { return };
    window.title = format!(
        "treeline fly: {:.0} fps · {} trees · {:.2} M points",
        1000.0 / median.max(1e-3),
        c.instances_seen,
        f64::from(c.points) / 1e6,
    );
}
