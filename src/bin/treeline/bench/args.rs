//! Options of `treeline bench`.

use super::{
    plan::Configuration,
    scenes::{SceneArg, View},
    technique,
};
use crate::options::{
    BakeOptions, ToolError, ToolResult, parse_count, parse_metres, parse_quality, parse_size,
};
use clap::{Args, ValueEnum};
use std::path::PathBuf;

/// `--camera`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum CameraArg {
    /// It stands.
    #[default]
    Still,
    /// It moves a little from frame to frame; the last frame is the still camera's.
    Flying,
}

impl CameraArg {
    pub fn view(self) -> View {
        match self {
            Self::Still => View::Still,
            Self::Flying => View::Flying,
        }
    }
}

#[derive(Args, Clone)]
#[command(after_help = after_help())]
pub struct BenchArgs {
    /// What is drawn.
    #[arg(long, value_enum, default_value = "baseline")]
    pub scene: SceneArg,
    /// The tree: a model (.glb, .gltf, .obj, .ply), a species or a species file (.ron). Default: aspen; on a landscape all
    /// species of trees.
    #[arg(long)]
    pub tree: Option<String>,
    /// Numbers of trees, with commas, such as 1k,10k,1M (1 to 10M).
    #[arg(long, value_delimiter = ',', default_value = "1k", value_parser = parse_count, allow_negative_numbers = true)]
    pub instances: Vec<u64>,
    /// Techniques with their variants, with commas (listed below).
    #[arg(long, value_delimiter = ',', default_value = "points,stock,lod")]
    pub techniques: Vec<String>,
    /// Picture size, WIDTHxHEIGHT.
    #[arg(long, default_value = "1280x720", value_parser = parse_size)]
    pub size: (u32, u32),
    /// Measured frames of a run.
    #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..=100_000), allow_negative_numbers = true)]
    pub frames: u32,
    /// Frames before the first measured one.
    #[arg(long, default_value_t = 4, value_parser = clap::value_parser!(u32).range(1..=10_000), allow_negative_numbers = true)]
    pub warm_up: u32,
    /// Seconds that the frames of a run may take: slow techniques get fewer, at least one.
    #[arg(long, default_value_t = 30.0, allow_negative_numbers = true)]
    pub seconds: f64,
    /// Runs of each configuration, each in a process of its own.
    #[arg(long, default_value_t = 2, value_parser = clap::value_parser!(u32).range(1..=100), allow_negative_numbers = true)]
    pub runs: u32,
    /// Seed of the scene.
    #[arg(long, default_value_t = 42, allow_negative_numbers = true)]
    pub seed: u64,
    /// Whether the camera moves.
    #[arg(long, value_enum, default_value = "still")]
    pub camera: CameraArg,
    /// Distances of the scene `single`, units of the model (default: d0/2, d0, 2 d0, 4 d0, 8 d0).
    #[arg(long, value_delimiter = ',', value_parser = parse_metres, allow_negative_numbers = true)]
    pub distances: Vec<f32>,
    /// Where on the flight of the landscape the last frame is, 0 to 1 (0.75: over forest, to the horizon).
    #[arg(long, default_value_t = 0.75, allow_negative_numbers = true)]
    pub at: f32,
    /// q of points: points per pixel of surface (default: the crate's).
    #[arg(long, value_parser = parse_quality, allow_negative_numbers = true)]
    pub quality: Option<f32>,
    /// What the rows say in their column `date`.
    #[arg(long, default_value = "")]
    pub date: String,
    /// Folder for results and pictures.
    #[arg(long, default_value = "out/bench")]
    pub out: PathBuf,
    /// Earlier results (results.json): says what differs from them beyond noise, and fails if something got worse.
    #[arg(long)]
    pub compare: Option<PathBuf>,
    /// Measure nothing: report of earlier results (results.json), with commas of several together.
    #[arg(long, value_delimiter = ',')]
    pub report: Vec<PathBuf>,
    /// Seconds after which a run is stopped.
    #[arg(long, default_value_t = 900.0, allow_negative_numbers = true)]
    pub time_limit: f64,
    /// Memory at which a run is stopped, MiB (default: three quarters of this machine's).
    #[arg(long)]
    pub memory_limit: Option<u64>,
    /// No image errors: no truth is rendered.
    #[arg(long)]
    pub no_truth: bool,
    /// Triangles of the largest truth that is rendered; above it there are no image errors.
    #[arg(long, default_value = "500M", value_parser = parse_count, allow_negative_numbers = true)]
    pub truth_triangles: u64,
    #[command(flatten)]
    pub bake: BakeOptions,
    /// In a process of its own: the configuration, and the folder for what was measured.
    #[arg(long, hide = true, requires = "into")]
    pub only: Option<Configuration>,
    #[arg(long, hide = true)]
    pub into: Option<PathBuf>,
}

impl BenchArgs {
    /// `--tree`, or the tree of scenes that have one.
    pub fn tree(&self) -> &str {
        self.tree.as_deref().unwrap_or("aspen")
    }
}

fn after_help() -> String {
    format!(
        "Techniques (NAME or NAME+VARIANT):\n{}\n\nEach configuration runs in a process of its own; one that fails gets a \
         row whose status says why.\nResults: results.csv, results.json, plots, pictures, report.html. \
         docs/benchmarks/README.md explains the protocol, schema.md beside it the columns.",
        technique::list()
    )
}

fn check(ok: bool, what: &str) -> ToolResult {
    if ok { Ok(()) } else { Err(ToolError::Message(what.to_owned())) }
}

/// Says what is wrong with options that clap cannot judge.
pub fn check_args(args: &BenchArgs) -> ToolResult {
    check(
        args.instances.iter().all(|n| (1..=10_000_000).contains(n)),
        "--instances must be 1 to 10M (10,000,000) each, such as 1k,10k,1M",
    )?;
    check(args.distances.iter().all(|d| *d > 0.0), "--distances must be numbers above 0")?;
    check((0.0..=1.0).contains(&args.at), "--at must be 0 to 1: a part of the way")?;
    check(args.seconds > 0.0, "--seconds must be above 0, such as 30")?;
    check(
        args.time_limit > 0.0 && args.time_limit.is_finite(),
        "--time-limit must be a number of seconds above 0",
    )?;
    check(
        args.scene != SceneArg::Single || args.camera == CameraArg::Still,
        "--scene single has a still camera",
    )?;
    args.techniques.iter().try_for_each(|name| technique::chosen(name).map(|_| ()))
}
