//! Outline of the crown: which points are inside, and how deep. O(1) a query, O(steps) a ray.

use super::shape::CrownShape;
use crate::math::hash::SplitMix64;
use bevy::math::{Vec2, Vec3};

const LOBES: usize = 14;
/// Directions that lumps are tabled for: azimuths and heights.
const AZIMUTHS: usize = 48;
const HEIGHTS: usize = 24;

/// A body of revolution of superellipse profile around the y axis, swollen and hollowed by lobes in random directions.
pub(super) struct Envelope {
    base_y: f32,
    top_y: f32,
    radius: f32,
    widest: f32,
    lower_power: f32,
    upper_power: f32,
    /// How much each direction is swollen, as a share of the radius; azimuth by azimuth from below.
    lumps: Vec<f32>,
    /// Metres from the centre to the outline in each direction.
    limits: Vec<f32>,
}

/// Unit direction of an entry of the tables.
fn table_direction(azimuth: usize, height: usize) -> Vec3 {
    let y = -1.0 + 2.0 * height as f32 / (HEIGHTS - 1) as f32;
    let turn = azimuth as f32 * std::f32::consts::TAU / AZIMUTHS as f32;
    let ring = (1.0 - y * y).max(0.0).sqrt();
    Vec3::new(ring * turn.cos(), y, ring * turn.sin())
}

/// A table's value in a unit direction, between its entries linearly.
fn look_up(table: &[f32], direction: Vec3) -> f32 {
    let turn = direction.z.atan2(direction.x) / std::f32::consts::TAU;
    let a = turn.rem_euclid(1.0) * AZIMUTHS as f32;
    let h = (direction.y * 0.5 + 0.5).clamp(0.0, 1.0) * (HEIGHTS - 1) as f32;
    let (low_a, low_h) = (a as usize % AZIMUTHS, (h as usize).min(HEIGHTS - 2));
    let high_a = (low_a + 1) % AZIMUTHS;
    let (share_a, share_h) = (a.fract(), h - low_h as f32);
    let column = |azimuth: usize| {
        let low = table[azimuth * HEIGHTS + low_h];
        low + (table[azimuth * HEIGHTS + low_h + 1] - low) * share_h
    };
    let (left, right) = (column(low_a), column(high_a));
    left + (right - left) * share_a
}

impl Envelope {
    pub(super) fn new(shape: &CrownShape, height_m: f32, rng: &mut SplitMix64) -> Self {
        let lobes = (0..LOBES).map(|i| {
            // Directions of a Fibonacci sphere, shaken: even cover, no two crowns alike.
            let y = 1.0 - 2.0 * (i as f32 + rng.next_f32()) / LOBES as f32;
            let azimuth = i as f32 * 2.399_963 + rng.range(-0.6, 0.6);
            let ring = (1.0 - y * y).max(0.0).sqrt();
            let direction = Vec3::new(ring * azimuth.cos(), y, ring * azimuth.sin());
            (direction, shape.lumpiness * rng.range(-0.9, 0.9))
        });
        let lobes: Vec<(Vec3, f32)> = lobes.collect();
        let directions = || {
            (0..AZIMUTHS).flat_map(|a| (0..HEIGHTS).map(move |height| table_direction(a, height)))
        };
        let lump = |direction: Vec3| -> f32 {
            let part = |lobe: &(Vec3, f32)| lobe.1 * direction.dot(lobe.0).max(0.0).powi(6);
            lobes.iter().map(part).sum()
        };
        let mut envelope = Self {
            base_y: shape.base * height_m,
            top_y: height_m,
            radius: shape.radius_m,
            widest: shape.widest,
            lower_power: shape.lower_power,
            upper_power: shape.upper_power,
            lumps: directions().map(lump).collect(),
            limits: vec![],
        };
        let center = envelope.center();
        envelope.limits = directions().map(|d| envelope.distance_to_outline(center, d)).collect();
        envelope
    }

    /// Height of the tree in metres.
    pub(super) fn top_y(&self) -> f32 {
        self.top_y
    }

    /// The place that depths and outward directions are measured from.
    pub(super) fn center(&self) -> Vec3 {
        Vec3::Y * (self.base_y + (self.top_y - self.base_y) * self.widest.clamp(0.3, 0.7))
    }

    /// Share of the crown's height at `y`: 0 at its base, 1 at the top.
    pub(super) fn height_share(&self, y: f32) -> f32 {
        ((y - self.base_y) / (self.top_y - self.base_y)).clamp(0.0, 1.0)
    }

    /// Distance to the trunk's axis as a share of the outline's there; 1 on the outline.
    fn radial_share(&self, position: Vec3) -> f32 {
        let u = (position.y - self.base_y) / (self.top_y - self.base_y);
        if !(0.0..=1.0).contains(&u) {
            return f32::INFINITY;
        }
        let (t, power) = if u < self.widest {
            ((self.widest - u) / self.widest, self.lower_power)
        } else {
            ((u - self.widest) / (1.0 - self.widest).max(1e-6), self.upper_power)
        };
        let profile = (1.0 - t.powf(power)).max(0.0).powf(1.0 / power);
        let direction = (position - self.center()).normalize_or_zero();
        let lump = look_up(&self.lumps, direction);
        let radius = self.radius * profile * (1.0 + lump).clamp(0.35, 1.6);
        Vec2::new(position.x, position.z).length() / radius.max(1e-3)
    }

    /// Metres from `origin` along `direction` (unit) until the outline is left for good; 0 if it is never inside.
    pub(super) fn distance_to_outline(&self, origin: Vec3, direction: Vec3) -> f32 {
        let step = self.radius * 0.04;
        let reach = (self.top_y + 2.0 * self.radius) / step;
        let last = (0..reach as u32)
            .rev()
            .find(|&i| self.radial_share(origin + direction * (i as f32 * step)) < 1.0);
        last.map_or(0.0, |i| (i as f32 + 0.5) * step)
    }

    /// 0 at the centre of the crown, 1 on the outline, more outside.
    pub(super) fn depth(&self, position: Vec3) -> f32 {
        let offset = position - self.center();
        let distance = offset.length();
        if distance < 1e-4 {
            return 0.0;
        }
        let limit = look_up(&self.limits, offset / distance);
        (distance / limit.max(self.radius * 0.1)).min(1.3)
    }

    /// Unit direction to the outside at `position`, the crown's height squeezed to its width. Measured from below the
    /// centre, so that most of the crown faces the sky.
    pub(super) fn outward(&self, position: Vec3) -> Vec3 {
        let squeeze = (2.0 * self.radius / (self.top_y - self.base_y)).min(1.0);
        let heart = Vec3::Y * (self.base_y + 0.2 * (self.top_y - self.base_y));
        let offset = (position - heart) * Vec3::new(1.0, squeeze, 1.0);
        offset.normalize_or(Vec3::Y)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::species::{PlantShape, Species, preset};

    #[test]
    fn depth_grows_from_the_centre_to_the_outline() {
        let Ok(Species { shape: PlantShape::Tree(oak), .. }) = preset("oak") else {
            panic!("the oak is a tree");
        };
        let envelope = Envelope::new(&oak.crown, oak.height_m, &mut SplitMix64(1));
        let center = envelope.center();
        let limit = envelope.distance_to_outline(center, Vec3::X);
        let share = limit / oak.crown.radius_m;
        assert!((0.4..1.6).contains(&share), "{share}");
        assert!(envelope.depth(center) < 0.01);
        assert!((envelope.depth(center + Vec3::X * limit) - 1.0).abs() < 0.05);
        assert!(envelope.depth(center + Vec3::X * limit * 0.5) < 0.55);
    }
}
