//! One pair of axes with curves in it.

use super::{
    axis::Axis,
    canvas::{Canvas, Drawn, FONT, Pixel, Side, line, mark, text, text_width, title},
    palette::{FRAME, GRID, INK, Look},
};
use plotters::prelude::*;

/// Width and height of a panel with its axes and title.
pub const WIDTH: i32 = 430;
pub const HEIGHT: i32 = 380;
const TITLE_HEIGHT: i32 = 30;

pub struct Curve<'a> {
    pub look: &'a Look,
    /// Values along both axes, and what is written beside them if there is room.
    pub points: Vec<(f64, f64, Option<String>)>,
}

/// A value along the upright axis, as a line across.
pub struct Level<'a> {
    pub look: &'a Look,
    pub value: f64,
    pub name: String,
}

pub struct Panel<'a> {
    pub title: String,
    pub x: Axis,
    pub y: Axis,
    pub curves: Vec<Curve<'a>>,
    pub levels: Vec<Level<'a>>,
}

impl Panel<'_> {
    /// Draws it with its upper left corner at `at`.
    pub fn draw(&self, canvas: &Canvas, at: Pixel) -> Drawn {
        title(canvas, &self.title, (at.0 + 12, at.1 + TITLE_HEIGHT / 2))?;
        let top = at.1 + TITLE_HEIGHT;
        let frame = canvas
            .clone()
            .shrink((at.0 as u32, top as u32), (WIDTH as u32, (HEIGHT - TITLE_HEIGHT) as u32));
        let mut chart = ChartBuilder::on(&frame)
            .margin_left(4)
            .margin_right(20)
            .margin_top(6)
            .margin_bottom(8)
            .x_label_area_size(48)
            .y_label_area_size(64)
            .build_cartesian_2d(self.x.clone(), self.y.clone())?;
        let ink = FONT.into_text_style(canvas).color(&INK);
        chart
            .configure_mesh()
            .bold_line_style(GRID)
            .light_line_style(TRANSPARENT)
            .axis_style(FRAME)
            .x_desc(&*self.x.label)
            .y_desc(&*self.y.label)
            .label_style(ink.clone())
            .axis_desc_style(ink)
            .draw()?;
        let pixel = |x: f64, y: f64| chart.backend_coord(&(x, y));
        let edges = chart.plotting_area().get_pixel_range();

        let mut taken: Vec<Room> = vec![];
        for level in &self.levels {
            let y = pixel(self.x.from, level.value).1;
            let ends = [(edges.0.start, y), (edges.0.end, y)];
            line(canvas, level.look, ends.to_vec())?;
            taken.extend(Room::along(ends));
        }
        let mut notes: Vec<(Pixel, &str)> = vec![];
        for curve in &self.curves {
            let places: Vec<Pixel> = curve.points.iter().map(|(x, y, _)| pixel(*x, *y)).collect();
            line(canvas, curve.look, places.clone())?;
            taken.extend(places.windows(2).flat_map(|ends| Room::along([ends[0], ends[1]])));
            for (place, (_, _, note)) in std::iter::zip(&places, &curve.points) {
                mark(canvas, curve.look, *place)?;
                taken.push(Room::around(*place, 6, 6));
                notes.extend(note.as_deref().map(|note| (*place, note)));
            }
        }
        // Names of levels first: without them a line says nothing.
        for level in &self.levels {
            let y = pixel(self.x.from, level.value).1;
            let half = text_width(&level.name) / 2;
            let ends = [edges.0.end - half - 6, edges.0.start + half + 8];
            let spots = [-10, 11].into_iter().flat_map(|dy| ends.map(|x| (x, y + dy)));
            note(canvas, &level.name, spots, &edges, &mut taken)?;
        }
        for ((x, y), name) in notes {
            let aside = text_width(name) / 2 + 10;
            let spots = [(x + aside, y), (x, y - 16), (x, y + 16), (x - aside, y)];
            note(canvas, name, spots, &edges, &mut taken)?;
        }
        Ok(())
    }
}

type Edges = (std::ops::Range<i32>, std::ops::Range<i32>);

/// Writes `name` in the middle of the first of `spots` that is free and inside `edges`; nowhere if there is none.
fn note(
    canvas: &Canvas,
    name: &str,
    spots: impl IntoIterator<Item = Pixel>,
    edges: &Edges,
    taken: &mut Vec<Room>,
) -> Drawn {
    let rooms = spots.into_iter().map(|spot| (spot, Room::around(spot, text_width(name) / 2, 8)));
    let free = |room: &Room| room.inside(edges) && !taken.iter().any(|other| other.meets(room));
    let Some((spot, room)) = rooms.into_iter().find(|(_, room)| free(room)) else { return Ok(()) };
    taken.push(room);
    text(canvas, name, spot, Side::Middle)
}

/// A rectangle that something is drawn in.
#[derive(Clone, Copy, Debug)]
struct Room {
    low: Pixel,
    high: Pixel,
}

impl Room {
    fn around((x, y): Pixel, half_width: i32, half_height: i32) -> Self {
        Self { low: (x - half_width, y - half_height), high: (x + half_width, y + half_height) }
    }

    /// What a line takes: rooms close to each other along it.
    fn along([from, to]: [Pixel; 2]) -> impl Iterator<Item = Self> {
        let (dx, dy) = (to.0 - from.0, to.1 - from.1);
        let steps = (dx.abs().max(dy.abs()) / 4).max(1);
        (0..=steps).map(move |i| {
            let place = (from.0 + dx * i / steps, from.1 + dy * i / steps);
            Self::around(place, 2, 1)
        })
    }

    fn meets(&self, other: &Self) -> bool {
        self.low.0 < other.high.0
            && other.low.0 < self.high.0
            && self.low.1 < other.high.1
            && other.low.1 < self.high.1
    }

    fn inside(&self, (across, upright): &Edges) -> bool {
        self.low.0 >= across.start
            && self.high.0 <= across.end
            && self.low.1 >= upright.start
            && self.high.1 <= upright.end
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::plot::canvas::svg;

    #[test]
    fn notes_never_lie_on_each_other() {
        let edges = (0..200, 0..100);
        let mut taken = vec![];
        let drawn = svg(200, 100, |canvas| {
            for _ in 0..3 {
                note(canvas, "1k", [(50, 50), (50, 70)], &edges, &mut taken)?;
            }
            note(canvas, "outside", [(199, 50)], &edges, &mut taken)
        });
        assert_eq!(drawn.expect("draws").matches("<text").count(), 2);
        assert!(!taken[0].meets(&taken[1]));
    }
}
