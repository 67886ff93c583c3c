//! Plots of results as SVG: rows in, pictures out. No plot mixes scenarios; a technique looks the same in all of them.

mod axis;
mod canvas;
mod curves;
mod palette;
mod panel;
mod shares;

use super::{
    row::{Results, Row},
    scenario::{Scenario, by_scenario, position},
};
use crate::options::{ToolError, ToolResult, write_file};
use canvas::Drawn;
use curves::{Column, against_position, error_against_cost, flip_against_points};
use palette::{Look, looks};
use shares::time_shares;
use std::path::Path;

pub struct Plot {
    pub scenario: Scenario,
    /// Name of the file: `frame_time_baseline_aspen_1280x720_still.svg`.
    pub file_name: String,
    /// What it shows and how to read it, in a sentence.
    pub caption: &'static str,
    pub svg: String,
}

const COST: [(&str, &str, Column); 2] = [
    ("CPU time of a frame", "CPU seconds per frame", |row| row.cpu_s_per_frame),
    ("Wall time of a frame", "ms per frame", |row| row.frame_ms),
];

const MEMORY: [(&str, &str, Column); 2] = [
    ("Memory of the process", "peak resident MB", |row| row.rss_mb),
    ("GPU memory without surfels", "MB of buffers", |row| row.vram_mb),
];

const PASSES: [(&str, Column); 9] = [
    ("select", |row| row.gpu_ms_select),
    ("splat", |row| row.gpu_ms_splat),
    ("pyramid", |row| row.gpu_ms_pyramid),
    ("classify", |row| row.gpu_ms_classify),
    ("resolve", |row| row.gpu_ms_resolve),
    ("temporal", |row| row.gpu_ms_temporal),
    ("prepass", |row| row.gpu_ms_prepass),
    ("opaque meshes", |row| row.gpu_ms_opaque),
    ("other", |row| row.gpu_ms_other),
];

const STAGES: [(&str, Column); 3] = [
    ("main world", |row| row.cpu_ms_main),
    ("extraction", |row| row.cpu_ms_extract),
    ("render world", |row| row.cpu_ms_render),
];

/// All plots for which there are figures.
pub fn plots(results: &Results) -> ToolResult<Vec<Plot>> {
    let looks = looks(&results.rows);
    let mut plots = vec![];
    for (scenario, rows) in by_scenario(&results.rows) {
        let mut ran: Vec<&Row> = rows.into_iter().filter(|row| row.ran()).collect();
        // As in the legends.
        let order = |row: &Row| looks.iter().position(|look| look.technique == row.technique);
        ran.sort_by(|a, b| order(a).cmp(&order(b)).then(position(a).total_cmp(&position(b))));
        for (name, caption, drawn) in drawings(&ran, &looks) {
            let file_name = format!("{name}_{}.svg", scenario.file_name());
            let Some(drawn) = drawn else { continue };
            let svg = drawn
                .map_err(|error| ToolError::Message(format!("cannot draw {file_name}: {error}")))?;
            plots.push(Plot { scenario: scenario.clone(), file_name, caption, svg });
        }
    }
    Ok(plots)
}

/// Name, caption and picture of each plot of a scenario; no picture where there are no figures for it.
fn drawings(
    rows: &[&Row],
    looks: &[Look],
) -> [(&'static str, &'static str, Option<Drawn<String>>); 6] {
    [
        (
            "frame_time",
            "Cost of a frame; both axes logarithmic. Where it is flat, it follows pixels and not trees.",
            against_position(rows, looks, &COST),
        ),
        (
            "error_cost",
            "Error against cost, the number of trees (or the distance of the one) beside each mark: further down and to the left is better.",
            error_against_cost(rows, looks),
        ),
        (
            "flip_points",
            "Error against points drawn, the number of trees (or the distance of the one) beside each mark; lines across are techniques without points.",
            flip_against_points(rows, looks),
        ),
        (
            "gpu_shares",
            "Shares of the passes in the GPU time of a frame; their sum is at the end of the bar.",
            time_shares(rows, "GPU time by pass", &PASSES),
        ),
        (
            "cpu_shares",
            "Shares of the stages in the CPU time of a frame, without waiting for the GPU; their sum is at the end of the bar.",
            time_shares(rows, "CPU time by stage", &STAGES),
        ),
        ("memory", "Memory; both axes logarithmic.", against_position(rows, looks, &MEMORY)),
    ]
}

/// Writes every plot into the folder `plots` of `out`.
pub fn write_plots(out: &Path, plots: &[Plot]) -> ToolResult {
    let folder = out.join("plots");
    plots.iter().try_for_each(|plot| write_file(&folder.join(&plot.file_name), plot.svg.as_bytes()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::sample::sample_results;

    #[test]
    fn every_scenario_has_its_plots() {
        let plots = plots(&sample_results()).expect("draws");
        let names: Vec<&str> = plots.iter().map(|plot| &*plot.file_name).collect();
        let aspen = "baseline_sapling_quaking_aspen_1280x720_still.svg";
        for name in
            ["frame_time", "error_cost", "flip_points", "gpu_shares", "cpu_shares", "memory"]
        {
            assert!(names.contains(&&*format!("{name}_{aspen}")), "{name}");
        }
        assert_eq!(plots.len(), 12);
        let all: String = plots.iter().map(|plot| &*plot.svg).collect();
        assert!(!all.contains("NaN") && !all.contains("inf"));
    }

    #[test]
    fn plots_say_what_they_show() {
        let plots = plots(&sample_results()).expect("draws");
        let svg = &plots[0].svg;
        for text in [
            "points+temporal",
            "stock+msaa4",
            "1k",
            "1M",
            "CPU seconds per frame",
            "trees in the scene",
        ] {
            assert!(svg.contains(text), "{text}");
        }
    }

    #[test]
    fn rows_without_figures_have_no_plots() {
        let mut results = sample_results();
        results.rows.iter_mut().for_each(|row| row.status = "no adapter".into());
        assert!(plots(&results).expect("nothing to draw").is_empty());
    }

    #[test]
    fn names_from_outside_are_escaped() {
        let mut results = sample_results();
        results.rows.iter_mut().for_each(|row| row.technique.push_str("<b>&"));
        let plots = plots(&results).expect("draws");
        assert!(!plots[0].svg.contains("<b>") && plots[0].svg.contains("&lt;b&gt;&amp;"));
    }

    #[test]
    fn files_lie_in_their_folder() {
        let folder = tempfile::tempdir().expect("a folder");
        let plots = plots(&sample_results()).expect("draws");
        write_plots(folder.path(), &plots).expect("writes");
        let files = std::fs::read_dir(folder.path().join("plots")).expect("a folder").count();
        assert_eq!(files, plots.len());
    }
}
