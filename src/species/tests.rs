//! What holds for every preset, and what wrong files are told.

use super::*;
use proptest::prelude::*;

/// Name, triangles and height in metres of each preset.
const BUDGETS: [(&str, std::ops::RangeInclusive<usize>, f32); 14] = [
    ("oak", 20_000..=250_000, 20.0),
    ("birch", 20_000..=250_000, 18.0),
    ("aspen", 20_000..=250_000, 18.0),
    ("willow", 20_000..=250_000, 14.0),
    ("maple", 20_000..=250_000, 18.0),
    ("spruce", 20_000..=250_000, 28.0),
    ("fir", 20_000..=250_000, 30.0),
    ("scots_pine", 20_000..=250_000, 24.0),
    ("poplar", 20_000..=250_000, 26.0),
    ("dead_tree", 20_000..=250_000, 14.0),
    ("shrub", 5_000..=15_000, 1.8),
    ("fern", 300..=1_500, 0.9),
    ("grass_tuft", 100..=600, 0.45),
    ("flower", 100..=800, 0.5),
];

fn known(name: &str) -> Species {
    preset(name).unwrap_or_else(|error| panic!("{error}"))
}

/// Mean colour of the leaves, by vertex.
fn mean_leaf_color(tree: &PlainTree) -> Vec3 {
    let leaves = tree.parts.iter().find(|part| part.name == "leaves").expect("leaves");
    let sum: Vec3 = leaves.colors.iter().map(|c| Vec3::from_slice(&c[..3])).sum();
    sum / leaves.colors.len() as f32
}

/// Hue in degrees: 0 red, 60 yellow, 120 green.
fn hue(color: Vec3) -> f32 {
    let (r, g, b) = (color.x, color.y, color.z);
    (3f32.sqrt() * (g - b)).atan2(2.0 * r - g - b).to_degrees()
}

#[test]
fn every_name_has_a_preset_of_that_name_and_a_budget() {
    assert_eq!(species_names(), BUDGETS.map(|(name, ..)| name));
    for name in species_names() {
        assert_eq!(known(name).name, *name);
    }
}

#[test]
fn every_preset_stands_on_the_ground_at_its_height_within_its_budget() {
    for (name, triangles, height) in BUDGETS {
        let species = known(name);
        assert_eq!(species.height_m(), height, "{name}");
        for seed in 1..6 {
            let tree = grow(&species, seed, 0.0);
            let (bounds, count) = (tree.bounds(), tree.triangle_count());
            let ratio = bounds.max.y / height;
            assert!((0.85..=1.15).contains(&ratio), "{name} {seed}: {bounds:?}");
            assert!(bounds.min.y.abs() < 1e-4, "{name} {seed}: {bounds:?}");
            assert!(triangles.contains(&count), "{name} {seed}: {count} triangles");
        }
    }
}

#[test]
fn vertices_are_finite_with_unit_normals_and_indices_in_range() {
    for name in species_names() {
        let tree = grow(&known(name), 7, 0.4);
        for part in &tree.parts {
            let vertices = part.positions.len();
            assert_eq!((part.normals.len(), part.colors.len()), (vertices, vertices));
            assert!(part.positions.iter().all(|p| p.is_finite()), "{name} {}", part.name);
            let unit = |n: &Vec3| (n.length() - 1.0).abs() < 1e-3;
            assert!(part.normals.iter().all(unit), "{name} {}", part.name);
            assert!(part.triangles.iter().flatten().all(|&i| (i as usize) < vertices));
        }
    }
}

#[test]
fn triangles_face_the_side_of_their_normals() {
    for name in species_names() {
        for part in grow(&known(name), 3, 0.0).parts {
            let agreeing = part.triangles.iter().filter(|t| {
                let [a, b, c] = t.map(|i| part.positions[i as usize]);
                let normal: Vec3 = t.iter().map(|&i| part.normals[i as usize]).sum();
                (b - a).cross(c - a).dot(normal) >= 0.0
            });
            let share = agreeing.count() as f32 / part.triangles.len() as f32;
            assert!(share > 0.97, "{name} {}: {share}", part.name);
        }
    }
}

#[test]
fn equal_seeds_give_equal_plants_and_others_do_not() {
    for name in species_names() {
        let species = known(name);
        assert_eq!(grow(&species, 5, 0.3), grow(&species, 5, 0.3), "{name}");
        assert_ne!(grow(&species, 5, 0.3), grow(&species, 6, 0.3), "{name}");
    }
}

#[test]
fn leaves_of_trees_have_albedos_of_leaves() {
    for name in species_names().iter().filter(|name| **name != "dead_tree") {
        let color = mean_leaf_color(&grow(&known(name), 1, 0.0));
        let fits = (0.02..0.13).contains(&color.x)
            && (0.05..0.2).contains(&color.y)
            && (0.012..0.09).contains(&color.z);
        assert!(fits && color.y > color.x && color.y > color.z, "{name}: {color}");
    }
}

#[test]
fn autumn_turns_deciduous_leaves_yellow_or_red_and_leaves_evergreens_alone() {
    for name in species_names().iter().filter(|name| **name != "dead_tree") {
        let species = known(name);
        let [summer, half, end] = [0.0, 0.5, 1.0].map(|autumn| grow(&species, 2, autumn));
        if !species.deciduous {
            assert_eq!(summer, end, "{name}");
            continue;
        }
        let hues = [&summer, &half, &end].map(|tree| hue(mean_leaf_color(tree)));
        assert!(hues[0] > 65.0, "{name} is green in summer: {hues:?}");
        assert!(hues[1] < hues[0] - 2.0, "{name} has begun to turn: {hues:?}");
        assert!((0.0..60.0).contains(&hues[2]), "{name} has turned: {hues:?}");
        let bare = species.autumn.as_ref().is_some_and(|autumn| autumn.fallen > 0.0);
        assert_eq!(end.triangle_count() < summer.triangle_count(), bare, "{name}");
    }
}

#[test]
fn leaves_of_one_crown_turn_at_different_times() {
    let maple = known("maple");
    let leaves = |autumn| grow(&maple, 1, autumn).parts[1].colors.clone();
    let (summer, later) = (leaves(0.0), leaves(0.35));
    let turned = summer.iter().zip(&later).filter(|(a, b)| (a[0] - b[0]).abs() > 0.05).count();
    let share = turned as f32 / summer.len() as f32;
    assert!((0.05..0.95).contains(&share), "{share}");
}

#[test]
fn an_unknown_preset_is_told_what_is_known() {
    let message = preset("baobab").expect_err("no such preset").to_string();
    assert!(message.contains("`baobab`"), "{message}");
    for name in species_names() {
        assert!(message.contains(name), "{message}");
    }
}

const OAK: &str = include_str!("../../assets/species/oak.ron");
const MAPLE: &str = include_str!("../../assets/species/maple.ron");

#[test]
fn a_value_out_of_range_is_named_with_file_field_value_and_range() {
    let cases = [
        ("height_m: 20.0", "height_m: -3.0", "shape.height_m is -3, but must be 0.2 to 80"),
        ("radius_m: 10.5", "radius_m: 99.0", "shape.crown.radius_m is 99, but must be 0.1 to 30"),
        ("per_m: 2.3", "per_m: NaN", "shape.levels[0].per_m is NaN, but must be 0 to 60"),
        (
            "angle_deg: (92.0, 26.0)",
            "angle_deg: (92.0, 260.0)",
            "shape.levels[0].angle_deg[1] is 260",
        ),
        ("bearing: (0.25, 1.0)", "bearing: (0.5, 0.4)", "bearing[1] is 0.4"),
        ("fallen: 0.3", "fallen: 1.5", "autumn.fallen is 1.5, but must be 0 to 1"),
    ];
    for (good, bad, expected) in cases {
        assert!(OAK.contains(good), "the oak no longer says {good}");
        let text = OAK.replacen(good, bad, 1);
        let message = Species::from_ron(&text, "my_oak.ron").expect_err(bad).to_string();
        assert!(message.starts_with("my_oak.ron: "), "{message}");
        assert!(message.contains(expected), "{message}");
    }
}

#[test]
fn malformed_ron_is_told_its_file_line_and_column() {
    let cases = [
        (OAK.replacen("height_m: 20.0", "height_m: tall", 1), "a word for a number"),
        (OAK.replacen("height_m: 20.0", "heigth_m: 20.0", 1), "a misspelt field"),
        (OAK.replacen("height_m: 20.0,", "", 1), "a missing field"),
        (OAK[..OAK.len() / 2].to_owned(), "half a file"),
        (String::new(), "nothing"),
    ];
    for (text, what) in cases {
        let error = Species::from_ron(&text, "my_oak.ron").expect_err(what);
        let SpeciesError::Syntax { line, column, .. } = &error else { panic!("{what}: {error}") };
        assert!(*line >= 1 && *column >= 1, "{what}: {error}");
        assert!(error.to_string().starts_with(&format!("my_oak.ron:{line}:{column}: ")), "{error}");
    }
    let misspelt = OAK.replacen("height_m: 20.0", "heigth_m: 20.0", 1);
    let line = 1 + misspelt.lines().position(|line| line.contains("heigth_m")).expect("there");
    let message = Species::from_ron(&misspelt, "x.ron").expect_err("misspelt").to_string();
    assert!(message.starts_with(&format!("x.ron:{line}:")), "{message}");
    assert!(message.contains("heigth_m"), "{message}");
}

#[test]
fn sections_that_belong_together_are_asked_for() {
    let start = MAPLE.find("    autumn: (").expect("the maple has an autumn");
    let text = format!("{})", &MAPLE[..start]);
    let message = Species::from_ron(&text, "m.ron").expect_err("deciduous").to_string();
    assert!(message.starts_with("m.ron: autumn is missing"), "{message}");
    let named = MAPLE.replacen("\"maple\"", "\"My Maple\"", 1);
    let message = Species::from_ron(&named, "m.ron").expect_err("a bad name").to_string();
    assert!(message.contains("name is \"My Maple\""), "{message}");
}

#[test]
fn a_file_that_cannot_be_read_is_named() {
    let message = Species::from_file("no/such/tree.ron").expect_err("no file").to_string();
    assert!(message.contains("no/such/tree.ron"), "{message}");
}

#[test]
fn less_detail_keeps_the_area_of_leaves() {
    let area = |species: &Species| -> f32 {
        let tree = grow(species, 1, 0.0);
        let leaves = tree.parts.iter().find(|part| part.name == "leaves").expect("leaves");
        let triangle = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|i| leaves.positions[i as usize]);
            0.5 * (b - a).cross(c - a).length()
        };
        leaves.triangles.iter().map(triangle).sum()
    };
    let (full, coarse) = (known("oak"), known("oak").with_leaf_detail(0.25));
    let ratio = area(&coarse) / area(&full);
    assert!((0.85..1.15).contains(&ratio), "{ratio}");
    assert!(grow(&coarse, 1, 0.0).triangle_count() * 2 < grow(&full, 1, 0.0).triangle_count());
}

#[test]
fn absurd_shapes_grow_without_panic() {
    let mut species = known("oak");
    let PlantShape::Tree(shape) = &mut species.shape else { panic!("the oak is a tree") };
    shape.height_m = f32::NAN;
    shape.crown.radius_m = -4.0;
    shape.levels[0].forks = f32::INFINITY;
    shape.levels[1].segments = u32::MAX;
    shape.levels.truncate(2);
    shape.bark.sides = 0;
    if let Some(leaves) = &mut shape.leaves {
        leaves.width = f32::NAN;
    }
    species.autumn = None;
    let tree = grow(&species, 1, f32::NAN);
    assert!(tree.parts.iter().flat_map(|p| &p.positions).all(|p| p.is_finite()));
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 48, ..ProptestConfig::default() })]

    #[test]
    fn any_seed_and_season_gives_a_plant_on_the_ground(
        index in 10usize..14, seed: u64, autumn in 0.0f32..=1.0,
    ) {
        let name = species_names()[index];
        let species = known(name);
        let tree = grow(&species, seed, autumn);
        let bounds = tree.bounds();
        // How high a shrub is depends on how far its stems lean: of 3,000, from 0.78 to 1.13.
        let tolerance = if name == "shrub" { 0.3 } else { 0.12 };
        prop_assert!(bounds.min.y.abs() < 1e-4);
        let height = bounds.max.y / species.height_m();
        prop_assert!((height - 1.0).abs() < tolerance, "{name}: {height}, {bounds:?}");
        prop_assert!(tree.triangle_count() > 100);
    }

    #[test]
    fn any_small_tree_shape_in_or_out_of_range_grows(
        seed: u64, height in -1.0f32..100.0, radius in -1.0f32..40.0, base in -0.5f32..1.5,
        forks in 0.0f32..5.0, hang in -1.0f32..2.0, lift in -200.0f32..200.0, broken in 0.0f32..1.0,
    ) {
        let mut species = known("shrub");
        let PlantShape::Tree(shape) = &mut species.shape else { panic!("shrubs have stems") };
        shape.height_m = height;
        shape.crown.radius_m = radius;
        shape.crown.base = base;
        shape.levels[0] = shape::StemShape {
            per_m: 1.0, forks, hang, lift_deg: [lift, -lift], broken, ..shape.levels[0].clone()
        };
        shape.levels.truncate(1);
        let tree = grow(&species, seed, 0.0);
        for part in &tree.parts {
            prop_assert!(part.positions.iter().all(|p| p.is_finite() && p.y >= 0.0));
            prop_assert!(part.normals.iter().all(|n| (n.length() - 1.0).abs() < 1e-3));
        }
    }
}
