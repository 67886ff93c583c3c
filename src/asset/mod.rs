//! L1: the baked tree in memory and on disk.

mod cache;
mod file;
pub mod format;
mod sections;
mod surfel;
mod tree_asset;
mod tree_data;

pub use cache::{BakeCache, CacheKey, CacheLocation};
pub use file::{FileError, read_treeline, write_treeline};
pub use format::FormatError;
pub use surfel::{SURFEL_LEAF, SURFEL_TWO_SIDED, SURFEL_UNLIT, Surfel, SurfelCold, SurfelHot};
#[doc(hidden)]
pub use surfel::MIRRORS as SURFEL_MIRRORS;
pub use tree_asset::{NearMesh, NearMeshPiece, TreeAsset};
pub use tree_data::{BakeSeconds, BakeStatistics, SourceReference, TreeData};
