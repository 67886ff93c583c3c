//! Where a species grows and how: one plain struct per species, with values for the presets. Pure data.

use super::{Biome, Site, smoothstep};
use serde::{Deserialize, Serialize};

/// How a plant is scattered.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum PlantKind {
    /// Makes up forests; stands alone in meadows.
    Tree,
    /// Between the trees, at edges and in meadows; keeps its distance from trunks.
    Shrub,
    /// Ground cover, only near the camera: [`Scatter::cover_tile`](super::Scatter::cover_tile).
    Cover,
}

/// Where a species grows and how.
///
/// Ranges fade out by a fifth of their unit at both ends, so nothing ends at a line.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Habitat {
    /// Tree, shrub or ground cover. Default: tree.
    pub kind: PlantKind,
    /// From and to, in units of [`Biome::altitude`]: 0 lowest ground, 1 tree line. Default: everywhere.
    pub altitude: [f32; 2],
    /// From and to, in units of [`Biome::wet`]: 0 dry, 1 wet. Default: everywhere.
    pub moisture: [f32; 2],
    /// Never on steeper ground, degrees, 0 to 90. Default: 36.
    pub max_slope_deg: f32,
    /// Share in broadleaved stands, relative to the other species, ≥ 0; for cover, density there. Default: 1.
    pub in_broadleaf: f32,
    /// Share in coniferous stands, relative to the other species, ≥ 0; for cover, density there. Default: 1.
    pub in_conifer: f32,
    /// Share among lone trees, relative to the other species, ≥ 0; for cover, density in meadows. Default: 1.
    pub lone: f32,
    /// Scale when young and when old, > 0. Default: 0.55 to 1.15.
    pub scale: [f32; 2],
    /// Radius of the trunk at the ground as a share of the height. Default: 0.02. Trunks never overlap.
    pub trunk_share: f32,
    /// Turns in autumn. Default: false.
    pub deciduous: bool,
}

impl Default for Habitat {
    fn default() -> Self {
        Self {
            kind: PlantKind::Tree,
            altitude: [-1.0, 1.2],
            moisture: [-1.0, 2.0],
            max_slope_deg: 36.0,
            in_broadleaf: 1.0,
            in_conifer: 1.0,
            lone: 1.0,
            scale: [0.55, 1.15],
            trunk_share: 0.02,
            deciduous: false,
        }
    }
}

impl Habitat {
    /// The habitat of a preset species by its name, as central Europe has them; `None` for names that are not known.
    pub fn of(name: &str) -> Option<Self> {
        let tree =
            |altitude, moisture, [in_broadleaf, in_conifer, lone]: [f32; 3], deciduous| Self {
                altitude,
                moisture,
                in_broadleaf,
                in_conifer,
                lone,
                deciduous,
                ..Self::default()
            };
        let steep = |max_slope_deg, habitat| Self { max_slope_deg, ..habitat };
        Some(match name {
            "oak" => tree([-1.0, 0.4], [0.0, 0.75], [1.0, 0.03, 1.6], true),
            "birch" => tree([-1.0, 0.85], [-1.0, 0.9], [0.4, 0.12, 0.7], true),
            "aspen" => tree([-1.0, 0.8], [0.2, 0.9], [0.4, 0.08, 0.25], true),
            "willow" => tree([-1.0, 0.45], [0.72, 2.0], [1.1, 0.25, 1.2], true),
            "maple" => tree([-1.0, 0.6], [0.1, 0.8], [0.8, 0.06, 0.7], true),
            "poplar" => tree([-1.0, 0.4], [0.62, 2.0], [0.7, 0.06, 0.5], true),
            "spruce" => steep(40.0, tree([0.1, 1.2], [0.1, 0.9], [0.05, 1.0, 0.3], false)),
            "fir" => steep(40.0, tree([0.05, 0.8], [0.25, 0.95], [0.05, 0.7, 0.08], false)),
            "scots_pine" => steep(42.0, tree([-1.0, 1.3], [-1.0, 0.6], [0.07, 0.55, 0.6], false)),
            "dead_tree" => Self {
                scale: [0.5, 1.0],
                ..steep(40.0, tree([-1.0, 1.2], [-1.0, 2.0], [0.012, 0.022, 0.04], false))
            },
            "shrub" => Self {
                kind: PlantKind::Shrub,
                scale: [0.5, 1.4],
                trunk_share: 0.03,
                ..steep(42.0, tree([-1.0, 1.15], [-1.0, 2.0], [0.5, 0.15, 1.0], true))
            },
            "fern" => cover([-1.0, 0.95], [0.25, 2.0], [0.5, 0.4, 0.02], [0.6, 1.3]),
            "grass_tuft" => cover([-1.0, 1.7], [-1.0, 2.0], [0.16, 0.1, 1.0], [0.6, 1.4]),
            "flower" => cover([-1.0, 1.5], [-1.0, 0.9], [0.03, 0.01, 0.22], [0.7, 1.3]),
            _ => return None,
        })
    }

    /// How well the place suits, 0 to 1; 0 where the plant never grows.
    pub(super) fn fit(&self, biome: &Biome, site: &Site) -> f32 {
        let limit = self.max_slope_deg.to_radians();
        if site.slope.is_nan() || site.slope > limit {
            return 0.0;
        }
        let within = |[from, to]: [f32; 2], value: f32| {
            smoothstep(from - 0.1, from + 0.1, value)
                * (1.0 - smoothstep(to - 0.1, to + 0.1, value))
        };
        within(self.altitude, biome.altitude)
            * within(self.moisture, biome.wet)
            * (1.0 - smoothstep(0.8 * limit, limit, site.slope))
    }

    /// The first value that cannot be used, and what it must be.
    pub(super) fn problem(&self) -> Option<(&'static str, f32, &'static str)> {
        let [young, old] = self.scale;
        let shares = [
            ("habitat.in_broadleaf", self.in_broadleaf),
            ("habitat.in_conifer", self.in_conifer),
            ("habitat.lone", self.lone),
        ];
        if let Some((what, value)) = shares.into_iter().find(|(_, v)| !(v.is_finite() && *v >= 0.0))
        {
            return Some((what, value, "at least 0 and finite"));
        }
        if let Some(&value) = self.scale.iter().find(|v| !(v.is_finite() && **v > 0.0)) {
            return Some(("habitat.scale", value, "positive and finite"));
        }
        if young > old {
            return Some(("habitat.scale[0]", young, "at most habitat.scale[1]"));
        }
        if !(0.0..=0.5).contains(&self.trunk_share) {
            return Some(("habitat.trunk_share", self.trunk_share, "0 to 0.5"));
        }
        let slope = self.max_slope_deg;
        (!(0.0..=90.0).contains(&slope)).then_some(("habitat.max_slope_deg", slope, "0 to 90"))
    }
}

fn cover(altitude: [f32; 2], moisture: [f32; 2], density: [f32; 3], scale: [f32; 2]) -> Habitat {
    let [in_broadleaf, in_conifer, lone] = density;
    Habitat {
        kind: PlantKind::Cover,
        altitude,
        moisture,
        max_slope_deg: 44.0,
        in_broadleaf,
        in_conifer,
        lone,
        scale,
        trunk_share: 0.0,
        deciduous: true,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The presets of the species module.
    pub const PRESETS: [&str; 14] = [
        "oak",
        "birch",
        "aspen",
        "willow",
        "maple",
        "spruce",
        "fir",
        "scots_pine",
        "poplar",
        "dead_tree",
        "shrub",
        "fern",
        "grass_tuft",
        "flower",
    ];

    #[test]
    fn every_preset_has_a_usable_habitat_and_other_names_have_none() {
        for name in PRESETS {
            let habitat = Habitat::of(name).expect(name);
            assert_eq!(habitat.problem(), None, "{name}");
        }
        assert_eq!(Habitat::of("baobab"), None);
        assert_eq!(Habitat::default().problem(), None);
    }

    #[test]
    fn willows_want_water_and_spruces_height() {
        let site = |slope| Site {
            height_m: 0.0,
            normal: bevy::math::Vec3::Y,
            slope,
            curvature: 0.0,
            moisture: 0.5,
            above_water_m: 9.0,
        };
        let biome = |altitude, wet| Biome { altitude, wet, ..Biome::default() };
        let fit = |name: &str, altitude, wet, slope| {
            Habitat::of(name).expect(name).fit(&biome(altitude, wet), &site(slope))
        };
        assert!(fit("willow", 0.1, 1.0, 0.0) > 0.9 && fit("willow", 0.1, 0.5, 0.0) == 0.0);
        assert!(fit("spruce", 0.7, 0.5, 0.2) > 0.9 && fit("oak", 0.7, 0.5, 0.2) == 0.0);
        assert_eq!(fit("spruce", 0.7, 0.5, 1.0), 0.0);
        assert_eq!(fit("spruce", 0.7, 0.5, f32::NAN), 0.0);
    }

    #[test]
    fn values_that_cannot_be_used_are_named() {
        let bad = Habitat { scale: [1.0, 0.5], ..Habitat::default() };
        assert_eq!(bad.problem().map(|p| p.0), Some("habitat.scale[0]"));
        let bad = Habitat { lone: f32::NAN, ..Habitat::default() };
        assert_eq!(bad.problem().map(|p| p.0), Some("habitat.lone"));
    }
}
