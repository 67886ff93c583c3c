//! `treeline view`: one tree as mesh and as points, in a window or as a contact sheet; or a gallery of all species.

mod gallery;
mod window;

use crate::{
    options::{BakeOptions, SplatPathArg, ToolResult, make_folder, parse_quality, write_png},
    plant::{PlantOptions, Source},
    sheet::contact_sheet,
    subject::{Shot, Subject, Technique},
};
use bevy_treeline::bake::Baked;
use clap::Args;
use indicatif::ProgressBar;
use std::path::PathBuf;

#[derive(Args)]
pub struct ViewArgs {
    /// A model: .glb, .gltf, .obj or .ply.
    #[arg(required_unless_present_any = ["species", "gallery"], conflicts_with_all = ["species", "gallery"])]
    file: Option<PathBuf>,
    /// Instead of a model: a plant of this species (such as oak), or of a species file (.ron).
    #[arg(long, value_name = "NAME")]
    species: Option<String>,
    #[command(flatten)]
    plant: PlantOptions,
    /// One picture of all species, `gallery.png`.
    #[arg(long, conflicts_with = "species")]
    gallery: bool,
    /// No window: write a turntable and a distance sweep as one picture.
    #[arg(long)]
    headless: bool,
    /// Folder for pictures.
    #[arg(long, default_value = "out/view")]
    out: PathBuf,
    /// q: points per pixel of surface.
    #[arg(long, default_value_t = bevy_treeline::TreelineSettings::default().quality, allow_negative_numbers = true, value_parser = parse_quality)]
    quality: f32,
    /// Kernels that draw the points.
    #[arg(long, value_enum, default_value = "auto")]
    splat_path: SplatPathArg,
    #[command(flatten)]
    bake: BakeOptions,
}

/// Whether a window can be opened.
pub fn has_display() -> bool {
    if cfg!(any(target_os = "windows", target_os = "macos")) {
        return true;
    }
    // The window backend is X11, which Wayland desktops offer too.
    std::env::var_os("DISPLAY").is_some_and(|d| !d.is_empty())
}

pub fn run(args: &ViewArgs) -> ToolResult {
    if args.gallery {
        make_folder(&args.out)?;
        return gallery::run(args);
    }
    let source = match (&args.file, &args.species) {
        (_, Some(name)) => Source::plant(name, &args.plant)?,
        (file, None) => Source::File(file.clone().unwrap_or_default()),
    };
    let windowed = !args.headless && has_display();
    if !windowed {
        make_folder(&args.out)?;
    }
    let baked = source.bake(&args.bake.settings(), &args.bake.context()?)?;
    let data = &baked.data;
    println!(
        "{}: {} triangles, {} points (LDI {}, {} order), surface {:.1}, mean leaf {:.5}",
        source.label(),
        data.statistics.triangles,
        data.point_count(),
        data.statistics.ldi_size,
        data.statistics.order,
        data.surface_area,
        data.mean_leaf_area
    );
    if windowed {
        return window::run(&baked, args.splat_path.into(), args.quality, &args.out);
    }
    if !args.headless {
        println!("there is no display, so pictures are written (the same as --headless)");
    }
    sheet(args, &source.stem(), &baked)
}

/// Turntable and distance sweep, mesh and points side by side.
fn sheet(args: &ViewArgs, name: &str, baked: &Baked) -> ToolResult {
    let settings = bevy_treeline::TreelineSettings { quality: args.quality, ..Default::default() };
    let mut subject = Subject::new(baked, args.splat_path.into(), settings)?;
    let d0 = subject.d0;
    let mut shots = vec![];
    for turn in 0..4 {
        let azimuth = turn as f32 * std::f32::consts::FRAC_PI_2 + 0.4;
        shots.push((format!("{} deg", turn * 90), d0, azimuth, 0.15f32));
    }
    shots.push(("from above".into(), d0, 0.4, 1.2));
    for times in [0.5, 0.8, 0.94, 1.0, 2.0, 4.0, 8.0] {
        shots.push((format!("{times} d0"), d0 * times, 0.4, 0.15));
    }
    let bar = ProgressBar::new(shots.len() as u64 * 3);
    let mut cells = vec![];
    for (name, distance, azimuth, elevation) in shots {
        let size = subject.fitting_size(distance);
        let shot = Shot { distance, azimuth, elevation, size };
        for (technique, label) in [
            (Technique::Mesh, "mesh"),
            (Technique::Points, "points"),
            (Technique::Crossfade, "as in a game"),
        ] {
            let (mut picture, counters) = subject.render(technique, shot, 1)?;
            picture.pixels_mut().for_each(|p| p[3] = 255);
            let count = match technique {
                Technique::Mesh => String::new(),
                _ => format!(", {} pts", counters.points),
            };
            cells.push((format!("{name}: {label}{count}"), picture));
            bar.inc(1);
        }
    }
    bar.finish_and_clear();
    let path = args.out.join(format!("{name}.png"));
    write_png(&path, &contact_sheet(&cells, 6, 320))?;
    println!("d0 is {d0:.2}; pictures in {}", path.display());
    Ok(())
}
