//! `treeline bench`: what techniques cost on one scene, and how far their pictures are from the truth.
//!
//! In: a scene, a tree, counts and techniques. Each configuration (`plan`) runs in a process of its own (`process`, `child`),
//! round by round (`run`), so that a slow hour of the machine meets all of them. Out: a row of medians for each (`row`,
//! `stats`), pictures and error maps (`truth`, `errors`), tables, plots and a report (`publish`: `table`, `plot`,
//! `report`), and what differs from earlier results (`compare_runs`).
//!
//! `scenes` says what is drawn, `technique` who draws it; both are a trait with a file for each that implements it.

mod args;
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
mod run;
#[cfg(test)]
mod sample;
mod scenario;
mod scenes;
mod stand;
mod stats;
mod table;
mod technique;
mod terminal;
mod tree;
mod truth;

pub use args::BenchArgs;

use crate::options::{ToolError, ToolResult, make_folder};
use machine::Machine;
use run::{Bench, UNFINISHED};
use scenes::{SceneArg, landscape::Landscape};
use tree::Tree;
use truth::TRUTH;

pub fn run(args: &BenchArgs) -> ToolResult {
    if let (Some(configuration), Some(folder)) = (&args.only, &args.into) {
        return if configuration.technique == TRUTH {
            truth::render(args, configuration)
        } else {
            child::run(args, configuration, folder)
        };
    }
    // What cannot be done is said before anything takes minutes.
    args::check_args(args)?;
    let old = match &args.compare {
        Some(path) => Some((path, table::read_results(path)?)),
        None => None,
    };
    if !args.report.is_empty() {
        let results = publish::publish_again(&args.report, &args.out)?;
        println!("results.csv, results.json, plots, report.html in {}", args.out.display());
        return old.map_or(Ok(()), |(path, old)| publish::compare_with(path, &old, &results));
    }
    let tree = Tree::load(args.tree())?;
    let machine = Machine::find()?;
    let configurations = plan::configurations(args, &tree)?;
    if args.scene == SceneArg::Landscape {
        // Species are baked here, so that processes find them in the cache.
        Landscape::new(args, args.instances[0], args.camera.view())?;
    }
    make_folder(&args.out)?;
    let work =
        tempfile::tempdir().map_err(|error| ToolError::write(&std::env::temp_dir(), error))?;
    let bench = Bench { args, machine, tree, work: work.path() };
    let rows = bench.measure(&configurations)?;
    let rows = bench.hold_against_truth(&configurations, rows)?;
    let results = bench.results(rows);
    publish::publish(&args.out, &results, &publish::pictures(&args.out, &results.rows))?;
    let unfinished = args.out.join(UNFINISHED);
    std::fs::remove_file(&unfinished).map_err(|error| ToolError::write(&unfinished, error))?;
    println!("{}", terminal::table(&results.rows));
    println!("results.csv, results.json, plots, pictures, report.html in {}", args.out.display());
    if !results.rows.iter().any(row::Row::ran) {
        return Err(ToolError::Message(
            "nothing could be measured; the column `status` says why".into(),
        ));
    }
    old.map_or(Ok(()), |(path, old)| publish::compare_with(path, &old, &results))
}
