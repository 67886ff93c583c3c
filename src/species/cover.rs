//! Plants without wood: blades, fronds, stalks with blossoms. O(blades · segments).

use super::PlainPart;
use super::blossoms::{empty_part, plant_color, push_blossom};
use super::season::{LeafTime, Season};
use super::shape::{BladeShape, BlossomShape, CoverShape, LeafletShape, StalkShape};
use super::skeleton::GOLDEN_ANGLE;
use crate::math::hash::SplitMix64;
use bevy::math::{Quat, Vec3};
use std::f32::consts::TAU;

/// Sides of a stalk.
const STALK_SIDES: u32 = 3;
const STALK_SEGMENTS: u32 = 4;

/// Leaves, then blossoms (if there are any), scaled to stand `height` metres high.
pub(super) fn grow_cover(
    shape: &CoverShape,
    blossoms: Option<&BlossomShape>,
    season: &Season,
    height: f32,
    rng: &mut SplitMix64,
) -> Vec<PlainPart> {
    let mut leaves = PlainPart {
        name: "leaves".into(),
        double_sided: true,
        roughness: shape.blades.roughness,
        ..PlainPart::default()
    };
    let reach = height / risen(&shape.blades).max(0.1);
    for i in 0..shape.blades.count {
        push_blade(&mut leaves, shape, reach, i, season, rng);
    }
    let mut parts = vec![leaves];
    if let (Some(stalks), Some(blossoms)) = (&shape.stalks, blossoms) {
        let mut heads = empty_part();
        let color = plant_color(blossoms, rng);
        for _ in 0..stalks.count {
            let foot = foot(shape.base_radius_m * 0.6, rng);
            let (end, facing) =
                push_stalk(&mut parts[0], stalks, (foot, height), shape, season, rng);
            push_blossom(&mut heads, blossoms, end, facing, color, rng);
        }
        parts.push(heads);
    }
    // Chance and arching leave the tip a little above or below.
    let top = parts.iter().flat_map(|p| &p.positions).fold(0.0, |top: f32, p| top.max(p.y));
    if top > 0.0 {
        let scale = height / top;
        parts.iter_mut().flat_map(|p| &mut p.positions).for_each(|p| *p *= scale);
    }
    parts
}

/// Highest place of the steepest blade, as a share of its length.
fn risen(shape: &BladeShape) -> f32 {
    let steps = 16;
    let (mut y, mut top) = (0.0, 0.0f32);
    for i in 0..steps {
        y += blade_angle(shape, shape.angle_deg[0], (i as f32 + 0.5) / steps as f32).cos();
        top = top.max(y);
    }
    top / steps as f32
}

/// Angle to the vertical at share `u` of a blade, in radians.
fn blade_angle(shape: &BladeShape, foot_deg: f32, u: f32) -> f32 {
    // The stiff foot bends little.
    (foot_deg + shape.arch_deg * u.powf(1.5)).min(178.0).to_radians()
}

fn foot(radius: f32, rng: &mut SplitMix64) -> Vec3 {
    let (r, azimuth) = (radius * rng.next_f32().sqrt(), rng.range(0.0, TAU));
    Vec3::new(r * azimuth.cos(), 0.0, r * azimuth.sin())
}

/// A place on a blade.
struct Rib {
    position: Vec3,
    direction: Vec3,
    across: Vec3,
    u: f32,
}

fn push_blade(
    part: &mut PlainPart,
    shape: &CoverShape,
    reach: f32,
    index: u32,
    season: &Season,
    rng: &mut SplitMix64,
) {
    let blades = &shape.blades;
    // Outer blades lean more and are younger; a sunflower's disc spreads them evenly.
    let rank = (index as f32 + rng.next_f32()) / blades.count as f32;
    let azimuth = index as f32 * GOLDEN_ANGLE + rng.range(-0.5, 0.5);
    let out = Vec3::new(azimuth.cos(), 0.0, azimuth.sin());
    let [short, long] = blades.length;
    let length = reach * (long + (short - long) * rank * rng.range(0.5, 1.0));
    let wander = blades.wander_deg;
    let foot_deg = blades.angle_deg[0]
        + (blades.angle_deg[1] - blades.angle_deg[0]) * rank
        + rng.range(-wander, wander);
    let arch = rng.range(0.75, 1.15);
    let twist = Quat::from_rotation_y(rng.range(-wander, wander).to_radians() * 0.6);
    let segments = blades.segments;
    let mut position = out * (shape.base_radius_m * rank.sqrt());
    let mut heading = out;
    let ribs: Vec<Rib> = (0..=segments)
        .map(|i| {
            let u = i as f32 / segments as f32;
            let angle = blade_angle(blades, foot_deg.max(0.0), u * arch);
            let direction = heading * angle.sin() + Vec3::Y * angle.cos();
            let rib = Rib { position, direction, across: heading.cross(Vec3::Y), u };
            position += direction * (length / segments as f32);
            position.y = position.y.max(0.0);
            heading = twist * heading;
            rib
        })
        .collect();
    let time = |rng: &mut SplitMix64| LeafTime { clump: rank, own: rng.next_f32(), light: 0.7 };
    let shade = rng.range(1.0 - blades.color_jitter, 1.0 + blades.color_jitter);
    let yellow = rng.range(-0.1, 0.14);
    let tint = Vec3::new(1.0 + yellow, 1.0, 1.0 - yellow) * shade;
    let blade_time = time(rng);
    let color = |u: f32| season.color(gradient(blades, u) * tint, blade_time);
    push_ribbon(part, blades, &ribs, &color);
    if let Some(leaflets) = &blades.leaflets {
        push_leaflets(part, blades, leaflets, &ribs, length, &color, rng);
    }
}

fn gradient(shape: &BladeShape, u: f32) -> Vec3 {
    let (foot, middle, tip) =
        (Vec3::from(shape.foot), Vec3::from(shape.middle), Vec3::from(shape.tip));
    if u < 0.5 { foot.lerp(middle, 2.0 * u) } else { middle.lerp(tip, 2.0 * u - 1.0) }
}

/// Shading normal of a blade: its upper side, bent up and out.
fn bent_normal(shape: &BladeShape, rib: &Rib) -> Vec3 {
    let mut face = rib.across.cross(rib.direction).normalize_or(Vec3::Y);
    if face.y < 0.0 {
        face = -face;
    }
    let out = (rib.position.with_y(0.0) * 0.8 + Vec3::Y).normalize_or(Vec3::Y);
    (face * (1.0 - shape.bend) + out * shape.bend).normalize_or(Vec3::Y)
}

/// The blade itself: a pair of vertices a rib, and one at the tip.
fn push_ribbon(
    part: &mut PlainPart,
    shape: &BladeShape,
    ribs: &[Rib],
    color: &dyn Fn(f32) -> Vec3,
) {
    let mut previous: Option<[u32; 2]> = None;
    let last = ribs.len() - 1;
    for (i, rib) in ribs.iter().enumerate() {
        let normal = bent_normal(shape, rib);
        if i == last {
            let tip = part.push_vertex(rib.position, normal, color(1.0));
            if let Some([left, right]) = previous {
                part.push_facing([left, right, tip]);
            }
            break;
        }
        // Widest at a third of its length.
        let width = shape.width_m * (0.55 + 0.9 * rib.u - 1.35 * rib.u * rib.u).max(0.05) / 0.7;
        let half = rib.across * (0.5 * width);
        let tint = color(rib.u);
        let pair = [
            part.push_vertex(rib.position - half, normal, tint),
            part.push_vertex(rib.position + half, normal, tint * 0.94),
        ];
        if let Some([left, right]) = previous {
            part.push_facing([left, right, pair[1]]);
            part.push_facing([left, pair[1], pair[0]]);
        }
        previous = Some(pair);
    }
}

/// The rib at share `u`, between its neighbours.
fn rib_at(ribs: &[Rib], u: f32) -> Rib {
    let s = u.clamp(0.0, 1.0) * (ribs.len() - 1) as f32;
    let i = (s as usize).min(ribs.len() - 2);
    let (a, b, f) = (&ribs[i], &ribs[i + 1], s - i as f32);
    Rib {
        position: a.position.lerp(b.position, f),
        direction: a.direction.lerp(b.direction, f).normalize_or(Vec3::Y),
        across: a.across.lerp(b.across, f).normalize_or(Vec3::X),
        u,
    }
}

fn push_leaflets(
    part: &mut PlainPart,
    shape: &BladeShape,
    leaflets: &LeafletShape,
    ribs: &[Rib],
    length: f32,
    color: &dyn Fn(f32) -> Vec3,
    rng: &mut SplitMix64,
) {
    for pair in 0..leaflets.pairs {
        let t = (pair as f32 + 0.5) / leaflets.pairs as f32;
        let rib = rib_at(ribs, leaflets.from + (1.0 - leaflets.from) * t);
        let longest = leaflets.longest;
        let size = if t < longest {
            0.45 + 0.55 * (t / longest.max(1e-3))
        } else {
            (1.0 - (t - longest) / (1.0 - longest).max(1e-3)).max(0.0).powf(0.85) + 0.06
        };
        // Leaflets point forward more and more to the tip.
        let angle = (leaflets.angle_deg * (1.05 - 0.45 * t)).to_radians();
        let face = rib.across.cross(rib.direction).normalize_or(Vec3::Y);
        let normal = bent_normal(shape, &rib);
        for side in [1.0, -1.0] {
            let reach = length * leaflets.length * size * rng.range(0.9, 1.08);
            let along = (rib.direction * angle.cos() + rib.across * (side * angle.sin())
                - face * rng.range(-0.05, 0.22) * face.y.signum())
            .normalize_or(rib.across);
            let wide = along.cross(face).normalize_or(rib.direction) * side;
            let half = wide * (0.5 * reach * leaflets.width);
            let tint = color(0.25 + 0.6 * rib.u) * rng.range(0.88, 1.1);
            let tilted = (normal + rib.across * (side * 0.25)).normalize_or(normal);
            let base = part.push_vertex(rib.position, normal, tint * 0.8);
            let middle = rib.position + along * (reach * 0.38);
            let low = part.push_vertex(middle - half, tilted, tint * 0.95);
            let high = part.push_vertex(middle + half, tilted, tint);
            let tip = part.push_vertex(rib.position + along * reach, tilted, tint * 1.1);
            part.push_facing([base, low, tip]);
            part.push_facing([base, tip, high]);
        }
    }
}

/// A stalk with its leaves; returns its end and where the blossom there looks.
fn push_stalk(
    part: &mut PlainPart,
    stalks: &StalkShape,
    (foot, height): (Vec3, f32),
    shape: &CoverShape,
    season: &Season,
    rng: &mut SplitMix64,
) -> (Vec3, Vec3) {
    let azimuth = rng.range(0.0, TAU);
    let out = Vec3::new(azimuth.cos(), 0.0, azimuth.sin());
    let lean = stalks.lean_deg.to_radians() * rng.range(0.1, 1.0);
    let length = height * rng.range(stalks.length[0], stalks.length[1]);
    let green = Vec3::from(stalks.color) * rng.range(0.85, 1.15);
    let time = LeafTime { clump: rng.next_f32(), own: rng.next_f32(), light: 0.6 };
    let color = season.color(green, time);
    let at = |u: f32| {
        let angle = lean * u;
        foot + (out * angle.sin() + Vec3::Y * angle.cos()) * (length * u)
    };
    let mut previous: Option<u32> = None;
    for ring in 0..=STALK_SEGMENTS {
        let u = ring as f32 / STALK_SEGMENTS as f32;
        let first = part.positions.len() as u32;
        for side in 0..STALK_SIDES {
            let turn = TAU * side as f32 / STALK_SIDES as f32;
            let radial = Vec3::new(turn.cos(), 0.0, turn.sin());
            let radius = stalks.radius_m * (1.0 - 0.4 * u);
            let normal = (radial + Vec3::Y * 0.4).normalize_or(radial);
            let position = at(u) + radial * radius;
            part.push_vertex(
                position.with_y(if ring == 0 { 0.0 } else { position.y }),
                normal,
                color,
            );
        }
        if let Some(before) = previous {
            for side in 0..STALK_SIDES {
                let next = (side + 1) % STALK_SIDES;
                part.push_facing([before + side, before + next, first + next]);
                part.push_facing([before + side, first + next, first + side]);
            }
        }
        previous = Some(first);
    }
    for leaf in 0..stalks.leaves {
        let u = 0.12 + 0.6 * (leaf as f32 + rng.next_f32()) / stalks.leaves as f32;
        let turn = leaf as f32 * GOLDEN_ANGLE + azimuth;
        let side = Vec3::new(turn.cos(), 0.0, turn.sin());
        let along = (side + Vec3::Y * rng.range(0.3, 1.1)).normalize_or(side);
        let across = side.cross(Vec3::Y);
        let reach = stalks.leaf_length_m * (1.15 - 0.6 * u) * rng.range(0.8, 1.15);
        let half = across * (0.5 * reach * stalks.leaf_width);
        let tint = season.color(
            gradient(&shape.blades, 0.4) * rng.range(0.85, 1.15),
            LeafTime { own: rng.next_f32(), ..time },
        );
        let normal = (Vec3::Y + side * 0.5).normalize_or(Vec3::Y);
        let base = part.push_vertex(at(u), normal, tint * 0.85);
        let middle = at(u) + along * (reach * 0.45);
        let left = part.push_vertex(middle + half, normal, tint);
        let tip = part.push_vertex(at(u) + along * reach - Vec3::Y * reach * 0.15, normal, tint);
        let right = part.push_vertex(middle - half, normal, tint * 0.94);
        part.push_facing([base, left, tip]);
        part.push_facing([base, tip, right]);
    }
    let facing = (out * (lean.sin() + rng.range(0.0, 0.5)) + Vec3::Y).normalize_or(Vec3::Y);
    (at(1.0), facing)
}
