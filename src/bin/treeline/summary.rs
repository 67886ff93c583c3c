//! The JSON summary of a run: what each frame took in; medians, percentiles and memory out. O(frames log frames).

use crate::options::{ToolError, ToolResult, write_file};
use serde::Serialize;
use std::path::Path;

/// What a headless flight was and took.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Summary {
    /// Frames that were kept.
    pub frames: u32,
    /// Trees and plants of the landscape.
    pub instances: u64,
    /// From the start of the program to the first frame, seconds.
    pub startup_s: f64,
    /// Wall time of a frame, milliseconds.
    pub frame_ms: Spread,
    /// Of the process, per frame, seconds.
    pub cpu_s_per_frame: f64,
    /// Points drawn per frame.
    pub points: PointSpread,
    /// Most memory held at once, MiB; 0 where the system does not say.
    pub peak_rss_mb: f64,
    /// Of the landscape.
    pub seed: u64,
    /// Width and height of a frame, pixels.
    pub size: [u32; 2],
    /// What drew it.
    pub adapter: String,
    /// Length of a side of the landscape, metres.
    pub side_m: f32,
}

/// Of times: half are not above `median`, 95 % are not above `p95`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Spread {
    pub median: f64,
    pub p95: f64,
    pub worst: f64,
}

impl Spread {
    /// Of any values in any order; zeros if there are none.
    pub fn of(values: &[f64]) -> Self {
        Self {
            median: percentile(values, 50.0),
            p95: percentile(values, 95.0),
            worst: percentile(values, 100.0),
        }
    }
}

/// Of counts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct PointSpread {
    pub median: u64,
    pub max: u64,
}

impl PointSpread {
    /// Of any counts in any order; zeros if there are none.
    pub fn of(counts: impl IntoIterator<Item = u32>) -> Self {
        // Counts of 32 bits are exact in f64.
        let values: Vec<f64> = counts.into_iter().map(f64::from).collect();
        Self { median: percentile(&values, 50.0) as u64, max: percentile(&values, 100.0) as u64 }
    }
}

/// The smallest of `values` that at least `percent` (0 to 100) of them do not exceed: the nearest-rank method, always one
/// of the values, the lower of the two middle ones as median of an even number. 0 without values; not-a-numbers are left
/// out.
pub fn percentile(values: &[f64], percent: f64) -> f64 {
    let mut sorted: Vec<f64> = values.iter().copied().filter(|v| !v.is_nan()).collect();
    sorted.sort_by(f64::total_cmp);
    let rank = (percent.clamp(0.0, 100.0) / 100.0 * sorted.len() as f64).ceil() as usize;
    sorted.get(rank.saturating_sub(1)).copied().unwrap_or(0.0)
}

/// Writes it as indented JSON, whole or not at all.
pub fn write_summary(path: &Path, summary: &Summary) -> ToolResult {
    let mut text =
        serde_json::to_string_pretty(summary).map_err(|error| ToolError::write(path, error))?;
    text.push('\n');
    write_file(path, text.as_bytes())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_are_those_of_the_nearest_rank() {
        // The example of Wikipedia's article "Percentile".
        let values = [35.0, 20.0, 15.0, 50.0, 40.0];
        for (percent, expected) in
            [(0.0, 15.0), (5.0, 15.0), (30.0, 20.0), (40.0, 20.0), (50.0, 35.0), (100.0, 50.0)]
        {
            assert_eq!(percentile(&values, percent), expected, "{percent} %");
        }
        let hundred: Vec<f64> = (1..=100).rev().map(f64::from).collect();
        let spread = Spread::of(&hundred);
        assert_eq!(spread, Spread { median: 50.0, p95: 95.0, worst: 100.0 });
    }

    #[test]
    fn few_values_and_bad_ones_have_percentiles_too() {
        assert_eq!(Spread::of(&[]), Spread::default());
        assert_eq!(Spread::of(&[7.0]), Spread { median: 7.0, p95: 7.0, worst: 7.0 });
        assert_eq!(percentile(&[f64::NAN, 2.0, 3.0], 50.0), 2.0);
        assert_eq!(percentile(&[1.0, 2.0], -3.0), 1.0);
        assert_eq!(
            PointSpread::of([4_000_000_001, 9, 10]),
            PointSpread { median: 10, max: 4_000_000_001 }
        );
    }

    #[test]
    fn the_file_holds_the_promised_names() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("new").join("summary.json");
        let summary = Summary {
            frames: 24,
            instances: 1_000_000,
            startup_s: 2.5,
            frame_ms: Spread::of(&[10.0, 20.0, 30.0]),
            cpu_s_per_frame: 0.04,
            points: PointSpread::of([100, 300, 200]),
            peak_rss_mb: 512.0,
            seed: 3,
            size: [1280, 720],
            adapter: "a \"software\" driver".into(),
            side_m: 16_000.0,
        };
        write_summary(&path, &summary).expect("writes");
        let text = std::fs::read_to_string(&path).expect("is there");
        let found: serde_json::Value = serde_json::from_str(&text).expect("is JSON");
        let expected = serde_json::json!({
            "frames": 24, "instances": 1_000_000, "startup_s": 2.5,
            "frame_ms": { "median": 20.0, "p95": 30.0, "worst": 30.0 },
            "cpu_s_per_frame": 0.04, "points": { "median": 200, "max": 300 }, "peak_rss_mb": 512.0,
            "seed": 3, "size": [1280, 720], "adapter": "a \"software\" driver", "side_m": 16_000.0,
        });
        assert_eq!(found, expected);
        assert!(write_summary(&path.join("below a file"), &summary).is_err());
    }
}
