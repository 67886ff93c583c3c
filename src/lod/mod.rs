//! L0: which level of detail is drawn, as plain functions of plain values. WGSL twins: `shaders/lib/lod.wgsl`.

pub mod fade;
pub mod prefix_count;
pub mod splat_size;
