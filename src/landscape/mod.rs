//! L2, feature `landscape`: ground, forest and camera path for demos, tests and games that have none of their own.
//!
//! `heightfield` (hills and their mesh) → `pattern` (where forest grows) → `scatter` (trees that stand on the ground) →
//! `flight` (a closed camera path past, between and over them). All pure and seeded; no randomness but the seeds.

pub mod biome;
pub mod chunk;
pub mod daylight;
pub mod dem;
pub mod draw;
mod erosion;
pub mod flight;
mod gradient_noise;
pub mod ground;
mod height_grid;
pub mod heightfield;
mod paint;
pub mod pattern;
pub mod quadtree;
pub mod scatter;
pub mod shade;
pub mod sunlight;
pub mod terrain;

pub use biome::{Biome, BiomeSettings, Biomes};
pub use daylight::{Daylight, TimeOfDay};
pub use dem::{DemError, DemTerrain};
pub use draw::{
    Landscape, Sky, SkyKind, SkySupport, Sun, TerrainCounters, TerrainLod, TerrainPlugin,
    TerrainSystems,
};
pub use flight::{Crown, CrownSource, FlightPath, FlightSettings, Role};
pub use ground::{Ground, Site};
pub use heightfield::{GroundMesh, Heightfield, HeightfieldError};
pub use pattern::ForestPattern;
pub use scatter::{ScatterError, ScatterSettings, ScatteredTree, scatter};
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
