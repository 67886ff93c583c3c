//! Stems → tapered tubes with coloured vertices. O(stems · segments · sides).

use super::PlainPart;
use super::shape::BarkShape;
use super::skeleton::Stem;
use crate::math::hash::SplitMix64;
use bevy::math::Vec3;
use std::f32::consts::TAU;

/// Stems thinner than this have the twig's colour.
const TWIG_RADIUS_M: f32 = 0.02;
/// Neighbours around a ring that share a mark: marks lie across the stem, like a birch's.
const MARK_SIDES: u32 = 3;
/// Share of the height over which the foot's colour turns into the trunk's.
const FOOT_SHARE: f32 = 0.09;

/// The wood of a tree.
pub(super) fn bark_part(
    shape: &BarkShape,
    stems: &[Stem],
    height_m: f32,
    rng: &mut SplitMix64,
) -> PlainPart {
    let mut part =
        PlainPart { name: "bark".into(), roughness: shape.roughness, ..PlainPart::default() };
    for stem in stems.iter().filter(|stem| stem.sides >= 3) {
        push_tube(&mut part, shape, stem, height_m, rng);
    }
    part
}

/// Height over which the root flare falls to 1/e, in metres.
fn flare_height(stem: &Stem) -> f32 {
    1.1 * stem.radii[0] + 0.02
}

/// Centres and radii of the rings: those of the stem, and more of them where a trunk's foot flares.
fn rings(stem: &Stem) -> Vec<(Vec3, f32)> {
    let mut rings: Vec<_> = stem.points.iter().copied().zip(stem.radii.iter().copied()).collect();
    if stem.flare > 0.0 {
        let (first, second) = (rings[0], rings[1]);
        let reach = (second.0.y - first.0.y).max(1e-6);
        let between: Vec<_> = [0.3, 0.75, 1.4, 2.4]
            .iter()
            .map(|heights| heights * flare_height(stem) / reach)
            .filter(|share| *share < 0.9)
            .map(|share| (first.0.lerp(second.0, share), first.1 + (second.1 - first.1) * share))
            .collect();
        rings.splice(1..1, between);
    }
    rings
}

/// Ridges and knots: −1 to 1 by place on a tube, and its slope along the azimuth.
fn relief(azimuth: f32, along: f32, phase: f32) -> (f32, f32) {
    let fine = 5.0 * azimuth + phase + 0.8 * (along * 1.3 + phase).sin();
    let coarse = 2.0 * azimuth - phase + along * 1.1;
    (0.5 * fine.sin() + 0.5 * coarse.sin(), 2.5 * fine.cos() + coarse.cos())
}

/// Rings along the stem and a point at its end; no cap at the start, which lies in the parent or on the ground.
fn push_tube(
    part: &mut PlainPart,
    shape: &BarkShape,
    stem: &Stem,
    height_m: f32,
    rng: &mut SplitMix64,
) {
    let sides = stem.sides;
    let rings = rings(stem);
    let last = rings.len() - 1;
    let first_direction = (rings[1].0 - rings[0].0).normalize_or(Vec3::Y);
    let (mut across, _) = first_direction.any_orthonormal_pair();
    let phase = rng.range(0.0, TAU);
    let mut walked = 0.0;
    let mut previous_ring = 0;
    for (i, &(center, radius)) in rings.iter().enumerate() {
        let behind = rings[i.saturating_sub(1)].0;
        let ahead = rings[(i + 1).min(last)].0;
        walked += center.distance(behind);
        // The foot is cut level, so that the trunk stands on the ground.
        let level_foot = stem.level == 0 && i == 0;
        let axis = if level_foot { Vec3::Y } else { (ahead - behind).normalize_or(Vec3::Y) };
        across = across.reject_from_normalized(axis).normalize_or(axis.any_orthonormal_vector());
        let along = axis.cross(across);
        if i == last && !stem.blunt {
            let color = bark_color(shape, radius, center.y, height_m, false, rng);
            let tip = part.push_vertex(center, axis, color);
            push_fan(part, previous_ring, sides, tip);
            break;
        }
        let ring = part.positions.len() as u32;
        let gnarl = if radius > 1.5 * TWIG_RADIUS_M { shape.gnarl } else { 0.0 };
        let flare = stem.flare * (-center.y.max(0.0) / flare_height(stem)).exp();
        let mut marked = false;
        for side in 0..sides {
            let azimuth = TAU * side as f32 / sides as f32;
            let radial = across * azimuth.cos() + along * azimuth.sin();
            let tangent = along * azimuth.cos() - across * azimuth.sin();
            let (bump, slope) = relief(azimuth, walked / (6.0 * stem.radii[0]).max(0.05), phase);
            // Roots run out to a few sides.
            let root = 1.0 + 0.35 * (3.0 * azimuth + phase).cos();
            if side.is_multiple_of(MARK_SIDES) {
                marked = radius > TWIG_RADIUS_M && rng.next_f32() < shape.mark_share;
            }
            let color = bark_color(shape, radius, center.y, height_m, marked, rng)
                * (1.0 + 1.4 * gnarl * bump);
            let normal = (radial - tangent * (slope * gnarl)).normalize_or(radial);
            let reach = radius * (1.0 + flare * root + gnarl * bump);
            part.push_vertex(center + radial * reach, normal, color);
        }
        if i > 0 {
            for side in 0..sides {
                let next = (side + 1) % sides;
                let (a, b) = (previous_ring + side, previous_ring + next);
                part.triangles.push([a, b, ring + next]);
                part.triangles.push([a, ring + next, ring + side]);
            }
        }
        if i == last {
            // The broken face shows pale wood.
            let wood = Vec3::from(shape.upper) * 1.25 + Vec3::new(0.03, 0.02, 0.01);
            let tip = part.push_vertex(center + axis * radius * 0.6, axis, wood);
            push_fan(part, ring, sides, tip);
        }
        previous_ring = ring;
    }
}

fn push_fan(part: &mut PlainPart, ring: u32, sides: u32, tip: u32) {
    for side in 0..sides {
        part.triangles.push([ring + side, ring + (side + 1) % sides, tip]);
    }
}

/// `t` from 0 to 1 with level ends.
fn smooth(t: f32) -> f32 {
    let t = t.clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// Foot → trunk → upper along the height, those → twig along the radius, then marks and a little noise.
fn bark_color(
    shape: &BarkShape,
    radius: f32,
    y: f32,
    height_m: f32,
    marked: bool,
    rng: &mut SplitMix64,
) -> Vec3 {
    let share = y / height_m;
    let [low, high] = shape.upper_from;
    let wood = Vec3::from(shape.foot).lerp(Vec3::from(shape.trunk), smooth(share / FOOT_SHARE));
    let wood = wood.lerp(Vec3::from(shape.upper), smooth((share - low) / (high - low).max(1e-3)));
    let thickness = ((radius - 0.5 * TWIG_RADIUS_M) / (1.5 * TWIG_RADIUS_M)).clamp(0.0, 1.0);
    let wood = Vec3::from(shape.twig).lerp(wood, thickness);
    let wood = if marked { Vec3::from(shape.mark).lerp(wood, 0.1) } else { wood };
    wood * rng.range(0.86, 1.12)
}
