//! Last-level stems → folded leaves of two triangles. O(leaves).

use super::PlainPart;
use super::envelope::Envelope;
use super::shape::LeafShape;
use super::skeleton::{GOLDEN_ANGLE, Stem, StemPoint, springing_direction};
use crate::math::hash::SplitMix64;
use bevy::math::Vec3;

/// All leaves of a tree.
pub(super) fn leaves_part(
    shape: &LeafShape,
    stems: &[Stem],
    envelope: &Envelope,
    rng: &mut SplitMix64,
) -> PlainPart {
    let mut part = PlainPart {
        name: "leaves".into(),
        double_sided: true,
        roughness: shape.roughness,
        ..PlainPart::default()
    };
    let leafy_length: f32 = stems.iter().filter(|stem| stem.leafy).map(|stem| stem.length).sum();
    let nodes_per_m = shape.count as f32 / (shape.per_node as f32 * leafy_length.max(1e-3));
    for stem in stems.iter().filter(|stem| stem.leafy) {
        // Rounded at random, so that the sum is met whatever the lengths are.
        let nodes = (stem.length * nodes_per_m + rng.next_f32()).floor() as usize;
        let mut azimuth = rng.range(0.0, std::f32::consts::TAU);
        for node in 0..nodes {
            // The last node sits on the tip: no stem ends bare.
            let inner = if stem.childless { 0.0 } else { 0.2 };
            let u = 1.0 - (1.0 - inner) * (node as f32 + rng.range(0.0, 0.5)) / nodes as f32;
            azimuth += GOLDEN_ANGLE;
            push_node(&mut part, shape, stem, &stem.at(u), envelope, azimuth, rng);
        }
    }
    part
}

/// The leaves of one place; they share its vertex.
fn push_node(
    part: &mut PlainPart,
    shape: &LeafShape,
    stem: &Stem,
    at: &StemPoint,
    envelope: &Envelope,
    azimuth: f32,
    rng: &mut SplitMix64,
) {
    let place = Place::new(shape, stem, at.position, envelope);
    let base = part.push_vertex(at.position, place.outward, place.color * 0.6);
    let count = shape.per_node;
    for leaf in 0..count {
        // Needles stand to the left, the right and (odd ones) straight on; leaves stand all around.
        let side = [1.0, -1.0][leaf as usize % 2];
        let straight = shape.flatness > 0.5 && count % 2 == 1 && leaf + 1 == count;
        let turn = std::f32::consts::TAU * leaf as f32 / count as f32;
        let radial = springing_direction(at.direction, azimuth + turn, side, shape.flatness);
        let angle = if straight { 6.0 } else { shape.angle_deg } + rng.range(-14.0, 14.0);
        let angle = angle.to_radians();
        let direction = at.direction * angle.cos() + radial * angle.sin();
        let direction =
            (direction - Vec3::Y * shape.droop * rng.range(0.6, 1.4)).normalize_or(at.direction);
        push_leaf(part, shape, base, at.position, direction, &place, rng);
    }
}

/// What the leaves of a place have in common.
struct Place {
    outward: Vec3,
    color: Vec3,
    /// Leaves in the sun, at the top, are smaller.
    size: f32,
}

impl Place {
    fn new(shape: &LeafShape, stem: &Stem, position: Vec3, envelope: &Envelope) -> Self {
        let depth = envelope.depth(position).clamp(0.0, 1.0);
        let height = envelope.height_share(position.y);
        // Clumps are rounder than the crown: away from a point inside the clump, its lower side in shade.
        let heart = stem.clump.lerp(envelope.center(), 0.22);
        let clump_out = (position - heart).normalize_or(Vec3::Y);
        let outward =
            (envelope.outward(position) + clump_out * 0.6 + Vec3::Y * 0.15).normalize_or(Vec3::Y);
        let light = (depth.powi(3) * (0.72 + 0.28 * clump_out.y)).clamp(0.0, 1.0);
        let crown = Vec3::from(shape.inside).lerp(Vec3::from(shape.outside), light);
        let sun = light
            * ((height - 0.35) / 0.65).clamp(0.0, 1.0)
            * (0.5 + 0.5 * outward.y).clamp(0.0, 1.0);
        Self {
            outward,
            color: crown.lerp(Vec3::from(shape.top), sun),
            size: 1.0 - 0.25 * height.powi(3),
        }
    }
}

/// A kite folded along its middle, from the shared `base` vertex.
fn push_leaf(
    part: &mut PlainPart,
    shape: &LeafShape,
    base: u32,
    origin: Vec3,
    direction: Vec3,
    place: &Place,
    rng: &mut SplitMix64,
) {
    let length =
        shape.length_m * place.size * rng.range(1.0 - shape.size_jitter, 1.0 + shape.size_jitter);
    let half_width = 0.5 * length * shape.width * rng.range(0.85, 1.15);
    // Blades turn to the light: the upper side faces up and out, with some disorder.
    let disorder = Vec3::new(rng.range(-1.0, 1.0), rng.range(-1.0, 1.0), rng.range(-1.0, 1.0));
    let facing = place.outward * 0.6 + Vec3::Y * 0.6 + disorder * 0.75;
    let across = direction.cross(facing).normalize_or(direction.any_orthonormal_vector());
    let face = across.cross(direction);
    let (sin, cos) = shape.fold_deg.to_radians().sin_cos();
    let middle = origin + direction * (length * shape.widest);
    let wing = |side: f32| middle + (across * (side * cos) + face * sin) * half_width;
    let normal = |side: f32| {
        let flat = (face * cos - across * (side * sin)) * (1.0 - shape.bend);
        (flat + place.outward * shape.bend).normalize_or(place.outward)
    };
    // Brightness differs per leaf; a little of it goes from green to yellow.
    let shade = rng.range(1.0 - shape.color_jitter, 1.0 + shape.color_jitter);
    let yellow = rng.range(-0.12, 0.16);
    let color = place.color * shade * Vec3::new(1.0 + yellow, 1.0, 1.0 - yellow);
    let left = part.push_vertex(wing(1.0), normal(1.0), color);
    let tip = part.push_vertex(origin + direction * length, normal(0.0), color * 1.12);
    let right = part.push_vertex(wing(-1.0), normal(-1.0), color * 0.94);
    push_facing(part, [base, left, tip]);
    push_facing(part, [base, tip, right]);
}

/// Adds the triangle, wound so that its front is on the side of its normals: there, lighting takes them as they are.
fn push_facing(part: &mut PlainPart, triangle: [u32; 3]) {
    let [a, b, c] = triangle.map(|i| part.positions[i as usize]);
    let normal: Vec3 = triangle.iter().map(|&i| part.normals[i as usize]).sum();
    let [i, j, k] = triangle;
    let front = (b - a).cross(c - a).dot(normal) >= 0.0;
    part.triangles.push(if front { [i, j, k] } else { [i, k, j] });
}
