//! How high to fly: the curve, wanted heights and crowns in; heights that clear ground, water and leaves out.
//!
//! Wanted heights are limited in slope and rounded; then every metre is checked against the crowns, and where the eye would
//! touch one, that place must be passed above it. A climb out of a forest that would lead through leaves so begins earlier,
//! until it fits into an opening. O(length · rounds).

use super::crowns::{Crown, Crowns, LowCrowns};
use super::curve::{rounded, slope_limited, spread};
use super::{EYE_TO_TRUNK_M, WATER_CLEARANCE_M};
use crate::landscape::{Ground, smoothstep};
use bevy::math::{Vec2, Vec3};

/// Aimed at above the ground, so that the promised clearance holds between the samples too, metres.
const LOWEST_M: f32 = 2.6;
/// Aimed at above crowns, metres; and what is good enough there.
const OVER_CROWN_M: f32 = 3.2;
const LEAST_OVER_CROWN_M: f32 = 2.0;
/// Air between the eye and leaves overhead, and leaves aside, metres.
const BELOW_LEAVES_M: f32 = 0.6;
const BESIDE_LEAVES_M: f32 = 0.7;
/// Steepest climb as a tangent.
const STEEPEST: f32 = 0.6;
/// Rounds of checks; each moves a climb by some 30 m.
const ROUNDS: usize = 200;

/// Wanted and least heights along a curve.
struct Bounds {
    wanted: Vec<f32>,
    least: Vec<f32>,
    /// Ground or water, metres.
    floor: Vec<f32>,
    /// Half a window of smoothing, points.
    half: usize,
    step_m: f32,
}

impl Bounds {
    fn new(points: &[Vec3], above_m: &[f32], step_m: f32, ground: &dyn Ground) -> Self {
        let places = |metres: f32| ((metres / step_m) as usize).max(1);
        let level = ground.water_level().unwrap_or(f32::NEG_INFINITY);
        let height = |x: f32, z: f32| ground.height(x, z).max(level);
        let floor: Vec<f32> = points.iter().map(|p| height(p.x, p.z)).collect();
        let (close, wide) = (rounded(&floor, places(6.0)), rounded(&floor, places(70.0)));
        let wanted = (0..points.len()).map(|i| {
            let base = close[i] + (wide[i] - close[i]) * smoothstep(15.0, 80.0, above_m[i]);
            base + above_m[i]
        });
        let least = points.iter().zip(&floor).map(|(p, floor)| {
            // Ground beside the path counts too: it fills the picture and may be drawn coarsely.
            let sides = [(1.2, 0.0), (-1.2, 0.0), (0.0, 1.2), (0.0, -1.2)];
            let around = sides.map(|(dx, dz)| height(p.x + dx, p.z + dz));
            let most = around.into_iter().fold(*floor, f32::max);
            (most + LOWEST_M).max(level + WATER_CLEARANCE_M + 0.4)
        });
        let (wanted, least) = (wanted.collect(), least.collect());
        Self { wanted, least, floor, half: places(8.0), step_m }
    }

    /// Heights that climb gently, bend gently and are nowhere below the least.
    fn heights(&self) -> Vec<f32> {
        let limited: Vec<f32> =
            self.wanted.iter().zip(&self.least).map(|(w, l)| w.max(*l)).collect();
        let mut heights = rounded(&slope_limited(&limited, STEEPEST * self.step_m), self.half);
        let missing: Vec<f32> =
            heights.iter().zip(&self.least).map(|(h, l)| (l - h).max(0.0)).collect();
        for (height, lift) in heights.iter_mut().zip(spread(&missing, self.half)) {
            *height += lift;
        }
        heights
    }
}

/// Heights above ground or water that the curve would have if there were no trees; crowns whose leaves are met there,
/// though they begin higher over level ground, are added to `low`.
pub(super) fn heights_without_trees(
    points: &[Vec3],
    above_m: &[f32],
    step_m: f32,
    ground: &dyn Ground,
    crowns: &mut Crowns,
    low: &mut LowCrowns,
) -> Vec<f32> {
    let bounds = Bounds::new(points, above_m, step_m, ground);
    let heights = bounds.heights();
    for (point, &height) in points.iter().zip(&heights) {
        let eye = Vec3::new(point.x, height, point.z);
        crowns.visit(Vec2::new(eye.x, eye.z), BESIDE_LEAVES_M, |crown| {
            if crown.open_below_m() > 0.0 && touches(crown, eye) {
                low.insert(crown.key());
            }
        });
    }
    heights.iter().zip(&bounds.floor).map(|(h, floor)| h - floor).collect()
}

/// Sets the heights of the points. Where the curve passes below leaves, the answer is true.
pub(super) fn set_heights(
    points: &mut [Vec3],
    above_m: &[f32],
    step_m: f32,
    ground: &dyn Ground,
    crowns: &mut Crowns,
) -> Vec<bool> {
    let mut bounds = Bounds::new(points, above_m, step_m, ground);
    let near: Vec<Vec<Crown>> = points
        .iter()
        .map(|p| {
            let mut found = vec![];
            crowns.visit(Vec2::new(p.x, p.z), BESIDE_LEAVES_M, |crown| found.push(*crown));
            found
        })
        .collect();
    let mut over = vec![false; points.len()];
    for _ in 0..ROUNDS {
        let heights = bounds.heights();
        let mut changed = false;
        for (i, point) in points.iter_mut().enumerate() {
            point.y = heights[i];
            if !over[i] && near[i].iter().any(|crown| touches(crown, *point)) {
                over[i] = true;
                changed = true;
                for crown in &near[i] {
                    let top = crown.position.y + crown.height_m;
                    bounds.least[i] = bounds.least[i].max(top + OVER_CROWN_M);
                }
            }
        }
        if !changed {
            break;
        }
    }
    points
        .iter()
        .zip(&near)
        .map(|(p, near)| near.iter().any(|c| p.y < c.position.y + c.height_m))
        .collect()
}

/// True if an eye within reach of a crown is neither above it nor below its leaves and clear of its trunk.
fn touches(crown: &Crown, eye: Vec3) -> bool {
    let up = eye.y - crown.position.y;
    let below = up + BELOW_LEAVES_M < crown.open_below_m()
        && crown.distance(Vec2::new(eye.x, eye.z)) > crown.trunk_m() + EYE_TO_TRUNK_M + 0.15;
    up < crown.height_m + LEAST_OVER_CROWN_M && !below
}
