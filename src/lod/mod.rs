//! L0: which level of detail is drawn, as plain functions of plain values. WGSL twins: `shaders/lib/lod.wgsl`.
//!
//! In: distance, scale, what the bake knows of a tree. Out: how many points ([`prefix_count`]), how large ([`splat_size`],
//! [`thinning`]) and how contrasty ([`contrast`]), and how much of mesh and points ([`fade`]); which lists they come from ([`clusters`]) and which part of
//! those ([`window`]); and the share of quality that keeps a
//! budget ([`governor`]). A few operations each.

pub mod clusters;
pub mod contrast;
pub mod fade;
pub mod governor;
pub mod prefix_count;
pub mod splat_size;
pub mod thinning;
pub mod window;
