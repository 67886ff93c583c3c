//! L1: what several stages of the GPU side share: the structs of Rust and WGSL ([`types`], declared through [`mirror`]),
//! buffers on their way back ([`readback`]), and a device without a window ([`headless`]).

pub mod headless;
pub mod mirror;
pub mod readback;
pub(crate) mod slice_buffer;
pub mod types;
