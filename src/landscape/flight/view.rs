//! Where to look: an even path in, unit directions out that turn gently and never end in the ground. O(length).

use super::curve::{rounded, spread};
use crate::landscape::{Ground, smoothstep};
use bevy::math::Vec3;
use std::f32::consts::{PI, TAU};

/// How far ahead the target is, metres.
pub(super) const TARGET_M: f32 = 30.0;
/// Steepest look down from high places, radians (16°).
const DOWN: f32 = 0.28;
/// Aimed at for turns, radians a metre: 25° a second at 14 m/s are 0.0312.
const MOST_TURN: f32 = 0.03;
/// Of the target above the ground, metres.
const TARGET_CLEARANCE_M: f32 = 1.2;

/// A direction for each point of an even path.
pub(super) fn directions(points: &[Vec3], step_m: f32, ground: &dyn Ground) -> Vec<Vec3> {
    let n = points.len();
    let mut found = vec![];
    // Wider windows where the view would nod too fast.
    for wider in [1.0, 1.4, 2.0, 2.8, 4.0] {
        found = directions_over(points, step_m, ground, wider);
        let most = MOST_TURN * step_m;
        // By the chord: the dot product of nearly equal directions loses the angle.
        if (0..n).all(|i| found[i].distance(found[(i + 1) % n]) <= most) {
            break;
        }
    }
    found
}

/// Directions, rounded over windows `wider` than the usual.
fn directions_over(points: &[Vec3], step_m: f32, ground: &dyn Ground, wider: f32) -> Vec<Vec3> {
    let n = points.len();
    let places = |metres: f32| ((metres / step_m) as usize).clamp(1, n / 8);
    let headings = headings(points, step_m, places(30.0), places(6.0));
    let level = ground.water_level().unwrap_or(f32::NEG_INFINITY);
    let above: Vec<f32> = points.iter().map(|p| p.y - ground.height(p.x, p.z).max(level)).collect();
    let above = rounded(&above, places(25.0));
    let rise: Vec<f32> = (0..n)
        .map(|i| {
            let ahead = points[(i + places(30.0)) % n] - points[i];
            ahead.y.atan2(ahead.x.hypot(ahead.z).max(1e-3))
        })
        .collect();
    let rise = rounded(&rise, places(12.0 * wider));
    // Part of the path's own rise: the view nods less than the path.
    let mut pitches: Vec<f32> =
        (0..n).map(|i| 0.55 * rise[i] - DOWN * smoothstep(8.0, 130.0, above[i])).collect();
    // Raised by what the ground ahead needs.
    for reach in [8.0, 14.0] {
        let missing: Vec<f32> = (0..n)
            .map(|i| {
                let eye = points[i];
                let (sin, cos) = headings[i].sin_cos();
                let need = [0.25, 0.5, 0.75, 1.0].map(|share| {
                    let far = share * TARGET_M;
                    let floor = ground.height(eye.x + cos * far, eye.z + sin * far).max(level);
                    (floor + TARGET_CLEARANCE_M * share - eye.y).atan2(far)
                });
                (need.into_iter().fold(f32::MIN, f32::max) - pitches[i]).clamp(0.0, 1.2)
            })
            .collect();
        for (pitch, lift) in pitches.iter_mut().zip(spread(&missing, places(reach * wider))) {
            *pitch = (*pitch + lift).clamp(-1.2, 1.2);
        }
    }
    headings
        .iter()
        .zip(&pitches)
        .map(|(heading, pitch)| {
            let (sin, cos) = heading.sin_cos();
            Vec3::new(cos * pitch.cos(), pitch.sin(), sin * pitch.cos())
        })
        .collect()
}

/// Angles around y from x towards z, continuous along the path but for whole turns at its end; rounded until none turns
/// faster than [`MOST_TURN`].
fn headings(points: &[Vec3], step_m: f32, ahead: usize, half: usize) -> Vec<f32> {
    let n = points.len();
    let raw = |i: usize| {
        let chord = points[(i + ahead) % n] - points[i % n];
        chord.z.atan2(chord.x)
    };
    let mut angles = Vec::with_capacity(n + 1);
    let mut last = raw(0);
    for i in 0..=n {
        // The nearest of the angles that differ by whole turns.
        let change = (raw(i) - last + PI).rem_euclid(TAU) - PI;
        last += change;
        angles.push(last);
    }
    // Without the turn of the whole loop the list is closed and can be averaged.
    let turn = (angles[n] - angles[0]) / n as f32;
    let closed: Vec<f32> = (0..n).map(|i| angles[i] - turn * i as f32).collect();
    let mut half = half;
    for _ in 0..12 {
        let smooth = rounded(&closed, half);
        let fast = (0..n).any(|i| {
            let change = smooth[(i + 1) % n] - smooth[i] + turn;
            change.abs() > MOST_TURN * 0.8 * step_m
        });
        if !fast || half >= n / 8 {
            return smooth.iter().enumerate().map(|(i, a)| a + turn * i as f32).collect();
        }
        half = (half + half / 4 + 1).min(n / 8);
    }
    let smooth = rounded(&closed, half);
    smooth.iter().enumerate().map(|(i, a)| a + turn * i as f32).collect()
}
