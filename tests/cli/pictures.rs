//! Commands that draw: small pictures of a small tree.

use super::{Workplace, has_adapter, tree};
use std::path::Path;

pub fn size(path: &Path) -> (u32, u32) {
    let image = image::open(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    (image.width(), image.height())
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
    place.run("compare {tree} --ldi 64 --distances 400,800 --out out --json c.json").succeeds();
    let mut expected: Vec<String> = ["400.0", "800.0"]
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
    assert_eq!((of(0, "distance"), of(1, "distance")), (400.0, 800.0));
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
