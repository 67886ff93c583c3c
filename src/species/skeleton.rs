//! Stems of a tree: shape and outline in, polylines with radii out. O(stems · segments).
//!
//! Down angles, rotation by the golden angle, curving and the taper follow Weber & Penn 1995, sections 4.1 to 4.4.

use super::envelope::Envelope;
use super::shape::{StemShape, TreeShape};
use crate::math::hash::SplitMix64;
use bevy::math::{Quat, Vec3};

/// 360° / φ², the angle between successive leaves of most plants.
pub(super) const GOLDEN_ANGLE: f32 = 2.399_963_2;
/// Stems shorter than this bear nothing and are left out.
const SHORTEST_M: f32 = 0.04;
/// An upper limit on stems of a level, so that absurd shapes end.
const MOST_STEMS: usize = 20_000;

/// A polyline with radii.
pub(super) struct Stem {
    /// 0 trunk, 1 limb, 2 bough, 3 twig.
    pub level: usize,
    /// At least two.
    pub points: Vec<Vec3>,
    /// One a point, falling.
    pub radii: Vec<f32>,
    /// Metres along the points.
    pub length: f32,
    /// Sides of the tube; 0 draws none.
    pub sides: u32,
    /// Bears leaves.
    pub leafy: bool,
    /// No other stem springs from it.
    pub childless: bool,
    /// Root flare as a share of the radius (trunk only).
    pub flare: f32,
    /// Outer end of the limb it belongs to: the middle of its clump of leaves.
    pub clump: Vec3,
}

/// A place on a stem.
#[derive(Clone, Copy)]
pub(super) struct StemPoint {
    pub position: Vec3,
    pub direction: Vec3,
    pub radius: f32,
}

impl Stem {
    /// The place at share `u` (0 to 1) of the stem.
    pub(super) fn at(&self, u: f32) -> StemPoint {
        let segments = self.points.len() - 1;
        let s = u.clamp(0.0, 1.0) * segments as f32;
        let i = (s as usize).min(segments - 1);
        let f = s - i as f32;
        let (a, b) = (self.points[i], self.points[i + 1]);
        StemPoint {
            position: a.lerp(b, f),
            direction: (b - a).normalize_or(Vec3::Y),
            radius: self.radii[i] + (self.radii[i + 1] - self.radii[i]) * f,
        }
    }
}

/// Where a stem starts and how it grows.
struct Start {
    level: usize,
    origin: Vec3,
    direction: Vec3,
    length: f32,
    radius: f32,
    lift_deg: [f32; 2],
    wander_deg: f32,
    segments: u32,
    sides: u32,
}

/// All stems, parents before children.
pub(super) fn grow_stems(
    shape: &TreeShape,
    envelope: &Envelope,
    rng: &mut SplitMix64,
) -> Vec<Stem> {
    let top = envelope.top_y();
    let start = Start {
        level: 0,
        origin: Vec3::ZERO,
        direction: Vec3::Y,
        length: top * shape.trunk.length,
        radius: shape.trunk.radius_m * (0.6 + 0.4 * top / shape.height_m),
        lift_deg: [40.0, 40.0],
        wander_deg: shape.trunk.wander_deg,
        segments: shape.trunk.segments,
        sides: shape.bark.sides,
    };
    let mut trunk = grow_stem(&start, rng);
    trunk.flare = shape.trunk.flare;
    let mut stems = vec![trunk];
    let mut parents = 0..1;
    for (level, stem) in [&shape.limbs, &shape.boughs, &shape.twigs].into_iter().enumerate() {
        let first = stems.len();
        for parent in parents {
            let children = grow_children(&stems[parent], level + 1, stem, envelope, rng);
            stems[parent].childless = children.is_empty();
            stems.extend(children);
            if stems.len() - first > MOST_STEMS {
                break;
            }
        }
        if stems.len() == first {
            break; // The level above bears the leaves.
        }
        parents = first..stems.len();
    }
    let last = stems.iter().map(|stem| stem.level).max().unwrap_or(0);
    for stem in &mut stems {
        let bears = stem.level > 0 && stem.level + shape.leaves.levels as usize > last;
        stem.leafy = bears || (stem.level > 0 && stem.childless);
    }
    stems
}

fn grow_children(
    parent: &Stem,
    level: usize,
    shape: &StemShape,
    envelope: &Envelope,
    rng: &mut SplitMix64,
) -> Vec<Stem> {
    let bearing = parent.length * (shape.bearing[1] - shape.bearing[0]);
    let whorls = (bearing * shape.per_m / shape.whorl as f32 + rng.next_f32()).floor() as usize;
    let mut children = Vec::with_capacity(whorls * shape.whorl as usize);
    let mut azimuth = rng.range(0.0, std::f32::consts::TAU);
    for whorl in 0..whorls {
        azimuth += GOLDEN_ANGLE;
        let place = (whorl as f32 + rng.range(0.4, 0.98)) / whorls as f32;
        for arm in 0..shape.whorl {
            // Arms of a whorl spring off at nearly, not exactly, the same height.
            let shaken =
                place + rng.range(-0.15, 0.15) / whorls as f32 * (shape.whorl.min(2) - 1) as f32;
            let u =
                shape.bearing[0] + (shape.bearing[1] - shape.bearing[0]) * shaken.clamp(0.0, 1.0);
            let turn = std::f32::consts::TAU * arm as f32 / shape.whorl as f32;
            let at = parent.at(u);
            let side = if (whorl + arm as usize).is_multiple_of(2) { 1.0 } else { -1.0 };
            let radial = springing_direction(
                at.direction,
                azimuth + turn + rng.range(-0.2, 0.2),
                side,
                shape.flatness,
            );
            let angle = shape.angle_deg[0]
                + (shape.angle_deg[1] - shape.angle_deg[0]) * shaken
                + rng.range(-1.0, 1.0) * shape.angle_jitter_deg;
            let angle = angle.to_radians();
            let direction =
                (at.direction * angle.cos() + radial * angle.sin()).normalize_or(Vec3::Y);
            let jitter = rng.range(1.0 - shape.length_jitter, 1.0 + shape.length_jitter * 0.4);
            let room = envelope.distance_to_outline(at.position, direction);
            let length = if level == 1 {
                // The topmost limbs have next to no room, yet no top is bare.
                (room * shape.length * jitter).max(envelope.top_y() * 0.018)
            } else {
                // Shorter to the end of the parent, like the parent's own children; never far beyond the outline.
                (parent.length * shape.length * (1.15 - 0.75 * shaken) * jitter)
                    .min(room * 0.9 + 0.35)
            };
            if length < SHORTEST_M {
                continue;
            }
            let start = Start {
                level,
                origin: at.position,
                direction,
                length,
                radius: (at.radius * shape.radius).min(length * 0.06).max(0.003),
                lift_deg: shape.lift_deg,
                wander_deg: shape.wander_deg,
                segments: shape.segments,
                sides: shape.sides,
            };
            let mut child = grow_stem(&start, rng);
            if level > 2 {
                child.clump = parent.clump;
            }
            children.push(child);
        }
    }
    children
}

/// Unit vector at right angles to `axis`; all around by `azimuth`, or with `flatness` pulled to the horizontal `side`.
pub(super) fn springing_direction(axis: Vec3, azimuth: f32, side: f32, flatness: f32) -> Vec3 {
    let (u, v) = axis.any_orthonormal_pair();
    let around = u * azimuth.cos() + v * azimuth.sin();
    let sideways = axis.cross(Vec3::Y).normalize_or(u) * side;
    let mixed = around * (1.0 - flatness) + sideways * flatness;
    mixed.reject_from_normalized(axis).normalize_or(around)
}

fn grow_stem(start: &Start, rng: &mut SplitMix64) -> Stem {
    let segments = start.segments.max(1);
    let step = start.length / segments as f32;
    let mut direction = start.direction;
    let mut position = start.origin;
    let (mut points, mut radii) = (vec![position], vec![start.radius]);
    for i in 0..segments {
        let lift = start.lift_deg[usize::from(2 * i >= segments)] * 2.0 / segments as f32;
        let wander = start.wander_deg.to_radians();
        if start.level > 0 || i > 0 {
            direction = turn_up(direction, lift.to_radians());
            let (u, v) = direction.any_orthonormal_pair();
            let shake = u * rng.range(-1.0, 1.0) + v * rng.range(-1.0, 1.0);
            direction = (direction + shake * wander.tan()).normalize_or(Vec3::Y);
        }
        position += direction * step;
        let u = (i + 1) as f32 / segments as f32;
        // Between Weber and Penn's cone and a slower taper: stems keep their strength to the middle.
        radii.push(start.radius * (1.0 - 0.9 * u.powf(1.15)));
        points.push(position);
    }
    Stem {
        level: start.level,
        clump: points[points.len() - 1],
        points,
        radii,
        length: start.length,
        sides: start.sides,
        leafy: false,
        childless: true,
        flare: 0.0,
    }
}

/// Turns `direction` by `angle` radians towards the sky (to the ground if negative), never past the vertical.
fn turn_up(direction: Vec3, angle: f32) -> Vec3 {
    let goal = if angle >= 0.0 { Vec3::Y } else { Vec3::NEG_Y };
    let axis = direction.cross(goal);
    let left = axis.length().atan2(direction.dot(goal));
    match axis.try_normalize() {
        Some(axis) => Quat::from_axis_angle(axis, angle.abs().min(left)) * direction,
        None => direction,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn turning_up_stops_at_the_vertical() {
        assert!(turn_up(Vec3::X, 0.5).y > 0.4);
        assert!(turn_up(Vec3::X, -0.5).y < -0.4);
        assert!(turn_up(Vec3::X, 3.0).distance(Vec3::Y) < 1e-5);
    }

    #[test]
    fn stems_stay_near_the_outline_and_taper() {
        let shape = TreeShape::broadleaf();
        let mut rng = SplitMix64(4);
        let envelope = Envelope::new(&shape.crown, 11.0, &mut rng);
        let stems = grow_stems(&shape, &envelope, &mut rng);
        assert!(stems.iter().any(|stem| stem.level == 3));
        for stem in &stems {
            assert!(stem.radii.windows(2).all(|w| w[1] <= w[0]));
            assert!(stem.points.iter().all(|p| p.length() < 16.0));
        }
    }
}
