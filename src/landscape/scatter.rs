//! Trees, shrubs and ground cover of a landscape, tile by tile: ground, biomes, species and an amount in, plants out.
//!
//! `blue_noise` (places that keep their distance) → `stand` (densities by biome and habitat) → `amount` (how dense, for a
//! total) → `planter` (a plant at a place). A tile depends on its number, the seed and the ground alone: any order, any
//! thread, neighbours or not. O(places of the grid + candidates) a tile.

use super::{
    Biomes, Ground, Habitat, PlantKind, Site,
    amount::{self, Amount},
    blue_noise::{BlueNoise, LEAST_SIDE},
    planter::Planter,
    stand::{Layer, Stands},
};
use bevy::math::{IVec2, Quat, Vec3};
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use thiserror::Error;

/// The least distance between trunks in metres, if none is asked for and trunks are thin.
const SPACING_M: f32 = 1.6;

/// A species as scattering knows it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ScatterSpecies {
    /// For messages and saved forests.
    pub name: String,
    /// Where it grows and how.
    pub habitat: Habitat,
    /// Of a plant of scale 1, metres, > 0.
    pub height_m: f32,
    /// Of a plant of scale 1, metres, > 0.
    pub crown_radius_m: f32,
}

impl ScatterSpecies {
    /// A species with the habitat of the preset of that name, else that of any tree.
    pub fn new(name: &str, height_m: f32, crown_radius_m: f32) -> Self {
        let habitat = Habitat::of(name).unwrap_or_default();
        Self { name: name.to_owned(), habitat, height_m, crown_radius_m }
    }
}

/// How many trees, shrubs included, ground cover not.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum TreeAmount {
    /// On the whole ground, met within 3 %; ≥ 1.
    Total(u64),
    /// On a hectare of closed forest of middle age, > 0.
    PerHectare(f32),
}

/// How plants are scattered.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ScatterSettings {
    /// Of all chance. Default: 1.
    pub seed: u64,
    /// Default: 450 per hectare of forest.
    pub amount: TreeAmount,
    /// 0 summer to 1 late autumn; each tree turns at its own time. Default: 0.
    pub season: f32,
    /// Side of a tile of trees in metres, 16 to 4,096. Default: 256.
    pub tile_m: f32,
    /// Side of a tile of ground cover in metres, 8 to 1,024. Default: 32.
    pub cover_tile_m: f32,
    /// Ground cover on a square metre of full meadow, 0 (none) to 20. Default: 0.8.
    pub cover_per_m2: f32,
    /// Least distance between trunks in metres, 0.3 to 100. Default (`None`): 1.6, more where trunks are thicker. Trunks
    /// never overlap, whatever is asked for.
    pub spacing_m: Option<f32>,
    /// Memory that all trees of the ground may take, at 64 bytes each. Default: 2 GiB.
    pub max_bytes: u64,
}

impl Default for ScatterSettings {
    fn default() -> Self {
        Self {
            seed: 1,
            amount: TreeAmount::PerHectare(450.0),
            season: 0.0,
            tile_m: 256.0,
            cover_tile_m: 32.0,
            cover_per_m2: 0.8,
            spacing_m: None,
            max_bytes: 2 << 30,
        }
    }
}

/// A plant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScatteredTree {
    /// Foot of the trunk: on the ground, a few centimetres into it, more on slopes.
    pub position: Vec3,
    /// Turned about the trunk, leaning a little.
    pub rotation: Quat,
    /// Uniform; 1 is the species' height.
    pub scale: f32,
    /// Index of the species.
    pub species: u16,
    /// Colour factor per channel, 128 = unchanged.
    pub tint: [u8; 3],
    /// 0 green to 1 turned: the season by this tree's own calendar. 0 for evergreens.
    pub autumn: f32,
    /// Random bits for everything else that differs from tree to tree.
    pub seed: u8,
}

/// Why trees could not be scattered.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum ScatterError {
    /// A total of 0.
    #[error("scatter: a total of 0 trees was asked for; ask for at least 1")]
    None,
    /// There is no room for so many.
    #[error(
        "scatter: {requested} trees do not fit on this ground with its forests and this spacing, {fits} do; \
         ask for at most that many, lower the spacing or enlarge ground or forests"
    )]
    Room {
        /// Trees asked for.
        requested: u64,
        /// Trees that fit.
        fits: u64,
    },
    /// A hectare has no room for so many.
    #[error(
        "scatter: {requested} trees do not fit on a hectare with this spacing, {fits} do; ask for at most that many or lower the spacing"
    )]
    Density {
        /// Trees per hectare asked for.
        requested: f32,
        /// Trees that fit.
        fits: f32,
    },
    /// Memory would not suffice.
    #[error(
        "scatter: {requested} trees take more than the {max_bytes} bytes allowed (max_bytes), which hold {fits}; \
         ask for at most that many or allow more"
    )]
    Memory {
        /// Trees asked for, or that the density comes to.
        requested: u64,
        /// Trees that fit.
        fits: u64,
        /// The bound in force.
        max_bytes: u64,
    },
    /// A setting cannot be used.
    #[error("scatter: {what} is {value}; it must be {must}")]
    Setting {
        /// Which.
        what: &'static str,
        /// What it is.
        value: f32,
        /// What it must be.
        must: &'static str,
    },
    /// A species cannot be used.
    #[error("scatter: {what} of species `{name}` is {value}; it must be {must}")]
    Species {
        /// Which species.
        name: String,
        /// Which value.
        what: &'static str,
        /// What it is.
        value: f32,
        /// What it must be.
        must: &'static str,
    },
    /// There is nothing to scatter.
    #[error(
        "scatter: none of the {given} species is a tree or shrub; give at least one, at most 65535 in all"
    )]
    NoSpecies {
        /// Species given.
        given: usize,
    },
}

/// All plants of a ground, made tile by tile. Cheap to clone, immutable, for any thread.
#[derive(Clone)]
pub struct Scatter {
    trees: Arc<Planter>,
    cover: Option<Arc<Planter>>,
    settings: ScatterSettings,
    amount: Amount,
}

impl Scatter {
    /// Prepares scattering: builds the pattern and finds the density for the amount. Below a second for 64 km too.
    ///
    /// # Errors
    /// [`ScatterError`]: amounts of 0 or that do not fit, settings and species that cannot be used.
    pub fn new(
        ground: Arc<dyn Ground>,
        biomes: Arc<Biomes>,
        species: Vec<ScatterSpecies>,
        settings: ScatterSettings,
    ) -> Result<Self, ScatterError> {
        check(&species, &settings)?;
        let species: Arc<[ScatterSpecies]> = species.into();
        let seed = settings.seed;
        let stands = |layer| {
            Stands::new(Arc::clone(&ground), Arc::clone(&biomes), Arc::clone(&species), layer, seed)
        };
        let widest =
            |s: &ScatterSpecies| 2.0 * s.habitat.trunk_share * s.height_m * s.habitat.scale[1];
        let trunks = species.iter().map(widest).fold(0.0, f32::max);
        // A little more: positions are rounded.
        let spacing_m = settings.spacing_m.unwrap_or(SPACING_M).max(1.02 * trunks);
        // A tile holds several of the widest discs.
        let tile_m = settings.tile_m.max(LEAST_SIDE * spacing_m);
        let trees = Arc::new(Planter::new(
            stands(Layer::Trees),
            BlueNoise::new(tile_m, spacing_m, seed),
            tile_m,
            Layer::Trees,
            seed,
        ));
        let has_cover = species.iter().any(|s| s.habitat.kind == PlantKind::Cover);
        let cover = (has_cover && settings.cover_per_m2 > 0.0).then(|| {
            // Half again as dense as a full meadow, for its patches.
            let spacing_m = (0.58 / (1.5 * settings.cover_per_m2)).sqrt();
            let tile_m = settings.cover_tile_m.max(LEAST_SIDE * spacing_m);
            let pattern = BlueNoise::new(tile_m, spacing_m, seed ^ 0xC0FE);
            Arc::new(Planter::new(stands(Layer::Cover), pattern, tile_m, Layer::Cover, seed))
        });
        let tiles: Vec<IVec2> = tiles(ground.side_m(), tile_m).collect();
        let amount = amount::resolve(&trees, settings.amount, settings.max_bytes, &tiles)?;
        Ok(Self { trees, cover, settings, amount })
    }

    /// The same plants at another time of the year. O(1).
    pub fn with_season(&self, season: f32) -> Self {
        let season = if season.is_nan() { 0.0 } else { season.clamp(0.0, 1.0) };
        Self { settings: ScatterSettings { season, ..self.settings.clone() }, ..self.clone() }
    }

    /// Trees and shrubs of a tile, in a fixed order: those with x and z from `tile` to `tile + 1` times
    /// [`Self::tile_size_m`]. Empty beyond the ground.
    pub fn tile(&self, tile: IVec2) -> Vec<ScatteredTree> {
        self.trees.tile(tile, self.amount.per_m2, self.settings.season)
    }

    /// Ground cover of one of the smaller tiles of [`Self::cover_tile_size_m`].
    pub fn cover_tile(&self, tile: IVec2) -> Vec<ScatteredTree> {
        self.cover.as_ref().map_or(vec![], |cover| {
            cover.tile(tile, self.settings.cover_per_m2, self.settings.season)
        })
    }

    /// Side of a tile in metres: as set, more where the spacing is wide.
    pub fn tile_size_m(&self) -> f32 {
        self.trees.tile_m
    }

    /// Side of a tile of ground cover in metres.
    pub fn cover_tile_size_m(&self) -> f32 {
        self.cover.as_ref().map_or(self.settings.cover_tile_m, |cover| cover.tile_m)
    }

    /// First and last tile that meet the ground, in x and z.
    pub fn tile_range(&self) -> [IVec2; 2] {
        tile_range(self.ground().side_m(), self.tile_size_m())
    }

    /// All tiles that meet the ground, by rows.
    pub fn tiles(&self) -> impl Iterator<Item = IVec2> + use<> {
        tiles(self.ground().side_m(), self.tile_size_m())
    }

    /// Trees and shrubs of all tiles together, within 3 %.
    pub fn expected_trees(&self) -> f64 {
        self.amount.expected
    }

    /// Trees and shrubs per hectare of closed forest of middle age.
    pub fn per_hectare(&self) -> f32 {
        self.amount.per_m2 * 1e4
    }

    /// Share of the ground at (x, z) that crowns are expected to cover, 0 to 1. O(octaves · species).
    pub fn canopy_cover(&self, x: f32, z: f32) -> f32 {
        self.canopy_cover_of(x, z, &self.ground().site(x, z))
    }

    /// [`Self::canopy_cover`] where the site is known.
    pub fn canopy_cover_of(&self, x: f32, z: f32, site: &Site) -> f32 {
        let stands = &self.trees.stands;
        let mut shares = vec![0.0; stands.members.len()];
        let spot = stands.at_site(x, z, site, &mut shares);
        let per_m2 =
            self.amount.per_m2.min(self.trees.most_per_m2(spot.density) / spot.density.max(1e-9));
        let crowns = stands.members.iter().zip(&shares).map(|((i, _), share)| {
            let species = &stands.species[usize::from(*i)];
            let [young, old] = species.habitat.scale;
            let grown = young + (old - young) * (0.25 + 0.6 * spot.age).min(1.0);
            share * std::f32::consts::PI * (species.crown_radius_m * grown * spot.vigour).powi(2)
        });
        // Crowns overlap at random (Boolean model).
        1.0 - (-per_m2 * crowns.sum::<f32>()).exp()
    }

    /// The species, as [`ScatteredTree::species`] counts.
    pub fn species(&self) -> &[ScatterSpecies] {
        &self.trees.stands.species
    }

    /// The settings.
    pub fn settings(&self) -> &ScatterSettings {
        &self.settings
    }

    /// What the plants stand on.
    pub fn ground(&self) -> &Arc<dyn Ground> {
        &self.trees.stands.ground
    }

    /// What decides where they grow.
    pub fn biomes(&self) -> &Arc<Biomes> {
        &self.trees.stands.biomes
    }
}

fn tile_range(side_m: f32, tile_m: f32) -> [IVec2; 2] {
    let last = ((0.5 * side_m / tile_m).ceil() as i32).max(1) - 1;
    [IVec2::splat(-last - 1), IVec2::splat(last)]
}

fn tiles(side_m: f32, tile_m: f32) -> impl Iterator<Item = IVec2> {
    let [first, last] = tile_range(side_m, tile_m);
    (first.y..=last.y).flat_map(move |z| (first.x..=last.x).map(move |x| IVec2::new(x, z)))
}

fn check(species: &[ScatterSpecies], settings: &ScatterSettings) -> Result<(), ScatterError> {
    let setting = |what, value: f32, from: f32, to: f32, must| {
        let usable = (from..=to).contains(&value);
        if usable { Ok(()) } else { Err(ScatterError::Setting { what, value, must }) }
    };
    setting("season", settings.season, 0.0, 1.0, "0 to 1")?;
    setting("tile_m", settings.tile_m, 16.0, 4096.0, "16 to 4096")?;
    setting("cover_tile_m", settings.cover_tile_m, 8.0, 1024.0, "8 to 1024")?;
    setting("cover_per_m2", settings.cover_per_m2, 0.0, 20.0, "0 to 20")?;
    setting("spacing_m", settings.spacing_m.unwrap_or(1.0), 0.3, 100.0, "0.3 to 100")?;
    if let TreeAmount::PerHectare(value) = settings.amount {
        setting("amount per hectare", value, f32::MIN_POSITIVE, f32::MAX, "positive and finite")?;
    }
    for s in species {
        let sizes = [("height_m", s.height_m), ("crown_radius_m", s.crown_radius_m)]
            .into_iter()
            .find(|(_, v)| !(*v > 0.0 && *v <= 500.0))
            .map(|(what, value)| (what, value, "more than 0, at most 500"));
        if let Some((what, value, must)) = s.habitat.problem().or(sizes) {
            return Err(ScatterError::Species { name: s.name.clone(), what, value, must });
        }
    }
    let plants = species.iter().filter(|s| s.habitat.kind != PlantKind::Cover).count();
    if plants == 0 || species.len() > usize::from(u16::MAX) {
        return Err(ScatterError::NoSpecies { given: species.len() });
    }
    Ok(())
}
