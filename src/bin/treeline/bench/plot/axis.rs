//! Axes: the values to be shown in; range, marks and their labels out.

use crate::bench::format::tick;
use plotters::coord::ranged1d::{KeyPointHint, NoDefaultFormatting, Ranged, ValueFormatter};
use std::ops::Range;

/// Powers of ten that a logarithmic axis shows at least: a few marks are in it wherever it lies.
const LEAST_DECADES: f64 = 0.7;
/// As many marks have room for their labels.
const MOST_MARKS: usize = 8;

/// The coordinates of plotters, with marks at round numbers and their labels short.
#[derive(Clone, Debug, PartialEq)]
pub struct Axis {
    pub label: String,
    /// Values at the two ends.
    pub from: f64,
    to: f64,
    logarithmic: bool,
    /// Values with a label and a line.
    marks: Vec<f64>,
}

impl Axis {
    /// Around `values` (those above 0), with marks at powers of ten, or at 1, 2 and 5 times them where there are few.
    pub fn logarithmic(label: &str, values: impl IntoIterator<Item = f64>) -> Option<Self> {
        let (low, high) = bounds(values.into_iter().filter(|value| *value > 0.0))?;
        // Room at both ends: no mark sits on the frame.
        let decades = (high / low).log10();
        let margin = (0.06 * decades).max(0.5 * (LEAST_DECADES - decades)).max(0.06);
        let (from, to) = (low.log10() - margin, high.log10() + margin);
        let steps: &[i32] = match to - from {
            0.0..1.2 => &[10, 15, 20, 30, 50, 70],
            1.2..3.2 => &[10, 20, 50],
            _ => &[10],
        };
        let (from, to) = (10.0_f64.powf(from), 10.0_f64.powf(to));
        // Tens of the decade below, so that marks below 1 are quotients: as exact as they can be.
        let mark = |decade: i32, tens: i32| match decade - 1 {
            power @ 0.. => f64::from(tens) * 10.0_f64.powi(power),
            power => f64::from(tens) / 10.0_f64.powi(-power),
        };
        let decades = from.log10().floor() as i32..=to.log10().floor() as i32;
        let marks = decades.flat_map(|decade| steps.iter().map(move |tens| mark(decade, *tens)));
        let marks = marks.filter(|mark| (from..=to).contains(mark)).collect();
        Some(Self { label: label.to_owned(), from, to, logarithmic: true, marks })
    }

    /// Logarithmic, with marks at the values themselves where they are few and apart: numbers that someone chose.
    pub fn at(label: &str, values: &[f64]) -> Option<Self> {
        let axis = Self::logarithmic(label, values.iter().copied())?;
        let mut marks: Vec<f64> = values.iter().copied().filter(|value| *value > 0.0).collect();
        marks.sort_by(f64::total_cmp);
        marks.dedup();
        let apart = marks.windows(2).all(|pair| pair[1] > 1.5 * pair[0]);
        Some(if apart && marks.len() <= MOST_MARKS { Self { marks, ..axis } } else { axis })
    }

    /// From 0 to above the largest of `values`, with four to eight round marks.
    pub fn from_zero(label: &str, values: impl IntoIterator<Item = f64>) -> Option<Self> {
        let (_, high) = bounds(values)?;
        let to = if high > 0.0 { high * 1.1 } else { 1.0 };
        let rough = to / 5.0;
        let power = 10.0_f64.powf(rough.log10().floor());
        let step = [1.0, 2.0, 5.0]
            .map(|k| k * power)
            .into_iter()
            .rfind(|step| *step <= rough)
            .unwrap_or(power);
        let marks = (0..=(to / step) as u32).map(|i| f64::from(i) * step).collect();
        Some(Self { label: label.to_owned(), from: 0.0, to, logarithmic: false, marks })
    }
}

impl Ranged for Axis {
    type FormatOption = NoDefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, pixels: (i32, i32)) -> i32 {
        let place = |value: f64| if self.logarithmic { value.log10() } else { value };
        let share = (place(*value) - place(self.from)) / (place(self.to) - place(self.from));
        pixels.0 + (share * f64::from(pixels.1 - pixels.0)).round() as i32
    }

    fn key_points<Hint: KeyPointHint>(&self, _: Hint) -> Vec<f64> {
        self.marks.clone()
    }

    fn range(&self) -> Range<f64> {
        self.from..self.to
    }
}

impl ValueFormatter<f64> for Axis {
    fn format_ext(&self, value: &f64) -> String {
        tick(*value)
    }
}

fn bounds(values: impl IntoIterator<Item = f64>) -> Option<(f64, f64)> {
    values.into_iter().filter(|value| value.is_finite()).fold(None, |found, value| match found {
        None => Some((value, value)),
        Some((low, high)) => Some((f64::min(low, value), f64::max(high, value))),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn texts(axis: &Axis) -> Vec<String> {
        axis.marks.iter().map(|mark| axis.format_ext(mark)).collect()
    }

    #[test]
    fn logarithmic_axes_are_marked_at_round_numbers() {
        let axis = Axis::logarithmic("trees", [1e3, 1e6]).expect("values");
        assert_eq!(texts(&axis), ["1k", "10k", "100k", "1M"]);
        assert!(axis.from < 1e3 && axis.to > 1e6);
        let (left, right) = (axis.map(&1e3, (0, 300)), axis.map(&1e6, (0, 300)));
        assert!(0 < left && right < 300 && left + right == 300);
        let middle = axis.map(&(1e9_f64.sqrt()), (0, 300));
        assert_eq!(middle, 150);

        let short = Axis::logarithmic("s", [0.3, 9.0, 0.0, f64::NAN]).expect("values");
        assert_eq!(texts(&short), ["0.5", "1", "2", "5", "10"]);
        let one = Axis::logarithmic("s", [1e3]).expect("a value");
        assert_eq!(texts(&one), ["500", "700", "1k", "1.5k", "2k"]);
        assert_eq!(Axis::logarithmic("s", [0.0]), None);
    }

    #[test]
    fn chosen_numbers_are_marked_themselves_unless_they_are_many_or_close() {
        let marks = |values: &[f64]| texts(&Axis::at("trees", values).expect("values"));
        assert_eq!(marks(&[1e3]), ["1k"]);
        assert_eq!(marks(&[25.0, 12.5, 25.0, 100.0]), ["12.5", "25", "100"]);
        assert_eq!(marks(&[1e3, 1.1e3, 1e7]), ["1k", "10k", "100k", "1M", "10M"]);
        assert_eq!(Axis::at("trees", &[]), None);
    }

    #[test]
    fn linear_axes_begin_at_zero() {
        let axis = Axis::from_zero("FLIP", [0.045, 0.0985]).expect("values");
        assert_eq!(texts(&axis), ["0", "0.02", "0.04", "0.06", "0.08", "0.1"]);
        assert_eq!(axis.map(&0.0, (400, 0)), 400, "upright axes begin below");
        assert!(Axis::from_zero("FLIP", [0.0]).expect("a value").to > 0.0);
        assert_eq!(Axis::from_zero("FLIP", []), None);
    }
}
