#![doc = include_str!("../README.md")]
#![forbid(unsafe_code)]
#![warn(missing_docs)]

pub mod asset;
pub mod bake;
pub mod diagnostics;
pub mod forest;
pub mod governor;
pub mod gpu;
#[cfg(feature = "landscape")]
pub mod landscape;
pub mod lod;
pub mod math;
mod plugin;
pub mod render;
pub mod shaders;
pub mod species;

pub use asset::{CacheLocation, TreeAsset};
pub use bake::{BakeSettings, TreeBaker, TreeLoaderSettings};
pub use diagnostics::TreelineDiagnosticsPlugin;
pub use forest::{
    CullingView, DebugView, Forest, GroveSettings, LodState, NearMeshes, Occlusion, QualityFactor,
    SplatPath, SplatShape, TemporalSampling, TreeImpostor, TreeInstance, TreelineSettings,
    TreelineSystems, UploadBudget,
};
pub use governor::{GovernorBudget, QualityGovernor};
pub use plugin::TreelinePlugin;
pub use render::{TreelineCounters, TreelineTaa, ViewCounters};

/// Every struct that Rust and WGSL share, for `tests/shader_layout.rs`.
#[doc(hidden)]
pub const MIRRORS: &[&[gpu::mirror::Mirror]] = &[asset::SURFEL_MIRRORS, gpu::types::MIRRORS];

/// What most apps name.
pub mod prelude {
    pub use crate::{
        BakeSettings, Forest, LodState, TreeAsset, TreeBaker, TreeImpostor, TreeInstance,
        TreelinePlugin, TreelineSettings,
    };
}
