//! L2, feature `landscape`: ground, forest and camera path for demos, tests and games that have none of their own.
//!
//! `ground` (any heights) → `biome` and `pattern` (where forest grows) → `scatter` (plants, tile by tile) → `planted` (with
//! edits by hand) → `flight` (a closed camera path past and over them): all pure and seeded. `planting` and `streaming` bring
//! tiles into the scene around the cameras.

mod amount;
pub mod biome;
mod blue_noise;
mod canopy;
pub mod edits;
pub mod flight;
pub mod ground;
pub mod habitat;
pub mod heightfield;
pub mod mesh_ground;
pub mod pattern;
pub mod planted;
#[cfg(test)]
mod planted_tests;
mod planter;
pub mod planting;
pub mod saved;
pub mod scatter;
mod scatter_on;
#[cfg(test)]
mod scatter_tests;
mod stand;
mod streaming;
#[cfg(test)]
mod test_ground;

pub use biome::{Biome, BiomeSettings, Biomes};
pub use edits::{ForestEdits, TreeId};
pub use flight::FlightPath;
pub use ground::{Ground, Site};
pub use habitat::{Habitat, PlantKind};
pub use heightfield::{GroundMesh, Heightfield, HeightfieldError};
pub use mesh_ground::{MeshGround, MeshGroundError};
pub use pattern::ForestPattern;
pub use planted::{EditError, FoundTree, PlantedForest, TilePlan};
pub use planting::{
    ForestTile, Planting, PlantingCounters, PlantingPlugin, PlantingSettings, PlantingSpecies,
};
pub use saved::{GroundMark, SavedForest};
pub use scatter::{
    Scatter, ScatterError, ScatterSettings, ScatterSpecies, ScatteredTree, TreeAmount,
};
pub use scatter_on::{GroundPoint, scatter_on};

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
