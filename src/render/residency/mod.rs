//! What is resident on the GPU: the surfels of every species, and one buffer with the instances of every forest.
//!
//! In: what was extracted. Out: [`SurfelPool`] and [`InstancePool`]. Only forests that changed are packed and written.

mod blocks;
mod grove_order;
mod groves;
mod instances;
mod packing;
mod surfels;

pub(super) use instances::{InstancePool, Tile, prepare_instances};
pub(super) use surfels::{SurfelPool, prepare_surfels};
