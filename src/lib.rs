//! bevy_treeline
pub mod asset;
pub mod bake;
pub mod gpu;
pub mod math;
pub mod shaders;

/// Every struct that Rust and WGSL share, for `tests/shader_layout.rs`.
#[doc(hidden)]
pub const MIRRORS: &[&[gpu::mirror::Mirror]] = &[asset::surfel::MIRRORS];
