//! Several runs of one configuration: their medians out, and how far they lie apart.
//!
//! Medians of few runs are taken between the two middle ones; those of the many frames of a run are `summary::percentile`.

use super::row::Row;
use serde_json::{Map, Value};

/// The value below which `share` (0 to 1) of `values` lie, linear between neighbours; nothing without values. What is no
/// number is left out.
pub fn quantile(values: &[f64], share: f64) -> Option<f64> {
    let mut sorted: Vec<f64> = values.iter().copied().filter(|value| !value.is_nan()).collect();
    sorted.sort_by(f64::total_cmp);
    let at = share.clamp(0.0, 1.0) * sorted.len().checked_sub(1)? as f64;
    let (low, high) = (sorted[at.floor() as usize], sorted[at.ceil() as usize]);
    Some(low + (high - low) * at.fract())
}

pub fn median(values: &[f64]) -> Option<f64> {
    quantile(values, 0.5)
}

/// How far the runs of one configuration lie apart in a column: most less least, as a share of the median. Nothing for less
/// than two runs, whose noise is unknown.
pub fn noise(values: &[f64]) -> Option<f64> {
    let known = values.iter().filter(|value| !value.is_nan()).count();
    let middle = median(values).filter(|middle| *middle > 0.0 && known > 1)?;
    Some((quantile(values, 1.0)? - quantile(values, 0.0)?) / middle)
}

/// One row for several runs of one configuration: the median of each figure over the runs that have it, what runs agree on
/// as it is. `runs` counts those that were ok; if none was, the first says why.
pub fn merge_runs(rows: &[Row]) -> Row {
    let ok: Vec<&Row> = rows.iter().filter(|row| row.ran()).collect();
    let Some(first) = ok.first() else {
        return Row { runs: 0, ..rows.first().cloned().unwrap_or_default() };
    };
    let runs: Vec<Map<String, Value>> = ok.iter().map(|row| row.columns()).collect();
    let mut merged = first.columns();
    for (name, value) in &mut merged {
        let known: Vec<&Value> =
            runs.iter().map(|run| &run[name]).filter(|v| !v.is_null()).collect();
        // What does not differ is not computed with: a seed of 64 bits would not survive it.
        match known.first() {
            Some(one) if known.iter().all(|other| other == one) => *value = (*one).clone(),
            _ => *value = median_value(&known).unwrap_or_else(|| value.clone()),
        }
    }
    let cpu_s: Vec<f64> = ok.iter().filter_map(|row| row.cpu_s_per_frame).collect();
    let merged: Row =
        serde_json::from_value(Value::Object(merged)).expect("a median has the type of its column");
    Row {
        runs: ok.len() as u32,
        cpu_s_min: quantile(&cpu_s, 0.0),
        cpu_s_max: quantile(&cpu_s, 1.0),
        ..merged
    }
}

/// Of numbers; whole ones stay whole. Nothing for words.
fn median_value(values: &[&Value]) -> Option<Value> {
    let numbers: Option<Vec<f64>> = values.iter().map(|value| value.as_f64()).collect();
    let middle = median(&numbers?)?;
    let whole = values.iter().all(|value| value.is_u64());
    Some(if whole { Value::from(middle.round() as u64) } else { Value::from(middle) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_lie_between_the_values() {
        let values = [4.0, 1.0, f64::NAN, 3.0, 2.0];
        assert_eq!(median(&values), Some(2.5));
        assert_eq!(quantile(&values, 0.25), Some(1.75));
        assert_eq!(median(&[7.0]), Some(7.0));
        assert_eq!(median(&[]), None);
        assert_eq!(quantile(&[f64::NAN], 0.25), None);
    }

    #[test]
    fn noise_is_the_spread_of_the_runs() {
        let spread = noise(&[1.0, 1.1, 0.9]).expect("three runs");
        assert!((spread - 0.2).abs() < 1e-12);
        assert_eq!(noise(&[1.0]), None, "one run says nothing about noise");
        assert_eq!(noise(&[0.0, 0.0]), None);
    }

    fn run(cpu_s: f64, points: u64) -> Row {
        Row {
            technique: "points".into(),
            // Not representable in f64.
            seed: u64::MAX - 1,
            status: "ok".into(),
            runs: 1,
            frames: 8,
            cpu_s_per_frame: Some(cpu_s),
            points_drawn: Some(points),
            ..Default::default()
        }
    }

    #[test]
    fn runs_become_medians_with_least_and_most() {
        let failed = Row { status: "out of memory".into(), ..run(99.0, 0) };
        let rows = [run(0.8, 100), failed, run(1.0, 103), run(0.9, 101), run(0.7, 101)];
        let merged = merge_runs(&rows);
        assert_eq!((merged.runs, merged.frames, merged.seed), (4, 8, u64::MAX - 1));
        assert_eq!(merged.status, "ok");
        let cpu_s = merged.cpu_s_per_frame.expect("is measured");
        assert!((cpu_s - 0.85).abs() < 1e-12);
        assert_eq!((merged.cpu_s_min, merged.cpu_s_max), (Some(0.7), Some(1.0)));
        assert_eq!(merged.points_drawn, Some(101));
        assert_eq!(merged.flip_mean, None, "what no run says stays absent");
    }

    #[test]
    fn a_figure_that_only_some_runs_have_is_kept() {
        let with_error = Row { flip_mean: Some(0.07), ..run(1.0, 5) };
        let merged = merge_runs(&[run(1.0, 5), with_error, run(1.0, 5)]);
        assert_eq!(merged.flip_mean, Some(0.07));
    }

    #[test]
    fn where_none_was_ok_the_first_says_why() {
        let rows = ["too slow", "out of memory"]
            .map(|status| Row { status: status.into(), ..run(1.0, 1) });
        let merged = merge_runs(&rows);
        assert_eq!((&*merged.status, merged.runs), ("too slow", 0));
        assert_eq!(merge_runs(&[]).runs, 0);
    }
}
