//! `treeline compare --coverage`: coverage and mean luminance of points against those of the full mesh, from half of `d0` to
//! where the tree covers one pixel, as a table, CSV and a plot.

mod plot;
mod wall;

use crate::{
    options::{ToolError, ToolResult, write_file},
    subject::z0,
};
use bevy_treeline::{SplatPath, TreelineSettings, bake::Baked, lod::prefix_count};
use serde::Serialize;
use std::path::Path;
use wall::{Technique, Wall};

/// Pixels along a side of the largest picture, and of one that has enough trees in less.
const LARGEST: f32 = 4096.0;
const ENOUGH: f32 = 1536.0;
/// Trees along a side of a wall: of the largest, which holds noise at one pixel below 1 %, and of one that shows trees from
/// enough sides.
const MOST_TREES: u32 = 128;
const FEWEST_TREES: u32 = 6;
/// The same for the wall of the truth.
const TRUTH_TREES: u32 = 8;

/// What was found at one distance.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// In `d0`.
    pub distance_d0: f32,
    /// World units.
    pub distance: f32,
    /// Pixels that the mesh covers, supersampled.
    pub covered_pixels: f64,
    /// Points a tree.
    pub points: f64,
    /// Coverage of points / of the mesh, 1 is right.
    pub coverage: f64,
    /// Mean luminance of points / of the mesh, 1 is right.
    pub luminance: f64,
}

pub fn run(
    baked: &Baked,
    splat_path: SplatPath,
    settings: &TreelineSettings,
    out: &Path,
) -> ToolResult {
    // Hundreds of trees with all their points.
    let settings = TreelineSettings { point_capacity_millions: 160.0, ..settings.clone() };
    let mut wall = Wall::new(baked, splat_path, settings)?;
    // Sampled at the middle of pixels, so without bias however coarse; fine enough to be without noise.
    let truth = wall.draw(Technique::Mesh, TRUTH_TREES, LARGEST / TRUTH_TREES as f32)?;
    let (coverage, luminance) = (truth.coverage(), truth.luminance());
    if coverage <= 0.0 {
        return Err(ToolError::Message("the mesh covers nothing".into()));
    }
    let d0 = prefix_count::d0(baked.data.pixel, z0());
    println!(
        "N0 {}, A {:.1}, a tree covers {coverage:.2} of its area, luminance {luminance:.4}",
        baked.data.point_count(),
        baked.data.surface_area
    );
    println!("   d/d0  distance    pixels    points  coverage  luminance");
    let mut rows: Vec<Row> = vec![];
    for step in -4.. {
        let distance_d0 = 2f32.powf(step as f32 * 0.25);
        let unit = baked.data.pixel * distance_d0;
        let covered_pixels = coverage / f64::from(unit * unit);
        if covered_pixels < 0.7 {
            break;
        }
        let cell_px = wall.cell / unit;
        let fits = |pixels: f32| (pixels / cell_px) as u32;
        let side = fits(ENOUGH).clamp(FEWEST_TREES, MOST_TREES).min(fits(LARGEST)).max(2);
        let points = wall.draw(Technique::Points, side, cell_px)?;
        let row = Row {
            distance_d0,
            distance: distance_d0 * d0,
            covered_pixels,
            points: f64::from(points.points) / f64::from(points.trees),
            coverage: points.coverage() / coverage,
            luminance: points.luminance() / luminance,
        };
        println!(
            "{:7.2} {:9.1} {:9.1} {:9.1} {:9.3} {:10.3}",
            row.distance_d0,
            row.distance,
            row.covered_pixels,
            row.points,
            row.coverage,
            row.luminance
        );
        rows.push(row);
    }
    let mut csv = csv::Writer::from_writer(vec![]);
    let file = out.join("coverage.csv");
    for row in &rows {
        csv.serialize(row).map_err(|error| ToolError::write(&file, error))?;
    }
    write_file(&file, &csv.into_inner().map_err(|error| ToolError::write(&file, error))?)?;
    plot::write(&rows, &out.join("coverage.svg"))?;
    println!("coverage.csv, coverage.svg in {}", out.display());
    Ok(())
}
