//! L1: the baked tree in memory and on disk.
//!
//! In: what a bake made ([`TreeData`]), or the bytes of a file. Out: [`TreeAsset`] for the asset server, `.treeline` files
//! ([`write_treeline`], [`read_treeline`], [`format`](mod@format)) and the disk cache ([`BakeCache`]). A point takes 16 bytes
//! ([`SurfelHot`] and [`SurfelCold`]); whatever a file holds, reading it ends in a tree or in an error.

mod cache;
mod clusters;
mod file;
pub mod format;
mod format_error;
mod lanes;
mod sections;
mod surfel;
#[cfg(test)]
pub(crate) mod synthetic;
mod thinning;
mod tree_asset;
mod tree_data;

pub use cache::{BAKE_VERSION, BakeCache, CACHE_DIR_VARIABLE, CacheKey, CacheLocation};
pub use clusters::{Cluster, TreeClusters};
pub use file::{FileError, read_treeline, write_treeline};
pub use format_error::{FilePart, FormatError, SectionId, SectionProblem};
#[doc(hidden)]
pub use surfel::MIRRORS as SURFEL_MIRRORS;
pub use surfel::{
    SURFEL_KEEPS_NORMAL, SURFEL_LEAF, SURFEL_TWO_SIDED, SURFEL_UNLIT, Surfel, SurfelCold,
    SurfelHot, light_factor,
};
pub use tree_asset::{NEAR_LIGHTING_PASS, NearMesh, NearMeshPiece, TreeAsset};
pub use tree_data::{
    BakeSeconds, BakeStatistics, MAX_POINTS, SeenMean, SourceReference, TreeData, TreeDataError,
};
