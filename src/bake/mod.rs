//! L2: mesh → tree. `source` → `peel` → `surfels` → `order` → `assemble`; `job` runs it in the background.

pub mod order;
pub mod peel;
pub mod settings;
pub mod source;
