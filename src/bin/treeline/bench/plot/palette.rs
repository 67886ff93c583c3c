//! Colours and marks of techniques: a colour for each technique, a mark and a dash for each of its variants.

use crate::bench::row::Row;
use plotters::style::RGBColor;

pub const PAPER: RGBColor = RGBColor(255, 255, 255);
pub const INK: RGBColor = RGBColor(51, 51, 51);
pub const GRID: RGBColor = RGBColor(225, 225, 225);
pub const FRAME: RGBColor = RGBColor(136, 136, 136);

/// Of Okabe and Ito ("Color Universal Design", 2008), told apart with any colour vision, without black and yellow, which do
/// not show on dark and on light paper.
pub const COLOURS: [RGBColor; 6] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(230, 159, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(86, 180, 233),
];

/// For parts of a whole, of which there may be more: the same, then darker ones.
pub const PARTS: [RGBColor; 9] = [
    COLOURS[3],
    COLOURS[0],
    COLOURS[5],
    RGBColor(0, 73, 73),
    COLOURS[2],
    COLOURS[4],
    RGBColor(146, 73, 0),
    COLOURS[1],
    RGBColor(153, 153, 153),
];

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mark {
    Disc,
    Square,
    Triangle,
    Diamond,
    Ring,
}

const MARKS: [Mark; 5] = [Mark::Disc, Mark::Square, Mark::Triangle, Mark::Diamond, Mark::Ring];

/// How a technique looks in every plot of a report.
#[derive(Clone, Debug)]
pub struct Look {
    pub technique: String,
    pub colour: RGBColor,
    pub mark: Mark,
    /// Variants are dashed, so that they stand apart where lines are close.
    pub dashed: bool,
}

/// One look for each technique, in the order of the legend: those of the same base together, in order of appearance.
pub fn looks(rows: &[Row]) -> Vec<Look> {
    // Fixed colours, so that two reports look alike.
    let mut bases = vec!["points", "stock", "lod", "meshlet"];
    for row in rows {
        if !bases.contains(&row.base_technique()) {
            bases.push(row.base_technique());
        }
    }
    let mut looks: Vec<Look> = vec![];
    for (colour, base) in std::iter::zip(COLOURS.iter().cycle(), &bases) {
        let mut variants: Vec<&str> = vec![];
        for row in rows.iter().filter(|row| row.base_technique() == *base) {
            if !variants.contains(&&*row.technique) {
                variants.push(&row.technique);
            }
        }
        looks.extend(variants.iter().enumerate().map(|(i, technique)| Look {
            technique: (*technique).to_owned(),
            colour: *colour,
            mark: MARKS[i % MARKS.len()],
            dashed: i > 0,
        }));
    }
    looks
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_technique_has_its_colour_and_its_variants_their_marks() {
        let rows = ["lod", "points+temporal", "lod+msaa4", "points", "mine"]
            .map(|technique| Row { technique: technique.into(), ..Default::default() });
        let looks = looks(&rows);
        let order: Vec<&str> = looks.iter().map(|look| &*look.technique).collect();
        assert_eq!(order, ["points+temporal", "points", "lod", "lod+msaa4", "mine"]);
        assert_eq!(looks[0].colour, COLOURS[0]);
        assert_eq!(looks[2].colour, looks[3].colour);
        assert_ne!(looks[2].mark, looks[3].mark);
        assert_eq!(looks[4].colour, COLOURS[4], "one that is not built in gets the next");
    }
}
