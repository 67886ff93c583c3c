//! Shadows of trees on the ground: crowns in, the part of the sun that passes out. Pure; O(texels under crowns).

use super::{flight::Crown, gradient_noise::noise, smoothstep};
use bevy::math::{Vec2, Vec3};

/// Light that a crown lets through.
const THROUGH: f32 = 0.22;
/// Sunlight on the floor of a closed forest.
const FOREST_FLOOR: f32 = 0.16;
/// Light of the sky there.
const FOREST_SKY: f32 = 0.5;
/// Longest shadow in heights of the tree: later ones are too faint to see.
const LONGEST: f32 = 5.0;

/// Where trees are, for their shadows. Asked from background tasks, for any place at any time.
pub trait ShadeSource: Send + Sync + 'static {
    /// Adds every tree whose foot is between `low` and `high` (x and z), in an order that is always the same.
    fn crowns(&self, low: Vec2, high: Vec2, crowns: &mut Vec<Crown>);

    /// Share of the ground around (x, z) that crowns cover, 0 to 1; for chunks too coarse for single trees.
    fn cover(&self, x: f32, z: f32) -> f32;
}

/// A square of texels to shade.
pub(super) struct ShadeMap {
    pub corner: Vec2,
    pub texel_m: f32,
    pub side: usize,
    /// Part of the sun that passes, of every texel.
    pub sun: Vec<f32>,
    /// Part of the sky that is open, of every texel.
    pub sky: Vec<f32>,
}

impl ShadeMap {
    pub fn open(corner: Vec2, texel_m: f32, side: usize) -> Self {
        let all = vec![1.0; side * side];
        Self { corner, texel_m, side, sun: all.clone(), sky: all }
    }

    /// Every crown whose shadow reaches the map.
    pub fn stamp(&mut self, source: &dyn ShadeSource, to_sun: Vec3) {
        let tallest = 40.0;
        let reach = tallest * (1.0 + LONGEST);
        let size = self.texel_m * self.side as f32;
        let mut crowns = Vec::new();
        // Only trees towards the sun throw shadows here.
        let flat = Vec2::new(to_sun.x, to_sun.z).normalize_or_zero()
            * reach.min(lean(to_sun) * tallest + 12.0);
        let low = self.corner.min(self.corner + flat) - 12.0;
        let high = (self.corner + size).max(self.corner + size + flat) + 12.0;
        source.crowns(low, high, &mut crowns);
        for crown in crowns {
            self.stamp_crown(&crown, to_sun);
        }
    }

    /// The expected shade of a stand, where single trees are smaller than a texel.
    pub fn cover(&mut self, source: &dyn ShadeSource, to_sun: Vec3) {
        // Low suns shine under less of a loose stand.
        let lengthening = 1.0 + 0.6 * lean(to_sun).min(LONGEST);
        for i in 0..self.side * self.side {
            let at = self.corner
                + Vec2::new((i % self.side) as f32, (i / self.side) as f32) * self.texel_m;
            let cover = source.cover(at.x, at.y).clamp(0.0, 1.0);
            let shaded = 1.0 - (1.0 - cover).powf(lengthening);
            self.sun[i] = 1.0 - (1.0 - FOREST_FLOOR) * shaded;
            self.sky[i] = 1.0 - 0.5 * cover;
        }
    }

    fn stamp_crown(&mut self, crown: &Crown, to_sun: Vec3) {
        if !(crown.position.is_finite() && crown.radius_m > 0.0 && crown.height_m > 0.0) {
            return;
        }
        let foot = Vec2::new(crown.position.x, crown.position.z);
        let lean = lean(to_sun);
        let away = -Vec2::new(to_sun.x, to_sun.z).normalize_or(Vec2::X);
        // The crown is an ellipsoid over the upper three quarters of the tree.
        let (middle, half) = (0.6 * crown.height_m, 0.4 * crown.height_m);
        let at = foot + away * (lean * middle);
        let along = crown.radius_m.hypot(half * lean);
        let seed = (foot.x * 7.3 + foot.y * 3.1) as i32 as u32;
        self.ellipse(at, away, [along, crown.radius_m], seed, THROUGH, true);
        // The trunk joins the shadow to the foot.
        let trunk = 0.07 * crown.radius_m + 0.5 * self.texel_m;
        let length = 0.5 * lean * middle;
        self.ellipse(foot + away * length, away, [length + trunk, trunk], seed, 0.45, true);
        // Less sky under the crown.
        self.ellipse(foot, away, [crown.radius_m * 1.1; 2], seed, 0.62, false);
    }

    /// Multiplies a soft, uneven ellipse.
    fn ellipse(
        &mut self,
        at: Vec2,
        along: Vec2,
        axes: [f32; 2],
        seed: u32,
        through: f32,
        sun: bool,
    ) {
        let reach = axes[0].max(axes[1]) * 1.15;
        let texel = |v: f32| (v / self.texel_m).clamp(0.0, self.side as f32) as usize;
        let (low, high) = (at - reach - self.corner, at + reach - self.corner);
        let (map, least) =
            if sun { (&mut self.sun, FOREST_FLOOR) } else { (&mut self.sky, FOREST_SKY) };
        for z in texel(low.y)..(texel(high.y) + 1).min(self.side) {
            for x in texel(low.x)..(texel(high.x) + 1).min(self.side) {
                let place = self.corner + Vec2::new(x as f32, z as f32) * self.texel_m;
                let offset = place - at;
                let a = offset.dot(along) / axes[0];
                let b = offset.dot(along.perp()) / axes[1];
                let radius = a * a + b * b;
                if radius > 1.35 {
                    continue;
                }
                let uneven = 0.28 * noise(place * 0.9, seed).value;
                let density = 1.0 - smoothstep(0.45, 1.05, radius.sqrt() + uneven);
                let texel = &mut map[z * self.side + x];
                // Under many crowns light still comes from between the trunks.
                *texel = (*texel * (1.0 - (1.0 - through) * density)).max(least);
            }
        }
    }
}

/// Length of a shadow per height.
fn lean(to_sun: Vec3) -> f32 {
    (Vec2::new(to_sun.x, to_sun.z).length() / to_sun.y.max(1e-3)).min(LONGEST)
}

#[cfg(test)]
mod tests {
    use super::*;

    struct One(Crown);
    impl ShadeSource for One {
        fn crowns(&self, low: Vec2, high: Vec2, crowns: &mut Vec<Crown>) {
            let foot = Vec2::new(self.0.position.x, self.0.position.z);
            if foot.cmpge(low).all() && foot.cmple(high).all() {
                crowns.push(self.0);
            }
        }
        fn cover(&self, _x: f32, _z: f32) -> f32 {
            0.8
        }
    }

    #[test]
    fn a_shadow_begins_at_the_foot_and_lies_away_from_the_sun() {
        let tree = One(Crown { position: Vec3::ZERO, radius_m: 3.0, height_m: 14.0 });
        let mut map = ShadeMap::open(Vec2::splat(-32.0), 0.5, 128);
        map.stamp(&tree, Vec3::new(1.0, 1.0, 0.0).normalize());
        let at = |x: f32, z: f32| {
            map.sun[((z + 32.0) * 2.0) as usize * 128 + ((x + 32.0) * 2.0) as usize]
        };
        assert!(at(-8.5, 0.0) < 0.4, "under the crown's shadow: {}", at(-8.5, 0.0));
        assert!(at(-1.0, 0.0) < 0.8, "beside the foot: {}", at(-1.0, 0.0));
        assert_eq!(at(8.0, 0.0), 1.0);
        assert_eq!(at(-8.5, 8.0), 1.0);
        map.cover(&tree, Vec3::Y);
        assert!(map.sun.iter().all(|s| *s < 0.5));
    }

    #[test]
    fn a_tree_outside_the_map_shades_into_it() {
        let tree =
            One(Crown { position: Vec3::new(40.0, 0.0, 0.0), radius_m: 3.0, height_m: 14.0 });
        let mut map = ShadeMap::open(Vec2::splat(-32.0), 0.5, 128);
        map.stamp(&tree, Vec3::new(1.0, 0.5, 0.0).normalize());
        assert!(map.sun.iter().any(|s| *s < 0.5));
    }
}
