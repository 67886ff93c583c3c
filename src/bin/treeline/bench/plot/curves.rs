//! The plots with a curve for each technique: cost, memory and error.

use super::{
    axis::Axis,
    canvas::{Canvas, Drawn, LINE, legend, legend_width, svg},
    palette::Look,
    panel::{Curve, HEIGHT, Level, Panel, WIDTH},
};
use crate::bench::{
    row::Row,
    scenario::{position, position_name, position_text},
};

pub type Column = fn(&Row) -> Option<f64>;

/// A figure against the number of trees (or the distance of one), for each of `figures` (title, unit, column) a panel; both axes logarithmic.
/// Nothing if no row has any.
pub fn against_position(
    rows: &[&Row],
    looks: &[Look],
    figures: &[(&str, &str, Column)],
) -> Option<Drawn<String>> {
    let panels: Vec<Panel> = figures
        .iter()
        .filter_map(|(title, unit, column)| {
            let curves = curves(rows, looks, |row| Some((position(row), column(row)?, None)));
            Some(Panel {
                title: (*title).to_owned(),
                x: Axis::at(position_name(rows), &all(&curves, 0))?,
                y: Axis::logarithmic(unit, all(&curves, 1))?,
                curves,
                levels: vec![],
            })
        })
        .collect();
    (!panels.is_empty()).then(|| beside_each_other(&panels, looks))
}

/// FLIP against the points drawn, with those techniques that draw none as levels: at the position where most of
/// them have an error.
pub fn flip_against_points(rows: &[&Row], looks: &[Look]) -> Option<Drawn<String>> {
    let curves = curves(rows, looks, |row| {
        Some((row.points_drawn? as f64, row.flip_mean?, Some(position_text(row))))
    });
    let peers = || rows.iter().filter(|row| row.points_drawn.is_none() && row.flip_mean.is_some());
    let peers_at = |at: f64| peers().filter(|row| position(row) == at).count();
    let at = peers().map(|row| position(row)).min_by(|a, b| {
        // Among equals the nearest to the start.
        peers_at(*b).cmp(&peers_at(*a)).then(a.total_cmp(b))
    });
    let levels: Vec<Level> = peers()
        .filter(|row| Some(position(row)) == at)
        .filter_map(|row| {
            let look = looks.iter().find(|look| look.technique == row.technique)?;
            let name = format!("{}, {}", row.technique, position_text(row));
            Some(Level { look, value: row.flip_mean?, name })
        })
        .collect();
    let errors = all(&curves, 1).into_iter().chain(levels.iter().map(|level| level.value));
    let panel = Panel {
        title: "Error against points".to_owned(),
        x: Axis::logarithmic("points drawn in a frame", all(&curves, 0))?,
        y: Axis::from_zero("FLIP (mean; 0 is equal)", errors)?,
        curves,
        levels,
    };
    Some(beside_each_other(&[panel], looks))
}

/// What a picture costs and how far it is from the truth: down and to the left is better. Both error measures, since each
/// can be fooled alone.
pub fn error_against_cost(rows: &[&Row], looks: &[Look]) -> Option<Drawn<String>> {
    let errors: [(&str, &str, Column); 2] = [
        ("Lost density and colour against cost", "block RMSE (0 is equal)", |row| row.block_rmse),
        ("Visible error against cost", "FLIP (mean; 0 is equal)", |row| row.flip_mean),
    ];
    let panels: Vec<Panel> = errors
        .iter()
        .filter_map(|(title, unit, column)| {
            let curves = curves(rows, looks, |row| {
                Some((row.cpu_s_per_frame?, column(row)?, Some(position_text(row))))
            });
            Some(Panel {
                title: (*title).to_owned(),
                x: Axis::logarithmic("CPU seconds per frame", all(&curves, 0))?,
                y: Axis::from_zero(unit, all(&curves, 1))?,
                curves,
                levels: vec![],
            })
        })
        .collect();
    (!panels.is_empty()).then(|| beside_each_other(&panels, looks))
}

/// A curve for each technique that has a point, along growing numbers of instances.
fn curves<'a>(
    rows: &[&Row],
    looks: &'a [Look],
    point: impl Fn(&Row) -> Option<(f64, f64, Option<String>)>,
) -> Vec<Curve<'a>> {
    let curve = |look: &'a Look| {
        let mut own: Vec<&&Row> = rows.iter().filter(|r| r.technique == look.technique).collect();
        own.sort_by(|a, b| position(a).total_cmp(&position(b)));
        // Neither 0 nor below has a logarithm; no figure is below.
        let points = own.into_iter().filter_map(|row| point(row)).filter(|(x, ..)| *x > 0.0);
        Curve { look, points: points.collect() }
    };
    looks.iter().map(curve).filter(|curve| !curve.points.is_empty()).collect()
}

/// All values of the curves along an axis: 0 across, 1 upright.
fn all(curves: &[Curve], axis: usize) -> Vec<f64> {
    let points = curves.iter().flat_map(|curve| &curve.points);
    points.map(|(x, y, _)| [*x, *y][axis]).collect()
}

/// Panels from left to right, then one legend for all of them.
fn beside_each_other(panels: &[Panel], looks: &[Look]) -> Drawn<String> {
    let is_used = |look: &&Look| {
        panels.iter().any(|panel| {
            let curves = panel.curves.iter().map(|curve| curve.look);
            let mut used = curves.chain(panel.levels.iter().map(|level| level.look));
            used.any(|used| used.technique == look.technique)
        })
    };
    let looks: Vec<&Look> = looks.iter().filter(is_used).collect();
    let width = WIDTH * panels.len() as i32 + legend_width(&looks);
    let height = HEIGHT.max(looks.len() as i32 * LINE + 60);
    svg(width, height, |canvas: &Canvas| {
        for (i, panel) in panels.iter().enumerate() {
            panel.draw(canvas, (i as i32 * WIDTH, 0))?;
        }
        legend(canvas, &looks, (WIDTH * panels.len() as i32 + 4, 46))
    })
}
