//! L0: pure mathematics. Knows no Bevy but `bevy::math`.

pub mod bounding;
pub mod hash;
pub mod image_error;
pub mod octahedral;
pub mod quantize;
