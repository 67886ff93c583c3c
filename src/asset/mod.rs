//! L1: the baked tree in memory and on disk.

pub mod cache;
pub mod file;
pub mod format;
pub mod format_error;
mod lanes;
mod sections;
pub mod surfel;
#[cfg(test)]
mod synthetic;
pub mod tree_data;
