//! A closed camera path over the ground: heightfield and trees in, eye and target by time out.
//!
//! Way points (low along forest edges, through clearings, high over the canopy) → closed Catmull-Rom spline → heights
//! lifted over ground and crowns → points evenly spaced by arc length. Building is O(length · window), a query O(1).
//! Source of the spline: Catmull & Rom 1974, "A Class of Local Interpolating Splines", with centripetal knots (Yuksel et
//! al. 2011, "Parameterization and Applications of Catmull-Rom Curves": no loops between unevenly spaced points).

use super::canopy::{Canopy, TREE_HEIGHT_M};
use super::{ForestPattern, Heightfield, ScatteredTree, smoothstep};
use crate::math::hash::SplitMix64;
use bevy::math::{Vec2, Vec3};
use std::f32::consts::TAU;

/// The path is at least this high above the ground, in metres.
pub const GROUND_CLEARANCE_M: f32 = 2.5;
/// Aimed at, so that the clearance holds between the samples too.
const LOWEST_M: f32 = 4.0;
/// Way points are at most this high above the ground.
const HIGHEST_M: f32 = 52.0;
/// Above crowns.
const CROWN_CLEARANCE_M: f32 = 3.0;
/// Half the width of the window in which climbs are anticipated, in metres along the path.
const ANTICIPATION_M: f32 = 26.0;
/// Forestness taken for forest where no trees are given.
const ASSUMED_FOREST: f32 = 0.56;
/// What the way points show, in turn around the loop.
const ROLES: [Role; 14] = {
    use Role::{Canopy, Clearing, Edge, Overview};
    [
        Edge, Edge, Canopy, Overview, Clearing, Edge, Canopy, Edge, Edge, Clearing, Canopy,
        Overview, Edge, Clearing,
    ]
};

/// What a stretch of the path shows.
#[derive(Clone, Copy, PartialEq)]
enum Role {
    /// Low, outside of but close to the forest.
    Edge,
    /// Low, in the open with forest all around.
    Clearing,
    /// Close above the crowns.
    Canopy,
    /// High, for the view.
    Overview,
}

/// A closed, smooth flight at constant speed.
#[derive(Clone, Debug, PartialEq)]
pub struct FlightPath {
    /// Evenly spaced by arc length; the last is followed by the first.
    points: Vec<Vec3>,
    /// Height above the ground at each point in metres, smoothed: decides how far the camera looks down.
    above_ground: Vec<f32>,
    /// Metres around.
    length_m: f32,
}

impl FlightPath {
    /// A flight over ground whose forest follows [`ForestPattern`] with `seed` and patches of 180 m, as
    /// [`super::scatter()`] does by default. Prefer [`Self::over_forest`], which knows the trees themselves.
    pub fn over(field: &Heightfield, seed: u64) -> Self {
        let pattern = ForestPattern::new(seed, 180.0);
        let mut canopy = Canopy::open(field.side_m());
        for cell in 0..canopy.heights.len() {
            let at = canopy.middle(cell);
            if pattern.forestness(at.x, at.y) > ASSUMED_FOREST {
                canopy.heights[cell] = TREE_HEIGHT_M;
            }
        }
        Self::build(field, &canopy, seed)
    }

    /// A flight past and over `trees`: along their edges, through their clearings, never through a crown.
    pub fn over_forest(field: &Heightfield, trees: &[ScatteredTree], seed: u64) -> Self {
        let mut canopy = Canopy::open(field.side_m());
        for tree in trees {
            canopy.add_tree(tree);
        }
        Self::build(field, &canopy, seed)
    }

    /// Metres around.
    pub fn length_m(&self) -> f32 {
        self.length_m
    }

    /// Place at share `t` of the way around; wraps, so 1.25 is 0.25. Speed is constant. Not a number counts as 0.
    pub fn position(&self, t: f32) -> Vec3 {
        let (i, f) = self.index(t);
        let p = [self.points.len() - 1, 0, 1, 2].map(|k| self.points[(i + k) % self.points.len()]);
        // Points are dense and even here, so the uniform spline is the centripetal one.
        let [a, b, c, d] = p;
        b + (c - a) * (0.5 * f)
            + (a * 2.0 - b * 5.0 + c * 4.0 - d) * (0.5 * f * f)
            + (b * 3.0 - a - c * 3.0 + d) * (0.5 * f * f * f)
    }

    /// Eye and a target some 30 m ahead of it, lower the higher the eye is; never equal.
    pub fn look(&self, t: f32) -> (Vec3, Vec3) {
        let eye = self.position(t);
        let ahead_m = 30f32.min(self.length_m * 0.1);
        let (i, f) = self.index(t);
        let next = self.above_ground[(i + 1) % self.points.len()];
        let above = self.above_ground[i] + (next - self.above_ground[i]) * f;
        let ahead = self.position(t + ahead_m / self.length_m);
        let down = ahead_m * 0.42 * smoothstep(8.0, 50.0, above);
        // Half of the path's own rise: the view nods less than the path.
        let target = Vec3::new(ahead.x, eye.y + 0.5 * (ahead.y - eye.y) - down, ahead.z);
        if target.distance_squared(eye) > 1e-4 { (eye, target) } else { (eye, eye + Vec3::NEG_Z) }
    }

    fn index(&self, t: f32) -> (usize, f32) {
        let t = if t.is_finite() { t.rem_euclid(1.0) } else { 0.0 };
        let s = t * self.points.len() as f32;
        let i = (s as usize).min(self.points.len() - 1);
        (i, (s - i as f32).min(1.0))
    }

    fn build(field: &Heightfield, canopy: &Canopy, seed: u64) -> Self {
        let way = way_points(field, canopy, seed);
        let dense: Vec<Vec3> = (0..way.len())
            .flat_map(|i| {
                let p = [way.len() - 1, 0, 1, 2].map(|k| way[(i + k) % way.len()]);
                (0..64).map(move |k| centripetal(p, k as f32 / 64.0))
            })
            .collect();
        let length = loop_length(&dense);
        // A point every metre, but enough of them on small grounds and not too many on huge ones.
        let count = (length as usize).clamp(512, 32_768);
        let mut points = resampled(&dense, count);
        let step = length / count as f32;
        // Again with narrower corners, for what the first rounding brought back under crowns.
        for corner_m in [12.0, 8.0] {
            sidestep(&mut points, field, canopy, step, corner_m);
        }
        lift(&mut points, field, canopy, step);
        // Lifting changes lengths: space the points evenly again.
        let points = resampled(&points, count);
        let window = ((30.0 / step) as usize).clamp(1, count / 4);
        let above: Vec<f32> = points.iter().map(|p| p.y - field.height(p.x, p.z)).collect();
        let above_ground = smoothed(&smoothed(&above, window), window);
        let length_m = loop_length(&points);
        Self { points, above_ground, length_m }
    }
}

/// One point per role around a loop, each the best of several distances from the middle for its role.
fn way_points(field: &Heightfield, canopy: &Canopy, seed: u64) -> Vec<Vec3> {
    let mut rng = SplitMix64(seed ^ 0xF11_6847);
    let start = rng.range(0.0, TAU);
    let mut previous = 0.3;
    let points = ROLES.iter().enumerate().map(|(i, &role)| {
        let mut best = (f32::NEG_INFINITY, Vec2::ZERO, previous);
        for _ in 0..48 {
            let azimuth = start + TAU * (i as f32 + rng.range(-0.3, 0.3)) / ROLES.len() as f32;
            // Shares of the side; 0.42 keeps away from the border of the ground.
            let radius = rng.range(0.14, 0.42);
            let at = Vec2::from_angle(azimuth) * (radius * field.side_m());
            // Smooth loops: no zigzag between the middle and the border.
            let score = suitability(role, canopy, at) - 2.5 * (radius - previous).abs();
            if score > best.0 {
                best = (score, at, radius);
            }
        }
        let at = best.1;
        previous = best.2;
        let above = match role {
            Role::Edge => rng.range(LOWEST_M, 7.0),
            Role::Clearing => rng.range(LOWEST_M, 5.5),
            Role::Canopy => canopy.height(at.x, at.y) + rng.range(4.0, 10.0),
            Role::Overview => rng.range(36.0, HIGHEST_M),
        };
        Vec3::new(at.x, field.height(at.x, at.y) + above, at.y)
    });
    points.collect()
}

/// How well a place suits a role, about 0 to 2.
fn suitability(role: Role, canopy: &Canopy, at: Vec2) -> f32 {
    let here = if canopy.height(at.x, at.y) > 0.0 { 1.0 } else { 0.0 };
    let (near, far) = (canopy.cover(at, 9.0), canopy.cover(at, 28.0));
    match role {
        // About half of the surroundings is forest, none of the place itself.
        Role::Edge => 2.0 - 1.5 * here - near - 2.0 * (far - 0.5).abs(),
        Role::Clearing => 1.0 - 1.5 * here - near + far,
        Role::Canopy => here + near,
        Role::Overview => near,
    }
}

/// Point at `u` (0 to 1) between the second and third of four points.
fn centripetal(p: [Vec3; 4], u: f32) -> Vec3 {
    let knot = |a: Vec3, b: Vec3| a.distance(b).sqrt().max(1e-3);
    let t1 = knot(p[0], p[1]);
    let t2 = t1 + knot(p[1], p[2]);
    let t3 = t2 + knot(p[2], p[3]);
    let t = t1 + (t2 - t1) * u;
    // Barry and Goldman's pyramid.
    let mix = |a: Vec3, b: Vec3, ta: f32, tb: f32| {
        a * ((tb - t) / (tb - ta)) + b * ((t - ta) / (tb - ta))
    };
    let (a, b, c) = (mix(p[0], p[1], 0.0, t1), mix(p[1], p[2], t1, t2), mix(p[2], p[3], t2, t3));
    let (d, e) = (mix(a, b, 0.0, t2), mix(b, c, t1, t3));
    mix(d, e, t1, t2)
}

fn loop_length(points: &[Vec3]) -> f32 {
    (0..points.len()).map(|i| points[i].distance(points[(i + 1) % points.len()])).sum()
}

/// `count` points evenly spaced along the closed polyline.
fn resampled(points: &[Vec3], count: usize) -> Vec<Vec3> {
    let step = loop_length(points) / count as f32;
    let mut result = Vec::with_capacity(count);
    let (mut segment, mut done) = (0, 0.0);
    for i in 0..count {
        let goal = i as f32 * step;
        loop {
            let (a, b) = (points[segment], points[(segment + 1) % points.len()]);
            let length = a.distance(b);
            if done + length >= goal || segment + 1 == points.len() {
                let f = if length > 0.0 { ((goal - done) / length).clamp(0.0, 1.0) } else { 0.0 };
                result.push(a.lerp(b, f));
                break;
            }
            done += length;
            segment += 1;
        }
    }
    result
}

/// Moves low stretches sideways out of single trees and the fringe of forests, so that they need not climb over them.
/// Like an elastic band: small pushes away from the crowns, smoothed along the path, many times.
fn sidestep(points: &mut [Vec3], field: &Heightfield, canopy: &Canopy, step: f32, corner_m: f32) {
    const PUSHES: usize = 48;
    const PUSH_M: f32 = 0.8;
    const FEELER_M: f32 = 6.0;
    let half = ((6.0 / step) as usize).clamp(1, points.len() / 8);
    let border = field.side_m() * 0.46;
    let (mut dx, mut dz) = (vec![0.0; points.len()], vec![0.0; points.len()]);
    for _ in 0..PUSHES {
        for (i, p) in points.iter().enumerate() {
            let at = Vec2::new(p.x + dx[i], p.z + dz[i]);
            let low = p.y - field.height(at.x, at.y) < TREE_HEIGHT_M;
            // In deep forest there is no side to step to.
            let cover = if low { canopy.cover(at, FEELER_M) } else { 0.0 };
            if !(0.01..0.7).contains(&cover) {
                continue;
            }
            let feelers = (0..16).map(|k| Vec2::from_angle(TAU * k as f32 / 16.0));
            let away: Vec2 = feelers
                .filter(|f| canopy.height(at.x + f.x * FEELER_M, at.y + f.y * FEELER_M) > 0.0)
                .map(|f| -f)
                .sum();
            let push = away.normalize_or_zero() * PUSH_M;
            dx[i] += push.x;
            dz[i] += push.y;
        }
        (dx, dz) = (smoothed(&dx, half), smoothed(&dz, half));
    }
    // Rounds off the corners that pushes from one side leave; what this brings back under crowns is lifted over them.
    let round = ((corner_m / step) as usize).clamp(1, points.len() / 8);
    let xs: Vec<f32> =
        points.iter().zip(&dx).map(|(p, d)| (p.x + d).clamp(-border, border)).collect();
    let zs: Vec<f32> =
        points.iter().zip(&dz).map(|(p, d)| (p.z + d).clamp(-border, border)).collect();
    let (xs, zs) = (smoothed(&smoothed(&xs, round), round), smoothed(&smoothed(&zs, round), round));
    for (i, point) in points.iter_mut().enumerate() {
        let above = point.y - field.height(point.x, point.z);
        (point.x, point.z) = (xs[i], zs[i]);
        point.y = field.height(point.x, point.z) + above;
    }
}

/// Raises the points over ground and crowns, early and smoothly: the needed lift is spread by a running maximum and then
/// averaged over windows of at most that width, so the average is nowhere below the need.
fn lift(points: &mut [Vec3], field: &Heightfield, canopy: &Canopy, step: f32) {
    let needed = |p: &Vec3| {
        // Ground beside the path counts too: the camera banks past slopes without clipping them.
        let sides = [(0.0, 0.0), (2.0, 0.0), (-2.0, 0.0), (0.0, 2.0), (0.0, -2.0)];
        let ground = sides
            .map(|(dx, dz)| field.height(p.x + dx, p.z + dz))
            .into_iter()
            .fold(f32::MIN, f32::max);
        let crown =
            sides.map(|(dx, dz)| canopy.height(p.x + dx, p.z + dz)).into_iter().fold(0.0, f32::max);
        let above = if crown > 0.0 { crown + CROWN_CLEARANCE_M } else { LOWEST_M };
        (ground + above - p.y).max(0.0)
    };
    let need: Vec<f32> = points.iter().map(needed).collect();
    let half = ((ANTICIPATION_M * 0.5 / step) as usize).clamp(1, points.len() / 8);
    // Two averages of `half` reach 2 · half to each side, no further than the maximum does.
    let spread = running_maximum(&need, 2 * half);
    let lifts = smoothed(&smoothed(&spread, half), half);
    for (point, lift) in points.iter_mut().zip(lifts) {
        point.y += lift;
    }
}

/// Largest value within `half` places to both sides of each place of a closed list. O(n · half).
fn running_maximum(values: &[f32], half: usize) -> Vec<f32> {
    let n = values.len();
    (0..n)
        .map(|i| (0..=2 * half).map(|k| values[(i + n + k - half) % n]).fold(f32::MIN, f32::max))
        .collect()
}

/// Mean within `half` places to both sides of each place of a closed list. O(n · half).
fn smoothed(values: &[f32], half: usize) -> Vec<f32> {
    let n = values.len();
    let share = 1.0 / (2 * half + 1) as f32;
    (0..n)
        .map(|i| (0..=2 * half).map(|k| values[(i + n + k - half) % n]).sum::<f32>() * share)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::landscape::{
        BiomeSettings, Biomes, Scatter, ScatterSettings, ScatterSpecies, TreeAmount,
    };
    use proptest::prelude::*;
    use std::sync::Arc;

    fn forest(side_m: f32, count: usize, seed: u64) -> (Heightfield, Vec<ScatteredTree>) {
        let field = Heightfield::rolling(side_m, 128, seed);
        let biomes =
            Arc::new(Biomes::new(&field, &BiomeSettings { seed, ..BiomeSettings::default() }));
        let amount = TreeAmount::Total(count as u64);
        let settings = ScatterSettings { amount, seed, ..ScatterSettings::default() };
        let species = vec![ScatterSpecies::new("tree", 16.0, 4.0)];
        let scatter =
            Scatter::new(Arc::new(field.clone()), biomes, species, settings).expect("room");
        (field, scatter.tiles().flat_map(|t| scatter.tile(t)).collect())
    }

    #[test]
    fn the_flight_is_low_at_times_and_high_at_others() {
        for seed in 1..8 {
            let (field, trees) = forest(1000.0, 15_000, seed);
            let path = FlightPath::over_forest(&field, &trees, seed);
            let above: Vec<f32> = (0..2000)
                .map(|i| path.position(i as f32 / 2000.0))
                .map(|p| p.y - field.height(p.x, p.z))
                .collect();
            let low = above.iter().filter(|&&h| h < 9.0).count() as f32 / 2000.0;
            let high = above.iter().filter(|&&h| h > 25.0).count() as f32 / 2000.0;
            let highest = above.iter().copied().fold(0.0, f32::max);
            assert!(low > 0.08 && high > 0.1, "seed {seed}: low {low}, high {high}");
            assert!(highest < 62.0, "seed {seed}: {highest}");
        }
    }

    #[test]
    fn the_flight_never_enters_a_crown() {
        let (field, trees) = forest(800.0, 12_000, 3);
        let path = FlightPath::over_forest(&field, &trees, 3);
        for i in 0..4000 {
            let p = path.position(i as f32 / 4000.0);
            for tree in &trees {
                let offset = p - tree.position;
                let aside = Vec2::new(offset.x, offset.z).length();
                let inside = aside < 5.0 * tree.scale && offset.y < 15.0 * tree.scale;
                assert!(!inside, "at {p}: {aside} m from a trunk, {} m up", offset.y);
            }
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(16))]
        #[test]
        fn the_flight_clears_the_ground_and_moves_evenly(seed in any::<u64>(), side_m in 60.0f32..4000.0) {
            let field = Heightfield::rolling(side_m, 96, seed);
            let path = FlightPath::over(&field, seed);
            prop_assert_eq!(&path, &FlightPath::over(&field, seed));
            let samples = 20_000;
            let step = path.length_m() / samples as f32;
            let mut before = path.position(-1.0 / samples as f32);
            for i in 0..samples {
                let t = i as f32 / samples as f32;
                let p = path.position(t);
                prop_assert!(p.y - field.height(p.x, p.z) >= GROUND_CLEARANCE_M, "t {}", t);
                prop_assert!(p.x.abs() < side_m * 0.5 && p.z.abs() < side_m * 0.5);
                prop_assert!(p.distance(before) < 1.6 * step + 2e-3, "jump at t {}: {} of {}", t, p.distance(before), step);
                let (eye, target) = path.look(t);
                prop_assert!(eye == p && target.distance(eye) > 1e-3 && target.is_finite());
                before = p;
            }
            prop_assert!(path.position(0.25).distance(path.position(1.25)) < 0.05);
            prop_assert!(path.position(f32::NAN).is_finite());
        }
    }
}
