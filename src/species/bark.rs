//! Stems → tapered tubes with coloured vertices. O(stems · segments · sides).

use super::PlainPart;
use super::shape::BarkShape;
use super::skeleton::Stem;
use crate::math::hash::SplitMix64;
use bevy::math::Vec3;

/// Height over which the root flare falls to 1/e, in metres.
const FLARE_HEIGHT_M: f32 = 0.45;
/// Stems thinner than this have the twig's colour.
const TWIG_RADIUS_M: f32 = 0.02;

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

/// Rings along the stem and a point at its end; no cap at the start, which lies in the parent or on the ground.
fn push_tube(
    part: &mut PlainPart,
    shape: &BarkShape,
    stem: &Stem,
    height_m: f32,
    rng: &mut SplitMix64,
) {
    let sides = stem.sides;
    let last = stem.points.len() - 1;
    let first_direction = (stem.points[1] - stem.points[0]).normalize_or(Vec3::Y);
    let (mut across, _) = first_direction.any_orthonormal_pair();
    let root_azimuth = rng.range(0.0, std::f32::consts::TAU);
    let mut previous_ring = 0;
    for (i, &center) in stem.points.iter().enumerate() {
        let behind = stem.points[i.saturating_sub(1)];
        let ahead = stem.points[(i + 1).min(last)];
        // The foot is cut level, so that the trunk stands on the ground.
        let level_foot = stem.level == 0 && i == 0;
        let axis = if level_foot { Vec3::Y } else { (ahead - behind).normalize_or(Vec3::Y) };
        across = across.reject_from_normalized(axis).normalize_or(axis.any_orthonormal_vector());
        let along = axis.cross(across);
        let radius = stem.radii[i];
        if i == last {
            let color = bark_color(shape, radius, center.y, height_m, false, rng);
            let tip = part.push_vertex(center, axis, color);
            for side in 0..sides {
                let next = (side + 1) % sides;
                part.triangles.push([previous_ring + side, previous_ring + next, tip]);
            }
            break;
        }
        let ring = part.positions.len() as u32;
        for side in 0..sides {
            let azimuth = std::f32::consts::TAU * side as f32 / sides as f32;
            let radial = across * azimuth.cos() + along * azimuth.sin();
            let flare = stem.flare * (-center.y / FLARE_HEIGHT_M).exp();
            let root = 1.0 + 0.35 * (3.0 * azimuth + root_azimuth).cos();
            let marked = radius > TWIG_RADIUS_M && rng.next_f32() < shape.mark_share;
            let color = bark_color(shape, radius, center.y, height_m, marked, rng);
            part.push_vertex(center + radial * radius * (1.0 + flare * root), radial, color);
        }
        if i > 0 {
            for side in 0..sides {
                let next = (side + 1) % sides;
                let (a, b) = (previous_ring + side, previous_ring + next);
                part.triangles.push([a, b, ring + next]);
                part.triangles.push([a, ring + next, ring + side]);
            }
        }
        previous_ring = ring;
    }
}

/// Foot → trunk along the height, trunk → twig along the radius, then marks and a little noise.
fn bark_color(
    shape: &BarkShape,
    radius: f32,
    y: f32,
    height_m: f32,
    marked: bool,
    rng: &mut SplitMix64,
) -> Vec3 {
    let rise = (y / (0.14 * height_m)).clamp(0.0, 1.0);
    let wood =
        Vec3::from(shape.foot).lerp(Vec3::from(shape.trunk), rise * rise * (3.0 - 2.0 * rise));
    let thickness = ((radius - 0.5 * TWIG_RADIUS_M) / (1.5 * TWIG_RADIUS_M)).clamp(0.0, 1.0);
    let wood = Vec3::from(shape.twig).lerp(wood, thickness);
    let wood = if marked { Vec3::from(shape.mark).lerp(wood, 0.1) } else { wood };
    wood * rng.range(0.86, 1.12)
}
