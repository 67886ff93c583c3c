//! Baking in the background of a running app, with progress.

use super::{
    assemble::{BakeContext, BakeError, BakeStage, Baked, bake_file, bake_model},
    loader::{NearMeshLoader, TreeLoader},
    near::{self, NearMeshSource},
    peel::gpu::GpuPeeler,
    plant::bake_species,
    settings::BakeSettings,
    source::SourceModel,
};
use crate::{
    asset::{BakeCache, CacheLocation, NearMesh, TreeAsset},
    species::Species,
};
use bevy::{
    ecs::system::SystemParam,
    prelude::*,
    render::renderer::{RenderAdapterInfo, RenderDevice, RenderQueue},
    tasks::{AsyncComputeTaskPool, Task, block_on, futures_lite::future},
};
use std::{
    collections::BTreeMap,
    path::PathBuf,
    sync::{Arc, Mutex, OnceLock},
};

/// Bakes that are running, by name of the model: stage and share of it done. Clones share the values.
#[derive(Resource, Clone, Default)]
pub struct BakeProgress(Arc<Mutex<BTreeMap<String, (BakeStage, f32)>>>);

impl BakeProgress {
    /// Every running bake.
    pub fn running(&self) -> BTreeMap<String, (BakeStage, f32)> {
        self.0.lock().unwrap_or_else(|poisoned| poisoned.into_inner()).clone()
    }

    pub(super) fn begin(&self, name: &str) -> RunningBake {
        let running = RunningBake { all: self.clone(), name: name.into() };
        running.set(BakeStage::Loading, 1.0);
        running
    }
}

/// A bake's entry, gone when it is dropped.
pub(super) struct RunningBake {
    all: BakeProgress,
    name: String,
}

impl RunningBake {
    pub fn set(&self, stage: BakeStage, done: f32) {
        let mut all = self.all.0.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        all.insert(self.name.clone(), (stage, done));
    }
}

impl Drop for RunningBake {
    fn drop(&mut self) {
        self.all.0.lock().unwrap_or_else(|poisoned| poisoned.into_inner()).remove(&self.name);
    }
}

/// The GPU of the app, for peeling.
#[derive(Clone)]
struct BakeGpu {
    device: wgpu::Device,
    queue: wgpu::Queue,
    is_software: bool,
}

/// What bakes of this app share.
#[derive(Resource, Clone)]
pub(super) struct BakeEnvironment {
    pub settings: BakeSettings,
    pub progress: BakeProgress,
    cache: Option<BakeCache>,
    gpu: Arc<OnceLock<BakeGpu>>,
    peeler: Arc<OnceLock<Option<Arc<GpuPeeler>>>>,
}

impl BakeEnvironment {
    /// The peeler is made when the first bake wants it: an app that only loads `.treeline` files needs none.
    pub fn context(&self) -> BakeContext {
        let Some(gpu) = self.gpu.get() else {
            return BakeContext { cache: self.cache.clone(), ..default() };
        };
        let peeler = self.peeler.get_or_init(|| {
            match GpuPeeler::new(gpu.device.clone(), gpu.queue.clone()) {
                Ok(peeler) => Some(Arc::new(peeler)),
                Err(error) => {
                    warn!("peeling on the CPU: {error}");
                    None
                }
            }
        });
        BakeContext {
            gpu: peeler.clone(),
            gpu_is_software: gpu.is_software,
            cache: self.cache.clone(),
        }
    }
}

struct BakeTask {
    handle: Handle<TreeAsset>,
    name: String,
    task: Task<Result<(Baked, Vec<NearMeshSource>), BakeError>>,
}

/// Bakes started by [`TreeBaker`].
#[derive(Resource, Default)]
pub struct BakeTasks {
    running: Vec<BakeTask>,
    failed: Vec<(AssetId<TreeAsset>, String)>,
}

impl BakeTasks {
    /// Bakes that are not done.
    pub fn running(&self) -> usize {
        self.running.len()
    }

    /// Why a tree will not come, if its bake failed.
    pub fn failure(&self, tree: &Handle<TreeAsset>) -> Option<&str> {
        self.failed.iter().find(|(id, _)| *id == tree.id()).map(|(_, why)| why.as_str())
    }
}

/// A bake started by [`TreeBaker`] failed.
#[derive(Message, Clone, Debug)]
pub struct BakeFailed {
    /// The tree that will not come.
    pub tree: AssetId<TreeAsset>,
    /// Why.
    pub error: String,
}

/// Starts bakes: of files outside the asset folder, and of models made by the game (see
/// [`model_of_entities`](super::model_of_entities)).
#[derive(SystemParam)]
pub struct TreeBaker<'w> {
    environment: Res<'w, BakeEnvironment>,
    tasks: ResMut<'w, BakeTasks>,
    trees: Res<'w, Assets<TreeAsset>>,
}

impl TreeBaker<'_> {
    /// The plugin's settings.
    pub fn default_settings(&self) -> BakeSettings {
        self.environment.settings.clone()
    }

    /// Reads and bakes a model file in the background. The tree appears when it is done.
    pub fn bake_file(&mut self, path: PathBuf, settings: BakeSettings) -> Handle<TreeAsset> {
        let name = path.display().to_string();
        self.start(name, move |environment, progress| {
            bake_file(&path, &settings, &environment.context(), progress)
        })
    }

    /// Bakes a model in the background. The tree appears when it is done.
    pub fn bake_model(&mut self, model: SourceModel, settings: BakeSettings) -> Handle<TreeAsset> {
        self.start(model.name.clone(), move |environment, progress| {
            bake_model(Arc::new(model), None, &settings, &environment.context(), 0.0, progress)
        })
    }

    /// Grows a plant (see [`grow`](crate::species::grow)) and bakes it in the background. The tree appears when it is done.
    pub fn bake_species(
        &mut self,
        species: Species,
        seed: u64,
        autumn: f32,
        settings: BakeSettings,
    ) -> Handle<TreeAsset> {
        self.start(species.name.clone(), move |environment, progress| {
            bake_species(&species, seed, autumn, &settings, &environment.context(), progress)
        })
    }

    fn start(
        &mut self,
        name: String,
        bake: impl FnOnce(
            &BakeEnvironment,
            &(dyn Fn(BakeStage, f32) + Sync),
        ) -> Result<Baked, BakeError>
        + Send
        + 'static,
    ) -> Handle<TreeAsset> {
        let handle = self.trees.reserve_handle();
        let environment = self.environment.clone();
        let bake_name = name.clone();
        let task = AsyncComputeTaskPool::get().spawn(async move {
            let progress = environment.progress.begin(&bake_name);
            let baked = bake(&environment, &|stage, done| progress.set(stage, done))?;
            // Here, not where it is received: it takes longer than a frame may.
            let near = near::near_mesh_sources(&baked.model, baked.data.is_shaded());
            Ok((baked, near))
        });
        self.tasks.running.push(BakeTask { handle: handle.clone(), name, task });
        handle
    }
}

fn finish_bakes(
    mut tasks: ResMut<BakeTasks>,
    mut trees: ResMut<Assets<TreeAsset>>,
    mut near_meshes: ResMut<Assets<NearMesh>>,
    mut meshes: ResMut<Assets<Mesh>>,
    mut materials: ResMut<Assets<StandardMaterial>>,
    mut images: ResMut<Assets<Image>>,
    mut failed: MessageWriter<BakeFailed>,
) {
    let tasks = &mut *tasks;
    let mut still_running = vec![];
    for mut bake in tasks.running.drain(..) {
        let Some(result) = block_on(future::poll_once(&mut bake.task)) else {
            still_running.push(bake);
            continue;
        };
        match result {
            Ok((baked, near)) => {
                let mesh = near::near_mesh(
                    near,
                    |_, image| images.add(image),
                    |_, mesh, material| (meshes.add(mesh), materials.add(material)),
                );
                let asset = TreeAsset { data: baked.data, near_mesh: Some(near_meshes.add(mesh)) };
                if let Err(error) = trees.insert(bake.handle.id(), asset) {
                    debug!("{}: nobody waits for this tree any more: {error}", bake.name);
                }
            }
            Err(error) => {
                error!("a tree is missing: {error}");
                tasks.failed.push((bake.handle.id(), error.to_string()));
                failed.write(BakeFailed { tree: bake.handle.id(), error: error.to_string() });
            }
        }
    }
    tasks.running = still_running;
}

/// Loaders and background bakes. Part of `TreelinePlugin`.
pub(crate) struct BakePlugin {
    pub cache: CacheLocation,
    pub settings: BakeSettings,
}

impl Plugin for BakePlugin {
    fn build(&self, app: &mut App) {
        let cache = match &self.cache {
            CacheLocation::Default => BakeCache::default_folder().map(BakeCache::new),
            CacheLocation::Folder(folder) => Some(BakeCache::new(folder.clone())),
            CacheLocation::Off => None,
        };
        if cache.is_none() && self.cache != CacheLocation::Off {
            warn!(
                "baked trees are not kept between runs: no cache folder is known, set TREELINE_CACHE_DIR"
            );
        }
        let progress = BakeProgress::default();
        let environment = BakeEnvironment {
            settings: self.settings.clone(),
            progress: progress.clone(),
            cache,
            gpu: default(),
            peeler: default(),
        };
        app.insert_resource(progress)
            .insert_resource(environment.clone())
            .init_resource::<BakeTasks>()
            .add_message::<BakeFailed>()
            .register_asset_loader(TreeLoader { environment })
            .register_asset_loader(NearMeshLoader)
            .add_systems(PreUpdate, finish_bakes.run_if(any_bake_runs));
    }

    fn finish(&self, app: &mut App) {
        let world = app.world();
        let (Some(device), Some(queue)) =
            (world.get_resource::<RenderDevice>(), world.get_resource::<RenderQueue>())
        else {
            return;
        };
        let is_software = world
            .get_resource::<RenderAdapterInfo>()
            .is_none_or(|info| info.device_type == wgpu::DeviceType::Cpu);
        let gpu = BakeGpu {
            device: device.wgpu_device().clone(),
            queue: (**queue.0).clone(),
            is_software,
        };
        // Set once: a second `finish` would bring the same device.
        let _ = world.resource::<BakeEnvironment>().gpu.set(gpu);
    }
}

fn any_bake_runs(tasks: Res<BakeTasks>) -> bool {
    !tasks.running.is_empty()
}
