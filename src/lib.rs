//! bevy_treeline
pub mod asset;
pub mod bake;
pub mod gpu;
pub mod math;
