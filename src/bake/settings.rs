//! What a bake can be told. The cache key is a hash of these and of the source.

use serde::{Deserialize, Serialize};

/// How the points of a tree are ordered; every prefix of the order is a level of detail.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum OrderMethod {
    /// A random permutation (Bærentzen 2005, §5).
    Random,
    /// Each point is the farthest from those before it (Hochbaum and Shmoys 1985; the paper's comparison).
    FarthestPoint,
    /// Progressive blue noise by weighted sample elimination (Yuksel 2015).
    BlueNoise,
    /// By the bits of the LDI cell, finest first: each prefix is an even lattice.
    #[default]
    Lattice,
}

/// Who peels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PeelBackend {
    /// The GPU if there is one, the CPU twin if there is none or it is a software driver.
    #[default]
    Auto,
    /// Render passes; an error without an adapter.
    Gpu,
    /// The CPU twin.
    Cpu,
}

/// Settings of a bake.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct BakeSettings {
    /// Longest side of any layered depth image in pixels ("LDI size"), 1 to 16384. Default: 512.
    pub ldi_size: u32,
    /// Peeling directions: 3 (X, Y, Z: the paper), or 4 to 64 for its variation with more, spread evenly over the half sphere. Default: 3.
    pub directions: u32,
    /// Layers peeled per direction before giving up with a warning, 1 to 4096. Default: 256.
    pub max_layers: u32,
    /// The paper's §2.1 variation: each direction rasterises only the triangles most perpendicular to it. Default: false.
    pub partition_triangles: bool,
    /// Order of the points. Default: lattice.
    pub order: OrderMethod,
    /// Seed of everything random in the bake. Default: 1.
    pub seed: u64,
    /// Points and near meshes are darker where the model's own leaves and wood keep light away. Default: true.
    pub ambient_visibility: bool,
    /// Who peels; does not change the result beyond rounding. Default: auto.
    pub backend: PeelBackend,
}

impl Default for BakeSettings {
    fn default() -> Self {
        Self {
            ldi_size: 512,
            directions: 3,
            max_layers: 256,
            partition_triangles: false,
            order: OrderMethod::default(),
            seed: 1,
            ambient_visibility: true,
            backend: PeelBackend::default(),
        }
    }
}

/// A setting out of its range.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("bake setting `{name}` is {value}, but must be {range}")]
pub struct SettingsError {
    /// Field name.
    pub name: &'static str,
    /// What was given.
    pub value: String,
    /// What is allowed.
    pub range: &'static str,
}

impl BakeSettings {
    /// Checks every range.
    ///
    /// # Errors
    /// The first field out of its range.
    pub fn validate(&self) -> Result<(), SettingsError> {
        let check = |ok: bool, name, value: u32, range| {
            if ok { Ok(()) } else { Err(SettingsError { name, value: value.to_string(), range }) }
        };
        check((1..=16384).contains(&self.ldi_size), "ldi_size", self.ldi_size, "1 to 16384")?;
        let directions_ok = (3..=64).contains(&self.directions);
        check(directions_ok, "directions", self.directions, "3 to 64")?;
        check((1..=4096).contains(&self.max_layers), "max_layers", self.max_layers, "1 to 4096")
    }
}
