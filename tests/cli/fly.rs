//! A flight without a window: frames, contact sheet, statistics, film and summary. A square kilometre, two species.

use super::{Workplace, has_adapter, pictures::size};
use serde_json::Value;

/// Small trees, few of them, and not far: seconds on a software driver.
const SMALL: &str = "fly --headless --size 192x108 --side 1km --trees 1000 --species oak,grass_tuft \
    --variants 1 --ldi 96 --tree-distance 400";

/// `stats.csv` of a flight.
struct Table {
    names: Vec<String>,
    rows: Vec<Vec<String>>,
}

impl Table {
    fn of(place: &Workplace, folder: &str) -> Self {
        let text = String::from_utf8(place.read(&format!("{folder}/stats.csv"))).expect("UTF-8");
        let mut rows = text.lines().map(|l| l.split(',').map(str::to_owned).collect::<Vec<_>>());
        Self { names: rows.next().expect("a row of names"), rows: rows.collect() }
    }

    fn text(&self, row: usize, name: &str) -> &str {
        let column = self.names.iter().position(|n| n == name);
        &self.rows[row][column.unwrap_or_else(|| panic!("no {name} in {:?}", self.names))]
    }

    fn number(&self, row: usize, name: &str) -> f64 {
        let text = self.text(row, name);
        text.parse().unwrap_or_else(|_| panic!("{name} of row {row} is no number: `{text}`"))
    }
}

/// Files of a folder without the film, which is an MP4 or an animated PNG; there is one film.
fn files_but_film(place: &Workplace, folder: &str) -> Vec<String> {
    let (films, others): (Vec<_>, Vec<_>) =
        place.files(folder).into_iter().partition(|name| name.starts_with("flight."));
    assert!(matches!(films[..], [ref f] if f == "flight.mp4" || f == "flight.png"), "{films:?}");
    others
}

#[test]
fn a_headless_flight_writes_frames_a_sheet_a_film_a_summary_and_a_row_of_statistics_per_frame() {
    if !has_adapter("a_headless_flight_writes_frames_a_sheet_a_film_a_summary") {
        return;
    }
    let place = Workplace::new();
    let run = place.run(&format!("{SMALL} --frames 2 --flip --json a.json --out a")).succeeds();
    assert!(run.out.contains("frames, sheet.png, stats.csv, flight."), "{}", run.out);
    let names = ["frame0000.png", "frame0001.png", "sheet.png", "stats.csv"];
    assert_eq!(files_but_film(&place, "a"), names);
    assert_eq!(size(&place.path("a/frame0001.png")), (192, 108));
    assert!(size(&place.path("a/sheet.png")).0 >= 2 * 192);
    let frames = [place.read("a/frame0000.png"), place.read("a/frame0001.png")];
    assert_ne!(frames[0], frames[1], "the camera moves");

    let table = Table::of(&place, "a");
    assert_eq!(table.rows.len(), 2);
    let most = |name| table.number(0, name).max(table.number(1, name));
    for row in 0..2 {
        assert_eq!(table.number(row, "frame"), row as f64);
        assert_eq!(table.number(row, "overflow"), 0.0);
        assert!(!table.text(row, "place").is_empty());
        for name in ["time_s", "wall_ms", "cpu_ms", "chunks", "ground_triangles"] {
            assert!(table.number(row, name) > 0.0, "{name}");
        }
    }
    for name in ["trees", "points", "work_items", "covered_pixels", "bytes_read", "tree_tiles"] {
        assert!(most(name) > 0.0, "{name}");
    }
    assert_eq!(table.text(0, "flip_to_previous"), "");
    assert!((0.0..1.0).contains(&table.number(1, "flip_to_previous")));

    let summary = place.json("a.json");
    let number = |path: &str| {
        let value = path.split('.').fold(&summary, |value, key| &value[key]);
        value.as_f64().unwrap_or_else(|| panic!("no number {path}: {summary}"))
    };
    assert_eq!(number("frames"), 2.0);
    assert!((number("instances") - 1000.0).abs() <= 30.0, "what --trees asked for: {summary}");
    assert_eq!(number("points.max"), most("points"));
    assert!(number("points.median") <= number("points.max"));
    assert!(number("frame_ms.median") <= number("frame_ms.p95"));
    assert!(number("frame_ms.p95") <= number("frame_ms.worst"));
    for path in ["startup_s", "frame_ms.median", "cpu_s_per_frame"] {
        assert!(number(path) > 0.0, "{path}");
    }
    if cfg!(target_os = "linux") {
        assert!(number("peak_rss_mb") > 10.0);
    }
    assert_eq!((number("seed"), number("side_m")), (1.0, 1000.0));
    assert_eq!(summary["size"], Value::from(vec![192, 108]));
    assert!(summary["adapter"].as_str().is_some_and(|a| !a.is_empty()));

    // The same seed gives the same bytes, another one another world; the way does not depend on the number of frames.
    place.run(&format!("{SMALL} --frames 2 --out b")).succeeds();
    assert_eq!([place.read("b/frame0000.png"), place.read("b/frame0001.png")], frames);
    place.run(&format!("{SMALL} --frames 1 --seed 2 --out c")).succeeds();
    assert_ne!(frames[0], place.read("c/frame0000.png"));
    assert_eq!(place.files("c"), ["frame0000.png", "sheet.png", "stats.csv"], "no film of a frame");
    place.run(&format!("{SMALL} --frames 1 --start 0.5 --out d")).succeeds();
    let alone = Table::of(&place, "d");
    for name in ["place", "x", "y", "z"] {
        assert_eq!(table.text(1, name), alone.text(0, name), "{name} of the frame half way");
    }
}

#[test]
fn hour_season_and_forest_change_the_picture() {
    if !has_adapter("hour_season_and_forest_change_the_picture") {
        return;
    }
    let place = Workplace::new();
    let mut pictures = vec![];
    for options in ["", "--hour 19", "--season 1", "--no-forest"] {
        place.run(&format!("{SMALL} --frames 1 --start 0.3 --out out {options}")).succeeds();
        let picture = place.read("out/frame0000.png");
        assert!(!pictures.contains(&picture), "{options} changes nothing");
        pictures.push(picture);
    }
    let bare = Table::of(&place, "out");
    assert_eq!((bare.number(0, "trees"), bare.number(0, "points")), (0.0, 0.0));
}

#[test]
fn a_model_of_the_users_can_be_planted_instead_of_the_species() {
    if !has_adapter("a_model_of_the_users_can_be_planted_instead_of_the_species") {
        return;
    }
    let place = Workplace::new();
    let run = place.run(
        "fly --headless --size 96x54 --side 1km --trees 1000 --tree {tree} --height 30 --ldi 64 \
         --tree-distance 200 --frames 1 --out out",
    );
    let out = run.succeeds().out;
    assert!(out.contains("1 species") && out.contains("1000 trees"), "{out}");
}

#[test]
fn the_names_of_species_are_listed() {
    let out = Workplace::new().run("fly --species list").succeeds().out;
    assert!(out.lines().eq(bevy_treeline::species::species_names().iter().copied()), "{out}");
}
