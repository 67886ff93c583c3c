//! RON text → [`Species`], and the species that ship with the crate. O(text).

use super::ranges::Ranged;
use super::shape::{AutumnShape, BlossomShape, CoverShape, TreeShape};
use ron::extensions::Extensions;
use serde::Deserialize;
use std::path::Path;

/// What a species is used as.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Deserialize)]
pub enum SpeciesKind {
    /// Stands alone or makes a forest.
    Tree,
    /// Grows below and between trees.
    Shrub,
    /// Covers the ground: grass, ferns, flowers.
    GroundCover,
}

/// How a plant is built.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub enum PlantShape {
    /// Of stems, with bark and leaves.
    Tree(TreeShape),
    /// Of blades or fronds from the ground, and stalks with blossoms.
    Cover(CoverShape),
}

/// Everything that describes a species; [`grow`](super::grow) makes plants of it.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Species {
    /// Lower-case letters, digits and `_`.
    pub name: String,
    /// What it is used as.
    pub kind: SpeciesKind,
    /// Turns colour and sheds leaves in autumn.
    pub deciduous: bool,
    /// How it is built.
    pub shape: PlantShape,
    /// Blossoms; absent on most.
    #[serde(default)]
    pub blossoms: Option<BlossomShape>,
    /// Colours of autumn; must be there if deciduous.
    #[serde(default)]
    pub autumn: Option<AutumnShape>,
}

/// Why there is no species.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SpeciesError {
    /// No preset of that name.
    #[error(
        "there is no species `{name}`; known are {known} (or write a RON file like those in assets/species)"
    )]
    Unknown {
        /// Asked for.
        name: String,
        /// All names, with commas.
        known: String,
    },
    /// The file cannot be read.
    #[error("cannot read the species file {file}: {source}")]
    Read {
        /// Path.
        file: String,
        /// Why.
        #[source]
        source: std::io::Error,
    },
    /// Not RON, or a field is missing, unknown or of the wrong type.
    #[error("{file}:{line}:{column}: {message}; compare with a file in assets/species")]
    Syntax {
        /// Path or name.
        file: String,
        /// From 1.
        line: usize,
        /// From 1.
        column: usize,
        /// What the parser says.
        message: String,
    },
    /// A number outside its range.
    #[error("{file}: {field} is {value}, but must be {low} to {high}")]
    Range {
        /// Path or name.
        file: String,
        /// Dotted path of the field.
        field: String,
        /// Found.
        value: f64,
        /// Lowest allowed.
        low: f64,
        /// Highest allowed.
        high: f64,
    },
    /// A value that is no number is of no use.
    #[error("{file}: {field} {problem}")]
    Value {
        /// Path or name.
        file: String,
        /// Dotted path of the field.
        field: &'static str,
        /// What is wrong and what to do.
        problem: String,
    },
}

macro_rules! embed {
    ($($name:literal),* $(,)?) => {
        /// Names of all presets, in the order of [`PRESETS`].
        const NAMES: &[&str] = &[$($name),*];
        /// Text of each preset's file.
        const PRESETS: &[&str] =
            &[$(include_str!(concat!("../../assets/species/", $name, ".ron"))),*];
    };
}

embed!(
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
);

/// Names of the species that ship with the crate: trees first, then shrub and ground cover.
pub fn species_names() -> &'static [&'static str] {
    NAMES
}

/// A species that ships with the crate. Its parameters are those of `assets/species/<name>.ron`, compiled in.
///
/// # Errors
/// [`SpeciesError::Unknown`], with a list of what is known.
pub fn preset(name: &str) -> Result<Species, SpeciesError> {
    let index = NAMES
        .iter()
        .position(|known| *known == name)
        .ok_or_else(|| SpeciesError::Unknown { name: name.to_owned(), known: NAMES.join(", ") })?;
    Species::from_ron(PRESETS[index], &format!("assets/species/{name}.ron"))
}

impl Species {
    /// Reads a species from RON text; `source_name` is its file in messages.
    ///
    /// # Errors
    /// [`SpeciesError::Syntax`] with line and column, [`SpeciesError::Range`] with the field, its value and its range, or
    /// [`SpeciesError::Value`].
    pub fn from_ron(text: &str, source_name: &str) -> Result<Self, SpeciesError> {
        let options = ron::Options::default().with_default_extension(Extensions::IMPLICIT_SOME);
        let species: Self = options.from_str(text).map_err(|error| SpeciesError::Syntax {
            file: source_name.to_owned(),
            line: error.span.start.line,
            column: error.span.start.col,
            message: error.code.to_string(),
        })?;
        species.check(source_name)?;
        Ok(species)
    }

    /// Reads a species from a RON file.
    ///
    /// # Errors
    /// As [`Species::from_ron`], and [`SpeciesError::Read`].
    pub fn from_file(path: impl AsRef<Path>) -> Result<Self, SpeciesError> {
        let file = path.as_ref().display().to_string();
        let text = std::fs::read_to_string(path)
            .map_err(|source| SpeciesError::Read { file: file.clone(), source })?;
        Self::from_ron(&text, &file)
    }

    /// Height in metres that plants of this species have on average.
    pub fn height_m(&self) -> f32 {
        match &self.shape {
            PlantShape::Tree(tree) => tree.height_m,
            PlantShape::Cover(cover) => cover.height_m,
        }
    }

    /// The same species with `detail` times as many leaves of the same total area; 0.01 to 4, clamped. Ground cover stays.
    pub fn with_leaf_detail(mut self, detail: f32) -> Self {
        let detail = if detail.is_nan() { 1.0 } else { detail.clamp(0.01, 4.0) };
        if let PlantShape::Tree(TreeShape { leaves: Some(leaves), .. }) = &mut self.shape {
            leaves.count = (leaves.count as f32 * detail) as u32;
            leaves.length_m /= detail.sqrt();
        }
        self
    }

    /// Every value inside its range.
    pub(super) fn clamped(&self) -> Self {
        Self {
            shape: match &self.shape {
                PlantShape::Tree(tree) => PlantShape::Tree(tree.clamped()),
                PlantShape::Cover(cover) => PlantShape::Cover(cover.clamped()),
            },
            blossoms: self.blossoms.as_ref().map(Ranged::clamped),
            autumn: self.autumn.as_ref().map(Ranged::clamped),
            ..self.clone()
        }
    }

    fn check(&self, file: &str) -> Result<(), SpeciesError> {
        let shape = match &self.shape {
            PlantShape::Tree(tree) => tree.out_of_range("shape"),
            PlantShape::Cover(cover) => cover.out_of_range("shape"),
        };
        let blossoms = || self.blossoms.as_ref().and_then(|b| b.out_of_range("blossoms"));
        let autumn = || self.autumn.as_ref().and_then(|a| a.out_of_range("autumn"));
        if let Some(wrong) = shape.or_else(blossoms).or_else(autumn) {
            return Err(SpeciesError::Range {
                file: file.to_owned(),
                field: wrong.field,
                value: wrong.value,
                low: wrong.low,
                high: wrong.high,
            });
        }
        let value = |field, problem: &str| {
            Err(SpeciesError::Value { file: file.to_owned(), field, problem: problem.to_owned() })
        };
        let letter = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_';
        if self.name.is_empty() || !self.name.chars().all(letter) {
            let problem = format!("is {:?}; write lower-case letters, digits and _", self.name);
            return value("name", &problem);
        }
        if self.deciduous && self.autumn.is_none() {
            return value("autumn", "is missing; add it, or write `deciduous: false`");
        }
        let stalks = matches!(&self.shape, PlantShape::Cover(CoverShape { stalks: Some(_), .. }));
        if stalks && self.blossoms.is_none() {
            return value("blossoms", "is missing, yet shape.stalks bears blossoms; add it");
        }
        Ok(())
    }
}
