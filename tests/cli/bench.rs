//! A benchmark from end to end, on two dozen small trees; and what it refuses.

use super::{Workplace, has_adapter, pictures::size};
use serde_json::Value;
use std::{process::Stdio, thread::sleep, time::Duration};

/// Seconds on a software driver.
const SMALL: &str = "bench --scene baseline --tree {tree} --ldi 64 --instances 20 --size 160x90 --frames 1 --warm-up 1 \
    --runs 1 --date today --out out";

fn row<'a>(results: &'a Value, technique: &str) -> &'a Value {
    let rows = results["rows"].as_array().expect("rows");
    let found = rows.iter().find(|row| row["technique"] == technique);
    found.unwrap_or_else(|| panic!("no row of {technique}: {results}"))
}

fn number(row: &Value, column: &str) -> f64 {
    row[column].as_f64().unwrap_or_else(|| panic!("{column} is missing: {row}"))
}

#[test]
fn a_small_benchmark_writes_rows_pictures_and_a_report() {
    if !has_adapter("a_small_benchmark_writes_rows_pictures_and_a_report") {
        return;
    }
    let place = Workplace::new();
    let run = place.run(&format!("{SMALL} --techniques points,stock,meshlet")).succeeds();
    let results = place.json("out/results.json");
    assert_eq!(results["schema"], 1);
    assert_eq!(results["rows"].as_array().map(Vec::len), Some(3));
    for technique in ["points", "stock"] {
        let row = row(&results, technique);
        assert_eq!((&row["status"], &row["scene"]), (&"ok".into(), &"baseline".into()));
        assert_eq!((&row["size"], &row["date"]), (&"160x90".into(), &"today".into()));
        assert_eq!((number(row, "instances"), number(row, "runs")), (20.0, 1.0));
        for column in ["frame_ms", "cpu_ms_main", "cpu_ms_render", "main_thread_ms", "startup_s"] {
            assert!(number(row, column) > 0.0, "{column}: {row}");
        }
        for column in ["flip_mean", "flip_p95", "block_rmse", "flip_mean_below", "coverage_error"] {
            assert!((0.0..0.5).contains(&number(row, column)), "{column}: {row}");
        }
        assert!(number(row, "source_triangles") > 1000.0);
    }
    let (points, stock) = (row(&results, "points"), row(&results, "stock"));
    assert!(number(points, "points_drawn") > 1000.0 && number(points, "points_baked") > 1000.0);
    assert!(stock["points_drawn"].is_null(), "{stock}");
    // The truth is the same meshes with more samples.
    assert!(number(stock, "coverage_error") < 0.1);
    let meshlet = row(&results, "meshlet");
    let why = meshlet["status"].as_str().expect("words");
    assert!(
        why.contains("TEXTURE_INT64_ATOMIC") || why.contains("not part of this build"),
        "{why}"
    );
    assert!(meshlet["frame_ms"].is_null() && run.out.contains(why));

    let csv = String::from_utf8(place.read("out/results.csv")).expect("UTF-8");
    assert_eq!(csv.lines().count(), 4, "{csv}");
    let files = place.files("out");
    for name in ["points_20_still", "points_20_still_error", "stock_20_still", "truth_20_still"] {
        let file = format!("pictures/{name}.png");
        assert!(files.contains(&file), "{file} is not among {files:?}");
        assert_eq!(size(&place.path("out").join(file)), (160, 90));
    }
    assert!(files.iter().any(|file| file == "report.html"), "{files:?}");
    assert!(!files.iter().any(|file| file == "unfinished.json"), "{files:?}");

    // The second time the truth is there already, and results are held against the first.
    let again =
        format!("{SMALL} --techniques meshlet,points --camera flying --compare out/results.json");
    let again = place.run(&again);
    assert!(again.out.contains("old:"), "{}{}", again.out, again.err);
    assert!(!again.err.contains("rendering the truth"), "{}", again.err);
}

#[test]
fn a_run_that_takes_too_long_says_so_in_its_row() {
    if !has_adapter("a_run_that_takes_too_long_says_so_in_its_row") {
        return;
    }
    let place = Workplace::new();
    let run = place.run(&format!("{SMALL} --techniques points --time-limit 0.05"));
    run.fails_with(&["nothing could be measured"]);
    let results = place.json("out/results.json");
    let why = row(&results, "points")["status"].as_str().expect("words").to_owned();
    assert!(why.contains("--time-limit"), "{why}");
}

#[test]
fn a_benchmark_that_is_stopped_keeps_what_it_measured() {
    if !has_adapter("a_benchmark_that_is_stopped_keeps_what_it_measured") {
        return;
    }
    let place = Workplace::new();
    let many = SMALL.replace("--runs 1", "--runs 99");
    let mut command = place.command(&format!("{many} --techniques points,stock"));
    let mut bench = command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().expect("it starts");
    while !place.path("out/unfinished.json").is_file() {
        let end = bench.try_wait().expect("it can be asked");
        assert_eq!(end, None, "it is still at work");
        sleep(Duration::from_millis(20));
    }
    bench.kill().and_then(|()| bench.wait()).expect("it stops");
    place.run("bench --report out/unfinished.json --out report").succeeds();
    let results = place.json("report/results.json");
    assert!(number(row(&results, "points"), "cpu_s_per_frame") > 0.0);
}
