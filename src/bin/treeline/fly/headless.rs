//! A flight without a window: frames, a contact sheet, `stats.csv`.

use super::{FlyArgs, world};
use crate::{
    headless::{capture, cpu_seconds, headless_app, peak_memory_mib, render_target, step, target},
    options::{ToolError, ToolResult, write_file, write_png},
    sheet::contact_sheet,
};
use bevy::{diagnostic::DiagnosticsStore, prelude::*};
use bevy_treeline::{NearMeshes, TreelineCounters, bake::Baked};
use indicatif::{ProgressBar, ProgressStyle};
use serde::Serialize;
use std::{
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    time::Instant,
};

/// Frames drawn before the first is kept: assets upload and near meshes warm up.
const WARM_UP: u32 = 6;
/// Pictures of the contact sheet at most.
const SHEET_CELLS: u32 = 12;

#[derive(Serialize)]
struct FrameStats {
    frame: u32,
    x: f32,
    y: f32,
    z: f32,
    wall_ms: f64,
    cpu_ms: f64,
    instances_seen: u32,
    culled_frustum: u32,
    culled_small: u32,
    as_mesh: u32,
    in_fade: u32,
    near_meshes: usize,
    points: u32,
    work_items: u32,
    overflow: u32,
    covered_pixels: u32,
    bytes_read: u64,
    select_gpu_ms: Option<f64>,
    splat_gpu_ms: Option<f64>,
    classify_gpu_ms: Option<f64>,
    resolve_gpu_ms: Option<f64>,
}

/// Newest GPU time of a pass of this crate, milliseconds.
pub fn span(app: &App, pass: &str) -> Option<f64> {
    let wanted = format!("render/treeline_{pass}/elapsed_gpu");
    let store = app.world().resource::<DiagnosticsStore>();
    let found = store.iter().find(|d| d.path().as_str() == wanted);
    found.and_then(|d| d.value())
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}

pub fn run(args: &FlyArgs, baked: &[Baked]) -> ToolResult {
    let stopped = Arc::new(AtomicBool::new(false));
    let flag = stopped.clone();
    // Without a handler Ctrl-C still works; files are whole either way, since each is renamed into place.
    let _ = ctrlc::set_handler(move || flag.store(true, Ordering::Relaxed));

    let start = Instant::now();
    let mut app = headless_app(args.splat_path.into())?;
    world::build(app.world_mut(), args, baked)?;
    let image = target(&mut app, args.size.0, args.size.1);
    let camera = app.world_mut().spawn((world::camera(args), render_target(&image))).id();
    let total = args.frames;
    let at = |frame: u32| args.start + args.way * frame as f32 / total as f32;
    let go = |app: &mut App, t: f32| {
        let place = world::place(app.world().resource::<world::Flight>(), t);
        app.world_mut().entity_mut(camera).insert(place);
    };
    go(&mut app, at(0));
    for _ in 0..WARM_UP {
        step(&mut app);
    }
    println!("{} trees, first frame after {:.1} s", args.count, start.elapsed().as_secs_f64());

    let bar = ProgressBar::new(u64::from(total));
    let style = ProgressStyle::with_template("frames {bar:30} {pos}/{len}  {eta} left");
    bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
    let mut rows: Vec<FrameStats> = vec![];
    let mut cells = vec![];
    let every = total.div_ceil(SHEET_CELLS).max(1);
    for frame in 0..total {
        if stopped.load(Ordering::Relaxed) {
            break;
        }
        go(&mut app, at(frame));
        let (cpu, wall) = (cpu_seconds(), Instant::now());
        step(&mut app);
        let (cpu, wall) = (cpu_seconds() - cpu, wall.elapsed().as_secs_f64());
        let picture = capture(&app, &image)?;
        // Of this very frame: the device has been waited for.
        let counters = app.world().resource::<TreelineCounters>().of(camera).unwrap_or_default();
        let eye = app.world().get::<Transform>(camera).map_or(Vec3::ZERO, |t| t.translation);
        rows.push(FrameStats {
            frame,
            x: eye.x,
            y: eye.y,
            z: eye.z,
            wall_ms: wall * 1e3,
            cpu_ms: cpu * 1e3,
            instances_seen: counters.instances_seen,
            culled_frustum: counters.culled_frustum,
            culled_small: counters.culled_small,
            as_mesh: counters.as_mesh,
            in_fade: counters.in_fade,
            near_meshes: app.world().resource::<NearMeshes>().len(),
            points: counters.points,
            work_items: counters.items,
            overflow: counters.item_overflow,
            covered_pixels: counters.covered_pixels,
            bytes_read: counters.bytes_read(),
            select_gpu_ms: span(&app, "select"),
            splat_gpu_ms: span(&app, "splat"),
            classify_gpu_ms: span(&app, "classify"),
            resolve_gpu_ms: span(&app, "resolve"),
        });
        write_png(&args.out.join(format!("frame{frame:04}.png")), &picture)?;
        if frame % every == 0 {
            cells.push((format!("frame {frame}: {} k points", counters.points / 1000), picture));
        }
        bar.inc(1);
    }
    bar.finish_and_clear();
    if rows.is_empty() {
        return Err(ToolError::Message("stopped before the first frame".into()));
    }
    write_png(&args.out.join("sheet.png"), &contact_sheet(&cells, 3, 480))?;
    let mut csv = csv::Writer::from_writer(vec![]);
    let stats = args.out.join("stats.csv");
    for row in &rows {
        csv.serialize(row).map_err(|error| ToolError::write(&stats, error))?;
    }
    let bytes = csv.into_inner().map_err(|error| ToolError::write(&stats, error))?;
    write_file(&stats, &bytes)?;
    let of = |f: fn(&FrameStats) -> f64| median(rows.iter().map(f).collect());
    println!(
        "{} frames of {}x{}: median {:.0} ms, {:.0} CPU ms, {:.0} k points, {:.1} MB read, {} near meshes; peak {:.0} MiB",
        rows.len(),
        args.size.0,
        args.size.1,
        of(|r| r.wall_ms),
        of(|r| r.cpu_ms),
        of(|r| f64::from(r.points)) / 1e3,
        of(|r| r.bytes_read as f64) / 1e6,
        of(|r| r.near_meshes as f64),
        peak_memory_mib()
    );
    println!("frames, sheet.png and stats.csv in {}", args.out.display());
    Ok(())
}
