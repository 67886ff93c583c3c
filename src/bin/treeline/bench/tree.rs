//! The tree of a benchmark: a model file, or a plant of a species of this crate. Baked only for techniques that need it.

use super::args::BenchArgs;
use crate::options::{ToolError, ToolResult, with_progress};
use bevy::{asset::RenderAssetUsages, prelude::*};
use bevy_treeline::{
    BakeSettings,
    bake::{
        Baked, bake_model, model_mesh_sources,
        source::{SourceModel, load_model, model_of_plain_tree},
    },
    species::{Species, grow, preset, species_names},
};
use std::{path::Path, sync::Arc};

/// Seed of a species' plant.
const PLANT_SEED: u64 = 1;

/// A model, not baked.
pub struct Tree {
    /// File name without its extension, or name of the species.
    pub name: String,
    pub model: Arc<SourceModel>,
}

/// Triangles of one material as an app without this crate has them.
#[derive(Clone)]
pub struct Part {
    pub mesh: Mesh,
    pub material: Handle<StandardMaterial>,
    /// Foliage, not wood.
    pub is_leaf: bool,
}

impl Tree {
    /// Reads `--tree`.
    pub fn load(tree: &str) -> ToolResult<Self> {
        let path = Path::new(tree);
        let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let species = |species: &Species| {
            let model = model_of_plain_tree(&name, &grow(species, PLANT_SEED, 0.0));
            Self { name: name.clone(), model: Arc::new(model) }
        };
        if species_names().contains(&tree) {
            return Ok(species(&preset(tree)?));
        }
        if path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("ron")) {
            return Ok(species(&Species::from_file(tree)?));
        }
        if !path.exists() {
            return Err(ToolError::Message(format!(
                "--tree {tree}: there is no such file, and no such species ({})",
                species_names().join(", ")
            )));
        }
        let model = load_model(path).map_err(|error| ToolError::Message(error.to_string()))?;
        Ok(Self { name, model: Arc::new(model) })
    }

    /// Triangles of the model.
    pub fn triangles(&self) -> u64 {
        self.model.meshes.iter().map(|mesh| mesh.triangles.len() as u64).sum()
    }

    /// Its points, from the cache if they are there. Without the light that a tree takes from itself: stock Bevy knows no such
    /// thing, and all techniques draw one picture.
    pub fn bake(&self, args: &BenchArgs) -> ToolResult<Baked> {
        let settings = BakeSettings { ambient_visibility: false, ..args.bake.settings() };
        settings.validate().map_err(|error| ToolError::Message(error.to_string()))?;
        let context = args.bake.context()?;
        with_progress(&self.name, |progress| {
            bake_model(self.model.clone(), None, &settings, &context, 0.0, progress)
        })
    }

    /// Meshes and materials as Bevy's glTF loader would give them, in the model's own space and kept in the main world.
    pub fn parts(&self, world: &mut World) -> Vec<Part> {
        let middle = self.model.bounds().center();
        let used = |i: &usize| {
            self.model.meshes.iter().any(|m| m.material == *i && !m.triangles.is_empty())
        };
        let materials: Vec<usize> = (0..self.model.materials.len()).filter(used).collect();
        let parts = model_mesh_sources(&self.model, false).into_iter().zip(materials);
        let parts = parts.map(|(source, material_index)| {
            let mut mesh = source.mesh.translated_by(middle);
            mesh.asset_usage = RenderAssetUsages::default();
            let mut material = source.material;
            material.base_color_texture =
                source.texture.map(|texture| world.resource_mut::<Assets<Image>>().add(texture));
            let material = world.resource_mut::<Assets<StandardMaterial>>().add(material);
            Part { mesh, material, is_leaf: self.model.materials[material_index].is_leaf }
        });
        parts.collect()
    }
}
