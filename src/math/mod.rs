//! L0: pure mathematics. Knows no Bevy but `bevy::math`.

pub mod bounding;
pub mod hash;
pub mod octahedral;
pub mod point_grid;
pub mod quantize;
pub mod sample_elimination;
pub mod triangle;
