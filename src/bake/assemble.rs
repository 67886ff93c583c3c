//! A whole bake: model → points in progressive order, by way of the cache.

use super::{
    lighting::{LightVolume, light_surfels},
    order, peel,
    peel::gpu::{GpuPeelError, GpuPeeler},
    settings::{BakeSettings, PeelBackend, SettingsError},
    source::{self, SourceError, SourceModel},
    surfels,
};
use crate::asset::{
    BakeCache, BakeSeconds, BakeStatistics, MAX_POINTS, SeenMean, SourceReference, TreeData,
};
use crate::lod::thinning::FACTOR_STEPS;
use bevy::log::{debug, info, warn};
use std::{path::Path, sync::Arc, time::Instant};

/// Where a bake is, for progress bars.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum BakeStage {
    /// Reading the model.
    Loading,
    /// Peeling layers.
    Peeling,
    /// Ordering points.
    Ordering,
    /// Finding how much light reaches each point.
    Lighting,
    /// Packing.
    Packing,
}

impl BakeStage {
    /// Lower-case name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Loading => "loading",
            Self::Peeling => "peeling",
            Self::Ordering => "ordering",
            Self::Lighting => "lighting",
            Self::Packing => "packing",
        }
    }
}

/// Called with a stage and how much of it is done, 0 to 1.
pub type Progress<'a> = &'a (dyn Fn(BakeStage, f32) + Sync);

/// What a bake uses besides its settings.
#[derive(Clone, Default)]
pub struct BakeContext {
    /// Render passes for peeling. `None`: there is no GPU.
    pub gpu: Option<Arc<GpuPeeler>>,
    /// The GPU is a software driver, so `auto` peels with the CPU twin.
    pub gpu_is_software: bool,
    /// Baked trees of earlier runs. `None`: bake always.
    pub cache: Option<BakeCache>,
}

/// Why a bake failed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BakeError {
    /// The model could not be read.
    #[error(transparent)]
    Source(#[from] SourceError),
    /// A setting is out of range.
    #[error(transparent)]
    Settings(#[from] SettingsError),
    /// Render passes were asked for.
    #[error(
        "{model}: peeling on the GPU was asked for, but there is no adapter; install a Vulkan driver or use the `cpu` or `auto` backend"
    )]
    NoGpu {
        /// Name of the model.
        model: String,
    },
    /// Render passes failed.
    #[error("{model}: peeling on the GPU failed: {error}")]
    Gpu {
        /// Name of the model.
        model: String,
        /// Why.
        #[source]
        error: GpuPeelError,
    },
    /// No surface was hit.
    #[error(
        "{model}: no LDI pixel meets the model's surface, so there are no points; raise the LDI size (it is {ldi_size})"
    )]
    NoPoints {
        /// Name of the model.
        model: String,
        /// Setting.
        ldi_size: u32,
    },
    /// More points than an index holds.
    #[error(
        "{model}: {points} points are too many for one tree (at most {most}); lower the LDI size (it is {ldi_size})"
    )]
    TooManyPoints {
        /// Name of the model.
        model: String,
        /// Found.
        points: usize,
        /// Allowed.
        most: usize,
        /// Setting.
        ldi_size: u32,
    },
}

/// A baked model.
#[derive(Clone, Debug)]
pub struct Baked {
    /// The model it was baked from.
    pub model: Arc<SourceModel>,
    /// The points.
    pub data: Arc<TreeData>,
    /// True if the cache had it.
    pub from_cache: bool,
}

/// Reads and bakes a model file, or takes it from the cache.
///
/// # Errors
/// See [`BakeError`]; every message names the file.
pub fn bake_file(
    path: &Path,
    settings: &BakeSettings,
    context: &BakeContext,
    progress: Progress,
) -> Result<Baked, BakeError> {
    settings.validate()?;
    progress(BakeStage::Loading, 0.0);
    let start = Instant::now();
    let model = source::load_model(path)?;
    let loading = start.elapsed().as_secs_f64();
    progress(BakeStage::Loading, 1.0);
    let reference = path.to_string_lossy().replace('\\', "/");
    bake_model(Arc::new(model), Some(reference), settings, context, loading, progress)
}

/// Bakes a model that was read in `loading` seconds from `reference` (a path to keep in the asset), or takes it from
/// the cache. Models that are not from a file are not cached.
///
/// # Errors
/// See [`BakeError`].
pub fn bake_model(
    model: Arc<SourceModel>,
    reference: Option<String>,
    settings: &BakeSettings,
    context: &BakeContext,
    loading: f64,
    progress: Progress,
) -> Result<Baked, BakeError> {
    settings.validate()?;
    for warning in &model.warnings {
        warn!("{}: {warning}", model.name);
    }
    let source = reference.map(|path| SourceReference { path, content_hash: model.content_hash });
    let from_file = model.content_hash != [0; 32];
    let cache = context.cache.as_ref().filter(|_| from_file);
    let key =
        BakeCache::key(&model.content_hash, &serde_json::to_string(settings).unwrap_or_default());
    if let Some(mut data) = cache.and_then(|cache| cache.get(&key)) {
        debug!("{}: taken from the cache", model.name);
        data.source = source;
        progress(BakeStage::Packing, 1.0);
        return Ok(Baked { model, data: Arc::new(data), from_cache: true });
    }
    let mut data = bake(&model, settings, context, loading, progress)?;
    data.source = source;
    if let Some(cache) = cache
        && let Err(error) = cache.put(&key, &data)
    {
        warn!("{}: the baked tree is not kept for the next start: {error}", model.name);
    }
    Ok(Baked { model, data: Arc::new(data), from_cache: false })
}

fn peel_model(
    model: &SourceModel,
    viewports: &[peel::LdiViewport],
    settings: &BakeSettings,
    context: &BakeContext,
    progress: &(dyn Fn(f32) + Sync),
) -> Result<(peel::PeelOutput, String), BakeError> {
    let gpu = match (settings.backend, &context.gpu) {
        (PeelBackend::Gpu, None) => return Err(BakeError::NoGpu { model: model.name.clone() }),
        (PeelBackend::Cpu, _) | (PeelBackend::Auto, None) => None,
        (PeelBackend::Auto, Some(_)) if context.gpu_is_software => None,
        (_, Some(gpu)) => Some(gpu),
    };
    if let Some(gpu) = gpu {
        match gpu.peel(model, viewports, settings, progress) {
            Ok(output) => return Ok((output, "gpu".into())),
            Err(error) if settings.backend == PeelBackend::Gpu => {
                return Err(BakeError::Gpu { model: model.name.clone(), error });
            }
            Err(error) => warn!("{}: peeling on the CPU instead: {error}", model.name),
        }
    }
    Ok((peel::cpu::peel(model, viewports, settings, progress), "cpu".into()))
}

fn bake(
    model: &SourceModel,
    settings: &BakeSettings,
    context: &BakeContext,
    loading: f64,
    progress: Progress,
) -> Result<TreeData, BakeError> {
    let bounds = model.bounds();
    let directions = peel::directions(settings.directions);
    let viewports = peel::viewports(&bounds, settings.ldi_size, &directions);

    let start = Instant::now();
    let (output, backend) = peel_model(model, &viewports, settings, context, &|done| {
        progress(BakeStage::Peeling, done)
    })?;
    let peeling = start.elapsed().as_secs_f64();
    let left_over: u64 = output.left_over.iter().sum();
    let mut warnings = model.warnings.clone();
    if left_over > 0 {
        let warning = format!(
            "{left_over} fragments lie behind layer {} and are lost; raise the maximum of layers",
            settings.max_layers
        );
        warn!("{}: {warning}", model.name);
        warnings.push(warning);
    }
    let points = output.samples.len();
    if points == 0 {
        return Err(BakeError::NoPoints { model: model.name.clone(), ldi_size: settings.ldi_size });
    }
    if points > MAX_POINTS as usize {
        let most = MAX_POINTS as usize;
        return Err(BakeError::TooManyPoints {
            model: model.name.clone(),
            points,
            most,
            ldi_size: settings.ldi_size,
        });
    }

    let ordering_start = Instant::now();
    let permutation = order::order(&output.samples, settings.order, settings.seed, &|done| {
        progress(BakeStage::Ordering, done);
    });
    let ordering = ordering_start.elapsed().as_secs_f64();

    let mut all = surfels::surfels(model, &output);
    if settings.ambient_visibility {
        let light = LightVolume::of_model(model, &|done| progress(BakeStage::Lighting, 0.8 * done));
        light_surfels(&mut all, &light);
        progress(BakeStage::Lighting, 1.0);
    }
    progress(BakeStage::Packing, 0.0);
    let surface_area = surfels::sample_area(&output, &directions) as f32;
    let (hot, cold) = permutation.iter().map(|&i| all[i as usize].pack(&bounds)).unzip();
    let total = loading + start.elapsed().as_secs_f64();
    info!("{}: {points} points in {total:.2} s ({backend})", model.name);
    progress(BakeStage::Packing, 1.0);
    let tree = TreeData {
        bounds,
        pixel: viewports[0].pixel,
        surface_area,
        mean_leaf_area: model.mean_leaf_area(),
        area_factors: [1.0; FACTOR_STEPS],
        light_factors: [1.0; FACTOR_STEPS],
        seen_mean: SeenMean::default(),
        hot,
        cold,
        source: None,
        statistics: BakeStatistics {
            triangles: model.triangle_count() as u64,
            ldi_size: settings.ldi_size,
            layers: output.layers,
            fragments: output.fragments,
            left_over,
            backend,
            order: serde_json::to_value(settings.order)
                .ok()
                .and_then(|v| v.as_str().map(str::to_owned))
                .unwrap_or_default(),
            seed: settings.seed,
            seconds: BakeSeconds { loading, peeling, ordering, total }.to_microseconds(),
            warnings,
        },
    };
    Ok(tree.with_factors())
}
