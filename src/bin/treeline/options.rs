//! Options and errors that several commands share.

use bevy::log::tracing_subscriber::{self, util::SubscriberInitExt};
use bevy_treeline::{
    BakeSettings, SplatPath, SplatShape,
    asset::BakeCache,
    bake::{
        BakeContext, BakeError, BakeStage, Baked, OrderMethod, PeelBackend, bake_file,
        peel::gpu::GpuPeeler,
    },
    gpu::headless::headless_device,
};
use clap::{Args, ValueEnum};
use indicatif::{ProgressBar, ProgressStyle};
use std::{
    io::{self, Write},
    path::{Path, PathBuf},
    sync::Arc,
};

/// What a command ends with if it fails: a sentence for the user.
#[derive(Debug, thiserror::Error)]
pub enum ToolError {
    #[error(transparent)]
    Bake(#[from] BakeError),
    #[error(transparent)]
    File(#[from] bevy_treeline::asset::FileError),
    #[error(transparent)]
    Species(#[from] bevy_treeline::species::SpeciesError),
    #[error(
        "cannot write {path}: {error}; choose another folder with --out, or make this one writable"
    )]
    Write { path: String, error: String },
    #[error("there is no GPU: {0}")]
    NoGpu(String),
    #[error("{0}")]
    Message(String),
}

impl ToolError {
    pub fn write(path: &Path, error: impl ToString) -> Self {
        Self::Write { path: path.display().to_string(), error: error.to_string() }
    }
}

pub type ToolResult<T = ()> = Result<T, ToolError>;

#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum OrderArg {
    Random,
    FarthestPoint,
    BlueNoise,
    Lattice,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum PeelArg {
    Auto,
    Gpu,
    Cpu,
}

#[derive(Clone, Copy, Debug, Default, ValueEnum)]
pub enum SplatPathArg {
    #[default]
    Auto,
    U64,
    U32,
}

#[derive(Clone, Copy, Debug, Default, ValueEnum)]
pub enum SplatArg {
    #[default]
    Cells,
    Discs,
    Squares,
}

impl From<SplatArg> for SplatShape {
    fn from(arg: SplatArg) -> Self {
        match arg {
            SplatArg::Cells => Self::Cells,
            SplatArg::Discs => Self::Discs,
            SplatArg::Squares => Self::Squares,
        }
    }
}

impl From<SplatPathArg> for SplatPath {
    fn from(arg: SplatPathArg) -> Self {
        match arg {
            SplatPathArg::Auto => Self::Auto,
            SplatPathArg::U64 => Self::U64,
            SplatPathArg::U32 => Self::U32,
        }
    }
}

/// How to bake.
#[derive(Args, Clone, Debug)]
pub struct BakeOptions {
    /// Longest side of a layered depth image, in pixels (1 to 16384).
    #[arg(long = "ldi", default_value_t = 512, allow_negative_numbers = true, value_parser = clap::value_parser!(u32).range(1..=16384))]
    pub ldi: u32,
    /// Peeling directions (3 to 64).
    #[arg(long, default_value_t = 3, allow_negative_numbers = true, value_parser = clap::value_parser!(u32).range(3..=64))]
    pub directions: u32,
    /// Layers per direction at most (1 to 4096).
    #[arg(long, default_value_t = 256, allow_negative_numbers = true, value_parser = clap::value_parser!(u32).range(1..=4096))]
    pub max_layers: u32,
    /// Give each direction only the triangles most perpendicular to it.
    #[arg(long)]
    pub partition: bool,
    /// Order of the points.
    #[arg(long, value_enum, default_value = "lattice")]
    pub order: OrderArg,
    /// Who peels; `auto` takes the GPU unless it is a software driver.
    #[arg(long, value_enum, default_value = "auto")]
    pub peel: PeelArg,
    /// Seed of the order.
    #[arg(long = "bake-seed", default_value_t = 1)]
    pub bake_seed: u64,
    /// Leave out how much light the tree takes from itself: crowns without depth.
    #[arg(long)]
    pub flat_light: bool,
    /// Folder of baked trees of earlier runs (default: the user's cache folder).
    #[arg(long)]
    pub cache: Option<PathBuf>,
    /// Neither read nor write the cache.
    #[arg(long)]
    pub no_cache: bool,
}

impl BakeOptions {
    pub fn settings(&self) -> BakeSettings {
        BakeSettings {
            ldi_size: self.ldi,
            directions: self.directions,
            max_layers: self.max_layers,
            partition_triangles: self.partition,
            order: match self.order {
                OrderArg::Random => OrderMethod::Random,
                OrderArg::FarthestPoint => OrderMethod::FarthestPoint,
                OrderArg::BlueNoise => OrderMethod::BlueNoise,
                OrderArg::Lattice => OrderMethod::Lattice,
            },
            seed: self.bake_seed,
            ambient_visibility: !self.flat_light,
            backend: match self.peel {
                PeelArg::Auto => PeelBackend::Auto,
                PeelArg::Gpu => PeelBackend::Gpu,
                PeelArg::Cpu => PeelBackend::Cpu,
            },
        }
    }

    /// Cache and GPU. A GPU that cannot be had is an error only if it was asked for.
    pub fn context(&self) -> ToolResult<BakeContext> {
        let folder = self.cache.clone().or_else(BakeCache::default_folder);
        let cache = folder.filter(|_| !self.no_cache).map(BakeCache::new);
        let mut context = BakeContext { cache, ..Default::default() };
        if matches!(self.peel, PeelArg::Cpu) {
            return Ok(context);
        }
        let asked = matches!(self.peel, PeelArg::Gpu);
        match headless_device() {
            Ok((adapter, device, queue)) => {
                context.gpu_is_software = adapter.get_info().device_type == wgpu::DeviceType::Cpu;
                match GpuPeeler::new(device, queue) {
                    Ok(peeler) => context.gpu = Some(Arc::new(peeler)),
                    Err(error) if asked => return Err(ToolError::NoGpu(error.to_string())),
                    Err(error) => eprintln!("peeling on the CPU: {error}"),
                }
            }
            Err(error) if asked => return Err(ToolError::NoGpu(error.to_string())),
            Err(error) => eprintln!("peeling on the CPU: {error}"),
        }
        Ok(context)
    }
}

/// Bakes a model file with a progress bar on standard error.
pub fn bake_with_progress(
    path: &Path,
    settings: &BakeSettings,
    context: &BakeContext,
) -> ToolResult<Baked> {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    with_progress(&name, |progress| bake_file(path, settings, context, progress))
}

/// Runs a bake with a progress bar on standard error.
pub fn with_progress(
    name: &str,
    bake: impl FnOnce(&(dyn Fn(BakeStage, f32) + Sync)) -> Result<Baked, BakeError>,
) -> ToolResult<Baked> {
    let bar = ProgressBar::new(1000);
    let style = ProgressStyle::with_template("{prefix:>24} {bar:30} {msg:9} {elapsed}");
    bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
    bar.set_prefix(name.to_owned());
    let progress = |stage: BakeStage, done: f32| {
        let (from, share) = match stage {
            BakeStage::Loading => (0.0, 0.15),
            BakeStage::Peeling => (0.15, 0.5),
            BakeStage::Ordering => (0.65, 0.25),
            BakeStage::Lighting => (0.9, 0.05),
            BakeStage::Packing => (0.95, 0.05),
        };
        bar.set_message(stage.name());
        bar.set_position(((from + share * done) * 1000.0) as u64);
    };
    let beside_bar = bar.clone();
    // The library's warnings: no app and so no logger runs yet.
    let warnings = tracing_subscriber::fmt()
        .with_max_level(bevy::log::Level::WARN)
        .with_target(false)
        .without_time()
        .with_ansi(false)
        .with_writer(move || BesideBar(beside_bar.clone()))
        .set_default();
    let baked = bake(&progress);
    drop(warnings);
    bar.finish_and_clear();
    Ok(baked?)
}

/// Standard error, with the progress bar out of the way.
struct BesideBar(ProgressBar);

impl Write for BesideBar {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.suspend(|| io::stderr().write(bytes))
    }

    fn flush(&mut self) -> io::Result<()> {
        io::stderr().flush()
    }
}

/// Makes a folder for output.
pub fn make_folder(path: &Path) -> ToolResult {
    std::fs::create_dir_all(path).map_err(|error| ToolError::write(path, error))
}

/// Writes a whole file or nothing: to a temporary beside it, then renamed.
pub fn write_file(path: &Path, bytes: &[u8]) -> ToolResult {
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    make_folder(folder)?;
    let mut builder = tempfile::Builder::new();
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        // Less the user's umask, as for any new file; a temporary one would be private.
        builder.permissions(std::fs::Permissions::from_mode(0o666));
    }
    let write = || -> io::Result<()> {
        let mut file = builder.tempfile_in(folder)?;
        file.write_all(bytes)?;
        file.persist(path).map_err(|e| e.error)?;
        Ok(())
    };
    write().map_err(|error| ToolError::write(path, error))
}

/// Writes a PNG, whole or not at all.
pub fn write_png(path: &Path, image: &image::RgbaImage) -> ToolResult {
    let mut bytes = std::io::Cursor::new(vec![]);
    image
        .write_to(&mut bytes, image::ImageFormat::Png)
        .map_err(|error| ToolError::write(path, error))?;
    write_file(path, bytes.get_ref())
}

/// Parses `--quality`.
pub fn parse_quality(text: &str) -> Result<f32, String> {
    match text.trim().parse() {
        Ok(quality) if (0.05..=16.0).contains(&quality) => Ok(quality),
        _ => Err("write a number from 0.05 to 16, such as 2".into()),
    }
}

/// Parses `WxH`, both 1 to 8192.
pub fn parse_size(text: &str) -> Result<(u32, u32), String> {
    let parts = text.split_once(['x', 'X', '×']).map(|(w, h)| (w.trim().parse(), h.trim().parse()));
    match parts {
        Some((Ok(w), Ok(h))) if (1..=8192).contains(&w) && (1..=8192).contains(&h) => Ok((w, h)),
        _ => Err(format!(
            "`{text}` is not a size; write WIDTHxHEIGHT in pixels, each 1 to 8192, such as 1280x720"
        )),
    }
}

/// Parses a count such as `4000`, `250k` or `1.5M`.
pub fn parse_count(text: &str) -> Result<u64, String> {
    let text = text.trim();
    let (digits, factor) = match text.char_indices().last() {
        Some((i, 'k' | 'K')) => (&text[..i], 1e3),
        Some((i, 'm' | 'M')) => (&text[..i], 1e6),
        _ => (text, 1.0),
    };
    match digits.replace('_', "").parse::<f64>() {
        Ok(number) if number >= 0.0 && number * factor <= 1e12 => {
            Ok((number * factor).round() as u64)
        }
        _ => Err("write a count such as 4000, 250k or 1M".into()),
    }
}

/// Parses a length such as `800`, `800m` or `16km`, in metres.
pub fn parse_metres(text: &str) -> Result<f32, String> {
    let text = text.trim();
    let (digits, factor) = if let Some(digits) = text.strip_suffix("km") {
        (digits, 1000.0)
    } else {
        (text.strip_suffix('m').unwrap_or(text), 1.0)
    };
    match digits.trim().parse::<f32>() {
        Ok(number) if number.is_finite() && number >= 0.0 => Ok(number * factor),
        _ => Err("write a length such as 800m or 16km".into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_and_lengths_are_read_with_their_units() {
        assert_eq!(parse_count("1M"), Ok(1_000_000));
        assert_eq!(parse_count("2.5k"), Ok(2_500));
        assert_eq!(parse_count(" 40_000 "), Ok(40_000));
        assert!(
            parse_count("-3").is_err() && parse_count("many").is_err() && parse_count("").is_err()
        );
        assert_eq!(parse_metres("16km"), Ok(16_000.0));
        assert_eq!(parse_metres("250 m"), Ok(250.0));
        assert_eq!(parse_metres("90"), Ok(90.0));
        assert!(parse_metres("far").is_err() && parse_metres("-1km").is_err());
    }
}
