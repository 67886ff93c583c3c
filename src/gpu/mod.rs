//! L1: what the bake and the renderer share of the GPU.

pub mod mirror;
