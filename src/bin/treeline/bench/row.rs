//! One measured configuration: the columns of `results.csv` and of `results.json` (schema 1).
//!
//! What a configuration cannot say is absent (an empty cell, `null`): never 0, never a guess. `status` says in words why a
//! peer did not run.

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

/// Version of the columns: raised when one changes its meaning or goes.
pub const SCHEMA: u32 = 1;

/// The columns, in the order in which they are written.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Row {
    /// Commit of the sources, as git says; `-dirty` appended if files differ from it.
    pub commit: String,
    /// What `--date` said.
    pub date: String,
    pub adapter: String,
    pub driver: String,
    pub backend: String,
    /// `1280x720`.
    pub size: String,
    /// `baseline`, `landscape` or `single`.
    pub scene: String,
    pub seed: u64,
    /// Name of the technique with its variant: `points`, `lod+msaa4`.
    pub technique: String,
    pub instances: u64,
    /// Names of the trees, joined by `+`.
    pub species: String,
    /// `ok`, or why there are no figures.
    pub status: String,
    /// Camera: `still`, `flying`, or of the scene `single` `still at 12.5`: the distance.
    pub camera: String,
    /// Runs of this configuration (each in a process of its own) and measured frames of each.
    pub runs: u32,
    pub frames: u32,
    /// Triangles of one tree of each species, summed.
    pub source_triangles: Option<u64>,
    /// Triangles that went through the rasteriser in a frame.
    pub triangles_drawn: Option<u64>,
    pub points_baked: Option<u64>,
    pub points_drawn: Option<u64>,
    pub work_items: Option<u64>,
    pub culled_tiles: Option<u64>,
    pub culled_frustum: Option<u64>,
    pub culled_small: Option<u64>,
    pub culled_occluded: Option<u64>,
    pub item_overflow: Option<u64>,
    /// Points drawn per pixel that shows a point.
    pub overdraw: Option<f64>,
    pub bytes_per_point: Option<f64>,
    /// Bytes that selection, splatting and resolve read in a frame.
    pub bytes_read: Option<u64>,
    /// `bytes_read` over the GPU time of a frame.
    pub gb_per_s: Option<f64>,
    /// GPU time of a frame: all spans; then by pass.
    pub gpu_ms: Option<f64>,
    pub gpu_ms_select: Option<f64>,
    pub gpu_ms_splat: Option<f64>,
    pub gpu_ms_pyramid: Option<f64>,
    pub gpu_ms_classify: Option<f64>,
    pub gpu_ms_resolve: Option<f64>,
    pub gpu_ms_temporal: Option<f64>,
    pub gpu_ms_prepass: Option<f64>,
    pub gpu_ms_opaque: Option<f64>,
    pub gpu_ms_other: Option<f64>,
    /// CPU time by stage: main world, extraction, render world without waiting for the GPU.
    pub cpu_ms_main: Option<f64>,
    pub cpu_ms_extract: Option<f64>,
    pub cpu_ms_render: Option<f64>,
    /// Work on the main thread: main world and extraction.
    pub main_thread_ms: Option<f64>,
    /// Wall time of a frame: median over frames and runs, quartiles, 95th percentile.
    pub frame_ms: Option<f64>,
    pub frame_ms_p25: Option<f64>,
    pub frame_ms_p75: Option<f64>,
    pub frame_ms_p95: Option<f64>,
    /// CPU seconds of the process per frame (all threads, the driver's too): median of the runs, least, most.
    pub cpu_s_per_frame: Option<f64>,
    pub cpu_s_min: Option<f64>,
    pub cpu_s_max: Option<f64>,
    /// GPU memory of this crate's buffers, without surfels; then the surfels.
    pub vram_mb: Option<f64>,
    pub vram_surfels_mb: Option<f64>,
    /// Peak resident memory of the process.
    pub rss_mb: Option<f64>,
    pub flip_mean: Option<f64>,
    pub flip_p95: Option<f64>,
    pub block_rmse: Option<f64>,
    /// The same over the part of the picture below the horizon.
    pub flip_mean_below: Option<f64>,
    pub block_rmse_below: Option<f64>,
    pub coverage_error: Option<f64>,
    /// Process start to first frame; and baking, not in it.
    pub startup_s: Option<f64>,
    pub bake_s: Option<f64>,
}

impl Row {
    /// There are figures.
    pub fn ran(&self) -> bool {
        self.status == "ok"
    }

    /// The technique without its variant: `lod` of `lod+msaa4`.
    pub fn base_technique(&self) -> &str {
        self.technique.split('+').next().unwrap_or_default()
    }

    /// How far the one tree of the scene `single` is.
    pub fn distance(&self) -> Option<f64> {
        self.camera.split_once(" at ")?.1.parse().ok()
    }

    /// Each column by its name; absent ones are null.
    pub fn columns(&self) -> Map<String, Value> {
        match serde_json::to_value(self) {
            Ok(Value::Object(columns)) => columns,
            other => unreachable!("a row of named fields is an object, not {other:?}"),
        }
    }
}

/// The machine that measured.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Machine {
    pub adapter: String,
    pub driver: String,
    pub backend: String,
    pub os: String,
    pub cpu: String,
    pub cores: u32,
    pub memory_mb: u64,
}

/// `results.json`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Results {
    pub schema: u32,
    pub machine: Machine,
    /// The command line.
    #[serde(default)]
    pub command: String,
    pub rows: Vec<Row>,
}

impl Results {
    /// Commits and dates of the rows, each once, for people.
    pub fn sources(&self) -> String {
        let mut sources: Vec<String> = vec![];
        for row in &self.rows {
            let words = [("commit", &row.commit), ("date", &row.date)];
            let known = words.iter().filter(|(_, text)| !text.is_empty());
            let source =
                known.map(|(name, text)| format!("{name} {text}")).collect::<Vec<_>>().join(", ");
            if !source.is_empty() && !sources.contains(&source) {
                sources.push(source);
            }
        }
        if sources.is_empty() { "commit and date unknown".to_owned() } else { sources.join("; ") }
    }
}
