//! The tables of a report: rows in, HTML out.

use super::html::{Cell, table};
use crate::bench::{
    format::{count, figure, figure_or_dash},
    row::Row,
    scenario::{Scenario, position, position_text},
};

/// What a user would otherwise take: the techniques that others are held against.
const PEERS: [&str; 2] = ["stock", "lod"];

/// Each technique against each peer at the same number of trees: the ratio of CPU seconds, and the errors of both beside
/// it. Speed without error is not a result: where a side has no error the verdict says so. Nothing where no two can be held
/// against each other.
pub fn ratios(rows: &[&Row]) -> Option<String> {
    let is_peer = |row: &&&Row| PEERS.contains(&row.base_technique());
    let mut lines = vec![];
    for ours in rows.iter().filter(|row| !is_peer(row)) {
        for peer in rows.iter().filter(is_peer).filter(|peer| position(peer) == position(ours)) {
            lines.extend(ratio_line(ours, peer));
        }
    }
    let headings = [
        "trees",
        "technique",
        "against",
        "CPU-s",
        "peer's",
        "ratio",
        "FLIP",
        "peer's",
        "block RMSE",
        "peer's",
        "",
    ];
    (!lines.is_empty()).then(|| table(
        "CPU seconds per frame and errors, each beside that of its peer: the technique it is held against",
        &headings,
        &lines,
    ))
}

fn ratio_line(ours: &Row, peer: &Row) -> Option<Vec<Cell>> {
    let (cost, peer_cost) =
        (ours.cpu_s_per_frame?, peer.cpu_s_per_frame.filter(|cost| *cost > 0.0)?);
    let (words, class) = verdict(ours, peer);
    let times = peer_cost / cost;
    let ratio = if times >= 1.0 {
        format!("{times:.1}× less")
    } else {
        format!("{:.1}× more", 1.0 / times)
    };
    Some(vec![
        Cell::figure(position_text(ours)),
        Cell::words(&*ours.technique),
        Cell::words(&*peer.technique),
        Cell::figure(figure(cost)),
        Cell::figure(figure(peer_cost)).classed("figure peer"),
        Cell::figure(ratio).classed("figure ratio"),
        Cell::figure(figure_or_dash(ours.flip_mean)),
        Cell::figure(figure_or_dash(peer.flip_mean)).classed("figure peer"),
        Cell::figure(figure_or_dash(ours.block_rmse)),
        Cell::figure(figure_or_dash(peer.block_rmse)).classed("figure peer"),
        Cell::words(words).classed(class),
    ])
}

/// Which of the two is cheaper, and which is closer to the truth by both measures.
fn verdict(ours: &Row, peer: &Row) -> (&'static str, &'static str) {
    let cheaper = ours.cpu_s_per_frame < peer.cpu_s_per_frame;
    let errors = |row: &Row| Some((row.flip_mean?, row.block_rmse?));
    let (Some((flip, block)), Some((peer_flip, peer_block))) = (errors(ours), errors(peer)) else {
        return ("error not measured", "words");
    };
    match (cheaper, flip <= peer_flip, block <= peer_block) {
        (true, true, true) => ("cheaper, and closer to the truth", "words good"),
        (true, false, false) => ("cheaper, but farther from the truth", "words"),
        (true, ..) => ("cheaper; closer by one measure", "words"),
        (false, false, false) => ("dearer, and farther from the truth", "words bad"),
        (false, true, true) => ("dearer, but closer to the truth", "words"),
        (false, ..) => ("dearer; closer by one measure", "words"),
    }
}

type Column = (&'static str, fn(&Row) -> String);

/// What most readers look for; all columns are in `results.csv`.
#[rustfmt::skip] // one column a line
const COLUMNS: [Column; 17] = [
    ("CPU-s", |row| figure_or_dash(row.cpu_s_per_frame)),
    ("least–most", |row| range(row.cpu_s_min, row.cpu_s_max)),
    ("frame ms", |row| figure_or_dash(row.frame_ms)),
    ("p95", |row| figure_or_dash(row.frame_ms_p95)),
    ("GPU ms", |row| figure_or_dash(row.gpu_ms)),
    ("main thread ms", |row| figure_or_dash(row.main_thread_ms)),
    ("FLIP", |row| figure_or_dash(row.flip_mean)),
    ("p95", |row| figure_or_dash(row.flip_p95)),
    ("block RMSE", |row| figure_or_dash(row.block_rmse)),
    ("coverage error", |row| figure_or_dash(row.coverage_error)),
    ("triangles", |row| row.triangles_drawn.map_or_else(dash, count)),
    ("points", |row| row.points_drawn.map_or_else(dash, count)),
    ("per pixel", |row| figure_or_dash(row.overdraw)),
    ("GPU MB", |row| figure_or_dash(row.vram_mb)),
    ("process MB", |row| figure_or_dash(row.rss_mb)),
    ("start s", |row| figure_or_dash(row.startup_s)),
    ("runs", |row| row.runs.to_string()),
];

fn dash() -> String {
    figure_or_dash(None)
}

fn range(least: Option<f64>, most: Option<f64>) -> String {
    match (least, most) {
        (Some(least), Some(most)) => format!("{}–{}", figure(least), figure(most)),
        _ => dash(),
    }
}

/// A line for each row, with those columns of which any row has a figure.
pub fn figures(rows: &[&Row]) -> String {
    let is_known = |column: &&Column| rows.iter().any(|row| column.1(row) != dash());
    let columns: Vec<&Column> = COLUMNS.iter().filter(is_known).collect();
    let headings: Vec<&str> =
        ["technique", "trees"].into_iter().chain(columns.iter().map(|c| c.0)).collect();
    let line = |row: &&Row| {
        let names = [Cell::words(&*row.technique), Cell::figure(position_text(row))];
        names.into_iter().chain(columns.iter().map(|column| Cell::figure(column.1(row)))).collect()
    };
    let lines: Vec<Vec<Cell>> = rows.iter().map(line).collect();
    table(
        "Medians of the runs; a dash is what the technique or the machine cannot say",
        &headings,
        &lines,
    )
}

/// The rows without figures, and why.
pub fn not_run(rows: &[Row]) -> Option<String> {
    let lines: Vec<Vec<Cell>> = rows
        .iter()
        .filter(|row| !row.ran())
        .map(|row| {
            vec![
                Cell::words(&*row.technique),
                Cell::figure(position_text(row)),
                Cell::words(Scenario::of(row).title()),
                Cell::words(&*row.status),
            ]
        })
        .collect();
    let headings = ["technique", "trees", "scene", "why"];
    (!lines.is_empty())
        .then(|| table("Nothing is extrapolated: these have no figures", &headings, &lines))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::sample::sample_results;

    fn row(technique: &str, cpu_s: f64, errors: Option<(f64, f64)>) -> Row {
        Row {
            technique: technique.into(),
            instances: 1_000,
            status: "ok".into(),
            cpu_s_per_frame: Some(cpu_s),
            flip_mean: errors.map(|(flip, _)| flip),
            block_rmse: errors.map(|(_, block)| block),
            ..Default::default()
        }
    }

    #[test]
    fn a_ratio_stands_beside_both_errors() {
        let ours = row("points", 0.8, Some((0.045, 0.0019)));
        let peer = row("lod+msaa4", 22.3, Some((0.0518, 0.0050)));
        let html = ratios(&[&ours, &peer]).expect("two to compare");
        for part in [
            "27.9× less",
            "0.0450",
            "0.0518",
            "0.00190",
            "0.00500",
            "cheaper, and closer to the truth",
        ] {
            assert!(html.contains(part), "{part}: {html}");
        }
    }

    #[test]
    fn speed_without_error_is_not_called_a_result() {
        let (ours, peer) = (row("points", 0.8, None), row("lod", 4.7, Some((0.08, 0.005))));
        assert!(ratios(&[&ours, &peer]).expect("two").contains("error not measured"));
        let dearer = row("points", 9.4, Some((0.09, 0.004)));
        let html = ratios(&[&dearer, &peer]).expect("two");
        assert!(html.contains("2.0× more") && html.contains("dearer; closer by one measure"));
        assert!(ratios(&[&peer]).is_none() && ratios(&[&ours]).is_none());
    }

    #[test]
    fn only_the_same_number_of_trees_is_compared() {
        let ours = row("points", 0.8, None);
        let peer = Row { instances: 10_000, ..row("lod", 5.0, None) };
        assert!(ratios(&[&ours, &peer]).is_none());
    }

    #[test]
    fn columns_without_a_figure_are_left_out() {
        let html = figures(&[&row("points", 0.8, Some((0.045, 0.0019)))]);
        assert!(html.contains("0.800") && html.contains("block RMSE"));
        assert!(!html.contains("start s") && !html.contains("triangles"));
    }

    #[test]
    fn what_did_not_run_says_why() {
        let html = not_run(&sample_results().rows).expect("some did not");
        assert!(html.contains("7,000,001 entities need 11 GB") && html.contains("meshlets need"));
        assert!(not_run(&[row("points", 1.0, None)]).is_none());
    }
}
