//! Species, elevation models and amounts of trees that cannot be: each a message that names what, where and a way out.

use super::Workplace;
use image::{GrayImage, ImageBuffer, Luma};

const DEM: &str =
    r#"{"spacing_m": 90, "height_min_m": 100, "height_max_m": 400, "width": 12, "height": 12}"#;

fn dem(place: &Workplace, name: &str, side: u32, json: Option<&str>) {
    let posts = ImageBuffer::from_fn(side, side, |x, z| Luma([(x * 5000 + z) as u16]));
    posts.save(place.path(&format!("{name}.png"))).expect("the folder is writable");
    if let Some(json) = json {
        place.write(&format!("{name}.json"), json.as_bytes());
    }
}

/// The command fails with all of `parts` and leaves nothing.
#[track_caller]
fn fails(place: &Workplace, command: &str, parts: &[&str]) {
    place.run(&format!("{command} --headless --out out")).fails_with(parts);
    assert_eq!(place.files("out"), [""; 0], "{command}");
    assert_eq!(place.files("cache"), [""; 0], "{command}");
}

#[test]
fn species_that_there_are_not_are_named_with_those_that_there_are() {
    let place = Workplace::new();
    for (names, part) in [("baobab", "`baobab`"), ("oak,baobab", "`baobab`"), ("", "``")] {
        let command = format!("fly --side 1km --species={names}");
        fails(&place, &command, &[part, "known are", "scots_pine", "grass_tuft"]);
    }
    fails(
        &place,
        "fly --side 1km --trees 1000 --species list,oak --tree oak.glb",
        &["--species", "cannot be used with", "--tree"],
    );
}

#[test]
fn a_malformed_species_file_is_named_with_line_field_and_range() {
    let place = Workplace::new();
    let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR"));
    let good = std::fs::read_to_string(root.join("assets/species/oak.ron")).expect("it ships");
    let cut = &good[..good.len() / 2];
    let unknown = good.replacen("deciduous:", "deciduos:", 1);
    let files: [(&str, &str, &[&str]); 4] = [
        ("cut.ron", cut, &["cut.ron:", "compare with a file in assets/species"]),
        ("empty.ron", "", &["empty.ron:", "compare with a file in assets/species"]),
        ("unknown.ron", &unknown, &["unknown.ron:", "deciduos", "assets/species"]),
        ("garbage.ron", "no ( species", &["garbage.ron:1:", "assets/species"]),
    ];
    for (name, text, parts) in files {
        place.write(name, text.as_bytes());
        fails(&place, &format!("view --species {name}"), parts);
    }
    place.write("binary.ron", b"\xff\xfe\x00");
    fails(&place, "view --species binary.ron", &["binary.ron"]);
    fails(&place, "view --species lost.ron", &["lost.ron", "cannot read the species file"]);
}

#[test]
fn an_elevation_model_that_cannot_be_used_is_named_with_its_fault() {
    let place = Workplace::new();
    dem(&place, "size", 11, Some(DEM));
    dem(&place, "alone", 12, None);
    dem(&place, "malformed", 12, Some(r#"{"spacing_m": "wide""#));
    dem(&place, "lacking", 12, Some(r#"{"spacing_m": 90, "width": 12, "height": 12}"#));
    dem(&place, "flat", 12, Some(&DEM.replace("400", "100")));
    dem(&place, "tiny", 4, Some(&DEM.replace("12", "4")));
    dem(&place, "shallow", 12, Some(DEM));
    GrayImage::new(12, 12).save(place.path("shallow.png")).expect("the folder is writable");
    dem(&place, "broken", 12, Some(DEM));
    place.write("broken.png", b"no picture");
    dem(&place, "cut", 12, Some(DEM));
    let whole = place.read("cut.png");
    place.write("cut.png", &whole[..whole.len() / 2]);
    let needs = "`spacing_m`, `height_min_m`";
    let models: [(&str, &[&str]); 10] = [
        ("size", &["size.png", "11 x 11", "12 x 12", "size.json"]),
        ("alone", &["alone.json", "cannot be read", "beside it"]),
        ("malformed", &["malformed.json", needs]),
        ("lacking", &["lacking.json", "height_min_m", needs]),
        ("flat", &["flat.json", "`height_max_m` must be above"]),
        ("tiny", &["tiny.json", "at least 8 x 8"]),
        ("shallow", &["shallow.png", "L8", "16-bit grey"]),
        ("broken", &["broken.png", "not a readable PNG", "16-bit grey"]),
        ("cut", &["cut.png", "not a readable PNG"]),
        ("lost", &["lost.json", "cannot be read"]),
    ];
    for (name, parts) in models {
        fails(&place, &format!("fly --species grass_tuft --dem {name}.png"), parts);
    }
}

/// The number behind `before` in a message.
fn number_behind(text: &str, before: &str) -> Option<u64> {
    let rest = text.split(before).nth(1)?;
    let digits: String = rest.trim_start().chars().take_while(char::is_ascii_digit).collect();
    digits.parse().ok()
}

#[test]
fn more_trees_than_memory_or_ground_holds_are_refused_with_the_number_that_fits() {
    let place = Workplace::new();
    let fly = "fly --headless --species oak --variants 1 --ldi 32 --peel cpu --out out";
    let memory = place.run(&format!("{fly} --side 16km --density 1000 --memory 64"));
    // 64 MiB at 64 bytes a tree.
    assert_eq!(number_behind(&memory.err, "which hold"), Some(1 << 20), "{}", memory.err);
    memory.fails_with(&["scatter", "trees take more than", "allow more"]);

    let room = place.run(&format!("{fly} --side 1km --trees 5M"));
    let fits = number_behind(&room.err, "this spacing,").expect("a number");
    assert!((500..500_000).contains(&fits), "{}", room.err);
    room.fails_with(&["5000000 trees do not fit", "ask for at most"]);

    let hectare = place.run(&format!("{fly} --side 1km --density 1e6"));
    let fits = number_behind(&hectare.err, "this spacing,").expect("a number");
    assert!((50..20_000).contains(&fits), "{}", hectare.err);
    hectare.fails_with(&["do not fit on a hectare", "ask for at most"]);

    // Ground cover alone is no forest.
    let cover = place.run(&format!("{fly} --side 1km").replace("oak", "grass_tuft"));
    cover.fails_with(&["is a tree or shrub", "give at least one"]);
    assert_eq!(place.files("out"), [""; 0]);
}
