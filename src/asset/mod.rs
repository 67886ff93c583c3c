//! L1: the baked tree in memory and on disk.

pub mod surfel;
