//! The README says what the code does. Needs no GPU. (Its Rust code is compiled as a doctest of the crate.)
use bevy::reflect::{PartialReflect, structs::Struct};
use bevy_treeline::{BakeSettings, NearMeshes, SplatShape, TreelineSettings};

const README: &str = include_str!("../README.md");

/// The cells of the first table row that begins with `name` in backquotes.
fn row(name: &str) -> Option<Vec<&'static str>> {
    let start = format!("| `{name}` |");
    let line = README.lines().find(|line| line.starts_with(&start))?;
    Some(line.trim_matches('|').split('|').map(str::trim).collect())
}

/// As the table writes a value: numbers without a needless fraction, enums by their name.
fn written(value: &dyn PartialReflect) -> String {
    if let Some(number) = value.try_downcast_ref::<f32>() {
        return number.to_string();
    }
    if let Some(shape) = value.try_downcast_ref::<SplatShape>() {
        return format!("{shape:?}");
    }
    format!("{value:?}")
}

#[test]
fn every_camera_setting_is_in_the_readme_with_its_default() {
    let settings = TreelineSettings::default();
    let mut wrong = vec![];
    for index in 0..settings.field_len() {
        let name = settings.name_at(index).expect("counted");
        let default = written(settings.field_at(index).expect("counted"));
        match row(name) {
            None => wrong.push(format!("no row for `{name}`")),
            Some(cells) if cells.get(2) != Some(&format!("`{default}`").as_str()) => {
                wrong.push(format!(
                    "the default of `{name}` is `{default}`, the row says {cells:?}"
                ));
            }
            Some(_) => {}
        }
    }
    assert!(wrong.is_empty(), "README.md, settings of a camera:\n{}", wrong.join("\n"));
}

#[test]
fn other_defaults_that_the_readme_names_are_so() {
    let pool = NearMeshes::default().max_trees;
    assert!(README.contains(&format!("(`max_trees`, {pool})")), "`max_trees` is {pool}");
    let ldi = BakeSettings::default().ldi_size;
    assert!(README.contains(&format!("default {ldi})")), "`ldi_size` is {ldi}");
}

#[test]
fn links_and_examples_of_the_readme_exist() {
    let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR"));
    let links = README.split("](").skip(1).filter_map(|rest| rest.split(')').next());
    let files = links.filter(|link| !link.contains("://") && !link.starts_with('#'));
    let examples =
        README.split("--example ").skip(1).filter_map(|rest| rest.split_whitespace().next());
    let wanted = files.map(str::to_owned).chain(examples.map(|e| format!("examples/{e}.rs")));
    let missing: Vec<_> = wanted.filter(|file| !root.join(file).exists()).collect();
    assert!(missing.is_empty(), "README.md names files that are not there: {missing:?}");
}

#[test]
fn the_version_table_has_this_version() {
    let version = env!("CARGO_PKG_VERSION").rsplit_once('.').expect("major.minor.patch").0;
    let line = README.lines().find(|line| line.ends_with(&format!("| {version} |")));
    assert!(line.is_some_and(|line| line.starts_with("| 0.19 ")), "no row for {version}");
}

/// The keys of `fly`, as its source lists them for the panel and the terminal.
fn keys_of_fly() -> Vec<(&'static str, &'static str)> {
    let source = include_str!("../src/bin/treeline/fly/window.rs");
    let list = source.split("pub const KEYS").nth(1).and_then(|rest| rest.split("];").next());
    let list = list.expect("window.rs has KEYS");
    let texts: Vec<&str> = list.split('"').skip(1).step_by(2).collect();
    texts.chunks_exact(2).map(|pair| (pair[0], pair[1])).collect()
}

#[test]
fn every_key_of_the_flight_is_in_the_readme() {
    let keys = keys_of_fly();
    assert!(keys.len() > 10, "{keys:?}");
    let rows: Vec<String> = keys.iter().map(|(key, does)| format!("| {key} | {does} |")).collect();
    let missing: Vec<_> = rows.iter().filter(|row| !README.contains(row.as_str())).collect();
    assert!(missing.is_empty(), "README.md, keys of fly: {missing:?}");
}
