//! L1: what several stages of the GPU side share.

pub mod headless;
pub mod mirror;
pub mod readback;
pub mod types;
