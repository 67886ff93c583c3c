//! `treeline bench`: what techniques cost on one scene, and how far their pictures are from the truth.
//!
//! In: a scene, a tree, counts and techniques. Each configuration (`plan`) runs in a process of its own (`process`, `child`),
//! round by round, so that a slow hour of the machine meets all of them. Out: a row of medians for each (`row`, `stats`),
//! pictures, error maps (`truth`, `errors`), tables and a report.
//!
//! `scenes` says what is drawn, `technique` who draws it; both have one file each and a trait.

mod child;
mod compare_runs;
mod errors;
mod format;
mod machine;
mod measure;
mod plan;
mod plot;
mod process;
mod publish;
mod report;
mod row;
#[cfg(test)]
mod sample;
mod scenario;
mod scenes;
mod stand;
mod stats;
mod table;
mod technique;
mod tree;
mod truth;

use crate::options::{
    BakeOptions, ToolError, ToolResult, make_folder, parse_count, parse_metres, parse_quality,
    parse_size, write_png,
};
use clap::{Args, ValueEnum};
use errors::Shot;
use indicatif::{ProgressBar, ProgressStyle};
use machine::Machine;
use plan::Configuration;
use process::Limits;
use row::{Results, Row, SCHEMA};
use scenes::{SceneArg, View};
use std::{
    ffi::OsString,
    path::{Path, PathBuf},
    time::Duration,
};
use tree::Tree;
use truth::TruthFiles;

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
    fn view(self) -> View {
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
    /// The tree: a model (.glb, .gltf, .obj, .ply), a species or a species file (.ron).
    #[arg(long, default_value = "aspen")]
    pub tree: String,
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
    only: Option<Configuration>,
    #[arg(long, hide = true)]
    into: Option<PathBuf>,
}

fn after_help() -> String {
    format!(
        "Techniques (NAME or NAME+VARIANT):\n{}\n\nEach configuration runs in a process of its own; one that fails gets a row whose \
         status says why.\nResults: results.csv, results.json, plots, pictures, report.html. docs/benchmarks/README.md explains the protocol, schema.md beside it \
         the columns.",
        technique::list()
    )
}

/// Name of the truth among techniques, for its process.
const TRUTH: &str = "truth";

fn check(ok: bool, what: &str) -> ToolResult {
    if ok { Ok(()) } else { Err(ToolError::Message(what.to_owned())) }
}

fn check_args(args: &BenchArgs) -> ToolResult {
    check(
        args.instances.iter().all(|n| (1..=10_000_000).contains(n)),
        "--instances must be 1 to 10M (10,000,000) each, such as 1k,10k,1M",
    )?;
    check(args.distances.iter().all(|d| *d > 0.0), "--distances must be numbers above 0")?;
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

pub fn run(args: &BenchArgs) -> ToolResult {
    if let (Some(configuration), Some(folder)) = (&args.only, &args.into) {
        return if configuration.technique == TRUTH {
            truth::render(args, configuration)
        } else {
            child::run(args, configuration, folder)
        };
    }
    let old = match &args.compare {
        Some(path) => Some((path, table::read_results(path)?)),
        None => None,
    };
    if !args.report.is_empty() {
        let results = publish::publish_again(&args.report, &args.out)?;
        println!("results.csv, results.json, plots, report.html in {}", args.out.display());
        return old.map_or(Ok(()), |(path, old)| publish::compare_with(path, &old, &results));
    }
    check_args(args)?;
    // What cannot be done is said before anything takes minutes.
    let machine = Machine::find()?;
    let tree = Tree::load(&args.tree)?;
    let work =
        tempfile::tempdir().map_err(|error| ToolError::write(&std::env::temp_dir(), error))?;
    make_folder(&args.out)?;
    let distances = if args.scene == SceneArg::Single && args.distances.is_empty() {
        let d0 =
            bevy_treeline::lod::prefix_count::d0(tree.bake(args)?.data.pixel, crate::subject::z0());
        [0.5, 1.0, 2.0, 4.0, 8.0].map(|k: f32| (k * d0 * 100.0).round() / 100.0).to_vec()
    } else {
        args.distances.clone()
    };
    let bench = Bench { args, machine, tree, work: work.path() };
    let configurations = plan::configurations(args, &distances);
    let rows = bench.measure(&configurations)?;
    let rows = bench.with_errors(&configurations, rows)?;
    let command = std::env::args().collect::<Vec<_>>().join(" ");
    let results = Results { schema: SCHEMA, machine: bench.machine.facts(), command, rows };
    publish::publish(&args.out, &results, &publish::pictures(&args.out, &results.rows))?;
    print(&results);
    println!("results.csv, results.json, plots, pictures, report.html in {}", args.out.display());
    if !results.rows.iter().any(Row::ran) {
        return Err(ToolError::Message(
            "no configuration could be measured; the column `status` says why".into(),
        ));
    }
    old.map_or(Ok(()), |(path, old)| publish::compare_with(path, &old, &results))
}

/// A benchmark at work.
struct Bench<'a> {
    args: &'a BenchArgs,
    machine: Machine,
    tree: Tree,
    /// For files that pass between processes.
    work: &'a Path,
}

impl Bench<'_> {
    /// A row of medians for each configuration.
    fn measure(&self, configurations: &[Configuration]) -> ToolResult<Vec<Row>> {
        let runs = self.args.runs;
        let mut all: Vec<Vec<Row>> = vec![vec![]; configurations.len()];
        let bar = ProgressBar::new(u64::from(runs) * configurations.len() as u64);
        let style = ProgressStyle::with_template("{bar:30} {pos}/{len} {elapsed}  {msg}");
        bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
        for _ in 0..runs {
            for (configuration, rows) in configurations.iter().zip(&mut all) {
                bar.set_message(format!(
                    "{} × {}",
                    configuration.technique, configuration.instances
                ));
                bar.tick();
                // What failed once is not tried again: it took its time limit, or would fail the same way.
                if rows.last().is_none_or(Row::ran) {
                    let row = self.one(configuration)?;
                    bar.suspend(|| say(&row));
                    rows.push(row);
                }
                bar.inc(1);
            }
        }
        bar.finish_and_clear();
        Ok(all.iter().map(|rows| stats::merge_runs(rows)).collect())
    }

    fn folder(&self, configuration: &Configuration) -> PathBuf {
        self.work.join(configuration.file_stem())
    }

    /// One run.
    fn one(&self, configuration: &Configuration) -> ToolResult<Row> {
        let folder = self.folder(configuration);
        make_folder(&folder)?;
        let technique = technique::chosen(&configuration.technique)?;
        let mut row = match technique.can_run(self.machine.features) {
            Err(reason) => Row { status: reason, ..Row::default() },
            Ok(()) => match self.start(configuration, &folder, false) {
                Err(reason) => Row { status: reason, ..Row::default() },
                Ok(()) => {
                    let path = folder.join(child::ROW);
                    let unreadable = |error: &dyn std::fmt::Display| {
                        ToolError::Message(format!("cannot read {}: {error}", path.display()))
                    };
                    let text = std::fs::read(&path).map_err(|error| unreadable(&error))?;
                    serde_json::from_slice(&text).map_err(|error| unreadable(&error))?
                }
            },
        };
        self.machine.sign(&mut row);
        row.date = self.args.date.clone();
        row.size = format!("{}x{}", self.args.size.0, self.args.size.1);
        row.scene = self.args.scene.name().to_owned();
        row.seed = self.args.seed;
        row.technique = configuration.technique.clone();
        row.instances = configuration.instances;
        row.species = self.tree.name.clone();
        row.camera = configuration.camera();
        row.source_triangles = Some(self.tree.triangles());
        row.runs = 1;
        Ok(row)
    }

    /// Runs a configuration in a process of its own.
    fn start(
        &self,
        configuration: &Configuration,
        folder: &Path,
        show: bool,
    ) -> Result<(), String> {
        let only = configuration.to_string();
        let own = [OsString::from("--only"), only.into(), "--into".into(), folder.into()];
        let arguments = std::env::args_os().skip(1).chain(own);
        let memory = process::memory_mib().map_or(u64::MAX, |mib| mib * 3 / 4);
        let limits = Limits {
            time: Duration::from_secs_f64(self.args.time_limit),
            memory_mib: self.args.memory_limit.unwrap_or(memory),
        };
        process::run(arguments, folder, limits, show)
    }

    /// Adds image errors and writes pictures, from what the last runs left.
    fn with_errors(
        &self,
        configurations: &[Configuration],
        mut rows: Vec<Row>,
    ) -> ToolResult<Vec<Row>> {
        let pictures = self.args.out.join(publish::PICTURES);
        for (configuration, row) in configurations.iter().zip(&mut rows) {
            if !row.ran() {
                continue;
            }
            let folder = self.folder(configuration);
            let shot = Shot::read(&folder.join(child::PICTURE), &folder.join(child::COVER))?;
            let stem = configuration.file_stem();
            write_png(&pictures.join(format!("{stem}.png")), &shot.picture)?;
            let Some(files) = self.truth(configuration)? else { continue };
            let truth = Shot::read(&files.picture, &files.cover)?;
            let scene = scenes::scene(self.args, configuration, &self.tree);
            let below = scene.first_row_below(self.args.size.1);
            let map = errors::fill(&shot, &truth, self.args.scene == SceneArg::Single, below, row)?;
            write_png(&pictures.join(format!("{stem}_error.png")), &map)?;
            let truth_stem =
                Configuration { technique: TRUTH.into(), ..configuration.clone() }.file_stem();
            write_png(&pictures.join(format!("{truth_stem}.png")), &truth.picture)?;
        }
        Ok(rows)
    }

    /// The truth of a configuration, rendered if it is not kept yet; none if it would take too much.
    fn truth(&self, configuration: &Configuration) -> ToolResult<Option<TruthFiles>> {
        if self.args.no_truth {
            return Ok(None);
        }
        if let Some(reason) = truth::too_large(self.args, configuration, &self.tree) {
            eprintln!("{reason}");
            return Ok(None);
        }
        let scene = scenes::scene(self.args, configuration, &self.tree);
        let files = TruthFiles::of(self.args, configuration, &*scene, &self.tree);
        if !files.exist() {
            let truth = Configuration { technique: TRUTH.into(), ..configuration.clone() };
            let folder = self.folder(&truth);
            make_folder(&folder)?;
            if let Err(reason) = self.start(&truth, &folder, true) {
                eprintln!(
                    "no image errors at {} trees: the truth {reason}",
                    configuration.instances
                );
                return Ok(None);
            }
        }
        Ok(Some(files))
    }
}

/// One line about a run.
fn say(row: &Row) {
    if row.ran() {
        eprintln!(
            "{} × {}: {:.0} ms, {:.2} CPU-s a frame",
            row.technique,
            row.instances,
            row.frame_ms.unwrap_or(f64::NAN),
            row.cpu_s_per_frame.unwrap_or(f64::NAN)
        );
    } else {
        eprintln!("{} × {}: {}", row.technique, row.instances, row.status);
    }
}

/// The figures that most ask for, as a table.
fn print(results: &Results) {
    println!(
        "{:24} {:>9} {:14} {:>9} {:>8} {:>8} {:>8} {:>8} {:>9}",
        "technique",
        "instances",
        "camera",
        "frame ms",
        "CPU-s",
        "main ms",
        "FLIP",
        "block",
        "RSS MiB"
    );
    for row in &results.rows {
        if !row.ran() {
            println!("{:24} {:>9} {:14} {}", row.technique, row.instances, row.camera, row.status);
            continue;
        }
        let figure = |value: Option<f64>, digits: usize| {
            value.map_or("-".into(), |v| format!("{v:.digits$}"))
        };
        println!(
            "{:24} {:>9} {:14} {:>9} {:>8} {:>8} {:>8} {:>8} {:>9}",
            row.technique,
            row.instances,
            row.camera,
            figure(row.frame_ms, 1),
            figure(row.cpu_s_per_frame, 3),
            figure(row.main_thread_ms, 2),
            figure(row.flip_mean, 4),
            figure(row.block_rmse, 4),
            figure(row.rss_mb, 0)
        );
    }
}
