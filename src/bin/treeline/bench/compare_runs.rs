//! `treeline bench --compare`: two sets of results in; what changed, and whether it is more than noise, out.
//!
//! Noise of a time is how far the runs of a configuration lay apart in CPU seconds, of wall time also how far its frames
//! did; in the old or the new results, whichever is more, and never less than 5 %. Figures that do not depend on the clock
//! have those 5 % only.

use super::{
    format::figure,
    row::{Machine, Results, Row},
    scenario::{Scenario, position_text},
    stats::noise,
};
use std::fmt::Write;

/// Share below which no change is told from noise.
const LEAST_NOISE: f64 = 0.05;

pub struct Comparison {
    /// For the user: many lines.
    pub text: String,
    /// A figure got worse beyond noise, or what ran before did not run.
    pub worse: bool,
}

#[derive(Clone, Copy, PartialEq)]
enum Kind {
    /// Less is better; another machine takes another time.
    CpuTime,
    WallTime,
    /// Less is better; another driver takes another amount.
    Memory,
    /// Less is better.
    Error,
    /// More is neither better nor worse.
    Count,
}

impl Kind {
    fn depends_on_machine(self) -> bool {
        matches!(self, Self::CpuTime | Self::WallTime | Self::Memory)
    }

    /// Noise of a figure of this kind, as a share.
    fn noise(self, row: &Row) -> f64 {
        let runs = [row.cpu_s_min, row.cpu_s_per_frame, row.cpu_s_max];
        let frames = [row.frame_ms_p25, row.frame_ms, row.frame_ms_p75];
        let spread =
            |values: [Option<f64>; 3]| noise(&values.map(|value| value.unwrap_or(f64::NAN)));
        let known = match self {
            Self::CpuTime => spread(runs),
            Self::WallTime => [spread(runs), spread(frames)].into_iter().flatten().reduce(f64::max),
            Self::Memory | Self::Error | Self::Count => None,
        };
        known.unwrap_or(0.0).max(LEAST_NOISE)
    }
}

struct Figure {
    name: &'static str,
    kind: Kind,
    column: fn(&Row) -> Option<f64>,
}

#[rustfmt::skip] // one figure a line
const FIGURES: [Figure; 7] = [
    Figure { name: "CPU s per frame", kind: Kind::CpuTime, column: |row| row.cpu_s_per_frame },
    Figure { name: "frame ms", kind: Kind::WallTime, column: |row| row.frame_ms },
    Figure { name: "FLIP", kind: Kind::Error, column: |row| row.flip_mean },
    Figure { name: "block RMSE", kind: Kind::Error, column: |row| row.block_rmse },
    Figure { name: "points drawn", kind: Kind::Count, column: |row| row.points_drawn.map(|points| points as f64) },
    Figure { name: "process MB", kind: Kind::Memory, column: |row| row.rss_mb },
    Figure { name: "GPU MB", kind: Kind::Memory, column: |row| row.vram_mb },
];

#[derive(Clone, Copy, Debug, PartialEq)]
enum Verdict {
    WithinNoise,
    Better,
    Worse,
    Changed,
}

/// Compares what both have: the same scenario, technique and number of instances.
pub fn compare(old: &Results, new: &Results) -> Comparison {
    let mut text = format!("old: {}\nnew: {}\n", origin(old), origin(new));
    let differences = differing_parts(&old.machine, &new.machine);
    if !differences.is_empty() {
        let parts = differences.join("; ");
        line(
            &mut text,
            &format!(
                "\nWARNING: not the same machine ({parts}): times and memory are shown, not judged."
            ),
        );
    }
    let mut rest: Vec<&Row> = old.rows.iter().collect();
    let (mut added, mut tally) = (vec![], Tally::default());
    let mut scenario = None;
    for row in &new.rows {
        let Some(at) = rest.iter().position(|old| is_same_configuration(old, row)) else {
            added.push(row);
            continue;
        };
        let before = rest.remove(at);
        let own = Scenario::of(row);
        if scenario.as_ref() != Some(&own) {
            line(&mut text, &format!("\n{}", own.title()));
            scenario = Some(own);
        }
        compare_rows(&mut text, &mut tally, before, row, differences.is_empty());
    }
    list(&mut text, "Only in the new results:", &added);
    list(&mut text, "Only in the old results:", &rest);
    line(&mut text, &format!("\n{}", tally.sentence()));
    Comparison { text, worse: tally.worse > 0 }
}

#[derive(Default)]
struct Tally {
    worse: u32,
    better: u32,
    within: u32,
    /// Configurations of which one side has a single run.
    single_runs: u32,
}

impl Tally {
    fn add(&mut self, verdict: Verdict) {
        match verdict {
            Verdict::Worse => self.worse += 1,
            Verdict::Better => self.better += 1,
            Verdict::WithinNoise => self.within += 1,
            Verdict::Changed => {}
        }
    }

    fn sentence(&self) -> String {
        if self.worse + self.better + self.within == 0 {
            return "Nothing could be judged: no configuration is in both with figures of the same machine.".into();
        }
        let Self { worse, better, within, single_runs } = self;
        let mut sentence =
            format!("Beyond noise: {worse} worse, {better} better. Within noise: {within}.");
        if *single_runs > 0 {
            let least = LEAST_NOISE * 100.0;
            sentence += &format!(
                " {single_runs} of the configurations ran only once: their noise is taken as {least} %."
            );
        }
        sentence
    }
}

fn compare_rows(text: &mut String, tally: &mut Tally, old: &Row, new: &Row, same_machine: bool) {
    line(text, &format!("  {}, {}", new.technique, position_text(new)));
    if old.seed != new.seed {
        line(
            text,
            &format!(
                "    WARNING: seed {} against {}: other places of the trees.",
                old.seed, new.seed
            ),
        );
    }
    match (old.ran(), new.ran()) {
        (true, true) => {}
        (false, false) => return line(text, &format!("    did not run in either: {}", new.status)),
        (false, true) => return line(text, &format!("    runs now; before: {}", old.status)),
        (true, false) => {
            tally.add(Verdict::Worse);
            return line(text, &format!("    WORSE: does not run any more: {}", new.status));
        }
    }
    tally.single_runs += u32::from(old.runs.min(new.runs) < 2);
    for Figure { name, kind, column } in &FIGURES {
        let (Some(before), Some(now)) = (column(old), column(new)) else { continue };
        // 0 against 0 is no change; anything against 0 has no ratio.
        let ratio = if before == now { 1.0 } else { now / before };
        let margin = kind.noise(old).max(kind.noise(new));
        let judged = same_machine || !kind.depends_on_machine();
        let verdict = judged.then(|| judge(*kind, ratio, margin));
        verdict.into_iter().for_each(|verdict| tally.add(verdict));
        let word = match verdict {
            Some(Verdict::Worse) => "WORSE",
            Some(Verdict::Better) => "better",
            Some(Verdict::Changed) => "changed",
            Some(Verdict::WithinNoise) => "within noise",
            None => "not judged",
        };
        let (before, now) = (figure(before), figure(now));
        line(
            text,
            &format!(
                "    {name:<16}{before:>12} -> {now:<12}{ratio:>7.3}x  {word} (±{:.0} %)",
                margin * 100.0
            ),
        );
    }
}

/// Beyond the noise in either direction: a rise above 1 + noise, or a fall by the same factor.
fn judge(kind: Kind, ratio: f64, margin: f64) -> Verdict {
    match (ratio > 1.0 + margin, ratio * (1.0 + margin) < 1.0) {
        (false, false) => Verdict::WithinNoise,
        _ if kind == Kind::Count => Verdict::Changed,
        (true, _) => Verdict::Worse,
        (false, true) => Verdict::Better,
    }
}

fn is_same_configuration(old: &Row, new: &Row) -> bool {
    old.technique == new.technique
        && old.instances == new.instances
        && old.camera == new.camera
        && Scenario::of(old) == Scenario::of(new)
}

fn origin(results: &Results) -> String {
    let machine = &results.machine;
    format!("{}, on {} ({})", results.sources(), machine.adapter, machine.driver)
}

/// `adapter: a against b` for each part that is not the same.
pub fn differing_parts(old: &Machine, new: &Machine) -> Vec<String> {
    let parts = [
        ("adapter", old.adapter.clone(), new.adapter.clone()),
        ("driver", old.driver.clone(), new.driver.clone()),
        ("backend", old.backend.clone(), new.backend.clone()),
        ("system", old.os.clone(), new.os.clone()),
        ("processor", old.cpu.clone(), new.cpu.clone()),
        ("cores", old.cores.to_string(), new.cores.to_string()),
    ];
    let differing = parts.into_iter().filter(|(_, old, new)| old != new);
    differing.map(|(name, old, new)| format!("{name}: {old} against {new}")).collect()
}

fn list(text: &mut String, heading: &str, rows: &[&Row]) {
    if rows.is_empty() {
        return;
    }
    line(text, &format!("\n{heading}"));
    for row in rows {
        let scenario = Scenario::of(row).title();
        line(text, &format!("  {}, {} ({scenario})", row.technique, position_text(row)));
    }
}

fn line(text: &mut String, words: &str) {
    writeln!(text, "{words}").expect("a string takes any text");
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::sample::sample_results;

    fn changed(change: impl Fn(&mut Row)) -> Comparison {
        let old = sample_results();
        let mut new = old.clone();
        new.rows
            .iter_mut()
            .filter(|row| row.technique == "points" && row.instances == 1_000)
            .for_each(change);
        compare(&old, &new)
    }

    fn verdict(text: &str, name: &str) -> Vec<String> {
        let lines = text.lines().filter(|line| line.trim_start().starts_with(name));
        let words = lines.map(|line| line.split("x  ").nth(1).unwrap_or_default().to_owned());
        words.filter(|word| !word.starts_with("within")).collect()
    }

    #[test]
    fn results_do_not_differ_from_themselves() {
        let results = sample_results();
        let found = compare(&results, &results);
        assert!(
            !found.worse && found.text.contains("Beyond noise: 0 worse, 0 better."),
            "{}",
            found.text
        );
        assert!(!found.text.contains("WARNING") && !found.text.contains("Only in"));
        assert!(found.text.contains("did not run in either: 2.8e9 triangles"));
    }

    #[test]
    fn what_is_within_the_spread_of_the_runs_is_noise() {
        let slower = |row: &mut Row| {
            for time in [&mut row.cpu_s_min, &mut row.cpu_s_per_frame, &mut row.cpu_s_max] {
                *time = time.map(|seconds| seconds * 1.15);
            }
        };
        let found = changed(slower);
        assert!(found.worse);
        assert_eq!(verdict(&found.text, "CPU s"), ["WORSE (±5 %)"; 2], "{}", found.text);
        let noisy = changed(|row| {
            slower(row);
            row.cpu_s_max = row.cpu_s_max.map(|s| s * 1.3);
        });
        assert!(!noisy.worse, "{}", noisy.text);
    }

    #[test]
    fn errors_and_memory_are_judged_too_and_points_only_shown() {
        let found = changed(|row| {
            row.flip_mean = Some(0.09);
            row.rss_mb = Some(200.0);
            row.points_drawn = Some(2_000_000);
        });
        assert_eq!(verdict(&found.text, "FLIP"), ["WORSE (±5 %)"; 2]);
        assert_eq!(verdict(&found.text, "process MB"), ["better (±5 %)"; 2]);
        assert_eq!(verdict(&found.text, "points drawn"), ["changed (±5 %)"; 2]);
        assert!(found.text.contains("Beyond noise: 2 worse, 2 better."));
    }

    #[test]
    fn another_machine_is_not_judged_by_the_clock() {
        let old = sample_results();
        let mut new = old.clone();
        new.machine.adapter = "a faster one".into();
        new.rows
            .iter_mut()
            .for_each(|row| row.cpu_s_per_frame = row.cpu_s_per_frame.map(|s| s * 3.0));
        let found = compare(&old, &new);
        assert!(!found.worse);
        assert!(
            found.text.contains("WARNING: not the same machine (adapter: llvmpipe"),
            "{}",
            found.text
        );
        assert!(found.text.contains("not judged"));
    }

    #[test]
    fn rows_come_and_go_and_fail() {
        let (mut old, mut new) = (sample_results(), sample_results());
        let gone = old.rows.remove(0);
        new.rows.retain(|row| row.technique != "lod+msaa4");
        let last = new.rows.last_mut().expect("rows");
        last.status = "device lost".into();
        let found = compare(&old, &new);
        assert!(found.worse && found.text.contains("WORSE: does not run any more: device lost"));
        let tail = found.text.split_once("Only in the new results:").expect("a list").1;
        assert!(tail.contains(&format!("{}, 1k", gone.technique)));
        assert!(
            tail.split_once("Only in the old results:")
                .expect("a list")
                .1
                .contains("lod+msaa4, 1k")
        );
    }

    #[test]
    fn what_cannot_be_judged_says_so() {
        let none = Results { rows: vec![], ..sample_results() };
        assert!(compare(&none, &sample_results()).text.contains("Nothing could be judged"));
        let once = changed(|row| {
            row.runs = 1;
            row.seed = 7;
        });
        assert!(once.text.contains("2 of the configurations ran only once"), "{}", once.text);
        assert!(once.text.contains("WARNING: seed 42 against 7"));
    }

    #[test]
    fn a_fall_counts_as_much_as_a_rise() {
        assert_eq!(judge(Kind::Error, 1.051, 0.05), Verdict::Worse);
        assert_eq!(judge(Kind::Error, 1.0 / 1.051, 0.05), Verdict::Better);
        assert_eq!(judge(Kind::Error, 1.0 / 1.049, 0.05), Verdict::WithinNoise);
        assert_eq!(judge(Kind::Count, 2.0, 0.05), Verdict::Changed);
        assert_eq!(judge(Kind::Error, f64::INFINITY, 0.05), Verdict::Worse);
    }
}
