//! L0: which level of detail is drawn, as plain functions of plain values. WGSL twins: `shaders/lib/lod.wgsl`.
//!
//! In: distance, scale, what the bake knows of a tree. Out: how many points ([`prefix_count`]), how large ([`splat_size`]),
//! which ([`window`]), and how much of mesh and points ([`fade`]). A few operations each.

pub mod fade;
pub mod prefix_count;
pub mod splat_size;
pub mod window;
