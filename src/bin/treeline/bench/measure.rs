//! Times of frames: wall, CPU by stage, GPU by pass.
//!
//! A frame is an update and the wait until the GPU is done. Software drivers draw inside of submission or of the wait that
//! follows, so the render world's time is taken without both.

use super::{row::Row, stats::median};
use bevy::{
    diagnostic::DiagnosticsStore,
    prelude::*,
    render::{
        Render, RenderApp, RenderSystems,
        render_resource::{PipelineCache, PollType},
        renderer::{RenderDevice, RenderGraph, RenderGraphSystems},
    },
};
use std::{
    collections::BTreeMap,
    sync::{Arc, Mutex},
    time::Instant,
};

/// When the render world had recorded its commands, and when it went on after submitting them and waiting.
#[derive(Default)]
struct Blocked {
    recorded: Option<Instant>,
    went_on: Option<Instant>,
}

/// Shared by the systems that mark and by the measurement.
#[derive(Resource, Clone, Default)]
struct Marks(Arc<Mutex<Blocked>>);

impl Marks {
    fn with<T>(&self, change: impl FnOnce(&mut Blocked) -> T) -> T {
        change(&mut self.0.lock().unwrap_or_else(|poisoned| poisoned.into_inner()))
    }
}

/// Adds what [`frame`] needs; before the app is finished.
pub fn add_marks(app: &mut App) {
    let marks = Marks::default();
    app.insert_resource(marks.clone());
    let Some(render) = app.get_sub_app_mut(RenderApp) else { return };
    let (recorded, went_on) = (marks.clone(), marks);
    render.add_systems(
        RenderGraph,
        (move || recorded.with(|m| m.recorded = Some(Instant::now())))
            .after(RenderGraphSystems::Render)
            .before(RenderGraphSystems::Submit),
    );
    render.add_systems(
        Render,
        (move || went_on.with(|m| m.went_on = Some(Instant::now())))
            .after(RenderSystems::Render)
            .before(RenderSystems::Cleanup),
    );
}

/// Milliseconds of one frame.
#[derive(Clone, Copy, Debug, Default)]
pub struct FrameTimes {
    pub wall: f64,
    pub main: f64,
    pub extract: f64,
    /// Without submission and waiting for the GPU.
    pub render: f64,
}

fn ms_since(start: Instant) -> f64 {
    start.elapsed().as_secs_f64() * 1e3
}

/// Draws a frame as `App::update` does, stage by stage, and waits until the GPU is done.
pub fn frame(app: &mut App) -> FrameTimes {
    let marks = app.world().resource::<Marks>().clone();
    marks.with(|m| *m = Blocked::default());
    let mut times = FrameTimes::default();
    let start = Instant::now();
    let apps = app.sub_apps_mut();
    apps.main.run_default_schedule();
    times.main = ms_since(start);
    for sub_app in apps.sub_apps.values_mut() {
        let extracting = Instant::now();
        sub_app.extract(apps.main.world_mut());
        times.extract += ms_since(extracting);
        let updating = Instant::now();
        sub_app.update();
        times.render += ms_since(updating);
    }
    apps.main.world_mut().clear_trackers();
    let device = app.world().resource::<RenderDevice>();
    // An error means that the device is lost; the capture that follows says so.
    let _ = device.wgpu_device().poll(PollType::wait_indefinitely());
    times.wall = ms_since(start);
    let blocked = marks.with(|m| Some(m.went_on?.duration_since(m.recorded?).as_secs_f64() * 1e3));
    times.render = (times.render - blocked.unwrap_or(0.0)).max(0.0);
    times
}

/// Frames after which a picture is taken as complete, whatever is still missing.
const PATIENCE: u32 = 30;

/// Draws until a frame lacks no pipeline: shaders load in the background, and what needs them is not drawn until then.
pub fn complete_frame(app: &mut App) -> FrameTimes {
    let mut times = frame(app);
    for _ in 1..PATIENCE {
        let render = app.get_sub_app(RenderApp);
        let cache = render.and_then(|render| render.world().get_resource::<PipelineCache>());
        if cache.is_none_or(|cache| cache.waiting_pipelines().next().is_none()) {
            break;
        }
        times = frame(app);
    }
    times
}

/// Diagnostics of render passes over the last `frames` frames, medians by path.
fn medians(app: &App, suffix: &str, frames: usize) -> BTreeMap<String, f64> {
    let store = app.world().resource::<DiagnosticsStore>();
    let found = store.iter().filter_map(|diagnostic| {
        let path = diagnostic.path().as_str();
        let pass = path.strip_prefix("render/")?.strip_suffix(suffix)?.strip_suffix('/')?;
        let values: Vec<f64> = diagnostic.values().copied().collect();
        let last = &values[values.len().saturating_sub(frames)..];
        Some((pass.to_owned(), median(last)?))
    });
    found.collect()
}

/// Passes that no other one holds: `a/b` is a part of `a`.
fn outermost(passes: BTreeMap<String, f64>) -> BTreeMap<String, f64> {
    let is_part =
        |pass: &str| pass.match_indices('/').any(|(end, _)| passes.contains_key(&pass[..end]));
    passes.iter().filter(|(pass, _)| !is_part(pass)).map(|(p, v)| (p.clone(), *v)).collect()
}

/// The stage of a pass, as the columns call them.
fn stage(pass: &str) -> &'static str {
    let stages = ["select", "splat", "pyramid", "classify", "resolve", "accumulate"];
    if let Some(own) = pass.strip_prefix("treeline_") {
        return stages.into_iter().find(|stage| own.contains(stage)).unwrap_or("other");
    }
    match pass {
        _ if pass.contains("prepass") => "prepass",
        _ if pass.contains("opaque_pass") => "opaque",
        _ => "other",
    }
}

/// Fills the columns of GPU times and of triangles from what the driver said of the last `frames` frames.
pub fn read_passes(app: &App, frames: usize, row: &mut Row) {
    let passes = outermost(medians(app, "elapsed_gpu", frames));
    if !passes.is_empty() {
        row.gpu_ms = Some(passes.values().sum());
    }
    for (pass, ms) in &passes {
        let column = match stage(pass) {
            "select" => &mut row.gpu_ms_select,
            "splat" => &mut row.gpu_ms_splat,
            "pyramid" => &mut row.gpu_ms_pyramid,
            "classify" => &mut row.gpu_ms_classify,
            "resolve" => &mut row.gpu_ms_resolve,
            "accumulate" => &mut row.gpu_ms_temporal,
            "prepass" => &mut row.gpu_ms_prepass,
            "opaque" => &mut row.gpu_ms_opaque,
            _ => &mut row.gpu_ms_other,
        };
        *column.get_or_insert(0.0) += ms;
    }
    let triangles = outermost(medians(app, "clipper_invocations", frames));
    if !triangles.is_empty() {
        row.triangles_drawn = Some(triangles.values().sum::<f64>().round() as u64);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn passes_within_passes_are_not_counted_twice() {
        let passes = [("a", 2.0), ("a/b", 1.0), ("a/b/c", 0.5), ("ab", 3.0)];
        let passes = passes.map(|(pass, ms)| (pass.to_owned(), ms)).into_iter().collect();
        let left: Vec<String> = outermost(passes).into_keys().collect();
        assert_eq!(left, ["a", "ab"]);
    }

    #[test]
    fn every_pass_has_a_column() {
        assert_eq!(stage("treeline_select_again"), "select");
        assert_eq!(stage("treeline_something_new"), "other");
        assert_eq!(stage("early prepass"), "prepass");
        assert_eq!(stage("main_opaque_pass_3d"), "opaque");
        assert_eq!(stage("tonemapping"), "other");
    }
}
