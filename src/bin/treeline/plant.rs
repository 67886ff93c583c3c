//! What `view` and `bake` take: model files, and plants of a species.

use crate::options::{ToolResult, bake_with_progress, with_progress};
use bevy_treeline::{
    BakeSettings,
    bake::{BakeContext, Baked, bake_species},
    species::{Species, preset},
};
use clap::Args;
use std::path::{Path, PathBuf};

/// Which plant of a species.
#[derive(Args, Clone, Debug)]
pub struct PlantOptions {
    /// Seed of the plant: every number is another one.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Season: 0 is summer, 1 the end of autumn.
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true, value_parser = parse_autumn)]
    pub autumn: f32,
}

/// Something to bake.
pub enum Source {
    /// A model file.
    File(PathBuf),
    /// A plant.
    Plant {
        /// Of which species.
        species: Box<Species>,
        /// Which one.
        seed: u64,
        /// 0 to 1.
        autumn: f32,
    },
}

impl Source {
    /// The plant of a species that ships with the crate, or of a RON file if `name` ends in `.ron`.
    pub fn plant(name: &str, options: &PlantOptions) -> ToolResult<Self> {
        let is_file = Path::new(name).extension().is_some_and(|e| e.eq_ignore_ascii_case("ron"));
        let species = if is_file { Species::from_file(name)? } else { preset(name)? };
        let (seed, autumn) = (options.seed, options.autumn);
        Ok(Self::Plant { species: Box::new(species), seed, autumn })
    }

    /// For messages: the path, or the species with its seed.
    pub fn label(&self) -> String {
        match self {
            Self::File(path) => path.display().to_string(),
            Self::Plant { species, seed, .. } => format!("{} (seed {seed})", species.name),
        }
    }

    /// Name for files made of it, without an ending.
    pub fn stem(&self) -> String {
        match self {
            Self::File(path) => {
                path.file_stem().unwrap_or(path.as_os_str()).to_string_lossy().into_owned()
            }
            Self::Plant { species, seed, .. } => format!("{}_{seed}", species.name),
        }
    }

    /// Bakes with a progress bar.
    pub fn bake(&self, settings: &BakeSettings, context: &BakeContext) -> ToolResult<Baked> {
        match self {
            Self::File(path) => bake_with_progress(path, settings, context),
            Self::Plant { species, seed, autumn } => with_progress(&species.name, |progress| {
                bake_species(species, *seed, *autumn, settings, context, progress)
            }),
        }
    }
}

/// Parses `--autumn`.
fn parse_autumn(text: &str) -> Result<f32, String> {
    match text.trim().parse() {
        Ok(autumn) if (0.0..=1.0).contains(&autumn) => Ok(autumn),
        _ => Err("write a number from 0 (summer) to 1 (the end of autumn), such as 0.7".into()),
    }
}
