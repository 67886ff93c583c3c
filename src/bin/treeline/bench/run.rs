//! All configurations, round by round: processes started, their rows gathered, pictures held against the truth.

use super::{
    args::BenchArgs,
    child,
    errors::{self, Shot},
    machine::Machine,
    plan::Configuration,
    process::{self, Limits},
    publish,
    row::{Results, Row, SCHEMA},
    scenes::{self, SceneArg, landscape},
    stats::merge_runs,
    table::write_json,
    technique,
    tree::Tree,
    truth::{self, TRUTH, TruthFiles},
};
use crate::options::{ToolError, ToolResult, make_folder, write_png};
use indicatif::{ProgressBar, ProgressStyle};
use std::{
    collections::BTreeSet,
    ffi::OsString,
    path::{Path, PathBuf},
    time::Duration,
};

/// Results of a benchmark that is not done, without image errors, in its folder: what remains if it is stopped.
pub const UNFINISHED: &str = "unfinished.json";

/// A benchmark at work.
pub struct Bench<'a> {
    pub args: &'a BenchArgs,
    pub machine: Machine,
    pub tree: Tree,
    /// For files that pass between processes.
    pub work: &'a Path,
}

impl Bench<'_> {
    /// Rows and all that is said beside them.
    pub fn results(&self, rows: Vec<Row>) -> Results {
        let command = std::env::args().collect::<Vec<_>>().join(" ");
        Results { schema: SCHEMA, machine: self.machine.facts(), command, rows }
    }

    /// A row of medians for each configuration. What is measured so far is kept in [`UNFINISHED`].
    pub fn measure(&self, configurations: &[Configuration]) -> ToolResult<Vec<Row>> {
        let runs = self.args.runs;
        let mut all: Vec<Vec<Row>> = vec![vec![]; configurations.len()];
        let bar = ProgressBar::new(u64::from(runs) * configurations.len() as u64);
        let style = ProgressStyle::with_template("{bar:30} {pos}/{len} {elapsed}  {msg}");
        bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
        for _ in 0..runs {
            for (i, configuration) in configurations.iter().enumerate() {
                bar.set_message(format!(
                    "{} × {}",
                    configuration.technique, configuration.instances
                ));
                bar.tick();
                // What failed once is not tried again: it took its time limit, or would fail the same way.
                if all[i].last().is_none_or(|row| row.ran()) {
                    let row = self.one(configuration)?;
                    bar.suspend(|| say(&row));
                    all[i].push(row);
                    let rows = all.iter().filter(|rows| !rows.is_empty());
                    let so_far = self.results(rows.map(|rows| merge_runs(rows)).collect());
                    write_json(&self.args.out.join(UNFINISHED), &so_far)?;
                }
                bar.inc(1);
            }
        }
        bar.finish_and_clear();
        Ok(all.iter().map(|rows| merge_runs(rows)).collect())
    }

    fn folder(&self, configuration: &Configuration) -> PathBuf {
        self.work.join(configuration.file_stem())
    }

    /// One run.
    fn one(&self, configuration: &Configuration) -> ToolResult<Row> {
        let folder = self.folder(configuration);
        make_folder(&folder)?;
        let technique = technique::chosen(&configuration.technique)?;
        let mut row = match technique.can_run(self.args.scene, self.machine.features) {
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
        row.species = match self.args.scene {
            SceneArg::Landscape => landscape::species(self.args).join("+"),
            _ => self.tree.name.clone(),
        };
        row.camera = configuration.camera();
        if self.args.scene != SceneArg::Landscape {
            row.source_triangles = Some(self.tree.triangles());
        }
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
    pub fn hold_against_truth(
        &self,
        configurations: &[Configuration],
        mut rows: Vec<Row>,
    ) -> ToolResult<Vec<Row>> {
        let single = self.args.scene == SceneArg::Single;
        let mut said = BTreeSet::new();
        for (configuration, row) in configurations.iter().zip(&mut rows) {
            if !row.ran() {
                continue;
            }
            let folder = self.folder(configuration);
            let shot = Shot::read(&folder.join(child::PICTURE), &folder.join(child::COVER))?;
            write_png(&self.picture_file(configuration, ""), &shot.picture)?;
            let files = match self.truth(configuration)? {
                Ok(files) => files,
                Err(reason) => {
                    // Once for all techniques.
                    if said.insert(reason.clone()) {
                        eprintln!("no image errors at {}", reason);
                    }
                    continue;
                }
            };
            let truth = Shot::read(&files.picture, &files.cover)?;
            let scene = scenes::scene(self.args, configuration, &self.tree)?;
            let below = scene.first_row_below(self.args.size.1);
            let map = errors::fill(&shot, &truth, single, below, row)?;
            write_png(&self.picture_file(configuration, "_error"), &map)?;
            let of_truth = Configuration { technique: TRUTH.into(), ..configuration.clone() };
            write_png(&self.picture_file(&of_truth, ""), &truth.picture)?;
        }
        Ok(rows)
    }

    fn picture_file(&self, configuration: &Configuration, ending: &str) -> PathBuf {
        let name = format!("{}{ending}.png", configuration.file_stem());
        self.args.out.join(publish::PICTURES).join(name)
    }

    /// The truth of a configuration, rendered if it is not kept yet; or why there is none.
    fn truth(&self, configuration: &Configuration) -> ToolResult<Result<TruthFiles, String>> {
        if self.args.no_truth {
            return Ok(Err("any number of trees: --no-truth".into()));
        }
        if let Some(reason) = truth::unknown(self.args, configuration, &self.tree) {
            return Ok(Err(reason));
        }
        let scene = scenes::scene(self.args, configuration, &self.tree)?;
        let files = TruthFiles::of(self.args, configuration, &*scene, &self.tree);
        if !files.exist() {
            let truth = Configuration { technique: TRUTH.into(), ..configuration.clone() };
            let folder = self.folder(&truth);
            make_folder(&folder)?;
            if let Err(reason) = self.start(&truth, &folder, true) {
                return Ok(Err(format!("{} trees: the truth {reason}", configuration.instances)));
            }
        }
        Ok(Ok(files))
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
