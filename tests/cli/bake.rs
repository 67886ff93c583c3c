//! `treeline bake`: files, report and cache.

use super::{Workplace, tree};
use bevy_treeline::asset::read_treeline;
use serde_json::Value;

#[test]
fn a_bad_model_among_good_ones_is_reported_and_the_good_ones_are_baked() {
    let place = Workplace::new();
    let birch = tree("birch.glb");
    let run =
        place.run(&format!("bake {{tree}} lost.glb {birch} --ldi 64 --out out --json table.json"));
    run.fails_with(&["lost.glb", "No such file", "check the path"]);
    assert!(run.err.contains("1 of 3 models failed"), "{}", run.err);
    assert_eq!(place.files("out"), ["birch.treeline", "spruce.treeline"]);

    let report = place.json("table.json");
    let models = report["models"].as_array().expect("a list");
    assert_eq!(models.len(), 2);
    for (model, name) in models.iter().zip(["spruce", "birch"]) {
        let text = |key: &str| model[key].as_str().unwrap_or_default().to_owned();
        let number = |value: &Value| value.as_u64().unwrap_or_default();
        assert!(text("file").ends_with(&format!("{name}.glb")), "{model}");
        assert!(text("output").ends_with(&format!("{name}.treeline")), "{model}");
        let tree = read_treeline(&place.path(&format!("out/{name}.treeline"))).expect("a tree");
        assert_eq!(number(&model["triangles"]), tree.statistics.triangles);
        assert_eq!(number(&model["ldi"]), 64);
        let layers: Vec<u64> =
            model["layers"].as_array().expect("a list").iter().map(number).collect();
        assert!(layers.len() == 3 && layers.iter().all(|l| (2..100).contains(l)), "{layers:?}");
        assert_eq!(number(&model["points"]), tree.point_count() as u64);
        assert!(tree.point_count() > 1000);
        let file = place.read(&format!("out/{name}.treeline"));
        assert_eq!(number(&model["bytes"]), file.len() as u64);
        let seconds = |key: &str| model["seconds"][key].as_f64().expect("seconds");
        let parts = seconds("loading") + seconds("peeling") + seconds("ordering");
        assert!(parts > 0.0 && seconds("total") >= parts * 0.999, "{model}");
        // The table on the screen says the same.
        let row = run.out.lines().find(|l| l.starts_with(name)).expect("a row");
        assert!(row.contains(&tree.point_count().to_string()), "{row}");
    }
    let failed = report["failed"].as_array().expect("a list");
    assert!(
        failed[0]["file"] == "lost.glb"
            && failed[0]["error"].as_str().is_some_and(|e| !e.is_empty())
    );
}

#[test]
fn a_second_bake_comes_from_the_cache_and_gives_the_same_bytes() {
    let place = Workplace::new();
    let bake = |options: &str| {
        place
            .run(&format!("bake {{tree}} --ldi 64 --out out --json table.json {options}"))
            .succeeds();
        let model = place.json("table.json")["models"][0].clone();
        (model["from_cache"] == true, place.read("out/spruce.treeline"))
    };
    let (cached, first) = bake("");
    assert!(!cached && place.files("cache").len() == 1);
    assert_eq!(bake(""), (true, first));
    assert_eq!(place.files("cache").len(), 1);
    // Another setting is another entry; no cache is no entry.
    assert!(!bake("--bake-seed 2").0);
    assert_eq!(place.files("cache").len(), 2);
    assert!(!bake("--no-cache").0);
    assert!(!bake("--no-cache --bake-seed 3").0);
    assert_eq!(place.files("cache").len(), 2);
}

#[test]
fn a_cache_that_cannot_be_written_is_a_warning_and_the_bake_succeeds() {
    let place = Workplace::new();
    place.write("file", b"not a folder");
    let run = place.run("bake {tree} --ldi 64 --out out --cache file/cache").succeeds();
    let warning = run
        .err
        .lines()
        .find(|l| l.contains("WARN") && l.contains("file/cache") && l.contains("not kept"));
    assert!(warning.is_some(), "{}", run.err);
    assert_eq!(place.files("out"), ["spruce.treeline"]);
}

#[test]
fn models_of_one_name_do_not_replace_each_other() {
    let place = Workplace::new();
    std::fs::create_dir(place.path("other")).expect("the folder is writable");
    let bytes = std::fs::read(tree("birch.glb")).expect("a tree of this project");
    place.write("other/spruce.glb", &bytes);
    place.write("birch.1.glb", &bytes);
    place.write("birch.2.glb", &bytes);
    let run = place.run("bake {tree} other/spruce.glb birch.1.glb birch.2.glb --ldi 32 --out out");
    run.fails_with(&["other/spruce.glb", "out/spruce.treeline", "another folder with --out"]);
    assert_eq!(place.files("out"), ["birch.1.treeline", "birch.2.treeline", "spruce.treeline"]);
    let kept = read_treeline(&place.path("out/spruce.treeline")).expect("a tree");
    assert_eq!(kept.source.map(|s| s.path.ends_with("assets/trees/spruce.glb")), Some(true));
}

#[test]
fn layers_that_are_lost_are_counted_in_a_warning_also_from_the_cache() {
    let place = Workplace::new();
    for _ in 0..2 {
        let run =
            place.run("bake {tree} --ldi 64 --max-layers 2 --out out --json table.json").succeeds();
        let model = place.json("table.json")["models"][0].clone();
        let warning = model["warnings"][0].as_str().expect("a warning").to_owned();
        assert!(warning.contains("fragments lie behind layer 2"), "{warning}");
        assert_eq!(run.err.matches(&warning).count(), 1, "{}", run.err);
    }
}
