//! Stems of a tree: shape and outline in, polylines with radii out. O(stems · segments).
//!
//! Down angles, rotation by the golden angle, curving, forks and the taper follow Weber & Penn 1995, sections 4.1 to 4.4.

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
    /// Broken off: it ends in a face, not in a point.
    pub blunt: bool,
    /// 0 to 1, alike within a limb: tint, and when it turns in autumn.
    pub tone: f32,
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

    /// Keeps the inner `share` (0 to 1) of the stem.
    fn break_off(&mut self, share: f32) {
        let end = self.at(share);
        let segments = self.points.len() - 1;
        let kept = ((share * segments as f32).ceil() as usize).clamp(1, segments);
        self.points.truncate(kept);
        self.radii.truncate(kept);
        self.points.push(end.position);
        self.radii.push(end.radius);
        self.length *= share;
        self.blunt = true;
    }
}

/// Where a stem starts and how it grows.
#[derive(Clone)]
struct Start {
    level: usize,
    origin: Vec3,
    direction: Vec3,
    length: f32,
    radius: f32,
    lift_deg: [f32; 2],
    wander_deg: f32,
    forks: f32,
    fork_deg: f32,
    taper: f32,
    segments: u32,
    sides: u32,
    tone: f32,
}

/// All stems, parents before children.
pub(super) fn grow_stems(
    shape: &TreeShape,
    envelope: &Envelope,
    rng: &mut SplitMix64,
) -> Vec<Stem> {
    let mut stems = grow_trunks(shape, envelope, rng);
    let mut parents = 0..stems.len();
    for (level, stem) in shape.levels.iter().enumerate() {
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
    let leaf_levels = shape.leaves.as_ref().map_or(0, |leaves| leaves.levels as usize);
    let last = stems.iter().map(|stem| stem.level).max().unwrap_or(0);
    for stem in &mut stems {
        let bears = stem.level > 0 && stem.level + leaf_levels > last;
        stem.leafy = bears || (stem.level > 0 && stem.childless);
    }
    stems
}

fn grow_trunks(shape: &TreeShape, envelope: &Envelope, rng: &mut SplitMix64) -> Vec<Stem> {
    let top = envelope.top_y();
    let trunk = &shape.trunk;
    let mut stems = Vec::new();
    for i in 0..trunk.count {
        let azimuth = i as f32 * GOLDEN_ANGLE + rng.range(-0.4, 0.4);
        let outward = Vec3::new(azimuth.cos(), 0.0, azimuth.sin());
        let several = trunk.count > 1;
        let (lean, shorter) = if several {
            (trunk.lean_deg * rng.range(0.25, 1.0), rng.range(0.72, 1.0))
        } else {
            (0.0, 1.0)
        };
        let lean = lean.to_radians();
        let direction = Vec3::Y * lean.cos() + outward * lean.sin();
        // A leaning trunk may not leave the crown, or its branches would have no room.
        let room = if several {
            envelope.distance_to_outline(Vec3::Y * top * 0.02, direction)
        } else {
            top
        };
        let start = Start {
            level: 0,
            origin: if several { outward * trunk.radius_m * 2.5 } else { Vec3::ZERO },
            direction,
            length: (room * trunk.length * shorter).max(top * 0.1),
            radius: trunk.radius_m * (0.6 + 0.4 * top / shape.height_m) * (0.4 + 0.6 * shorter),
            lift_deg: if several { [4.0, 10.0] } else { [40.0, 40.0] },
            wander_deg: trunk.wander_deg,
            forks: 0.0,
            fork_deg: 0.0,
            taper: trunk.taper,
            segments: trunk.segments,
            sides: shape.bark.sides,
            tone: rng.next_f32(),
        };
        grow_stem(start, &mut stems, rng);
    }
    for stem in &mut stems {
        stem.flare = trunk.flare;
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
    let whorls = whorls.min(MOST_STEMS);
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
            let broken = rng.next_f32() < shape.broken;
            let left = if broken { rng.range(0.2, 0.7) } else { 1.0 };
            let length = child_length(parent, level, shape, envelope, (at, direction), shaken);
            let length = length * jitter;
            if length < SHORTEST_M.min(envelope.top_y() * 0.01) {
                continue;
            }
            let tone = if level == 1 { 0.0 } else { 0.55 };
            let start = Start {
                level,
                origin: at.position,
                direction,
                length,
                radius: (at.radius * shape.radius).min(length * 0.06).max(0.002),
                lift_deg: shape.lift_deg,
                wander_deg: shape.wander_deg,
                forks: shape.forks,
                fork_deg: shape.fork_deg,
                taper: shape.taper,
                segments: shape.segments,
                sides: shape.sides,
                tone: parent.tone * tone + rng.next_f32() * (1.0 - tone),
            };
            let first = children.len();
            grow_stem(start, &mut children, rng);
            if broken {
                // Its arms broke off with it.
                children.truncate(first + 1);
                children[first].break_off(left);
            }
            if level > 2 {
                children[first..].iter_mut().for_each(|child| child.clump = parent.clump);
            }
        }
    }
    children
}

/// Length of a stem before its random part.
fn child_length(
    parent: &Stem,
    level: usize,
    shape: &StemShape,
    envelope: &Envelope,
    (at, direction): (StemPoint, Vec3),
    shaken: f32,
) -> f32 {
    let top = envelope.top_y();
    if level == 1 && shape.hang == 0.0 {
        // The topmost limbs have next to no room, yet no top is bare.
        return (envelope.distance_to_outline(at.position, direction) * shape.length)
            .max(top * 0.018);
    }
    // Shorter to the end of the parent, like the parent's own children.
    let wanted = parent.length * shape.length * (1.15 - 0.75 * shaken);
    let room = envelope.distance_to_outline(at.position, direction) * 0.9 + top * 0.025;
    let within = wanted.min(room);
    if shape.hang == 0.0 {
        return within;
    }
    let above_ground = (at.position.y - top * 0.05).max(top * 0.01);
    (within + (wanted - within) * shape.hang).min(above_ground)
}

/// Unit vector at right angles to `axis`; all around by `azimuth`, or with `flatness` pulled to the horizontal `side`.
pub(super) fn springing_direction(axis: Vec3, azimuth: f32, side: f32, flatness: f32) -> Vec3 {
    let (u, v) = axis.any_orthonormal_pair();
    let around = u * azimuth.cos() + v * azimuth.sin();
    let sideways = axis.cross(Vec3::Y).normalize_or(u) * side;
    let mixed = around * (1.0 - flatness) + sideways * flatness;
    mixed.reject_from_normalized(axis).normalize_or(around)
}

/// Grows one stem and the arms that fork off it; the stem itself comes first.
fn grow_stem(start: Start, stems: &mut Vec<Stem>, rng: &mut SplitMix64) {
    let segments = start.segments.max(1);
    let step = start.length / segments as f32;
    let mut direction = start.direction;
    let mut position = start.origin;
    let (mut points, mut radii) = (vec![position], vec![start.radius]);
    let mut forks = (start.forks + rng.next_f32()).floor() as u32;
    let mut arms = Vec::new();
    for i in 0..segments {
        let u = i as f32 / segments as f32;
        let left = segments - i;
        // Forks lie in the middle part; each place is as likely as the others.
        let may_fork = u >= 0.25 && left >= 2;
        if may_fork && forks > 0 && rng.next_f32() * (left - 1) as f32 <= forks as f32 {
            let half = start.fork_deg.to_radians() * rng.range(0.35, 0.65);
            let radial =
                springing_direction(direction, rng.range(0.0, std::f32::consts::TAU), 1.0, 0.35);
            let bent = |angle: f32| (direction * angle.cos() + radial * angle.sin()).normalize();
            arms.push(Start {
                origin: position,
                direction: bent(half - start.fork_deg.to_radians()),
                length: step * left as f32 * rng.range(0.75, 1.0),
                radius: radii[i as usize] * 0.82,
                forks: (forks - 1) as f32,
                segments: left,
                ..start.clone()
            });
            direction = bent(half);
            forks -= 1;
        }
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
        radii.push(start.radius * (1.0 - 0.9 * u.powf(start.taper)));
        points.push(position);
    }
    stems.push(Stem {
        level: start.level,
        clump: points[points.len() - 1],
        points,
        radii,
        length: start.length,
        sides: start.sides,
        leafy: false,
        childless: true,
        blunt: false,
        flare: 0.0,
        tone: start.tone,
    });
    for arm in arms {
        grow_stem(arm, stems, rng);
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
    use crate::species::{PlantShape, Species, preset};

    #[test]
    fn turning_up_stops_at_the_vertical() {
        assert!(turn_up(Vec3::X, 0.5).y > 0.4);
        assert!(turn_up(Vec3::X, -0.5).y < -0.4);
        assert!(turn_up(Vec3::X, 3.0).distance(Vec3::Y) < 1e-5);
    }

    #[test]
    fn stems_stay_near_the_outline_and_taper() {
        let Ok(Species { shape: PlantShape::Tree(shape), .. }) = preset("oak") else {
            panic!("the oak is a tree");
        };
        let mut rng = SplitMix64(4);
        let envelope = Envelope::new(&shape.crown, shape.height_m, &mut rng);
        let stems = grow_stems(&shape, &envelope, &mut rng);
        assert!(stems.iter().any(|stem| stem.level == shape.levels.len()));
        for stem in &stems {
            assert!(stem.radii.windows(2).all(|w| w[1] <= w[0]));
            assert!(stem.points.iter().all(|p| p.length() < 1.3 * shape.height_m));
        }
    }

    #[test]
    fn a_broken_stem_keeps_its_inner_part() {
        let mut stem = Stem {
            level: 1,
            points: vec![Vec3::ZERO, Vec3::X, Vec3::X * 2.0, Vec3::X * 3.0],
            radii: vec![0.4, 0.3, 0.2, 0.1],
            length: 3.0,
            sides: 4,
            leafy: false,
            childless: true,
            flare: 0.0,
            blunt: false,
            tone: 0.0,
            clump: Vec3::ZERO,
        };
        stem.break_off(0.5);
        assert_eq!(stem.points, [Vec3::ZERO, Vec3::X, Vec3::X * 1.5]);
        assert_eq!((stem.length, stem.blunt), (1.5, true));
        assert!((stem.radii[2] - 0.25).abs() < 1e-6);
    }
}
