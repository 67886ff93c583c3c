//! Settings out of their range and places that cannot be written.

use super::Workplace;

#[test]
fn every_bad_setting_is_named_with_what_is_allowed_and_nothing_is_written() {
    let place = Workplace::new();
    let size = "WIDTHxHEIGHT";
    let runs: [(&str, &[&str]); 59] = [
        ("bake {tree} --ldi 0", &["--ldi", "0 is not in 1..=16384"]),
        ("bake {tree} --ldi 100000", &["--ldi", "100000 is not in 1..=16384"]),
        ("bake {tree} --ldi -5", &["--ldi", "-5 is not in 1..=16384"]),
        ("bake {tree} --max-layers 0", &["--max-layers", "0 is not in 1..=4096"]),
        ("bake {tree} --directions 2", &["--directions", "2 is not in 3..=64"]),
        ("bake {tree} --order sorted", &["--order", "sorted"]),
        ("view {tree} --headless --ldi 0", &["--ldi", "1..=16384"]),
        ("view {tree} --headless --quality -1", &["--quality", "-1", "0.05 to 16"]),
        ("view --headless", &["FILE"]),
        ("view {tree} --species oak --headless", &["--species", "cannot be used with"]),
        ("view --species baobab --headless", &["`baobab`", "scots_pine", "grass_tuft"]),
        ("view --species oak --autumn 3 --headless", &["--autumn", "0 (summer) to 1"]),
        ("compare {tree} --ldi 0", &["--ldi", "1..=16384"]),
        ("compare {tree} --quality nan", &["--quality", "nan", "0.05 to 16"]),
        ("compare {tree} --distances 0", &["--distances", "0 is not a distance", "above 0"]),
        ("compare {tree} --distances 40,-1", &["--distances", "-1 is not a distance", "above 0"]),
        ("compare {tree} --distances near", &["--distances", "near"]),
        ("compare {tree} --overlap 2", &["--overlap", "2", "0 to 1"]),
        ("compare {tree} --elevation 100", &["--elevation", "100", "-89 to 89"]),
        ("compare {tree} --supersample 1", &["--supersample", "1 is not in 4..=8"]),
        ("bench --instances 0", &["--instances", "1 to 10M"]),
        ("bench --instances 1k,20M", &["--instances", "1 to 10M"]),
        ("bench --instances few", &["--instances", "few", "250k"]),
        ("bench --techniques voxels", &["--techniques", "voxels", "points", "lod"]),
        ("bench --techniques lod+fast", &["--techniques", "fast", "msaa4"]),
        ("bench --tree baobab", &["--tree baobab", "no such file", "aspen"]),
        ("bench --scene moon", &["--scene", "moon"]),
        ("bench --size 0x9", &["--size", "0x9", size]),
        ("bench --seconds 0", &["--seconds", "above 0"]),
        ("bench --compare nowhere.json", &["nowhere.json"]),
        ("fly --headless --ldi 0", &["--ldi", "1..=16384"]),
        ("fly --headless --size 0x0", &["--size", "0x0", size]),
        ("fly --headless --size abc", &["--size", "abc", size]),
        ("fly --headless --size 100000x10", &["--size", "100000x10", size]),
        ("fly --headless --frames 0", &["--frames 0", "give 1 or more"]),
        ("fly --headless --quality -1", &["--quality", "-1", "0.05 to 16"]),
        ("fly --headless --trees -7", &["--trees", "-7", "1M"]),
        ("fly --headless --trees many", &["--trees", "many", "1M"]),
        ("fly --headless --trees 0", &["--trees 0", "1000 or more", "--no-forest"]),
        ("fly --headless --trees 20M", &["--trees", "at most 10M"]),
        ("fly --headless --density 0", &["--density", "per hectare"]),
        ("fly --headless --density nan", &["--density", "per hectare"]),
        ("fly --headless --variants 0", &["--variants", "1..=8"]),
        ("fly --headless --memory 1", &["--memory", "64..="]),
        ("fly --headless --side -5", &["--side", "-5", "16km"]),
        ("fly --headless --seed -1", &["--seed", "-1"]),
        ("fly --headless --visibility -1", &["--visibility", "-1", "16km"]),
        ("fly --headless --side far", &["--side", "far", "16km"]),
        ("fly --headless --side 999m", &["--side", "1km to 64km"]),
        ("fly --headless --side 65km", &["--side", "1km to 64km"]),
        ("fly --headless --height -2", &["--height", "height in metres"]),
        ("fly --headless --hour 25", &["--hour", "0 to 24"]),
        ("fly --headless --season -0.1", &["--season", "0 (summer) to 1"]),
        ("fly --headless --visibility 5", &["--visibility", "100 metres"]),
        ("fly --headless --tree-distance 0", &["--tree-distance", "100 metres"]),
        ("fly --headless --mesh-distance -1", &["--mesh-distance", "metres"]),
        ("fly --headless --splat-path u16", &["--splat-path", "u16"]),
        ("fly --headless --sky blue", &["--sky", "blue"]),
        ("fly --headless --way nan", &["--way", "numbers"]),
    ];
    for (arguments, parts) in runs {
        place.run(&format!("{arguments} --out out")).fails_with(parts);
        assert_eq!(place.files("out"), [""; 0], "{arguments}");
    }
    assert_eq!(place.files("cache"), [""; 0]);
}

#[test]
fn an_output_folder_that_cannot_be_made_is_named_and_found_out_before_the_work() {
    let place = Workplace::new();
    place.write("file", b"not a folder");
    for command in [
        "bake {tree} --ldi 64",
        "compare {tree} --ldi 64",
        "fly --headless",
        "view {tree} --headless --ldi 64",
    ] {
        let run = place.run(&format!("{command} --out file/out"));
        run.fails_with(&["cannot write file/out", "--out"]);
    }
    assert_eq!(place.files("cache"), [""; 0]);
    assert_eq!(place.read("file"), b"not a folder");
}

#[test]
fn a_report_that_cannot_be_written_is_named_and_the_trees_are_there() {
    let place = Workplace::new();
    place.write("file", b"not a folder");
    let run = place.run("bake {tree} --ldi 64 --out out --json file/table.json");
    run.fails_with(&["cannot write file"]);
    assert_eq!(place.files("out"), ["spruce.treeline"]);
}

#[test]
fn a_command_that_does_not_exist_or_lacks_its_file_is_explained() {
    let place = Workplace::new();
    for (arguments, part) in
        [("", "Usage"), ("flie", "flie"), ("bake", "<FILES>"), ("compare", "<FILE>")]
    {
        let run = place.run(arguments);
        assert!(!run.ok && run.err.contains(part), "{arguments}: {}", run.err);
    }
}
