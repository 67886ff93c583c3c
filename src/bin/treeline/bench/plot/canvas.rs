//! What all plots are made of: an SVG, text, marks and legends. Places are in pixels of the whole picture.

use super::palette::{INK, Look, Mark, PAPER};
use plotters::{
    coord::Shift,
    element::DashedPathElement,
    prelude::*,
    style::text_anchor::{HPos, Pos, VPos},
};

pub type Canvas<'a> = DrawingArea<SVGBackend<'a>, Shift>;
pub type Pixel = (i32, i32);
/// An SVG is kept in memory: only a mistake in a plot can fail.
pub type Drawn<T = ()> = Result<T, DrawingAreaErrorKind<std::io::Error>>;

/// Family and size of the text of a plot; an SVG's letters are an eighth smaller than plotters counts them.
pub const FONT: (&str, i32) = ("sans-serif", 15);
const TITLE_FONT: (&str, i32, FontStyle) = ("sans-serif", 16, FontStyle::Bold);
/// Between lines of text.
pub const LINE: i32 = 20;

/// Draws a picture of that size on paper.
pub fn svg(width: i32, height: i32, draw: impl FnOnce(&Canvas) -> Drawn) -> Drawn<String> {
    let mut text = String::new();
    {
        let canvas =
            SVGBackend::with_string(&mut text, (width as u32, height as u32)).into_drawing_area();
        canvas.fill(&PAPER)?;
        draw(&canvas)?;
        canvas.present()?;
    }
    Ok(text)
}

/// Where a text lies about its place, from left to right; it is centred in height.
#[derive(Clone, Copy)]
pub enum Side {
    /// The text begins there.
    Right,
    /// The text ends there.
    Left,
    Middle,
}

pub fn text(canvas: &Canvas, text: &str, at: Pixel, side: Side) -> Drawn {
    let horizontal = match side {
        Side::Right => HPos::Left,
        Side::Left => HPos::Right,
        Side::Middle => HPos::Center,
    };
    let style = FONT.into_text_style(canvas).color(&INK).pos(Pos::new(horizontal, VPos::Center));
    canvas.draw_text(text, &style, at)
}

pub fn title(canvas: &Canvas, text: &str, at: Pixel) -> Drawn {
    let style = TITLE_FONT.into_text_style(canvas).color(&INK);
    canvas.draw_text(text, &style.pos(Pos::new(HPos::Left, VPos::Center)), at)
}

/// Width of a text, on the safe side: there is no font to ask.
pub fn text_width(text: &str) -> i32 {
    (text.chars().count() as f64 * 7.1).ceil() as i32
}

pub fn mark(canvas: &Canvas, look: &Look, (x, y): Pixel) -> Drawn {
    let polygon = |corners: &[Pixel]| {
        let corners: Vec<Pixel> = corners.iter().map(|(dx, dy)| (x + dx, y + dy)).collect();
        canvas.draw(&Polygon::new(corners, look.colour.filled()))
    };
    match look.mark {
        Mark::Disc => canvas.draw(&Circle::new((x, y), 4, look.colour.filled())),
        Mark::Square => polygon(&[(-4, -4), (4, -4), (4, 4), (-4, 4)]),
        Mark::Triangle => polygon(&[(0, -5), (5, 4), (-5, 4)]),
        Mark::Diamond => polygon(&[(0, -6), (6, 0), (0, 6), (-6, 0)]),
        Mark::Ring => {
            canvas.draw(&Circle::new((x, y), 4, PAPER.filled()))?;
            canvas.draw(&Circle::new((x, y), 4, look.colour.stroke_width(2)))
        }
    }
}

/// A line through the places, dashed for variants.
pub fn line(canvas: &Canvas, look: &Look, places: Vec<Pixel>) -> Drawn {
    let style = look.colour.stroke_width(2);
    if look.dashed {
        canvas.draw(&DashedPathElement::new(places, 6, 4, style))
    } else {
        canvas.draw(&PathElement::new(places, style))
    }
}

const SAMPLE: i32 = 30;

/// Width of a legend of these techniques.
pub fn legend_width(looks: &[&Look]) -> i32 {
    SAMPLE + 22 + looks.iter().map(|look| text_width(&look.technique)).max().unwrap_or(0)
}

/// One technique a line, from `at` downwards.
pub fn legend(canvas: &Canvas, looks: &[&Look], (x, y): Pixel) -> Drawn {
    for (i, look) in looks.iter().enumerate() {
        let y = y + i as i32 * LINE;
        line(canvas, look, vec![(x, y), (x + SAMPLE, y)])?;
        mark(canvas, look, (x + SAMPLE / 2, y))?;
        text(canvas, &look.technique, (x + SAMPLE + 8, y), Side::Right)?;
    }
    Ok(())
}
