//! The baked tree as plain data: what a bake hands over, a `.treeline` file holds and a renderer uploads.

use super::surfel::{Surfel, SurfelCold, SurfelHot};
use super::thinning::{Thinning, thinning};
use crate::{lod::thinning::FACTOR_STEPS, math::bounding::Aabb};
use serde::{Deserialize, Serialize};

/// Most points of one tree: a half (hot or cold) of this many takes 1 GiB.
pub const MAX_POINTS: u64 = (1 << 30) / size_of::<SurfelHot>() as u64;

/// Most bytes of all texts of [`BakeStatistics`] and [`SourceReference`] together.
pub const MAX_TEXT_BYTES: u64 = 4 << 20;

/// Most peeling directions that statistics speak of (`BakeSettings` allows fewer).
const MAX_DIRECTIONS: u64 = 1024;

/// Where a tree was baked from.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct SourceReference {
    /// As given to the bake; relative to the `.treeline` file when possible, with `/` separators.
    pub path: String,
    /// `SourceModel::content_hash` of the model; 64 hexadecimal digits in JSON.
    #[serde(with = "hex")]
    pub content_hash: [u8; 32],
}

/// Wall-clock duration of the parts of a bake, in seconds, finite and ≥ 0.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct BakeSeconds {
    /// Reading and decoding the model.
    pub loading: f64,
    /// Rendering (or tracing) all layers of all directions.
    pub peeling: f64,
    /// Finding the progressive order.
    pub ordering: f64,
    /// All of it, the rest included.
    pub total: f64,
}

impl BakeSeconds {
    /// The same durations in whole microseconds. That is what a file keeps: JSON numbers of up to 15 digits come
    /// back exactly, longer ones may not.
    pub fn to_microseconds(&self) -> Self {
        let round = |seconds: f64| (seconds * 1e6).round() / 1e6;
        Self {
            loading: round(self.loading),
            peeling: round(self.peeling),
            ordering: round(self.ordering),
            total: round(self.total),
        }
    }
}

/// What a bake did: for reports and for baking again in the same way. Nothing here changes how a tree is drawn.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct BakeStatistics {
    /// Triangles of the model.
    pub triangles: u64,
    /// Longest side of the LDIs in pixels.
    pub ldi_size: u32,
    /// Non-empty layers per direction.
    pub layers: Vec<u32>,
    /// Fragments per direction, kept or not.
    pub fragments: Vec<u64>,
    /// Fragments lost behind the last layer allowed, over all directions.
    pub left_over: u64,
    /// `gpu <adapter>` or `cpu`.
    pub backend: String,
    /// Name of the order, as in the settings.
    pub order: String,
    /// Seed of everything random in the bake.
    pub seed: u64,
    /// How long it took.
    pub seconds: BakeSeconds,
    /// What the user was told.
    pub warnings: Vec<String>,
}

/// What is seen of a tree on average: towards it the contrast correction moves colours ([`lod::contrast`](crate::lod::contrast)).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SeenMean {
    /// Colour in light of 1, linear: albedo with the shade of the tree itself; what is lit counts more.
    pub color: [f32; 3],
    /// How bright leaves are beside leaves of any direction
    /// ([`mean_shade`](crate::lod::contrast::mean_shade)), 0 to 2.
    pub shade: f32,
}

impl Default for SeenMean {
    fn default() -> Self {
        Self { color: [1.0; 3], shade: 1.0 }
    }
}

/// A baked tree.
#[derive(Clone, Debug, PartialEq)]
pub struct TreeData {
    /// Box of the points in model space; positions are quantised in it. Finite.
    pub bounds: Aabb,
    /// Side of an LDI pixel in model units, > 0: the paper's `s` (Bærentzen 2005, §3).
    pub pixel: f32,
    /// Area of all surfaces in square model units, ≥ 0: `A` of the area rule.
    pub surface_area: f32,
    /// Mean area of a leaf in square model units: `L` of the area rule; 0 if there are no leaves.
    pub mean_leaf_area: f32,
    /// Factors on `A` of one point to all, with which so many cover what the tree covers (`lod::thinning`), 0 to 2.5. They follow
    /// from the points: [`TreeData::with_factors`] finds them.
    pub area_factors: [f32; FACTOR_STEPS],
    /// Factors on the colour, with which so many are as bright as the tree. Found with the area factors.
    pub light_factors: [f32; FACTOR_STEPS],
    /// What is seen of the tree on average. Found with the area factors.
    pub seen_mean: SeenMean,
    /// Half of the points read by the splat pass, in progressive order: every prefix is a level of detail.
    pub hot: Vec<SurfelHot>,
    /// The other half, read by the resolve pass: same length, same order.
    pub cold: Vec<SurfelCold>,
    /// The model, if it was a file.
    pub source: Option<SourceReference>,
    /// How it was baked.
    pub statistics: BakeStatistics,
}

/// A value that no tree can have.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{what} is {value}, but must be {expected}")]
pub struct TreeDataError {
    /// Which value, in words.
    pub what: &'static str,
    /// What it is.
    pub value: String,
    /// What is allowed.
    pub expected: &'static str,
}

impl TreeData {
    /// Points in full: the paper's `N0`.
    pub fn point_count(&self) -> usize {
        self.hot.len()
    }

    /// This tree with its [`TreeData::area_factors`], [`TreeData::light_factors`] and [`TreeData::seen_mean`]. O(points).
    pub fn with_factors(self) -> Self {
        let Thinning { area, light, mean } = thinning(&self);
        Self { area_factors: area, light_factors: light, seen_mean: mean, ..self }
    }

    /// `N0 s² / A`: the mean share of its area that a point shows to its peeling direction; 0 if it was peeled from more
    /// directions than X, Y and Z, or has no area.
    pub fn sample_share(&self) -> f32 {
        if self.statistics.layers.len() > 3 || self.surface_area <= 0.0 {
            return 0.0;
        }
        self.point_count() as f32 * self.pixel * self.pixel / self.surface_area
    }

    /// Bytes that the points take in memory and on the GPU.
    pub fn byte_count(&self) -> usize {
        size_of_val(self.hot.as_slice()) + size_of_val(self.cold.as_slice())
    }

    /// Point `index` of the progressive order, unpacked; `None` past the end of either half.
    pub fn surfel(&self, index: usize) -> Option<Surfel> {
        let (hot, cold) = (self.hot.get(index)?, self.cold.get(index)?);
        Some(Surfel::unpack(*hot, *cold, &self.bounds))
    }

    /// Whether any point gets less than all light, as after a bake with
    /// [`ambient_visibility`](crate::BakeSettings::ambient_visibility). O(n), but short where the answer is yes.
    pub fn is_shaded(&self) -> bool {
        self.cold.iter().any(|cold| cold.ambient_visibility() != 255)
    }

    /// Checks everything that drawing and writing rely on. O(1) but for the texts.
    ///
    /// # Errors
    /// The first value out of its range.
    pub fn validate(&self) -> Result<(), TreeDataError> {
        let Self { bounds, hot, cold, .. } = self;
        let box_ok = bounds.min.is_finite()
            && bounds.max.is_finite()
            && !bounds.is_empty()
            && bounds.extent().is_finite();
        let box_text = || format!("{} to {}", bounds.min, bounds.max);
        check(box_ok, "the box", box_text, "finite, with min ≤ max")?;

        let text = |v: f32| move || v.to_string();
        let from_zero = |v: f32| v.is_finite() && v >= 0.0;
        let pixel_ok = from_zero(self.pixel) && self.pixel > 0.0;
        check(pixel_ok, "the LDI pixel", text(self.pixel), "finite and above 0")?;
        let area = self.surface_area;
        check(from_zero(area), "the surface area", text(area), "finite and at least 0")?;
        let leaf = self.mean_leaf_area;
        check(from_zero(leaf), "the mean leaf area", text(leaf), "finite and at least 0")?;

        let count = |n: usize| move || n.to_string();
        // The area rule divides by the number of points.
        let count_ok = (1..=MAX_POINTS).contains(&(hot.len() as u64));
        check(count_ok, "the number of points", count(hot.len()), "1 to 134,217,728")?;
        let halves = "as many as there are hot halves of points";
        check(hot.len() == cold.len(), "the number of cold halves", count(cold.len()), halves)?;
        self.validate_statistics()
    }

    fn validate_statistics(&self) -> Result<(), TreeDataError> {
        let BakeStatistics { layers, fragments, seconds, warnings, .. } = &self.statistics;
        for v in [seconds.loading, seconds.peeling, seconds.ordering, seconds.total] {
            // Above 10⁹ s (31 years) a microsecond is no longer a safe decimal.
            let range = "0 to 1,000,000,000";
            check((0.0..=1e9).contains(&v), "a duration in seconds", || v.to_string(), range)?;
        }
        let directions = layers.len().max(fragments.len()) as u64;
        let directions_ok = directions <= MAX_DIRECTIONS;
        check(directions_ok, "the number of directions", || directions.to_string(), "0 to 1024")?;
        // Each text counts 8 bytes more for its place in the file.
        let path = self.source.as_ref().map_or("", |s| &s.path);
        let names = [path, &self.statistics.backend, &self.statistics.order];
        let texts = names.into_iter().chain(warnings.iter().map(String::as_str));
        let bytes: u64 = texts.map(|t| t.len() as u64 + 8).sum();
        let expected = "at most 4,194,304 bytes (8 more a text)";
        check(bytes <= MAX_TEXT_BYTES, "the length of all texts", || bytes.to_string(), expected)
    }
}

fn check(
    ok: bool,
    what: &'static str,
    value: impl FnOnce() -> String,
    expected: &'static str,
) -> Result<(), TreeDataError> {
    if ok { Ok(()) } else { Err(TreeDataError { what, value: value(), expected }) }
}

/// 32 bytes as hexadecimal digits.
mod hex {
    use blake3::Hash;
    use serde::{Deserialize, Deserializer, Serializer, de::Error};

    pub fn serialize<S: Serializer>(bytes: &[u8; 32], serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(Hash::from_bytes(*bytes).to_hex().as_str())
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<[u8; 32], D::Error> {
        let digits = String::deserialize(deserializer)?;
        Hash::from_hex(&digits).map(|hash| *hash.as_bytes()).map_err(D::Error::custom)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::asset::synthetic::synthetic_tree;
    use bevy::math::Vec3;

    #[test]
    fn a_whole_tree_is_valid_and_takes_sixteen_bytes_a_point() {
        let tree = synthetic_tree(100, 1);
        tree.validate().expect("a synthetic tree is valid");
        assert_eq!((tree.point_count(), tree.byte_count()), (100, 1600));
        let inside = tree.surfel(99).expect("there are 100").position;
        assert!(inside.cmpge(tree.bounds.min).all() && inside.cmple(tree.bounds.max).all());
        assert_eq!(tree.surfel(100), None);
    }

    #[test]
    fn every_value_out_of_its_range_is_named() {
        type Break = fn(&mut TreeData);
        let broken: [(&str, Break); 15] = [
            ("the box", |t| t.bounds.max.y = f32::NAN),
            ("the box", |t| t.bounds = Aabb::default()),
            ("the box", |t| t.bounds.min = t.bounds.max + Vec3::X),
            ("the box", |t| {
                t.bounds = Aabb { min: Vec3::splat(-3e38), max: Vec3::splat(3e38) };
            }),
            ("the LDI pixel", |t| t.pixel = 0.0),
            ("the LDI pixel", |t| t.pixel = f32::INFINITY),
            ("the surface area", |t| t.surface_area = -1.0),
            ("the mean leaf area", |t| t.mean_leaf_area = f32::NAN),
            ("the number of points", |t| t.hot.clear()),
            ("the number of cold halves", |t| t.cold.truncate(3)),
            ("a duration in seconds", |t| t.statistics.seconds.total = f64::NAN),
            ("a duration in seconds", |t| t.statistics.seconds.loading = -0.5),
            ("the number of directions", |t| t.statistics.layers = vec![0; 2000]),
            ("the length of all texts", |t| t.statistics.backend = "x".repeat(5 << 20)),
            ("the length of all texts", |t| t.statistics.warnings = vec![String::new(); 1 << 20]),
        ];
        for (what, breaks) in broken {
            let mut tree = synthetic_tree(10, 1);
            breaks(&mut tree);
            assert_eq!(tree.validate().expect_err(what).what, what);
        }
    }

    #[test]
    fn a_source_reference_is_readable_json() {
        let source = SourceReference { path: "trees/oak.glb".into(), content_hash: [0xAB; 32] };
        let json = serde_json::to_string(&source).expect("plain data");
        assert!(json.contains(&"ab".repeat(32)), "{json}");
        assert_eq!(serde_json::from_str::<SourceReference>(&json).expect("just written"), source);
        assert!(
            serde_json::from_str::<SourceReference>(r#"{"path":"","content_hash":"ab"}"#).is_err()
        );
    }
}
