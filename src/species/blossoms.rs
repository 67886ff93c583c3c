//! Blossoms: petals around a disc. O(blossoms · petals).

use super::PlainPart;
use super::envelope::Envelope;
use super::shape::BlossomShape;
use super::skeleton::Stem;
use crate::math::hash::SplitMix64;
use bevy::math::Vec3;
use std::f32::consts::TAU;

/// Corners of a blossom's disc.
const DISC_CORNERS: u32 = 6;

/// A part for blossoms of a plant.
pub(super) fn empty_part() -> PlainPart {
    PlainPart {
        name: "blossoms".into(),
        double_sided: true,
        roughness: 0.8,
        ..PlainPart::default()
    }
}

/// The petals' colour of one plant.
pub(super) fn plant_color(shape: &BlossomShape, rng: &mut SplitMix64) -> Vec3 {
    let place = rng.next_f32() * (shape.colors.len() - 1) as f32;
    let low = place as usize;
    let high = (low + 1).min(shape.colors.len() - 1);
    Vec3::from(shape.colors[low]).lerp(Vec3::from(shape.colors[high]), place.fract())
}

/// Blossoms spread over the leafy stems of a tree or shrub.
pub(super) fn tree_blossoms(
    shape: &BlossomShape,
    stems: &[Stem],
    envelope: &Envelope,
    rng: &mut SplitMix64,
) -> PlainPart {
    let mut part = empty_part();
    let leafy: Vec<&Stem> = stems.iter().filter(|stem| stem.leafy).collect();
    let color = plant_color(shape, rng);
    if leafy.is_empty() {
        return part;
    }
    for _ in 0..shape.count {
        let at = leafy[rng.below(leafy.len())].at(rng.range(0.4, 1.0));
        let facing = envelope.outward(at.position) + random_direction(rng) * 0.5;
        push_blossom(&mut part, shape, at.position, facing.normalize_or(Vec3::Y), color, rng);
    }
    part
}

fn random_direction(rng: &mut SplitMix64) -> Vec3 {
    Vec3::new(rng.range(-1.0, 1.0), rng.range(-1.0, 1.0), rng.range(-1.0, 1.0))
}

/// One blossom that looks along `facing` (unit).
pub(super) fn push_blossom(
    part: &mut PlainPart,
    shape: &BlossomShape,
    center: Vec3,
    facing: Vec3,
    color: Vec3,
    rng: &mut SplitMix64,
) {
    let radius = shape.radius_m * rng.range(0.8, 1.1);
    let color = color * rng.range(0.88, 1.08);
    let (u, v) = facing.any_orthonormal_pair();
    let turn = rng.range(0.0, TAU);
    let (sin, cos) = shape.cup_deg.to_radians().sin_cos();
    let disc = radius * shape.disc;
    for petal in 0..shape.petals {
        let azimuth = turn + TAU * petal as f32 / shape.petals as f32;
        let out = u * azimuth.cos() + v * azimuth.sin();
        let along = out * cos + facing * (sin + rng.range(-0.1, 0.1));
        let across = facing.cross(out);
        let length = (radius - disc * 0.6) * rng.range(0.9, 1.05);
        let foot = center + out * disc * 0.6;
        let half = across * (0.5 * shape.petal_width * length);
        let middle = foot + along * (length * 0.62) + facing * (length * 0.06);
        let normal = (facing * 0.8 + out * -0.3 * sin + Vec3::Y * 0.3).normalize_or(facing);
        let base = part.push_vertex(foot, normal, color * 0.8);
        let left = part.push_vertex(middle + half, normal, color);
        let tip = part.push_vertex(foot + along * length, normal, color * 1.05);
        let right = part.push_vertex(middle - half, normal, color * 0.96);
        part.push_facing([base, left, tip]);
        part.push_facing([base, tip, right]);
    }
    let yellow = Vec3::from(shape.disc_color);
    let heart = part.push_vertex(center + facing * disc * 0.55, facing, yellow * 1.1);
    let ring: Vec<u32> = (0..DISC_CORNERS)
        .map(|corner| {
            let azimuth = TAU * corner as f32 / DISC_CORNERS as f32;
            let out = u * azimuth.cos() + v * azimuth.sin();
            let normal = (out + facing).normalize_or(facing);
            part.push_vertex(center + out * disc + facing * disc * 0.15, normal, yellow * 0.8)
        })
        .collect();
    for corner in 0..ring.len() {
        part.push_facing([heart, ring[corner], ring[(corner + 1) % ring.len()]]);
    }
}
