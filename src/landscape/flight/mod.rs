//! A closed camera path through varied places: ground, biomes and crowns in, eye and direction by time out.
//!
//! `survey` (a varied neighbourhood, way points by role) → `curve` (closed spline, no tight bends) → `corridor` (steers
//! between the trunks) → `profile` (heights that clear ground, water and leaves) → `captions` (what came of it) and
//! `view` (where to look). Building reads some 7,000 sites of the ground and is O(length) otherwise, whatever the size of
//! the world; a query is O(1).

mod captions;
mod corridor;
mod crowns;
mod curve;
#[cfg(test)]
mod preview;
mod profile;
mod survey;
#[cfg(test)]
mod test_grounds;
#[cfg(test)]
mod tests;
mod view;

pub use crowns::{Crown, CrownSource};

use super::{Biomes, Ground, smoothstep};
use crate::math::hash::SplitMix64;
use bevy::math::{Vec2, Vec3};
use corridor::Aside;
use crowns::{Crowns, LowCrowns};
use std::fmt;
use survey::WayPoint;

/// The eye is at least this high above the ground, in metres.
pub const GROUND_CLEARANCE_M: f32 = 2.0;
/// The eye is at least this high above still water, in metres.
pub const WATER_CLEARANCE_M: f32 = 2.5;
/// The eye is at least this far from the bark of every trunk that it passes below the leaves, in metres.
pub const EYE_TO_TRUNK_M: f32 = 1.0;
/// Radius that no bend of the curve is tighter than before trunks are avoided, metres.
const BEND_M: f32 = 50.0;
/// Furthest that the path leaves its curve for a gap between trunks, metres.
const ASIDE_M: f32 = 18.0;
/// Times that the way between the trunks is sought, at most.
const STEERINGS: usize = 4;

/// What a stretch of a flight shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Role {
    /// Low over open ground or along water.
    ValleyFloor,
    /// Low in the open, forest beside.
    ForestEdge,
    /// Between trunks, below the leaves.
    InsideForest,
    /// Close above the crowns.
    Canopy,
    /// Along high ground.
    Ridge,
    /// High above the landscape.
    Overview,
}

impl fmt::Display for Role {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.pad(match self {
            Self::ValleyFloor => "open ground",
            Self::ForestEdge => "forest edge",
            Self::InsideForest => "inside the forest",
            Self::Canopy => "over the crowns",
            Self::Ridge => "ridge",
            Self::Overview => "overview",
        })
    }
}

/// What flight to make.
#[derive(Clone, Debug, PartialEq)]
pub struct FlightSettings {
    /// Of the choice of places. Default: 1.
    pub seed: u64,
    /// About how long the loop is, metres, 200 to 40,000; shorter where the ground has no room. The real length differs by
    /// up to a third. Default: 7,000, eight minutes at 14 m/s.
    pub length_m: f32,
    /// Middle of the loop in x and z; moved away from the border if needed. Default (`None`): the most varied of 49.
    pub center: Option<Vec2>,
}

impl Default for FlightSettings {
    fn default() -> Self {
        Self { seed: 1, length_m: 7000.0, center: None }
    }
}

/// A closed, smooth flight at constant speed.
///
/// It keeps [`GROUND_CLEARANCE_M`], [`WATER_CLEARANCE_M`] and, below leaves, [`EYE_TO_TRUNK_M`]; it never enters leaves. The
/// view turns by at most 25° a second at 14 m/s on ground of 1 km and more; smaller loops turn faster.
#[derive(Clone, Debug, PartialEq)]
pub struct FlightPath {
    /// Evenly spaced by arc length; the last is followed by the first.
    points: Vec<Vec3>,
    /// Unit direction of the view at each point.
    directions: Vec<Vec3>,
    roles: Vec<Role>,
    length_m: f32,
}

impl FlightPath {
    /// A flight over `ground` past, between and over the crowns of `crowns`. Deterministic: the same ground, biomes, crowns
    /// and settings give the same flight.
    pub fn over(
        ground: &dyn Ground,
        biomes: &Biomes,
        crowns: &CrownSource,
        settings: &FlightSettings,
    ) -> Self {
        let side_m = ground.side_m();
        let length_m = survey::loop_length_m(side_m, settings);
        let way = survey::way_points(ground, biomes, settings, length_m);
        let bend_m = BEND_M.min(length_m * 0.03);
        let mut points = curve_through(&way, bend_m);
        let step_m = curve::loop_length(&points) / points.len() as f32;
        let (above_m, mut roles) = wanted(&mut points, &way, length_m, settings.seed);

        let mut crowns = Crowns::new(crowns);
        // Again with what the first ways met: heights that the ground forces, and leaves that hang low beside slopes.
        let curve = points.clone();
        let mut flown_m = above_m.clone();
        let mut low = LowCrowns::new();
        for _ in 0..STEERINGS {
            points.clone_from(&curve);
            let aside = Aside { most_m: ASIDE_M.min(bend_m * 0.45), border_m: side_m * 0.49 };
            corridor::steer(&mut points, &flown_m, &roles, &mut crowns, &low, aside);
            let known = low.len();
            let met_m = profile::heights_without_trees(
                &points,
                &above_m,
                step_m,
                ground,
                &mut crowns,
                &mut low,
            );
            // The higher of all ways so far, or the search would change its mind for ever.
            flown_m = flown_m.iter().zip(met_m).map(|(flown, met)| flown.max(met)).collect();
            if low.len() == known {
                break;
            }
        }
        let below_leaves = profile::set_heights(&mut points, &above_m, step_m, ground, &mut crowns);
        captions::name_stretches(
            &mut roles,
            &points,
            &below_leaves,
            overview_m(length_m),
            step_m,
            ground,
            &mut crowns,
        );

        // Sidesteps and climbs changed lengths: space the points evenly again.
        let count = point_count(curve::loop_length(&points));
        let even = curve::resampled(&points, count);
        let roles = even.iter().map(|(i, _)| roles[*i]).collect();
        let points: Vec<Vec3> = even.into_iter().map(|(_, p)| p).collect();
        let length_m = curve::loop_length(&points);
        let directions = view::directions(&points, length_m / count as f32, ground);
        Self { points, directions, roles, length_m }
    }

    /// Metres around.
    pub fn length_m(&self) -> f32 {
        self.length_m
    }

    /// Place at share `t` of the way around; wraps, so 1.25 is 0.25. Speed is constant. Not a number counts as 0.
    pub fn position(&self, t: f32) -> Vec3 {
        let (i, f) = self.index(t);
        let n = self.points.len();
        // Points are dense and even here, so the uniform Catmull-Rom spline is the centripetal one.
        let [a, b, c, d] = [n - 1, 0, 1, 2].map(|k| self.points[(i + k) % n]);
        b + (c - a) * (0.5 * f)
            + (a * 2.0 - b * 5.0 + c * 4.0 - d) * (0.5 * f * f)
            + (b * 3.0 - a - c * 3.0 + d) * (0.5 * f * f * f)
    }

    /// Eye and a target 30 m from it (less on tiny loops), lower the higher the eye is; the target is above the ground.
    pub fn look(&self, t: f32) -> (Vec3, Vec3) {
        let eye = self.position(t);
        let (i, f) = self.index(t);
        let next = self.directions[(i + 1) % self.directions.len()];
        let direction = self.directions[i].lerp(next, f).normalize_or(Vec3::NEG_Z);
        (eye, eye + direction * view::TARGET_M)
    }

    /// What the path shows at share `t` of the way around.
    pub fn role_at(&self, t: f32) -> Role {
        self.roles[self.index(t).0]
    }

    fn index(&self, t: f32) -> (usize, f32) {
        let t = if t.is_finite() { t.rem_euclid(1.0) } else { 0.0 };
        let s = t * self.points.len() as f32;
        let i = (s as usize).min(self.points.len() - 1);
        (i, (s - i as f32).min(1.0))
    }
}

/// A point every metre, a multiple of three for [`corridor`]; enough of them on small loops.
fn point_count(length_m: f32) -> usize {
    (length_m / 3.0).round().clamp(64.0, 20_000.0) as usize * 3
}

/// Even points at height 0 through the way points, without tight bends.
fn curve_through(way: &[WayPoint], bend_m: f32) -> Vec<Vec3> {
    let places: Vec<Vec2> = way.iter().map(|p| p.at).collect();
    let mut points = curve::spline(&places, 192);
    for _ in 0..3 {
        let count = point_count(curve::loop_length(&points));
        points = if points.len() == 192 && count != 192 {
            curve::spline(&places, count)
        } else {
            curve::resampled(&points, count).into_iter().map(|(_, p)| p).collect()
        };
        let step_m = curve::loop_length(&points) / count as f32;
        curve::unbend(&mut points, step_m, bend_m);
    }
    let count = point_count(curve::loop_length(&points));
    curve::resampled(&points, count).into_iter().map(|(_, p)| p).collect()
}

/// Height of the overview above the ground: enough to look over the loop, 120 to 250 m on large grounds.
fn overview_m(length_m: f32) -> f32 {
    (length_m * 0.05).clamp(12.0, 190.0)
}

/// Height above the ground and role of each point; turns the list so that it begins at the first way point, the overview,
/// where no crown is near.
fn wanted(
    points: &mut [Vec3],
    way: &[WayPoint],
    length_m: f32,
    seed: u64,
) -> (Vec<f32>, Vec<Role>) {
    let n = points.len();
    let nearest = |points: &[Vec3], at: Vec2| {
        let distance = |i: &usize| Vec2::new(points[*i].x, points[*i].z).distance_squared(at);
        (0..n).min_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap_or(0)
    };
    points.rotate_left(nearest(points, way[0].at));
    let mut rng = SplitMix64(seed ^ 0x0A17_17DE);
    let overview_m = overview_m(length_m);
    let mut stops: Vec<(usize, f32, Role)> = way
        .iter()
        .enumerate()
        .map(|(k, point)| {
            let above = match point.role {
                Role::ValleyFloor => rng.range(3.0, 4.5),
                Role::ForestEdge => rng.range(2.8, 3.4),
                Role::InsideForest | Role::Canopy => 2.7,
                Role::Ridge => rng.range(7.0, 13.0).min(overview_m),
                Role::Overview => overview_m * rng.range(0.9, 1.2),
            };
            (if k == 0 { 0 } else { nearest(points, point.at) }, above, point.role)
        })
        .collect();
    stops.sort_by_key(|stop| stop.0);
    let (mut above_m, mut roles) = (Vec::with_capacity(n), Vec::with_capacity(n));
    for (k, &(from, low, role)) in stops.iter().enumerate() {
        let (to, high, next) = stops.get(k + 1).copied().unwrap_or((n, stops[0].1, stops[0].2));
        for i in from..to {
            let u = (i - from) as f32 / (to - from) as f32;
            above_m.push(low + (high - low) * smoothstep(0.05, 0.95, u));
            roles.push(if u < 0.5 { role } else { next });
        }
    }
    (above_m, roles)
}
