//! What grows at a place: altitude, slope, moisture and noise in; shares of ground and forest out. Pure; O(octaves).

use super::{Ground, Site, pattern::ForestPattern, smoothstep};

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
}

/// The biomes of a ground.
pub struct Biomes {
    pattern: ForestPattern,
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
        Self {
            pattern: ForestPattern::new(settings.seed, settings.patch_m),
            tree_line_m: settings.tree_line_m.unwrap_or(line(0.55, 350.0)),
            snow_line_m: settings.snow_line_m.unwrap_or(line(0.78, 600.0)),
            forest_share: settings.forest_share.clamp(0.0, 1.0),
        }
    }

    /// The biome at (x, z), which is `site` of the ground.
    pub fn at(&self, x: f32, z: f32, site: &Site) -> Biome {
        let shore = 1.0 - smoothstep(0.3, 1.6, site.above_water_m);
        let rock = smoothstep(0.62, 0.82, site.slope) * (1.0 - shore);
        let rest = 1.0 - shore - rock;
        let snow = rest
            * smoothstep(self.snow_line_m - 40.0, self.snow_line_m + 60.0, site.height_m)
            * (1.0 - smoothstep(0.5, 0.75, site.slope));
        let rest = rest - snow;
        let scree =
            rest * smoothstep(self.tree_line_m + 20.0, self.tree_line_m + 160.0, site.height_m);
        let grass = rest - scree;
        let below_line = 1.0 - smoothstep(self.tree_line_m - 60.0, self.tree_line_m, site.height_m);
        let forestness = self.pattern.forestness(x, z) + 0.25 * (site.moisture - 0.5);
        let threshold = 0.95 - 0.85 * self.forest_share;
        let forest = smoothstep(threshold - 0.06, threshold + 0.06, forestness)
            * below_line
            * (1.0 - smoothstep(0.5, 0.65, site.slope))
            * grass;
        let conifer = smoothstep(0.35, 0.75, (site.height_m + 400.0) / (self.tree_line_m + 400.0));
        Biome { forest, conifer, grass, rock, scree, snow, shore }
    }
}
