//! The figures that most ask for, as a table for the terminal.

use super::{
    format::{figure, figure_or_dash},
    row::Row,
    scenario::position_text,
};

/// A line for each row, below a line of names.
pub fn table(rows: &[Row]) -> String {
    let names = ["frame ms", "CPU-s", "main ms", "FLIP", "block", "RSS MiB", "start s"];
    let mut lines = vec![line("technique", "trees", names.map(str::to_owned).as_slice())];
    for row in rows {
        let cells = if row.ran() {
            let small = |value: Option<f64>| value.map_or("–".into(), |v| format!("{v:.4}"));
            vec![
                figure_or_dash(row.frame_ms),
                figure_or_dash(row.cpu_s_per_frame),
                figure_or_dash(row.main_thread_ms),
                small(row.flip_mean),
                small(row.block_rmse),
                figure_or_dash(row.rss_mb),
                row.startup_s.map_or("–".into(), figure),
            ]
        } else {
            vec![format!("  {}", row.status)]
        };
        lines.push(line(&row.technique, &position_text(row), &cells));
    }
    lines.join("\n")
}

fn line(technique: &str, position: &str, cells: &[String]) -> String {
    let cells: String = cells.iter().map(|cell| format!(" {cell:>9}")).collect();
    format!("{technique:24} {position:>9}{cells}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_row_without_figures_says_why() {
        let ran = Row {
            technique: "points".into(),
            status: "ok".into(),
            instances: 1000,
            ..Row::default()
        };
        let stopped = Row { status: "held 9 GiB".into(), ..ran.clone() };
        let text = table(&[ran, stopped]);
        assert_eq!(text.lines().count(), 3);
        assert!(text.lines().all(|line| line.contains("trees") || line.contains("1k")));
        assert!(text.ends_with("held 9 GiB"), "{text}");
    }
}
