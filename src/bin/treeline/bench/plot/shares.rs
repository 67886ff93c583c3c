//! Where the time of a frame goes: a bar for each configuration, cut into its parts.

use super::{
    canvas::{Canvas, Drawn, LINE, Pixel, Side, svg, text, text_width, title},
    curves::Column,
    palette::{FRAME, PAPER, PARTS},
};
use crate::bench::{format::figure, row::Row, scenario::position_text};
use plotters::prelude::*;

const BAR_WIDTH: i32 = 560;
const BAR: i32 = 18;
const STEP: i32 = 26;
const HEAD: i32 = 40;

/// Shares of `parts` (name and column, milliseconds) in their sum, for each row that has any. Nothing if none has.
pub fn time_shares(
    rows: &[&Row],
    heading: &str,
    parts: &[(&str, Column)],
) -> Option<Drawn<String>> {
    let bars: Vec<(String, Vec<f64>)> = rows
        .iter()
        .map(|row| {
            let times = parts.iter().map(|(_, column)| column(row).unwrap_or(0.0).max(0.0));
            (format!("{}, {}", row.technique, position_text(row)), times.collect())
        })
        .filter(|(_, times): &(String, Vec<f64>)| times.iter().sum::<f64>() > 0.0)
        .collect();
    // What no bar shows needs no place in the legend.
    let shown: Vec<usize> =
        (0..parts.len()).filter(|i| bars.iter().any(|(_, times)| times[*i] > 0.0)).collect();
    if shown.is_empty() {
        return None;
    }
    let names: Vec<&str> = shown.iter().map(|i| parts[*i].0).collect();
    let left = 20 + bars.iter().map(|(name, _)| text_width(name)).max().unwrap_or(0);
    let width = left + BAR_WIDTH + 110;
    let (places, lines) = legend_places(&names, left, width - 20);
    let top = HEAD + lines * LINE + 8;
    let height = top + bars.len() as i32 * STEP + 36;
    Some(svg(width, height, |canvas: &Canvas| {
        title(canvas, heading, (12, HEAD / 2))?;
        for (i, (x, y)) in std::iter::zip(&shown, &places) {
            let (x, y) = (*x, HEAD + y * LINE + LINE / 2);
            let colour = PARTS[i % PARTS.len()].filled();
            canvas.draw(&Rectangle::new([(x, y - 6), (x + 12, y + 6)], colour))?;
            text(canvas, parts[*i].0, (x + 18, y), Side::Right)?;
        }
        for (row, (name, times)) in bars.iter().enumerate() {
            let y = top + row as i32 * STEP;
            text(canvas, name, (left - 8, y + BAR / 2), Side::Left)?;
            let total: f64 = times.iter().sum();
            let (mut before, mut x) = (0.0, left);
            for i in &shown {
                before += times[*i];
                let end = left + (before / total * f64::from(BAR_WIDTH)).round() as i32;
                let colour = PARTS[i % PARTS.len()];
                canvas.draw(&Rectangle::new([(x, y), (end, y + BAR)], colour.filled()))?;
                // A seam, where the part is wide enough to keep its colour.
                if end - x > 3 && end < left + BAR_WIDTH {
                    canvas.draw(&PathElement::new([(end, y), (end, y + BAR)], PAPER))?;
                }
                x = end;
            }
            let sum = format!("{} ms", figure(total));
            text(canvas, &sum, (left + BAR_WIDTH + 8, y + BAR / 2), Side::Right)?;
        }
        percent_axis(canvas, (left, top + bars.len() as i32 * STEP))
    }))
}

fn percent_axis(canvas: &Canvas, (left, y): Pixel) -> Drawn {
    canvas.draw(&PathElement::new([(left, y), (left + BAR_WIDTH, y)], FRAME))?;
    for percent in [0, 25, 50, 75, 100] {
        let x = left + BAR_WIDTH * percent / 100;
        canvas.draw(&PathElement::new([(x, y), (x, y + 4)], FRAME))?;
        text(canvas, &format!("{percent} %"), (x, y + 16), Side::Middle)?;
    }
    Ok(())
}

/// Where each name of a legend goes (pixels across, line), in lines no longer than to `right`; and the number of lines.
fn legend_places(names: &[&str], left: i32, right: i32) -> (Vec<Pixel>, i32) {
    let (mut x, mut line) = (left, 0);
    let places = names.iter().map(|name| {
        let width = 18 + text_width(name);
        if x + width > right && x > left {
            (x, line) = (left, line + 1);
        }
        let place = (x, line);
        x += width + 16;
        place
    });
    let places: Vec<Pixel> = places.collect();
    (places, line + 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_legends_go_on_in_the_next_line() {
        let (places, lines) = legend_places(&["resolve", "opaque meshes", "other"], 100, 300);
        assert_eq!(lines, 2);
        assert_eq!(places[0], (100, 0));
        assert_eq!(places[2].0.min(places[1].0), 100);
    }

    #[test]
    fn rows_without_times_have_no_bar() {
        let parts: &[(&str, Column)] = &[("splat", |row| row.gpu_ms_splat)];
        let (bare, timed) = (Row::default(), Row { gpu_ms_splat: Some(2.0), ..Default::default() });
        assert!(time_shares(&[&bare], "GPU", parts).is_none());
        let drawn = time_shares(&[&bare, &timed], "GPU", parts).expect("one").expect("draws");
        assert_eq!(drawn.matches(" ms").count(), 1);
    }
}
