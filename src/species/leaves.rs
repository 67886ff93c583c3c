//! Leafy stems → leaves of a few triangles. O(leaves).

use super::PlainPart;
use super::envelope::Envelope;
use super::season::{LeafTime, Season};
use super::shape::{LeafForm, LeafShape};
use super::skeleton::{GOLDEN_ANGLE, Stem, StemPoint, springing_direction};
use crate::math::hash::SplitMix64;
use bevy::math::Vec3;

/// Triangles of a leaf in its own plane.
struct Outline {
    /// Shares of the half width (across, left is positive) and of the length, where 0.5 stands for the widest place. The
    /// first is the foot, which the leaves of a place share.
    corners: &'static [[f32; 2]],
    triangles: &'static [[usize; 3]],
}

const KITE: Outline = Outline {
    corners: &[[0.0, 0.0], [1.0, 0.5], [0.0, 1.0], [-1.0, 0.5]],
    triangles: &[[0, 1, 2], [0, 2, 3]],
};
const OVAL: Outline = Outline {
    corners: &[[0.0, 0.0], [0.92, 0.34], [0.74, 0.78], [0.0, 1.0], [-0.74, 0.78], [-0.92, 0.34]],
    triangles: &[[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5]],
};
const LOBED: Outline = Outline {
    corners: &[[0.0, 0.0], [1.0, 0.5], [0.46, 0.62], [0.0, 1.0], [-0.46, 0.62], [-1.0, 0.5]],
    triangles: &[[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5]],
};
/// Side twigs stand off an axis, shorter and shorter, each as one triangle.
#[rustfmt::skip] // a twig a line
const SPRAY: Outline = Outline {
    corners: &[
        [0.0, 0.0], [0.0, 0.24], [0.0, 0.48], [0.0, 0.70], [0.0, 1.0],
        [1.0, 0.44], [-1.0, 0.44],
        [0.84, 0.66], [-0.84, 0.66],
        [0.56, 0.86], [-0.56, 0.86],
        [0.09, 0.64], [-0.09, 0.64],
    ],
    triangles: &[[0, 5, 1], [0, 1, 6], [1, 7, 2], [1, 2, 8], [2, 9, 3], [2, 3, 10], [11, 4, 12]],
};

/// All leaves of a tree.
pub(super) fn leaves_part(
    shape: &LeafShape,
    stems: &[Stem],
    envelope: &Envelope,
    season: &Season,
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
            let inner = if stem.childless { shape.from } else { shape.from.max(0.2) };
            let u = 1.0 - (1.0 - inner) * (node as f32 + rng.range(0.0, 0.5)) / nodes as f32;
            azimuth += GOLDEN_ANGLE;
            let place = Place::new(shape, stem, stem.at(u), envelope);
            push_node(&mut part, shape, &place, season, azimuth, rng);
        }
    }
    part
}

/// What the leaves of a place have in common.
pub(super) struct Place {
    at: StemPoint,
    /// Unit, to the outside of crown and clump.
    pub outward: Vec3,
    color: Vec3,
    /// 0 in shade to 1 in the sun.
    light: f32,
    /// See [`Stem::tone`].
    tone: f32,
    /// Leaves in the sun, at the top, are smaller.
    size: f32,
}

impl Place {
    pub(super) fn new(shape: &LeafShape, stem: &Stem, at: StemPoint, envelope: &Envelope) -> Self {
        let depth = envelope.depth(at.position).clamp(0.0, 1.0);
        let height = envelope.height_share(at.position.y);
        // Clumps are rounder than the crown: away from a point inside the clump, its lower side in shade.
        let heart = stem.clump.lerp(envelope.center(), 0.22);
        let clump_out = (at.position - heart).normalize_or(Vec3::Y);
        let outward = (envelope.outward(at.position) + clump_out * 0.6 + Vec3::Y * 0.15)
            .normalize_or(Vec3::Y);
        let light = (depth.powi(3) * (0.72 + 0.28 * clump_out.y)).clamp(0.0, 1.0);
        let crown = Vec3::from(shape.inside).lerp(Vec3::from(shape.outside), light);
        let sun = light
            * ((height - 0.35) / 0.65).clamp(0.0, 1.0)
            * (0.5 + 0.5 * outward.y).clamp(0.0, 1.0);
        // Limbs differ a little, from bluish dark to yellowish light.
        let tint = stem.tone - 0.5;
        let tint = Vec3::new(1.0 + 0.3 * tint, 1.0 + 0.14 * tint, 1.0 - 0.1 * tint);
        Self {
            at,
            outward,
            color: crown.lerp(Vec3::from(shape.top), sun) * tint,
            light,
            tone: stem.tone,
            size: 1.0 - 0.25 * height.powi(3),
        }
    }
}

/// The leaves of one place; they share its vertex.
fn push_node(
    part: &mut PlainPart,
    shape: &LeafShape,
    place: &Place,
    season: &Season,
    azimuth: f32,
    rng: &mut SplitMix64,
) {
    let at = &place.at;
    let mut base = None;
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
        let leaf = Leaf::new(shape, place, direction, season, rng);
        // Drawn after all of its random numbers, so that the crown is the same in all seasons.
        if season.fallen(leaf.chance) {
            continue;
        }
        let base = *base
            .get_or_insert_with(|| part.push_vertex(at.position, place.outward, leaf.color * 0.85));
        leaf.push(part, shape, place, base);
    }
}

/// One leaf: its frame, size and colour.
struct Leaf {
    direction: Vec3,
    across: Vec3,
    length: f32,
    half_width: f32,
    color: Vec3,
    /// Uniform, 0 to 1: falls if the season says so.
    chance: f32,
}

impl Leaf {
    fn new(
        shape: &LeafShape,
        place: &Place,
        direction: Vec3,
        season: &Season,
        rng: &mut SplitMix64,
    ) -> Self {
        let jitter = rng.range(1.0 - shape.size_jitter, 1.0 + shape.size_jitter);
        let length = shape.length_m * place.size * jitter;
        let half_width = 0.5 * length * shape.width * rng.range(0.85, 1.15);
        // Blades turn to the light: the upper side faces up and out, with some disorder.
        let disorder = Vec3::new(rng.range(-1.0, 1.0), rng.range(-1.0, 1.0), rng.range(-1.0, 1.0));
        // Sprays of needles lie in layers.
        let (up, chaos) = if shape.form == LeafForm::Spray { (0.8, 0.65) } else { (0.6, 0.75) };
        let facing = place.outward * 0.6 + Vec3::Y * up + disorder * chaos;
        let across = direction.cross(facing).normalize_or(direction.any_orthonormal_vector());
        // Brightness differs per leaf; a little of it goes from green to yellow.
        let shade = rng.range(1.0 - shape.color_jitter, 1.0 + shape.color_jitter);
        let yellow = rng.range(-0.12, 0.16);
        let summer = place.color * shade * Vec3::new(1.0 + yellow, 1.0, 1.0 - yellow);
        let time = LeafTime { clump: place.tone, own: rng.next_f32(), light: place.light };
        let chance = rng.next_f32();
        Self { direction, across, length, half_width, color: season.color(summer, time), chance }
    }

    /// Folded along its middle, from the shared `base` vertex.
    fn push(&self, part: &mut PlainPart, shape: &LeafShape, place: &Place, base: u32) {
        let outline = match shape.form {
            LeafForm::Kite => KITE,
            LeafForm::Oval => OVAL,
            LeafForm::Lobed => LOBED,
            LeafForm::Spray => SPRAY,
        };
        let face = self.across.cross(self.direction);
        let (sin, cos) = shape.fold_deg.to_radians().sin_cos();
        let first = part.positions.len() as u32;
        for [across, along] in &outline.corners[1..] {
            let place_along = if *along < 0.5 {
                2.0 * along * shape.widest
            } else {
                shape.widest + (2.0 * along - 1.0) * (1.0 - shape.widest)
            };
            let side = if *across == 0.0 { 0.0 } else { across.signum() };
            let wing = (self.across * (side * cos) + face * sin) * (self.half_width * across.abs());
            let position = place.at.position + self.direction * (self.length * place_along) + wing;
            let flat = (face * cos - self.across * (side * sin)) * (1.0 - shape.bend);
            let normal = (flat + place.outward * shape.bend).normalize_or(place.outward);
            // The middle and the tip are lighter, one half a little darker.
            let tone = 0.97 + 0.03 * side + 0.14 * (1.0 - across.abs()) * along;
            part.push_vertex(position, normal, self.color * tone);
        }
        let vertex = |corner: usize| if corner == 0 { base } else { first + corner as u32 - 1 };
        for triangle in outline.triangles {
            part.push_facing(triangle.map(vertex));
        }
    }
}
