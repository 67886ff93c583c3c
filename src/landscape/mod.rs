//! L2, feature `landscape`: ground, forest and camera path for games, demos and tests.
//!
//! `ground` (any heights: `terrain`, `dem`, `heightfield`, `mesh_ground`) → `biome` (what grows where) → `scatter` (plants,
//! tile by tile) → `planted` (with edits by hand) → `flight` (a closed camera path past, between and over them). All of
//! these are pure and seeded. `draw` streams ground, water and sky around the cameras, `planting` the plants.

mod amount;
pub mod biome;
mod blue_noise;
pub mod chunk;
pub mod daylight;
pub mod dem;
pub mod draw;
pub mod edits;
mod erosion;
pub mod flight;
mod forest_shade;
mod gradient_noise;
pub mod ground;
pub mod habitat;
mod height_grid;
pub mod heightfield;
pub mod mesh_ground;
mod paint;
mod pattern;
pub mod planted;
#[cfg(test)]
mod planted_tests;
mod planter;
pub mod planting;
pub mod quadtree;
mod rivers;
pub mod saved;
pub mod scatter;
mod scatter_on;
#[cfg(test)]
mod scatter_tests;
pub mod shade;
mod stand;
mod streaming;
pub mod sunlight;
pub mod terrain;
#[cfg(test)]
mod test_ground;

pub use biome::{Biome, BiomeSettings, Biomes};
pub use daylight::{Daylight, TimeOfDay};
pub use dem::{DemError, DemTerrain};
pub use draw::{
    Landscape, Sky, SkyKind, SkySupport, Sun, TerrainCounters, TerrainLod, TerrainPlugin,
    TerrainSystems,
};
pub use edits::{ForestEdits, TreeId};
pub use flight::{Crown, CrownSource, FlightPath, FlightSettings, Role};
pub use forest_shade::ForestShade;
pub use ground::{Ground, Site};
pub use habitat::{Habitat, PlantKind};
pub use heightfield::{Heightfield, HeightfieldError};
pub use mesh_ground::{MeshGround, MeshGroundError};
pub use planted::{EditError, FoundTree, PlantedForest, TilePlan};
pub use planting::{
    ForestTile, Planting, PlantingCounters, PlantingPlugin, PlantingSettings, PlantingSpecies,
};
pub use saved::{GroundMark, SavedForest};
pub use scatter::{
    Scatter, ScatterError, ScatterSettings, ScatterSpecies, ScatteredTree, TreeAmount,
};
pub use scatter_on::{GroundPoint, scatter_on};
pub use shade::ShadeSource;
pub use terrain::{NoiseTerrain, TerrainError, TerrainSettings, Water};

use crate::math::hash::SplitMix64;
use noise::{Fbm, MultiFractal, NoiseFn, Perlin};

/// Fractal noise with a wavelength in metres, roughly −1 to 1.
struct Field {
    fbm: Fbm<Perlin>,
    wavelength_m: f64,
}

impl Field {
    fn new(seed: u64, octaves: usize, wavelength_m: f32) -> Self {
        let seed = SplitMix64(seed).next_u64() as u32;
        Self { fbm: Fbm::new(seed).set_octaves(octaves), wavelength_m: f64::from(wavelength_m) }
    }

    fn at(&self, x: f32, z: f32) -> f32 {
        // Perlin noise is 0 on its lattice; the offset keeps the origin of the world off it.
        self.fbm
            .get([f64::from(x) / self.wavelength_m + 0.37, f64::from(z) / self.wavelength_m + 0.61])
            as f32
    }
}

/// 0 below `low`, 1 above `high`, smooth between (Hermite).
fn smoothstep(low: f32, high: f32, value: f32) -> f32 {
    let t = ((value - low) / (high - low)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}
