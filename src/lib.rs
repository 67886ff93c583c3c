//! bevy_treeline
pub mod asset;
pub mod bake;
#[cfg(feature = "landscape")]
pub mod landscape;
pub mod math;
pub mod species;
