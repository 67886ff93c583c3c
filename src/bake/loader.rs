//! Trees through the asset server: `.treeline` files, and models that are baked when they load.
//!
//! There is one loader per asset type on purpose: Bevy then picks it by type, and its own glTF loader keeps `.glb`.

use super::{
    assemble::{BakeError, bake_model},
    job::BakeEnvironment,
    near,
    settings::BakeSettings,
    source::{self, SourceError, SourceModel},
};
use crate::asset::{FormatError, NearMesh, TreeAsset, format};
use bevy::{
    asset::{
        AssetLoader, AssetPath, AsyncWriteExt, LoadContext,
        io::{Reader, Writer},
        saver::{AssetSaver, SavedAsset},
    },
    prelude::*,
    reflect::TypePath,
    tasks::AsyncComputeTaskPool,
};
use serde::{Deserialize, Serialize};
use std::{io, sync::Arc, time::Instant};

/// How a tree is loaded.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct TreeLoaderSettings {
    /// For models: how to bake. `None`: the plugin's settings.
    pub bake: Option<BakeSettings>,
    /// Do not load the mesh that is drawn near the camera. Default: false.
    pub points_only: bool,
}

/// How a near mesh is loaded.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct NearMeshLoaderSettings {
    /// As [`BakeSettings::ambient_visibility`]. Default: true.
    pub ambient_visibility: bool,
}

impl Default for NearMeshLoaderSettings {
    fn default() -> Self {
        Self { ambient_visibility: true }
    }
}

/// Loads [`TreeAsset`]s.
#[derive(TypePath, Clone)]
pub struct TreeLoader {
    pub(super) environment: BakeEnvironment,
}

/// Loads [`NearMesh`]es from models.
#[derive(TypePath, Clone, Default)]
pub struct NearMeshLoader;

/// Saves [`TreeAsset`]s as `.treeline` files.
#[derive(TypePath, Clone, Default)]
pub struct TreeSaver;

/// Why a tree could not be loaded.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LoadTreeError {
    /// The file could not be read.
    #[error("{path}: {error}")]
    Io {
        /// Asset path.
        path: String,
        /// Why.
        error: io::Error,
    },
    /// Not a whole `.treeline` file.
    #[error("{path}: {error}")]
    Format {
        /// Asset path.
        path: String,
        /// Why.
        error: FormatError,
    },
    /// Not a usable model.
    #[error(transparent)]
    Source(#[from] SourceError),
    /// It could not be baked.
    #[error(transparent)]
    Bake(#[from] BakeError),
}

async fn read_all(reader: &mut dyn Reader, path: &str) -> Result<Vec<u8>, LoadTreeError> {
    let mut bytes = vec![];
    let read = reader.read_to_end(&mut bytes).await;
    read.map_err(|error| LoadTreeError::Io { path: path.into(), error })?;
    Ok(bytes)
}

/// The asset at `relative`, as seen from the file at `base`.
fn sibling(base: &AssetPath<'static>, relative: &str) -> AssetPath<'static> {
    let parent = base.path().parent().map(std::path::Path::to_path_buf).unwrap_or_default();
    AssetPath::from_path_buf(parent.join(relative)).with_source(base.source().clone_owned())
}

fn parse(bytes: &[u8], context: &mut LoadContext) -> Result<SourceModel, SourceError> {
    let path = context.path().clone_owned();
    let mut read = |name: &str| {
        // Loaders run on their own threads, so waiting for a texture here keeps nobody else waiting.
        let bytes = bevy::tasks::block_on(context.read_asset_bytes(sibling(&path, name)));
        bytes.map_err(|error| io::Error::other(error.to_string()))
    };
    source::parse_model(&path.to_string(), bytes, &mut read)
}

fn label_near_mesh(
    model: &SourceModel,
    ambient_visibility: bool,
    context: &mut LoadContext,
) -> NearMesh {
    let context = std::cell::RefCell::new(context);
    near::near_mesh(
        near::near_mesh_sources(model, ambient_visibility),
        |i, image| context.borrow_mut().add_labeled_asset(format!("treeline/texture{i}"), image),
        |i, mesh, material| {
            let mut context = context.borrow_mut();
            (
                context.add_labeled_asset(format!("treeline/mesh{i}"), mesh),
                context.add_labeled_asset(format!("treeline/material{i}"), material),
            )
        },
    )
}

impl AssetLoader for TreeLoader {
    type Asset = TreeAsset;
    type Settings = TreeLoaderSettings;
    type Error = LoadTreeError;

    async fn load(
        &self,
        reader: &mut dyn Reader,
        settings: &TreeLoaderSettings,
        context: &mut LoadContext<'_>,
    ) -> Result<TreeAsset, LoadTreeError> {
        let path = context.path().clone_owned();
        let name = path.to_string();
        let start = Instant::now();
        let bytes = read_all(reader, &name).await?;
        if bytes.starts_with(&format::MAGIC)
            || path.get_full_extension().is_some_and(|e| e.ends_with("treeline"))
        {
            let data = format::decode(&bytes)
                .map_err(|error| LoadTreeError::Format { path: name, error })?;
            let source = data.source.as_ref().filter(|_| !settings.points_only);
            let ambient_visibility = data.is_shaded();
            let near_mesh = source.map(|source| {
                let set = move |settings: &mut NearMeshLoaderSettings| {
                    settings.ambient_visibility = ambient_visibility;
                };
                context.load_builder().with_settings(set).load(sibling(&path, &source.path))
            });
            return Ok(TreeAsset { data: Arc::new(data), near_mesh });
        }
        let model = Arc::new(parse(&bytes, context)?);
        let loading = start.elapsed().as_secs_f64();
        let environment = self.environment.clone();
        let bake = settings.bake.clone().unwrap_or_else(|| environment.settings.clone());
        let near_mesh = (!settings.points_only).then(|| {
            let mesh = label_near_mesh(&model, bake.ambient_visibility, context);
            context.add_labeled_asset("treeline/near_mesh", mesh)
        });
        // Peeling and ordering take seconds: off the threads that read files.
        let task = AsyncComputeTaskPool::get().spawn(async move {
            let progress = environment.progress.begin(&model.name);
            let file = path.path().file_name().map(|f| f.to_string_lossy().into_owned());
            bake_model(model, file, &bake, &environment.context(), loading, &|stage, done| {
                progress.set(stage, done);
            })
        });
        let baked = task.await?;
        Ok(TreeAsset { data: baked.data, near_mesh })
    }

    fn extensions(&self) -> &[&str] {
        &["treeline"]
    }
}

impl AssetLoader for NearMeshLoader {
    type Asset = NearMesh;
    type Settings = NearMeshLoaderSettings;
    type Error = LoadTreeError;

    async fn load(
        &self,
        reader: &mut dyn Reader,
        settings: &NearMeshLoaderSettings,
        context: &mut LoadContext<'_>,
    ) -> Result<NearMesh, LoadTreeError> {
        let name = context.path().to_string();
        let bytes = read_all(reader, &name).await?;
        let model = parse(&bytes, context)?;
        Ok(label_near_mesh(&model, settings.ambient_visibility, context))
    }
}

impl AssetSaver for TreeSaver {
    type Asset = TreeAsset;
    type Settings = ();
    type OutputLoader = TreeLoader;
    type Error = LoadTreeError;

    async fn save(
        &self,
        writer: &mut Writer,
        asset: SavedAsset<'_, '_, TreeAsset>,
        _: &(),
        path: AssetPath<'_>,
    ) -> Result<TreeLoaderSettings, LoadTreeError> {
        let written = writer.write_all(&format::encode(&asset.data)).await;
        written.map_err(|error| LoadTreeError::Io { path: path.to_string(), error })?;
        Ok(TreeLoaderSettings::default())
    }
}
