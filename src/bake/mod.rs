//! L2: mesh → tree. `source` → `peel` → `surfels` → `order` → `assemble`; `job` runs it in the background.

pub mod order;
pub mod peel;
pub mod predict;
pub mod settings;
pub mod source;
pub mod surfels;
pub mod texture;

#[cfg(test)]
mod test_models;
