//! What grows: species (or models of the user's), baked, as assets.

use super::{FlyArgs, shipped::shipped};
use crate::{
    options::{ToolResult, bake_with_progress, with_progress},
    scene,
};
use bevy::prelude::*;
use bevy_treeline::{
    BakeSettings, TreeAsset,
    asset::{NearMesh, TreeData},
    bake::{BakeContext, Baked, bake_species, source::SourceModel},
    landscape::{PlantingSpecies, ScatterSpecies},
    species::{Species, SpeciesKind, preset, species_names},
};
use std::{
    path::Path,
    sync::{
        Arc,
        mpsc::{Receiver, channel},
    },
};

/// A baked plant.
#[derive(Clone)]
struct Plant {
    data: Arc<TreeData>,
    /// Its triangles, for near; a plant that stands in for another has none.
    model: Option<Arc<SourceModel>>,
}

impl From<Baked> for Plant {
    fn from(baked: Baked) -> Self {
        Self { data: baked.data, model: Some(baked.model) }
    }
}

/// A species of the roster: several plants.
pub struct Member {
    /// As scattering knows it.
    pub scatter: ScatterSpecies,
    /// In summer, one per seed.
    summer: Vec<Plant>,
    /// In autumn; empty for evergreens, and where the season needs none.
    autumn: Vec<Plant>,
    /// Metres per unit of the model.
    unit_scale: f32,
    /// Near the camera it is a mesh; ground cover stays points, there is too much of it.
    pub has_mesh: bool,
}

impl Member {
    /// Points of all its plants.
    pub fn points(&self) -> u64 {
        self.summer.iter().chain(&self.autumn).map(|plant| plant.data.point_count() as u64).sum()
    }
}

/// A plant that was baked in the background, and whose place it takes.
pub struct Ready {
    member: usize,
    autumn: bool,
    variant: usize,
    plant: Plant,
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

/// The species asked for, by name or as species files.
pub fn chosen(args: &FlyArgs) -> ToolResult<Vec<Species>> {
    let names: Vec<String> = if args.species.is_empty() {
        species_names().iter().map(|&name| name.to_owned()).collect()
    } else {
        args.species.clone()
    };
    let species = names.iter().map(|name| name.trim()).map(|name| {
        let is_file = Path::new(name).extension().is_some_and(|e| e.eq_ignore_ascii_case("ron"));
        Ok(if is_file { Species::from_file(name)? } else { preset(name)? })
    });
    species.collect()
}

/// Bakes what grows, or takes it from the cache; with progress bars. `at_once`: species are shown by the small plants that
/// ship with the program, until [`bake_in_background`] has the others.
pub fn bake(args: &FlyArgs, at_once: bool) -> ToolResult<Vec<Member>> {
    if !args.models.is_empty() {
        let (settings, context) = (args.bake.settings(), args.bake.context()?);
        let members = args.models.iter().map(|path| model(args, path, &settings, &context));
        return members.collect();
    }
    let species = chosen(args)?;
    if at_once {
        let members: Option<Vec<Member>> =
            species.iter().map(|species| small(args, species)).collect();
        if let Some(members) = members {
            return Ok(members);
        }
    }
    let (settings, context) = (args.bake.settings(), args.bake.context()?);
    species.iter().map(|species| grown(args, species, &settings, &context)).collect()
}

fn variants(args: &FlyArgs, species: &Species) -> u32 {
    if species.kind == SpeciesKind::Tree { args.variants } else { 1 }
}

fn has_autumn(args: &FlyArgs, species: &Species) -> bool {
    species.deciduous && args.season > 0.0
}

fn settings_for(species: &Species, settings: &BakeSettings) -> BakeSettings {
    let pixel_m =
        if species.kind == SpeciesKind::GroundCover { COVER_PIXEL_M } else { TREE_PIXEL_M };
    BakeSettings { ldi_size: ldi_size(settings, species.height_m(), pixel_m), ..settings.clone() }
}

fn member(args: &FlyArgs, species: &Species, summer: Vec<Plant>, autumn: Vec<Plant>) -> Member {
    debug_assert_eq!(summer.len(), variants(args, species) as usize);
    let (height_m, crown_radius_m) = size_of(&summer[0], 1.0);
    Member {
        scatter: ScatterSpecies::new(&species.name, height_m, crown_radius_m),
        summer,
        autumn,
        unit_scale: 1.0,
        has_mesh: species.kind != SpeciesKind::GroundCover,
    }
}

/// By the small plant that ships.
fn small(args: &FlyArgs, species: &Species) -> Option<Member> {
    let plant = Plant { data: Arc::new(shipped(&species.name)?), model: None };
    let plants = vec![plant; variants(args, species) as usize];
    let autumn = if has_autumn(args, species) { plants.clone() } else { vec![] };
    Some(member(args, species, plants, autumn))
}

fn grown(
    args: &FlyArgs,
    species: &Species,
    settings: &BakeSettings,
    context: &BakeContext,
) -> ToolResult<Member> {
    let settings = settings_for(species, settings);
    let bake = |autumn: f32| -> ToolResult<Vec<Plant>> {
        (1..=variants(args, species))
            .map(|seed| {
                let baked = with_progress(&format!("{} {seed}", species.name), |progress| {
                    bake_species(species, seed.into(), autumn, &settings, context, progress)
                })?;
                Ok(baked.into())
            })
            .collect()
    };
    let summer = bake(0.0)?;
    let autumn = if has_autumn(args, species) { bake(1.0)? } else { vec![] };
    Ok(member(args, species, summer, autumn))
}

/// Bakes every plant in a thread of its own, in the order of the roster. `None` where nothing is left to do.
pub fn bake_in_background(args: &FlyArgs) -> ToolResult<Option<Receiver<Ready>>> {
    if !args.models.is_empty() || args.no_forest {
        return Ok(None);
    }
    let (species, settings, context) = (chosen(args)?, args.bake.settings(), args.bake.context()?);
    let (send, receive) = channel();
    let args = args.clone();
    std::thread::spawn(move || {
        // All species once before any twice.
        for variant in 0..args.variants as usize {
            for (member, species) in species.iter().enumerate() {
                let settings = settings_for(species, &settings);
                let seasons: &[bool] =
                    if has_autumn(&args, species) { &[false, true] } else { &[false] };
                if variant >= variants(&args, species) as usize {
                    continue;
                }
                for &autumn in seasons {
                    let (seed, turned) = (variant as u64 + 1, if autumn { 1.0 } else { 0.0 });
                    match bake_species(species, seed, turned, &settings, &context, &|_, _| ()) {
                        Ok(baked) => {
                            let ready = Ready { member, autumn, variant, plant: baked.into() };
                            if send.send(ready).is_err() {
                                return; // The window is closed.
                            }
                        }
                        Err(error) => error!("{} stays coarse: {error}", species.name),
                    }
                }
            }
        }
    });
    Ok(Some(receive))
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
    let summer = vec![Plant::from(baked)];
    let (height_m, crown_radius_m) = size_of(&summer[0], unit_scale);
    let name = path.file_stem().unwrap_or_default().to_string_lossy();
    Ok(Member {
        scatter: ScatterSpecies::new(&name, height_m, crown_radius_m),
        summer,
        autumn: vec![],
        unit_scale,
        has_mesh: true,
    })
}

/// Height and crown radius in metres.
fn size_of(plant: &Plant, unit_scale: f32) -> (f32, f32) {
    let extent = plant.data.bounds.extent() * unit_scale;
    (extent.y.max(0.1), (0.25 * (extent.x + extent.z)).max(0.05))
}

fn asset(world: &mut World, plant: &Plant, has_mesh: bool) -> TreeAsset {
    let model = plant.model.as_ref().filter(|_| has_mesh);
    let near_mesh = model.map(|model| {
        let mesh = scene::near_mesh(world, model, &plant.data);
        world.resource_mut::<Assets<NearMesh>>().add(mesh)
    });
    TreeAsset { data: plant.data.clone(), near_mesh }
}

/// Makes the assets.
pub fn plant(world: &mut World, members: &[Member]) -> Vec<PlantingSpecies> {
    let mut add = |plants: &[Plant], has_mesh: bool| -> Vec<Handle<TreeAsset>> {
        let assets = plants.iter().map(|plant| {
            let asset = asset(world, plant, has_mesh);
            world.resource_mut::<Assets<TreeAsset>>().add(asset)
        });
        assets.collect()
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

/// Puts a plant that is ready in the place of the one that stood in for it.
pub fn replace(world: &mut World, kinds: &[PlantingSpecies], has_mesh: &[bool], ready: &Ready) {
    let kind = &kinds[ready.member];
    let handles = if ready.autumn { &kind.autumn } else { &kind.summer };
    let Some(handle) = handles.get(ready.variant).cloned() else { return };
    let asset = asset(world, &ready.plant, has_mesh[ready.member]);
    if let Err(error) = world.resource_mut::<Assets<TreeAsset>>().insert(&handle, asset) {
        error!("a plant stays coarse: {error}");
    }
}
