//! Commands that draw: small pictures of a small tree.

use super::{Workplace, has_adapter, tree};
use std::path::Path;

fn size(path: &Path) -> (u32, u32) {
    let image = image::open(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    (image.width(), image.height())
}

#[test]
fn a_headless_flight_writes_frames_a_sheet_and_a_row_of_statistics_per_frame() {
    if !has_adapter("a_headless_flight_writes_frames_a_sheet_and_a_row_of_statistics_per_frame") {
        return;
    }
    let place = Workplace::new();
    place.run("fly --headless --frames 2 --size 160x90 --count 200 --ldi 64 --out a").succeeds();
    assert_eq!(place.files("a"), ["frame0000.png", "frame0001.png", "sheet.png", "stats.csv"]);
    assert_eq!(size(&place.path("a/frame0001.png")), (160, 90));
    let frames = [place.read("a/frame0000.png"), place.read("a/frame0001.png")];
    assert_ne!(frames[0], frames[1], "the camera moves");

    let table = String::from_utf8(place.read("a/stats.csv")).expect("UTF-8");
    let rows: Vec<Vec<&str>> = table.lines().map(|line| line.split(',').collect()).collect();
    assert_eq!(rows.len(), 3);
    let value = |row: usize, name: &str| -> f64 {
        let column = rows[0].iter().position(|n| *n == name).unwrap_or_else(|| panic!("no {name}"));
        rows[row + 1][column].parse().unwrap_or_else(|_| panic!("{name} is no number"))
    };
    for row in 0..2 {
        assert_eq!((value(row, "frame"), value(row, "instances_seen")), (row as f64, 200.0));
        assert_eq!(value(row, "overflow"), 0.0);
        for name in ["wall_ms", "points", "work_items", "covered_pixels", "bytes_read"] {
            assert!(value(row, name) > 0.0, "{name}");
        }
    }

    // The same seed gives the same bytes, another one another forest; the counters are those of their own frame.
    place.run("fly --headless --frames 2 --size 160x90 --count 200 --ldi 64 --out b").succeeds();
    place
        .run("fly --headless --frames 1 --size 160x90 --count 200 --ldi 64 --start 0.5 --out c")
        .succeeds();
    place
        .run("fly --headless --frames 1 --size 160x90 --count 200 --ldi 64 --seed 2 --out d")
        .succeeds();
    let again = [place.read("b/frame0000.png"), place.read("b/frame0001.png")];
    assert_eq!(frames, again);
    assert_ne!(frames[0], place.read("d/frame0000.png"));
    let alone = String::from_utf8(place.read("c/stats.csv")).expect("UTF-8");
    let alone: Vec<&str> = alone.lines().nth(1).expect("a row").split(',').collect();
    for name in ["culled_frustum", "points", "work_items", "x"] {
        let column = rows[0].iter().position(|n| *n == name).expect("as above");
        assert_eq!(rows[2][column], alone[column], "{name} of the frame half way");
    }
}

#[test]
fn a_headless_view_writes_one_sheet_named_after_the_tree() {
    if !has_adapter("a_headless_view_writes_one_sheet_named_after_the_tree") {
        return;
    }
    let place = Workplace::new();
    let run = place.run("view {tree} --headless --ldi 64 --out out").succeeds();
    assert_eq!(place.files("out"), ["spruce.png"]);
    let (width, height) = size(&place.path("out/spruce.png"));
    assert!(width > 6 * 320 && height > 4 * 100, "{width} × {height}");
    assert!(run.out.contains("triangles") && run.out.contains("d0 is"), "{}", run.out);
}

#[test]
fn a_comparison_writes_pictures_and_a_row_per_distance() {
    if !has_adapter("a_comparison_writes_pictures_and_a_row_per_distance") {
        return;
    }
    let place = Workplace::new();
    place.run("compare {tree} --ldi 64 --distances 200,400 --out out --json c.json").succeeds();
    let mut expected: Vec<String> = ["200.0", "400.0"]
        .iter()
        .flat_map(|d| {
            ["reference", "mesh", "points", "mesh_error", "points_error"]
                .map(|n| format!("{n}_{d}.png"))
        })
        .collect();
    expected.push("sheet.png".into());
    expected.sort();
    assert_eq!(place.files("out"), expected);

    let report = place.json("c.json");
    assert_eq!(report["file"], tree("spruce.glb"));
    let d0 = report["d0"].as_f64().expect("d0");
    assert!(d0 > 50.0 && d0 < 1000.0, "{d0}");
    let rows = report["rows"].as_array().expect("rows");
    let of = |row: usize, key: &str| -> f64 {
        rows[row][key].as_f64().unwrap_or_else(|| panic!("row {row} lacks {key}: {report}"))
    };
    assert_eq!(rows.len(), 2);
    assert_eq!((of(0, "distance"), of(1, "distance")), (200.0, 400.0));
    for row in 0..2 {
        for key in [
            "flip_mean",
            "flip_p95",
            "block_rmse",
            "mesh_flip_mean",
            "mesh_flip_p95",
            "mesh_block_rmse",
        ] {
            assert!((0.0..1.0).contains(&of(row, key)), "{key}");
        }
        assert!(of(row, "flip_mean") > 0.0 && of(row, "mesh_flip_mean") > 0.0);
        assert!(of(row, "coverage_error").abs() < 0.3);
    }
    assert!(of(0, "points") > of(1, "points") && of(1, "points") > 0.0);
}
