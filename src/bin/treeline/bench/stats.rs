//! Placeholder of the `report` branch's file of this name.

use super::row::Row;

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

pub fn merge_runs(rows: &[Row]) -> Row {
    let ok: Vec<&Row> = rows.iter().filter(|row| row.status == "ok").collect();
    let Some(first) = ok.first() else { return rows.first().cloned().unwrap_or_default() };
    let all = |of: fn(&Row) -> Option<f64>| {
        median(&ok.iter().filter_map(|row| of(row)).collect::<Vec<_>>())
    };
    Row {
        runs: ok.len() as u32,
        frame_ms: all(|row| row.frame_ms),
        cpu_s_per_frame: all(|row| row.cpu_s_per_frame),
        ..(*first).clone()
    }
}
