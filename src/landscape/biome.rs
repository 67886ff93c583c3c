//! What grows at a place: altitude, slope, moisture and noise in; shares of ground and forest out. Pure; O(octaves).

use super::{Field, Ground, Site, pattern::ForestPattern, smoothstep};

/// Half the width of a forest's edge, in units of forestness: some 15 m on the ground.
const EDGE: f32 = 0.05;
/// The tree line rises and falls by this much with the noise, in metres, at most half the forest's own range.
const TREE_LINE_NOISE_M: f32 = 60.0;
/// Metres above still water up to which banks are wet, whatever the ground says.
const BANK_M: f32 = 4.5;

/// Where biomes begin and end.
#[derive(Clone, Debug, PartialEq)]
pub struct BiomeSettings {
    /// Of all noise. Default: 1.
    pub seed: u64,
    /// Altitude in metres where forest ends. Default (`None`): from the ground's range of heights.
    pub tree_line_m: Option<f32>,
    /// Altitude in metres where snow stays. Default (`None`): from the ground's range of heights.
    pub snow_line_m: Option<f32>,
    /// Share of the ground that could bear forest which does, 0 to 1. Default: 0.6.
    pub forest_share: f32,
    /// Size of a patch of forest in metres. Default: 260.
    pub patch_m: f32,
}

impl Default for BiomeSettings {
    fn default() -> Self {
        Self { seed: 1, tree_line_m: None, snow_line_m: None, forest_share: 0.6, patch_m: 260.0 }
    }
}

impl BiomeSettings {
    /// With a share of forest that suits `trees` on a ground of `side_m` metres a side: few trees on much ground make a few
    /// closed forests instead of many thin ones. At most the share before.
    pub fn for_trees(self, trees: u64, side_m: f32) -> Self {
        // Trees on a hectare of a forest that looks closed, and the share of the ground that bears forest at best.
        const CLOSED: f64 = 330.0;
        const FIT: f64 = 0.85;
        let hectares = (f64::from(side_m) * f64::from(side_m) / 1e4).max(1e-6);
        let share = (trees as f64 / hectares / CLOSED / FIT) as f32;
        Self { forest_share: share.max(0.08).min(self.forest_share), ..self }
    }
}

/// Shares at a place. `grass + rock + scree + snow + shore` is 1; what bears forest is grass with forest floor.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Biome {
    /// 0 open ground to 1 closed forest; between at edges.
    pub forest: f32,
    /// 0 broadleaved to 1 coniferous.
    pub conifer: f32,
    /// Meadow, heath, forest floor.
    pub grass: f32,
    /// Bare rock: too steep for soil.
    pub rock: f32,
    /// Loose stones below rock and above the meadows.
    pub scree: f32,
    /// Lasting snow.
    pub snow: f32,
    /// Sand and gravel at and under the water.
    pub shore: f32,
    /// Altitude relative to the forest's: 0 at the water or the lowest ground, 1 at the local tree line, more above.
    pub altitude: f32,
    /// How wet the soil is, banks of still water included: 0 to 1.
    pub wet: f32,
    /// How tall trees grow: 1 below, down to 0.2 at the tree line.
    pub vigour: f32,
}

/// The biomes of a ground.
pub struct Biomes {
    pattern: ForestPattern,
    /// Forestness at the middle of a forest's edge.
    threshold: f32,
    line: Field,
    kinds: Field,
    base_m: f32,
    tree_line_m: f32,
    snow_line_m: f32,
    forest_share: f32,
}

impl Biomes {
    /// Biomes of `ground`; only its range of heights is read here.
    pub fn new(ground: &dyn Ground, settings: &BiomeSettings) -> Self {
        let [low, high] = ground.height_range();
        let base = ground.water_level().unwrap_or(low).max(low);
        let span = (high - base).max(1.0);
        // Low hills are below both lines.
        let line = |share: f32, least: f32| base + (span * share).max(least);
        let pattern = ForestPattern::new(settings.seed, settings.patch_m);
        let forest_share = if settings.forest_share.is_nan() {
            0.0
        } else {
            settings.forest_share.clamp(0.0, 1.0)
        };
        let stream = |i: u64| settings.seed.wrapping_mul(0x2545_F491).wrapping_add(i);
        Self {
            threshold: pattern.exceeded_by(forest_share),
            pattern,
            line: Field::new(stream(1), 3, 420.0),
            kinds: Field::new(stream(2), 3, 780.0),
            base_m: base,
            tree_line_m: settings.tree_line_m.unwrap_or(line(0.55, 350.0)),
            snow_line_m: settings.snow_line_m.unwrap_or(line(0.78, 600.0)),
            forest_share,
        }
    }

    /// The biome at (x, z), which is `site` of the ground.
    pub fn at(&self, x: f32, z: f32, site: &Site) -> Biome {
        let shore = 1.0 - smoothstep(0.3, 1.6, site.above_water_m);
        // Rough ground holds soil on slopes where smooth ground loses it.
        let line_noise = self.line.at(x, z);
        let steep = site.slope + 0.08 * line_noise;
        let rock = smoothstep(0.64, 0.84, steep) * (1.0 - shore);
        let rest = 1.0 - shore - rock;
        let snow_line = self.snow_line_m + 50.0 * line_noise;
        let snow = rest
            * smoothstep(snow_line - 40.0, snow_line + 60.0, site.height_m)
            * (1.0 - smoothstep(0.5, 0.75, site.slope));
        let rest = rest - snow;
        let reach = (self.tree_line_m - self.base_m).max(20.0);
        // Slopes towards +z, the sunny side, and hollows let trees climb; ridges and steep ground do not.
        let line = self.tree_line_m
            + TREE_LINE_NOISE_M.min(0.4 * reach) * 1.6 * line_noise
            + (0.12 * reach).min(35.0)
                * (1.6 * site.normal.z - site.slope + (60.0 * site.curvature).clamp(-0.7, 0.7));
        let scree = rest
            * smoothstep(self.tree_line_m + 30.0, self.tree_line_m + 170.0, site.height_m)
            * smoothstep(-0.5, 0.4, line_noise + 2.0 * (site.slope - 0.35));
        let grass = (rest - scree).max(0.0);
        // Trees thin out and become small over this height below the line.
        let band = (0.28 * reach).clamp(10.0, 130.0);
        let below_m = line - site.height_m;
        let thinning = smoothstep(0.0, 1.0, below_m / band);
        let vigour = 0.2 + 0.8 * smoothstep(-0.1, 1.5, below_m / band);
        let bank = 1.0 - smoothstep(0.35 * BANK_M, BANK_M, site.above_water_m);
        let wet = site.moisture.clamp(0.0, 1.0).max(bank);
        let forestness = self.pattern.forestness(x, z)
            + 0.12 * (site.moisture - 0.5)
            // Galleries of trees along banks, and steep ground is not mown.
            + 0.22 * bank
            + 0.25 * smoothstep(0.2, 0.45, site.slope);
        let edge = smoothstep(self.threshold - EDGE, self.threshold + EDGE, forestness);
        // Clamped at the ends: a share of 0 or 1 has no other side.
        let edge = match self.forest_share {
            s if s <= 0.0 => 0.0,
            s if s >= 1.0 => 1.0,
            _ => edge,
        };
        // Near the line the forest opens into groups.
        let groups =
            smoothstep(-0.25, 0.35, self.pattern.forestness(3.0 * z, 3.0 * x) - 0.5 + thinning);
        let forest = edge * thinning * groups * (1.0 - smoothstep(0.6, 0.76, steep)) * grass;
        let altitude = (site.height_m - self.base_m) / (line - self.base_m).max(10.0);
        let conifer = smoothstep(
            0.24,
            0.52,
            altitude + 0.75 * self.kinds.at(x, z) + 0.15 * (0.5 - wet) - 0.25 * bank,
        );
        Biome { forest, conifer, grass, rock, scree, snow, shore, altitude, wet, vigour }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::landscape::Heightfield;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn shares_of_the_ground_add_up(x in -3e4f32..3e4, z in -3e4f32..3e4, height in -50f32..1500.0, slope in 0f32..1.5, moisture in 0f32..1.0) {
            let ground = Heightfield::rolling(1000.0, 32, 1);
            let settings = BiomeSettings { tree_line_m: Some(500.0), snow_line_m: Some(900.0), ..BiomeSettings::default() };
            let biomes = Biomes::new(&ground, &settings);
            let site = Site {
                height_m: height, normal: bevy::math::Vec3::new(slope.sin(), slope.cos(), 0.0), slope, curvature: 0.0, moisture, above_water_m: height,
            };
            let b = biomes.at(x, z, &site);
            prop_assert!((b.grass + b.rock + b.scree + b.snow + b.shore - 1.0).abs() < 1e-4, "{b:?}");
            for share in [b.forest, b.conifer, b.grass, b.rock, b.scree, b.snow, b.shore, b.wet, b.vigour] {
                prop_assert!((-1e-4..=1.0001).contains(&share), "{b:?}");
            }
            prop_assert!(b.forest == 0.0 || (height > 0.0 && height < 650.0), "{b:?}");
        }
    }
}
