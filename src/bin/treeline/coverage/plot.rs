//! Coverage and luminance against distance, as SVG.

use super::Row;
use crate::options::{ToolError, ToolResult};
use plotters::prelude::*;
use std::path::Path;

/// Ratios that the plot shows at least.
const RANGE: std::ops::Range<f64> = 0.8..1.2;
/// Room above and below what goes beyond.
const MARGIN: f64 = 0.02;
/// The error that is aimed at.
const AIM: f64 = 0.02;

pub fn write(rows: &[Row], file: &Path) -> ToolResult {
    draw(rows, file).map_err(|error| ToolError::write(file, error))
}

fn draw(rows: &[Row], file: &Path) -> Result<(), Box<dyn std::error::Error>> {
    let (Some(first), Some(last)) = (rows.first(), rows.last()) else { return Ok(()) };
    let root = SVGBackend::new(file, (900, 480)).into_drawing_area();
    root.fill(&WHITE)?;
    let across = (f64::from(first.distance_d0)..f64::from(last.distance_d0)).log_scale();
    let mut chart = ChartBuilder::on(&root)
        .margin(12)
        .x_label_area_size(40)
        .y_label_area_size(60)
        .caption("points / mesh, against distance", ("sans-serif", 20))
        .build_cartesian_2d(across, range(rows))?;
    chart.configure_mesh().x_desc("distance / d0").y_desc("ratio, 1 is the mesh").draw()?;
    let (near, far) = (f64::from(first.distance_d0), f64::from(last.distance_d0));
    let aim = [(near, 1.0 - AIM), (far, 1.0 + AIM)];
    chart.draw_series([Rectangle::new(aim, GREEN.mix(0.15).filled())])?;
    let of = |row: &Row, ratio: f64| (f64::from(row.distance_d0), ratio);
    for (name, color, ratio) in [
        ("coverage", BLUE, (|row| row.coverage) as fn(&Row) -> f64),
        ("mean luminance", RED, |row| row.luminance),
    ] {
        let line =
            LineSeries::new(rows.iter().map(|row| of(row, ratio(row))), color.stroke_width(2));
        chart
            .draw_series(line)?
            .label(name)
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], color.stroke_width(2)));
    }
    chart.configure_series_labels().background_style(WHITE.mix(0.8)).border_style(BLACK).draw()?;
    root.present()?;
    Ok(())
}

fn range(rows: &[Row]) -> std::ops::Range<f64> {
    let ratios = rows.iter().flat_map(|row| [row.coverage, row.luminance]);
    ratios
        .filter(|ratio| ratio.is_finite())
        .fold(RANGE, |range, ratio| range.start.min(ratio - MARGIN)..range.end.max(ratio + MARGIN))
}
