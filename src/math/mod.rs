//! L0: pure mathematics: plain values in, plain values out. Knows no Bevy but `bevy::math`. What shaders need too has a
//! twin in `shaders/lib`.

pub mod block_order;
pub mod bounding;
pub mod compact;
pub mod hash;
pub mod image_error;
pub mod occlusion;
pub mod octahedral;
pub mod point_grid;
pub mod quantize;
pub mod sample_elimination;
pub mod slice_allocator;
pub mod spherical_harmonics;
pub mod triangle;
