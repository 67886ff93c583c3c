//! The camera in a window: along the path, or flown by hand.

use super::world::Flight;
use bevy::{
    input::mouse::{AccumulatedMouseMotion, AccumulatedMouseScroll},
    prelude::*,
};
use bevy_egui::input::EguiWantsInput;
use bevy_treeline::landscape::Landscape;

/// Metres per second along the path.
pub const PATH_SPEED: f32 = 14.0;
/// The free camera stays this high above ground and water, metres.
const LOWEST_M: f32 = 1.2;

/// Who steers, and how fast.
#[derive(Resource)]
pub struct Pilot {
    /// Share of the way around.
    pub t: f32,
    /// Stands still on the path.
    pub paused: bool,
    /// Flown by hand.
    pub free: bool,
    /// Along the path, metres per second.
    pub path_speed: f32,
    /// By hand, metres per second.
    pub free_speed: f32,
}

impl Pilot {
    /// On the path at `t`.
    pub fn at(t: f32) -> Self {
        Self { t, paused: false, free: false, path_speed: PATH_SPEED, free_speed: 25.0 }
    }
}

/// The camera that shows the landscape.
#[derive(Component)]
pub struct FlyCamera;

#[expect(clippy::too_many_arguments, reason = "a system's parameters are its dependencies")]
pub fn steer(
    time: Res<Time>,
    mut pilot: ResMut<Pilot>,
    flight: Res<Flight>,
    landscape: Res<Landscape>,
    keys: Res<ButtonInput<KeyCode>>,
    buttons: Res<ButtonInput<MouseButton>>,
    motion: Res<AccumulatedMouseMotion>,
    scroll: Res<AccumulatedMouseScroll>,
    panel: Res<EguiWantsInput>,
    mut camera: Single<&mut Transform, With<FlyCamera>>,
) {
    // A slow frame must not throw the camera far.
    let seconds = time.delta_secs().min(0.25);
    if !pilot.free {
        if !pilot.paused {
            pilot.t = (pilot.t + seconds * pilot.path_speed / flight.0.length_m()).fract();
        }
        **camera = flight.place(pilot.t);
        return;
    }
    if !panel.wants_any_pointer_input() {
        let steps = scroll.delta.y.clamp(-3.0, 3.0);
        pilot.free_speed = (pilot.free_speed * (0.15 * steps).exp()).clamp(0.5, 2000.0);
        if buttons.pressed(MouseButton::Right) || buttons.pressed(MouseButton::Left) {
            let (yaw, pitch, _) = camera.rotation.to_euler(EulerRot::YXZ);
            let pitch = (pitch - motion.delta.y * 0.003).clamp(-1.54, 1.54);
            let yaw = yaw - motion.delta.x * 0.003;
            camera.rotation = Quat::from_euler(EulerRot::YXZ, yaw, pitch, 0.0);
        }
    }
    if panel.wants_any_keyboard_input() {
        return;
    }
    let axis =
        |plus, minus| f32::from(i8::from(keys.pressed(plus)) - i8::from(keys.pressed(minus)));
    let local = Vec3::new(
        axis(KeyCode::KeyD, KeyCode::KeyA),
        axis(KeyCode::KeyE, KeyCode::KeyQ),
        axis(KeyCode::KeyS, KeyCode::KeyW),
    );
    let fast = if keys.pressed(KeyCode::ShiftLeft) { 5.0 } else { 1.0 };
    let step = camera.rotation * local.clamp_length_max(1.0) * (pilot.free_speed * fast * seconds);
    camera.translation += step;
    let ground = &landscape.ground;
    let at = camera.translation;
    let surface = ground.height(at.x, at.z).max(ground.water_level().unwrap_or(f32::NEG_INFINITY));
    camera.translation.y = at.y.max(surface + LOWEST_M);
}
