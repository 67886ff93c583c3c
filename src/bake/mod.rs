//! L2: mesh → tree. `source` → `peel` → `surfels` → `lighting` → `order` → `assemble`; `job` runs it in the background.
//!
//! In: a model file ([`bake_file`]), a species ([`bake_species`]), or a model of any origin ([`bake_model`], [`model_of_entities`]). Out: [`Baked`], the points
//! and the model they came from. In a running game, load a model as a [`TreeAsset`](crate::TreeAsset), or start a bake with
//! [`TreeBaker`]. Seconds for a tree of some 100,000 triangles; nothing on the second start, thanks to the cache.
//!
//! ```no_run
//! use bevy_treeline::bake::{BakeContext, BakeSettings, bake_file};
//! let settings = BakeSettings { ldi_size: 1024, ..Default::default() };
//! let baked = bake_file("oak.glb".as_ref(), &settings, &BakeContext::default(), &|_, _| ())?;
//! println!("{} points", baked.data.point_count());
//! # Ok::<(), bevy_treeline::bake::BakeError>(())
//! ```

mod assemble;
mod cards;
mod entities;
mod job;
pub mod lighting;
mod loader;
mod near;
pub mod order;
pub mod peel;
mod plant;
pub mod predict;
mod settings;
pub mod source;
pub mod surfels;
#[cfg(test)]
mod test_models;
mod texture;
mod thickness;

pub use assemble::{BakeContext, BakeError, BakeStage, Baked, bake_file, bake_model};
pub use entities::{EntityModelError, model_of_entities};
pub(crate) use job::BakePlugin;
pub use job::{BakeFailed, BakeProgress, BakeTasks, TreeBaker};
pub use loader::{
    LoadTreeError, NearMeshLoader, NearMeshLoaderSettings, TreeLoader, TreeLoaderSettings,
    TreeSaver,
};
pub use near::{NearMeshSource, model_mesh_sources, near_mesh_sources};
pub use plant::bake_species;
pub use settings::{BakeSettings, OrderMethod, PeelBackend, SettingsError};
