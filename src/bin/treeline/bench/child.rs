//! One configuration, measured: all that a process of its own does.

use super::{
    BenchArgs,
    measure::{self, FrameTimes},
    plan::Configuration,
    row::Row,
    scenes,
    stand::Stand,
    stats::{median, quantile},
    technique::{self, Work},
    tree::Tree,
};
use crate::{
    headless::{bevy_plugins, cpu_seconds, pass_time, peak_memory_mib},
    options::{ToolError, ToolResult, write_file, write_png},
};
use bevy::{
    prelude::*,
    render::{diagnostic::RenderDiagnosticsPlugin, renderer::RenderAdapterInfo},
};
use std::{
    path::Path,
    time::{Duration, Instant},
};

/// Files that it leaves in its folder.
pub const ROW: &str = "row.json";
pub const PICTURE: &str = "picture.png";
pub const COVER: &str = "cover.png";

/// Time that passes in the world between two frames.
const BETWEEN_FRAMES: Duration = Duration::from_micros(16_667);

/// An app without a window, ready to update.
pub fn app(build: impl FnOnce(&mut App)) -> ToolResult<App> {
    // Bevy panics without an adapter; ask first.
    bevy_treeline::gpu::headless::headless_device()
        .map_err(|error| ToolError::NoGpu(error.to_string()))?;
    let mut app = App::new();
    app.add_plugins((bevy_plugins(None), RenderDiagnosticsPlugin));
    pass_time(&mut app, BETWEEN_FRAMES);
    measure::add_marks(&mut app);
    build(&mut app);
    app.finish();
    app.cleanup();
    Ok(app)
}

/// Measures a configuration and leaves its row and its pictures in `folder`.
pub fn run(args: &BenchArgs, configuration: &Configuration, folder: &Path) -> ToolResult {
    let start = Instant::now();
    let mut technique = technique::chosen(&configuration.technique)?;
    let tree = Tree::load(&args.tree)?;
    let scene = scenes::scene(args, configuration, &tree);
    let mut app = app(|app| technique.build(app))?;
    let scenery = scene.set_up(app.world_mut());
    let mut row = Row::default();
    let mut work =
        Work { args, tree: &tree, trees: scene.trees(), row: &mut row, baking: Duration::ZERO };
    technique.plant(&mut app, &mut work)?;
    let baking = work.baking;
    let mut stand = Stand::new(app, &*scene, scenery, args.size);
    technique.set_up_camera(&mut stand.app.world_mut().entity_mut(stand.camera));

    let mut flight =
        Flight { steps: args.warm_up + args.frames, stand: &mut stand, scene: &*scene };
    let first = flight.next();
    row.startup_s = Some((start.elapsed() - baking).as_secs_f64());
    let mut left = Plan { warm_up: args.warm_up.saturating_sub(1), frames: args.frames };
    let mut seconds = args.seconds - first.wall / 1e3;
    let mut typical = first.wall / 1e3;
    if left.warm_up > 0 && typical < 0.3 * args.seconds {
        // The first frame also compiled and uploaded: the second one tells how long they take.
        typical = flight.next().wall / 1e3;
        seconds -= typical;
        left.warm_up -= 1;
    }
    let plan = left.within(seconds, typical);
    flight.steps = plan.warm_up + plan.frames;
    for _ in 0..plan.warm_up {
        flight.next();
    }
    let cpu = cpu_seconds();
    let times: Vec<FrameTimes> = (0..plan.frames).map(|_| flight.next()).collect();
    let cpu = (cpu_seconds() - cpu) / f64::from(plan.frames);
    row.cpu_s_per_frame = (cpu > 0.0).then_some(cpu);
    row.frames = plan.frames;
    fill_times(&times, &mut row);
    row.rss_mb = Some(peak_memory_mib()).filter(|mib| *mib > 0.0);
    technique.read(&stand.app, stand.camera, &mut row);
    write_png(&folder.join(PICTURE), &opaque(stand.picture()?))?;

    stand.show_trees_alone();
    measure::frame(&mut stand.app);
    write_png(&folder.join(COVER), &stand.picture()?)?;
    // The GPU's times of a frame are known one frame later.
    measure::read_passes(&stand.app, plan.frames as usize, &mut row);
    if let (Some(bytes), Some(ms)) = (row.bytes_read, row.gpu_ms.filter(|ms| *ms > 0.0)) {
        row.gb_per_s = Some(bytes as f64 / 1e6 / ms);
    }
    if let Some(info) = stand.app.world().get_resource::<RenderAdapterInfo>() {
        row.adapter = info.name.clone();
        row.driver = format!("{} {}", info.driver, info.driver_info).trim().to_owned();
        row.backend = format!("{:?}", info.backend).to_lowercase();
    }
    row.status = "ok".into();
    let path = folder.join(ROW);
    let text = serde_json::to_vec(&row).map_err(|error| ToolError::write(&path, error))?;
    write_file(&path, &text)
}

/// Frames to come.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Plan {
    warm_up: u32,
    frames: u32,
}

impl Plan {
    /// As many of them as `seconds` allow if each takes `typical` seconds: at least one is measured, and warming up is given up
    /// first.
    fn within(self, seconds: f64, typical: f64) -> Self {
        let affordable = (seconds / typical.max(1e-6)).clamp(0.0, 1e9) as u32;
        if affordable >= self.warm_up + self.frames {
            return self;
        }
        let warm_up = self.warm_up.min(affordable / 3);
        Self { warm_up, frames: (affordable - warm_up).clamp(1, self.frames.max(1)) }
    }
}

/// A camera on its way.
struct Flight<'a> {
    /// Frames to come.
    steps: u32,
    stand: &'a mut Stand,
    scene: &'a dyn scenes::BenchScene,
}

impl Flight<'_> {
    /// Moves on and draws.
    fn next(&mut self) -> FrameTimes {
        self.steps = self.steps.saturating_sub(1);
        self.stand.go(self.scene.place(self.steps));
        measure::frame(&mut self.stand.app)
    }
}

fn fill_times(times: &[FrameTimes], row: &mut Row) {
    let of = |time: fn(&FrameTimes) -> f64| times.iter().map(time).collect::<Vec<f64>>();
    let wall = of(|t| t.wall);
    row.frame_ms = median(&wall);
    row.frame_ms_p25 = quantile(&wall, 0.25);
    row.frame_ms_p75 = quantile(&wall, 0.75);
    row.frame_ms_p95 = quantile(&wall, 0.95);
    row.cpu_ms_main = median(&of(|t| t.main));
    row.cpu_ms_extract = median(&of(|t| t.extract));
    row.cpu_ms_render = median(&of(|t| t.render));
    row.main_thread_ms = median(&of(|t| t.main + t.extract));
}

/// As a file shows it.
fn opaque(mut picture: image::RgbaImage) -> image::RgbaImage {
    picture.pixels_mut().for_each(|pixel| pixel[3] = 255);
    picture
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slow_techniques_get_fewer_frames_and_at_least_one() {
        let plan = Plan { warm_up: 3, frames: 5 };
        assert_eq!(plan.within(30.0, 0.5), plan);
        assert_eq!(plan.within(20.0, 6.0), Plan { warm_up: 1, frames: 2 });
        assert_eq!(plan.within(1.0, 60.0), Plan { warm_up: 0, frames: 1 });
        assert_eq!(plan.within(-5.0, 60.0), Plan { warm_up: 0, frames: 1 });
    }
}
