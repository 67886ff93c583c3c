//! A flight without a window: frames, a contact sheet, `stats.csv`, a film, a summary.

use super::{FlyArgs, camera::FlyCamera, world};
use crate::{
    flip::{CropRect, flip},
    headless::{
        capture, cpu_seconds, headless_app_with, pass_time, peak_memory_mib, render_target, step,
        target,
    },
    movie::write_movie,
    options::{ToolError, ToolResult, write_file, write_png},
    sheet::contact_sheet,
    summary::{PointSpread, Spread, Summary, write_summary},
};
use bevy::{diagnostic::DiagnosticsStore, prelude::*, render::renderer::RenderAdapterInfo};
use bevy_treeline::{
    NearMeshes, Occlusion, TreelineCounters, TreelineSettings,
    landscape::{Planting, PlantingCounters, TerrainCounters},
};
use image::RgbaImage;
use indicatif::{ProgressBar, ProgressStyle};
use serde::Serialize;
use std::{
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    time::{Duration, Instant},
};

/// Frames drawn before the first is kept: assets upload and near meshes warm up.
const WARM_UP: u32 = 6;
/// Pictures of the contact sheet at most.
const SHEET_CELLS: u32 = 12;
/// Frames a second of the film.
const FILM_FPS: u32 = 24;

#[derive(Serialize)]
struct FrameStats {
    frame: u32,
    /// Seconds since the first frame.
    time_s: f64,
    place: String,
    x: f32,
    y: f32,
    z: f32,
    wall_ms: f64,
    cpu_ms: f64,
    trees: u32,
    culled_tiles: u32,
    culled_frustum: u32,
    culled_small: u32,
    as_mesh: u32,
    in_fade: u32,
    near_meshes: usize,
    near_left_as_points: usize,
    /// q as drawn: less than --quality where a budget asks for it.
    quality: f32,
    points: u32,
    work_items: u32,
    overflow: u32,
    covered_pixels: u32,
    bytes_read: u64,
    tree_tiles: usize,
    cover_tiles: usize,
    cover: usize,
    chunks: usize,
    ground_triangles: usize,
    /// Waited for ground and trees to be made, before the frame was drawn.
    streaming_ms: f32,
    select_gpu_ms: Option<f64>,
    splat_gpu_ms: Option<f64>,
    classify_gpu_ms: Option<f64>,
    resolve_gpu_ms: Option<f64>,
    /// FLIP against the frame before, with --flip.
    flip_to_previous: Option<f32>,
}

/// Newest GPU time of a pass of this crate, milliseconds.
pub fn span(app: &App, pass: &str) -> Option<f64> {
    let wanted = format!("render/treeline_{pass}/elapsed_gpu");
    let store = app.world().resource::<DiagnosticsStore>();
    let found = store.iter().find(|d| d.path().as_str() == wanted);
    found.and_then(|d| d.value())
}

pub fn run(args: &FlyArgs) -> ToolResult {
    let stopped = Arc::new(AtomicBool::new(false));
    let flag = stopped.clone();
    // Without a handler Ctrl-C still works; files are whole either way, since each is renamed into place.
    let _ = ctrlc::set_handler(move || flag.store(true, Ordering::Relaxed));

    let start = Instant::now();
    let plan = world::prepare(args, false)?;
    let mut app = headless_app_with(args.splat_path.into(), |app| {
        world::build(app, args, plan, true);
        Ok(())
    })?;
    let image = target(&mut app, args.size.0, args.size.1);
    let camera = world::camera(app.world_mut(), args);
    // What holes of a pixel would show depends on the frames before; two flights have to give the same bytes.
    if let Some(mut settings) = app.world_mut().get_mut::<TreelineSettings>(camera) {
        settings.occlusion = Occlusion::Exact;
    }
    app.world_mut().entity_mut(camera).insert((FlyCamera, render_target(&image)));
    let total = args.frames;
    let at = |frame: u32| args.start + args.way * frame as f32 / total as f32;
    let go = |app: &mut App, t: f32| {
        let place = app.world().resource::<world::Flight>().place(t);
        app.world_mut().entity_mut(camera).insert(place);
    };
    go(&mut app, at(0));
    for _ in 0..WARM_UP {
        step(&mut app);
    }
    let startup_s = start.elapsed().as_secs_f64();
    println!("first frame after {startup_s:.1} s");

    let bar = ProgressBar::new(u64::from(total));
    let style = ProgressStyle::with_template("frames {bar:30} {pos}/{len}  {eta} left");
    bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
    let mut rows: Vec<FrameStats> = vec![];
    let (mut cells, mut files) = (vec![], vec![]);
    let mut previous: Option<RgbaImage> = None;
    let every = total.div_ceil(SHEET_CELLS).max(1);
    let mut there = streamed(&app);
    let first_frame = Instant::now();
    for frame in 0..total {
        if stopped.load(Ordering::Relaxed) {
            break;
        }
        go(&mut app, at(frame));
        pass_time(&mut app, Duration::from_secs_f64(1.0 / f64::from(FILM_FPS)));
        let mut timed = timed_step(&mut app);
        pass_time(&mut app, Duration::ZERO);
        let streaming_ms = streaming_ms(&app);
        let now = streamed(&app);
        if std::mem::replace(&mut there, now) != now {
            // This step waited for ground and trees, which a window makes in the background: the frame is drawn again.
            // What came decides, not how long it took: pictures do not depend on the clock.
            timed = timed_step(&mut app);
        }
        let (cpu, wall) = timed;
        let picture = capture(&app, &image)?;
        let mut row = stats(&app, camera, frame, at(frame));
        row.streaming_ms = streaming_ms;
        row.time_s = first_frame.elapsed().as_secs_f64();
        (row.wall_ms, row.cpu_ms) = (wall * 1e3, cpu * 1e3);
        if args.flip {
            if let Some(previous) = &previous {
                row.flip_to_previous = Some(difference(previous, &picture)?);
            }
            previous = Some(picture.clone());
        }
        let file = args.out.join(format!("frame{frame:04}.png"));
        write_png(&file, &picture)?;
        files.push(file);
        if frame % every == 0 {
            cells
                .push((format!("{frame}: {}, {} k points", row.place, row.points / 1000), picture));
        }
        rows.push(row);
        bar.inc(1);
    }
    bar.finish_and_clear();
    if rows.is_empty() {
        return Err(ToolError::Message("stopped before the first frame".into()));
    }
    write_png(&args.out.join("sheet.png"), &contact_sheet(&cells, 3, 480))?;
    write_rows(args, &rows)?;
    let film = if files.len() > 1 { Some(write_movie(&files, FILM_FPS, &args.out)?) } else { None };
    report(&app, args, &rows, startup_s)?;
    let film = film.map_or(String::new(), |film| {
        format!(", {}", film.file_name().unwrap_or_default().to_string_lossy())
    });
    println!("frames, sheet.png, stats.csv{film} in {}", args.out.display());
    Ok(())
}

/// CPU and wall seconds of a step.
fn timed_step(app: &mut App) -> (f64, f64) {
    let (cpu, wall) = (cpu_seconds(), Instant::now());
    step(app);
    (cpu_seconds() - cpu, wall.elapsed().as_secs_f64())
}

/// How much ground and how many plants are there.
fn streamed(app: &App) -> [usize; 5] {
    let world = app.world();
    let planting = world.get_resource::<PlantingCounters>().copied().unwrap_or_default();
    let terrain = world.get_resource::<TerrainCounters>().copied().unwrap_or_default();
    let PlantingCounters { tree_tiles, cover_tiles, trees, cover, .. } = planting;
    [tree_tiles, cover_tiles, trees, cover, terrain.chunks]
}

/// What the last step took to make ground and trees.
fn streaming_ms(app: &App) -> f32 {
    let planting = app.world().get_resource::<PlantingCounters>();
    let terrain = app.world().get_resource::<TerrainCounters>();
    planting.map_or(0.0, |c| c.main_thread_ms) + terrain.map_or(0.0, |c| c.main_thread_ms)
}

/// Mean FLIP between two frames.
fn difference(a: &RgbaImage, b: &RgbaImage) -> ToolResult<f32> {
    let all = CropRect { x: 0, y: 0, width: a.width(), height: a.height() };
    let report = flip(a, b, all).map_err(|error| ToolError::Message(error.to_string()))?;
    Ok(report.mean)
}

/// Of this very frame: the device has been waited for.
fn stats(app: &App, camera: Entity, frame: u32, t: f32) -> FrameStats {
    let world = app.world();
    let counters = world.resource::<TreelineCounters>().of(camera).unwrap_or_default();
    let near = world.resource::<NearMeshes>();
    let eye = world.get::<Transform>(camera).map_or(Vec3::ZERO, |t| t.translation);
    let planting = world.get_resource::<PlantingCounters>().cloned().unwrap_or_default();
    let terrain = world.get_resource::<TerrainCounters>().cloned().unwrap_or_default();
    FrameStats {
        frame,
        time_s: 0.0,
        place: world.resource::<world::Flight>().0.role_at(t).to_string(),
        x: eye.x,
        y: eye.y,
        z: eye.z,
        wall_ms: 0.0,
        cpu_ms: 0.0,
        trees: counters.instances_seen,
        culled_tiles: counters.culled_tiles,
        culled_frustum: counters.culled_frustum,
        culled_small: counters.culled_small,
        as_mesh: counters.as_mesh,
        in_fade: counters.in_fade,
        near_meshes: near.len(),
        near_left_as_points: near.left_as_points(),
        quality: counters.quality,
        points: counters.points,
        work_items: counters.items,
        overflow: counters.item_overflow,
        covered_pixels: counters.covered_pixels,
        bytes_read: counters.bytes_read(),
        tree_tiles: planting.tree_tiles,
        cover_tiles: planting.cover_tiles,
        cover: planting.cover,
        chunks: terrain.chunks,
        ground_triangles: terrain.triangles,
        streaming_ms: 0.0,
        select_gpu_ms: span(app, "select"),
        splat_gpu_ms: span(app, "splat"),
        classify_gpu_ms: span(app, "classify"),
        resolve_gpu_ms: span(app, "resolve"),
        flip_to_previous: None,
    }
}

fn write_rows(args: &FlyArgs, rows: &[FrameStats]) -> ToolResult {
    let stats = args.out.join("stats.csv");
    let mut csv = csv::Writer::from_writer(vec![]);
    for row in rows {
        csv.serialize(row).map_err(|error| ToolError::write(&stats, error))?;
    }
    let bytes = csv.into_inner().map_err(|error| ToolError::write(&stats, error))?;
    write_file(&stats, &bytes)
}

/// Prints the summary, and writes it with --json.
fn report(app: &App, args: &FlyArgs, rows: &[FrameStats], startup_s: f64) -> ToolResult {
    let all = |of: fn(&FrameStats) -> f64| rows.iter().map(of).collect::<Vec<f64>>();
    let wall = Spread::of(&all(|r| r.wall_ms));
    let cpu = Spread::of(&all(|r| r.cpu_ms));
    let points = Spread::of(&all(|r| f64::from(r.points)));
    let trees = Spread::of(&all(|r| f64::from(r.trees)));
    println!(
        "{} frames of {}x{}: median {:.0} ms (p95 {:.0}, worst {:.0}), {:.0} CPU ms, {:.0} k trees, {:.0} k points (most {:.0} k); peak {:.0} MiB",
        rows.len(),
        args.size.0,
        args.size.1,
        wall.median,
        wall.p95,
        wall.worst,
        cpu.median,
        trees.median / 1e3,
        points.median / 1e3,
        points.worst / 1e3,
        peak_memory_mib()
    );
    if args.flip {
        let flips: Vec<f64> =
            rows.iter().filter_map(|r| r.flip_to_previous).map(f64::from).collect();
        let flips = Spread::of(&flips);
        println!("FLIP from frame to frame: median {:.4}, worst {:.4}", flips.median, flips.worst);
    }
    let Some(path) = &args.json else { return Ok(()) };
    let adapter = app.world().get_resource::<RenderAdapterInfo>();
    let planting = app.world().get_resource::<Planting>();
    let planted = planting.map_or(0.0, |p| p.forest().scatter().expected_trees()).round() as u64;
    write_summary(
        path,
        &Summary {
            frames: rows.len() as u32,
            // Of the whole landscape; without a forest none.
            instances: planted,
            startup_s,
            frame_ms: wall,
            cpu_s_per_frame: cpu.median / 1e3,
            points: PointSpread::of(rows.iter().map(|r| r.points)),
            peak_rss_mb: peak_memory_mib(),
            seed: args.seed,
            size: args.size.into(),
            side_m: app.world().resource::<bevy_treeline::landscape::Landscape>().ground.side_m(),
            adapter: adapter.map_or(String::new(), |info| info.name.clone()),
        },
    )
}
