//! What grows: species (or models of the user's), baked, as assets.

use super::FlyArgs;
use crate::{
    options::{ToolResult, bake_with_progress, with_progress},
    scene,
};
use bevy::prelude::*;
use bevy_treeline::{
    BakeSettings,
    bake::{BakeContext, Baked, bake_species},
    landscape::{PlantingSpecies, ScatterSpecies},
    species::{Species, SpeciesKind, preset, species_names},
};

/// A plant of the roster: several individuals of one species.
pub struct Member {
    /// As scattering knows it.
    pub scatter: ScatterSpecies,
    /// In summer, one per seed.
    summer: Vec<Baked>,
    /// In autumn; empty for evergreens, and where the season needs none.
    autumn: Vec<Baked>,
    /// Metres per unit of the model.
    unit_scale: f32,
    /// Near the camera it is a mesh; ground cover stays points, there is too much of it.
    has_mesh: bool,
}

/// Sides of an LDI pixel aimed at, metres: `d0` is then about 26 m at 720p.
const TREE_PIXEL_M: f32 = 0.03;
const COVER_PIXEL_M: f32 = 0.008;

/// An LDI size for a plant of this height, unless the user asked for one.
fn ldi_size(settings: &BakeSettings, height_m: f32, pixel_m: f32) -> u32 {
    let wanted = (height_m / pixel_m).clamp(96.0, 1024.0);
    // Steps of 64: near heights share a setting, and so the cache.
    settings.ldi_size.min((wanted / 64.0).round() as u32 * 64)
}

/// Bakes what grows, or takes it from the cache; with progress bars.
pub fn bake(args: &FlyArgs) -> ToolResult<Vec<Member>> {
    let (settings, context) = (args.bake.settings(), args.bake.context()?);
    if !args.models.is_empty() {
        let members = args.models.iter().map(|path| model(args, path, &settings, &context));
        return members.collect();
    }
    let names: Vec<String> = if args.species.is_empty() {
        species_names().iter().map(|&name| name.to_owned()).collect()
    } else {
        args.species.clone()
    };
    let species = names.iter().map(|name| Ok(preset(name.trim())?));
    let species: Vec<Species> = species.collect::<ToolResult<_>>()?;
    species.iter().map(|species| grown(args, species, &settings, &context)).collect()
}

fn grown(
    args: &FlyArgs,
    species: &Species,
    settings: &BakeSettings,
    context: &BakeContext,
) -> ToolResult<Member> {
    let is_tree = species.kind == SpeciesKind::Tree;
    let pixel_m = if is_tree { TREE_PIXEL_M } else { COVER_PIXEL_M };
    let settings = BakeSettings {
        ldi_size: ldi_size(settings, species.height_m(), pixel_m),
        ..settings.clone()
    };
    let variants = if is_tree { args.variants } else { 1 };
    let bake = |autumn: f32| -> ToolResult<Vec<Baked>> {
        (1..=variants)
            .map(|seed| {
                with_progress(&format!("{} {seed}", species.name), |progress| {
                    bake_species(species, seed.into(), autumn, &settings, context, progress)
                })
            })
            .collect()
    };
    let summer = bake(0.0)?;
    let autumn = if species.deciduous && args.season > 0.0 { bake(1.0)? } else { vec![] };
    let (height_m, crown_radius_m) = size_of(&summer, 1.0);
    Ok(Member {
        scatter: ScatterSpecies::new(&species.name, height_m, crown_radius_m),
        summer,
        autumn,
        unit_scale: 1.0,
        has_mesh: species.kind != SpeciesKind::GroundCover,
    })
}

fn model(
    args: &FlyArgs,
    path: &std::path::Path,
    settings: &BakeSettings,
    context: &BakeContext,
) -> ToolResult<Member> {
    let baked = bake_with_progress(path, settings, context)?;
    let height = baked.data.bounds.extent().y;
    let unit_scale = if args.height > 0.0 && height > 0.0 { args.height / height } else { 1.0 };
    let summer = vec![baked];
    let (height_m, crown_radius_m) = size_of(&summer, unit_scale);
    let name = path.file_stem().unwrap_or_default().to_string_lossy();
    Ok(Member {
        scatter: ScatterSpecies::new(&name, height_m, crown_radius_m),
        summer,
        autumn: vec![],
        unit_scale,
        has_mesh: true,
    })
}

/// Height and crown radius in metres of the largest.
fn size_of(baked: &[Baked], unit_scale: f32) -> (f32, f32) {
    let sizes = baked.iter().map(|b| {
        let extent = b.data.bounds.extent() * unit_scale;
        (extent.y, 0.25 * (extent.x + extent.z))
    });
    sizes.fold((0.1, 0.05), |a, b| (a.0.max(b.0), a.1.max(b.1)))
}

/// Makes the assets.
pub fn plant(world: &mut World, members: &[Member]) -> Vec<PlantingSpecies> {
    let mut add = |baked: &[Baked], with_mesh: bool| {
        baked.iter().map(|b| scene::add_tree(world, b, with_mesh)).collect::<Vec<_>>()
    };
    members
        .iter()
        .map(|member| PlantingSpecies {
            summer: add(&member.summer, member.has_mesh),
            autumn: add(&member.autumn, member.has_mesh),
            unit_scale: member.unit_scale,
        })
        .collect()
}
