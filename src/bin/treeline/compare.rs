//! `treeline compare`: the error of points and of the one-sample mesh against the supersampled mesh, by distance.

use crate::{
    flip::{CropRect, flip},
    options::{
        BakeOptions, SplatArg, SplatPathArg, ToolError, ToolResult, bake_with_progress,
        make_folder, parse_quality, write_file, write_png,
    },
    sheet::contact_sheet,
    subject::{Shot, Subject, Technique},
};
use bevy_treeline::TreelineSettings;
use bevy_treeline::math::image_error::{block_rmse, coverage_error};
use clap::Args;
use image::RgbaImage;
use indicatif::ProgressBar;
use serde::Serialize;
use std::path::PathBuf;

#[derive(Args)]
pub struct CompareArgs {
    /// A model: .glb, .gltf, .obj or .ply.
    file: PathBuf,
    /// Distances in model units, from the middle of the tree (default: d0/2, d0, 2 d0, 4 d0, 8 d0).
    #[arg(long, value_delimiter = ',', allow_negative_numbers = true)]
    distances: Vec<f32>,
    /// Write the figures to this file.
    #[arg(long)]
    json: Option<PathBuf>,
    /// Folder for pictures.
    #[arg(long, default_value = "out/compare")]
    out: PathBuf,
    /// q: points per pixel of surface.
    #[arg(long, default_value_t = TreelineSettings::default().quality, allow_negative_numbers = true, value_parser = parse_quality)]
    quality: f32,
    /// Overlap of splats, 0 to 1.
    #[arg(long, default_value_t = TreelineSettings::default().overlap_gain)]
    overlap: f32,
    /// Strength of the contrast correction, 0 to 1.
    #[arg(long, default_value_t = TreelineSettings::default().contrast, allow_negative_numbers = true)]
    contrast: f32,
    /// Instead: frame times of 50 instances at d0 to 8 d0, as points (q 1) and as meshes (the paper's Table 2).
    #[arg(long)]
    table2: bool,
    /// Instead: coverage and mean luminance against distance, from d0/2 to where the tree covers a pixel.
    #[arg(long, conflicts_with = "table2")]
    coverage: bool,
    /// Shape of the splats.
    #[arg(long, value_enum, default_value = "cells")]
    splats: SplatArg,
    /// Samples of the reference along each side of a pixel (4: 16 samples).
    #[arg(long, default_value_t = 4, value_parser = clap::value_parser!(u32).range(4..=8))]
    supersample: u32,
    /// Where from: degrees about the vertical.
    #[arg(long, default_value_t = 30.0, allow_negative_numbers = true)]
    azimuth: f32,
    /// Where from: degrees above the horizon.
    #[arg(long, default_value_t = 10.0, allow_negative_numbers = true)]
    elevation: f32,
    /// Kernels that draw the points.
    #[arg(long, value_enum, default_value = "auto")]
    splat_path: SplatPathArg,
    #[command(flatten)]
    bake: BakeOptions,
}

#[derive(Serialize)]
struct Report {
    file: String,
    d0: f32,
    quality: f32,
    order: String,
    rows: Vec<Row>,
}

#[derive(Serialize)]
struct Row {
    distance: f32,
    points: u32,
    flip_mean: f32,
    flip_p95: f32,
    block_rmse: f32,
    mesh_flip_mean: f32,
    mesh_flip_p95: f32,
    mesh_block_rmse: f32,
    coverage_error: f32,
    mesh_coverage_error: f32,
    width: u32,
    height: u32,
}

/// Of a picture against a reference.
pub struct Errors {
    /// FLIP.
    pub mean: f32,
    pub p95: f32,
    /// RMSE of means of 16 × 16 pixels.
    pub block: f32,
    coverage: f32,
    /// FLIP of each pixel, as colours.
    pub map: RgbaImage,
}

/// The box of pixels where the reference shows the tree, with a margin of 2.
pub fn tree_box(reference: &RgbaImage) -> Option<CropRect> {
    let covered = reference.enumerate_pixels().filter(|(_, _, p)| p[3] > 0);
    let bounds = covered.fold(None, |b: Option<[u32; 4]>, (x, y, _)| {
        let [x0, y0, x1, y1] = b.unwrap_or([x, y, x, y]);
        Some([x0.min(x), y0.min(y), x1.max(x), y1.max(y)])
    })?;
    let (x, y) = (bounds[0].saturating_sub(2), bounds[1].saturating_sub(2));
    let width = (bounds[2] + 3).min(reference.width()) - x;
    let height = (bounds[3] + 3).min(reference.height()) - y;
    Some(CropRect { x, y, width, height })
}

/// Errors of `test` within `crop`.
pub fn errors(reference: &RgbaImage, test: &RgbaImage, crop: CropRect) -> ToolResult<Errors> {
    let message = |error: &dyn std::fmt::Display| ToolError::Message(error.to_string());
    let report = flip(reference, test, crop).map_err(|e| message(&e))?;
    let cut = |image: &RgbaImage| {
        image::imageops::crop_imm(image, crop.x, crop.y, crop.width, crop.height).to_image()
    };
    let (a, b) = (cut(test), cut(reference));
    let block = block_rmse(&a, &b, crop.width, crop.height, 16).map_err(|e| message(&e))?;
    let alpha = |image: &RgbaImage| image.pixels().map(|p| p[3]).collect::<Vec<_>>();
    let coverage = coverage_error(alpha(&a), alpha(&b));
    Ok(Errors { mean: report.mean, p95: report.p95, block, coverage, map: report.error_map })
}

pub fn run(args: &CompareArgs) -> ToolResult {
    if let Some(bad) = args.distances.iter().find(|d| !(d.is_finite() && **d > 0.0)) {
        return Err(ToolError::Message(format!(
            "--distances: {bad} is not a distance; give numbers above 0"
        )));
    }
    if args.table2 {
        let baked = bake_with_progress(&args.file, &args.bake.settings(), &args.bake.context()?)?;
        return crate::table2::run(&baked, args.splat_path.into());
    }
    for (name, value, range) in [
        ("--overlap", args.overlap, 0.0..=1.0),
        ("--contrast", args.contrast, 0.0..=1.0),
        ("--azimuth", args.azimuth, -360.0..=360.0),
        ("--elevation", args.elevation, -89.0..=89.0),
    ] {
        if !range.contains(&value) {
            return Err(ToolError::Message(format!(
                "{name} is {value}, but must be {} to {}",
                range.start(),
                range.end()
            )));
        }
    }
    make_folder(&args.out)?;
    let baked = bake_with_progress(&args.file, &args.bake.settings(), &args.bake.context()?)?;
    let settings = TreelineSettings {
        quality: args.quality,
        overlap_gain: args.overlap,
        contrast: args.contrast,
        splat_shape: args.splats.into(),
        ..Default::default()
    };
    if args.coverage {
        return crate::coverage::run(&baked, args.splat_path.into(), &settings, &args.out);
    }
    let mut subject = Subject::new(&baked, args.splat_path.into(), settings)?;
    let d0 = subject.d0;
    let distances = if args.distances.is_empty() {
        [0.5, 1.0, 2.0, 4.0, 8.0].map(|k| k * d0).to_vec()
    } else {
        args.distances.clone()
    };
    println!(
        "{}: N0 {}, d0 {d0:.2}, q {}, {} order",
        args.file.display(),
        baked.data.point_count(),
        args.quality,
        baked.data.statistics.order
    );
    println!(
        "distance   points | points: FLIP    p95  block RMSE  coverage | mesh 1x: FLIP    p95  block RMSE"
    );
    let bar = ProgressBar::new(distances.len() as u64 * 3);
    let mut report = Report {
        file: args.file.display().to_string(),
        d0,
        quality: args.quality,
        order: baked.data.statistics.order.clone(),
        rows: vec![],
    };
    let mut cells = vec![];
    for distance in distances {
        let shot = Shot {
            distance,
            azimuth: args.azimuth.to_radians(),
            elevation: args.elevation.to_radians(),
            size: subject.fitting_size(distance),
        };
        let (reference, _) = subject.render(Technique::Mesh, shot, args.supersample)?;
        bar.inc(1);
        let (mesh, _) = subject.render(Technique::Mesh, shot, 1)?;
        bar.inc(1);
        let (points, counters) = subject.render(Technique::Points, shot, 1)?;
        bar.inc(1);
        let Some(crop) = tree_box(&reference) else {
            return Err(ToolError::Message(format!(
                "at distance {distance} the tree covers no pixel; give smaller --distances (d0 is {d0:.2})"
            )));
        };
        let (p, m) = (errors(&reference, &points, crop)?, errors(&reference, &mesh, crop)?);
        bar.suspend(|| {
            println!(
                "{distance:8.2} {:8} | {:12.4} {:6.3} {:11.4} {:8.1} % | {:13.4} {:6.3} {:11.4}",
                counters.points,
                p.mean,
                p.p95,
                p.block,
                p.coverage * 100.0,
                m.mean,
                m.p95,
                m.block
            );
        });
        let tag = format!("{distance:.1}");
        for (name, image) in [
            ("reference", &reference),
            ("mesh", &mesh),
            ("points", &points),
            ("mesh_error", &m.map),
            ("points_error", &p.map),
        ] {
            let file = args.out.join(format!("{name}_{tag}.png"));
            // The background is opaque in files: alpha here is coverage.
            let mut opaque = image.clone();
            opaque.pixels_mut().for_each(|pixel| pixel[3] = 255);
            write_png(&file, &opaque)?;
            let cut = if name.ends_with("error") {
                opaque
            } else {
                image::imageops::crop_imm(&opaque, crop.x, crop.y, crop.width, crop.height)
                    .to_image()
            };
            let label = match name {
                "reference" => format!("reference at {tag}"),
                "mesh" => format!("mesh 1x, FLIP {:.3}", m.mean),
                "points" => format!("{} points, FLIP {:.3}", counters.points, p.mean),
                "mesh_error" => format!("block {:.4}", m.block),
                _ => format!("block {:.4}, cover {:.1} %", p.block, p.coverage * 100.0),
            };
            cells.push((label, cut));
        }
        report.rows.push(Row {
            distance,
            points: counters.points,
            flip_mean: p.mean,
            flip_p95: p.p95,
            block_rmse: p.block,
            mesh_flip_mean: m.mean,
            mesh_flip_p95: m.p95,
            mesh_block_rmse: m.block,
            coverage_error: p.coverage,
            mesh_coverage_error: m.coverage,
            width: crop.width,
            height: crop.height,
        });
    }
    bar.finish_and_clear();
    write_png(&args.out.join("sheet.png"), &contact_sheet(&cells, 5, 360))?;
    println!("pictures in {}", args.out.display());
    if let Some(json) = &args.json {
        let text =
            serde_json::to_string_pretty(&report).map_err(|error| ToolError::write(json, error))?;
        write_file(json, text.as_bytes())?;
    }
    Ok(())
}
