//! What holds for every landscape: on a small made-up ground with water, cliffs and a tree line.

use super::{test_ground::Cliffs, *};
use bevy::math::{IVec2, Vec2, Vec3};
use proptest::prelude::*;
use std::sync::Arc;

const NAMES: [(&str, f32, f32); 9] = [
    ("oak", 22.0, 6.0),
    ("birch", 18.0, 3.5),
    ("willow", 14.0, 6.0),
    ("spruce", 28.0, 3.5),
    ("scots_pine", 22.0, 4.0),
    ("poplar", 28.0, 3.0),
    ("shrub", 1.8, 1.2),
    ("grass_tuft", 0.45, 0.3),
    ("fern", 0.9, 0.6),
];

pub(super) fn species() -> Vec<ScatterSpecies> {
    NAMES.map(|(name, height, radius)| ScatterSpecies::new(name, height, radius)).to_vec()
}

pub(super) fn scatter_over(
    ground: impl Ground,
    settings: ScatterSettings,
) -> Result<Scatter, ScatterError> {
    let biomes = Biomes::new(
        &ground,
        &BiomeSettings {
            seed: settings.seed,
            tree_line_m: Some(220.0),
            ..BiomeSettings::default()
        },
    );
    Scatter::new(Arc::new(ground), Arc::new(biomes), species(), settings)
}

fn all(scatter: &Scatter) -> Vec<ScatteredTree> {
    scatter.tiles().flat_map(|t| scatter.tile(t)).collect()
}

fn name(scatter: &Scatter, tree: &ScatteredTree) -> String {
    scatter.species()[usize::from(tree.species)].name.clone()
}

/// The pair of trunks with the least room between them, in metres.
fn least_room(scatter: &Scatter, trees: &[ScatteredTree]) -> f32 {
    let trunk = |t: &ScatteredTree| {
        let s = &scatter.species()[usize::from(t.species)];
        s.habitat.trunk_share * s.height_m * t.scale
    };
    let place = |t: &ScatteredTree| Vec2::new(t.position.x, t.position.z);
    let mut sorted = trees.to_vec();
    sorted.sort_by(|a, b| a.position.x.total_cmp(&b.position.x));
    let mut least = f32::INFINITY;
    for (i, a) in sorted.iter().enumerate() {
        for b in sorted[i + 1..].iter().take_while(|b| b.position.x - a.position.x < 4.0) {
            least = least.min(place(a).distance(place(b)) - trunk(a) - trunk(b));
        }
    }
    least
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(10))]
    #[test]
    fn plants_stand_apart_on_dry_ground_that_is_not_too_steep(seed in any::<u64>(), per_hectare in 50f32..1500.0, side in 300f32..700.0) {
        let settings = ScatterSettings { seed, tile_m: 128.0, amount: TreeAmount::PerHectare(per_hectare), ..ScatterSettings::default() };
        let scatter = scatter_over(Cliffs { side }, settings).expect("it fits");
        let trees = all(&scatter);
        prop_assert!(!trees.is_empty());
        prop_assert!(least_room(&scatter, &trees) > 0.0, "{}", least_room(&scatter, &trees));
        let cover: Vec<ScatteredTree> = (-3..3).flat_map(|x| scatter.cover_tile(IVec2::new(x, 1))).collect();
        let ground = scatter.ground();
        for tree in trees.iter().chain(&cover) {
            let Vec3 { x, y, z } = tree.position;
            let habitat = &scatter.species()[usize::from(tree.species)].habitat;
            let sunk = ground.height(x, z) - y;
            prop_assert!((0.0..0.8).contains(&sunk), "sunk {sunk}");
            prop_assert!(ground.height(x, z) > 0.3, "in the water at {}", tree.position);
            let slope = ground.normal(x, z).y.min(1.0).acos().to_degrees();
            prop_assert!(slope <= habitat.max_slope_deg + 0.1, "{slope} degrees");
            prop_assert!(x.abs() <= side / 2.0 && z.abs() <= side / 2.0);
            let [young, old] = habitat.scale;
            prop_assert!(tree.scale > 0.1 * young && tree.scale <= old, "scale {}", tree.scale);
            prop_assert!(tree.rotation.is_normalized() && tree.tint.iter().all(|t| (40..200).contains(t)));
            let lean = (tree.rotation * Vec3::Y).y.min(1.0).acos();
            prop_assert!(lean < if habitat.kind == PlantKind::Cover { 0.6 } else { 0.12 }, "leans {lean}");
        }
    }

    #[test]
    fn tiles_do_not_depend_on_the_order_they_are_made_in(seed in any::<u64>()) {
        let settings = ScatterSettings { seed, tile_m: 64.0, ..ScatterSettings::default() };
        let [a, b] = [(); 2].map(|()| scatter_over(Cliffs { side: 400.0 }, settings.clone()).expect("it fits"));
        let mut tiles: Vec<IVec2> = a.tiles().collect();
        let forward: Vec<_> = tiles.iter().map(|t| a.tile(*t)).collect();
        tiles.reverse();
        let mut backward: Vec<_> = tiles.iter().map(|t| b.tile(*t)).collect();
        backward.reverse();
        prop_assert_eq!(forward, backward);
        prop_assert_eq!(a.cover_tile(IVec2::new(2, -1)), b.cover_tile(IVec2::new(2, -1)));
    }
}

#[test]
fn a_tile_holds_what_lies_in_it() {
    let scatter =
        scatter_over(Cliffs { side: 500.0 }, ScatterSettings::default()).expect("it fits");
    for tile in scatter.tiles() {
        let low = tile.as_vec2() * scatter.tile_size_m();
        for tree in scatter.tile(tile) {
            let inside = Vec2::new(tree.position.x, tree.position.z) - low;
            assert!(inside.min_element() >= 0.0 && inside.max_element() <= scatter.tile_size_m());
        }
    }
    assert!(scatter.tile(IVec2::new(9, 0)).is_empty() && scatter.tile(IVec2::MAX).is_empty());
    assert!(scatter.tile(IVec2::MIN).is_empty());
}

#[test]
fn totals_are_met_within_three_per_cent() {
    for (side, total, seed) in [
        (500.0, 1, 1),
        (2000.0, 1_000, 1),
        (1000.0, 9_000, 2),
        (2500.0, 30_000, 3),
        (2500.0, 150_000, 4),
    ] {
        let settings = ScatterSettings {
            seed,
            amount: TreeAmount::Total(total),
            ..ScatterSettings::default()
        };
        let scatter = scatter_over(Cliffs { side }, settings).expect("it fits");
        let found = all(&scatter).len();
        assert!((found as f32 / total as f32 - 1.0).abs() < 0.03, "{found} of {total}");
        assert_eq!(scatter.expected_trees(), total as f64);
    }
}

#[test]
fn a_density_says_how_many_trees_to_expect() {
    for per_hectare in [40.0, 400.0, 2000.0] {
        let amount = TreeAmount::PerHectare(per_hectare);
        let settings = ScatterSettings { amount, ..ScatterSettings::default() };
        let scatter = scatter_over(Cliffs { side: 2000.0 }, settings).expect("it fits");
        let found = all(&scatter).len() as f64;
        assert!(
            (found / scatter.expected_trees() - 1.0).abs() < 0.03,
            "{found} of {}",
            scatter.expected_trees()
        );
    }
}

#[test]
fn amounts_that_do_not_fit_are_refused_with_the_number_that_does() {
    let with = |amount, max_bytes| {
        let settings = ScatterSettings { amount, max_bytes, ..ScatterSettings::default() };
        scatter_over(Cliffs { side: 300.0 }, settings)
    };
    assert_eq!(with(TreeAmount::Total(0), u64::MAX).err(), Some(ScatterError::None));
    let Some(ScatterError::Room { fits, .. }) = with(TreeAmount::Total(1 << 40), u64::MAX).err()
    else {
        panic!("no room")
    };
    let scatter = with(TreeAmount::Total(fits), u64::MAX).expect("the number that fits does");
    assert!((all(&scatter).len() as f32 / fits as f32 - 1.0).abs() < 0.03);
    let refused = with(TreeAmount::Total(2_000), 64 * 1_000).err();
    assert_eq!(
        refused,
        Some(ScatterError::Memory { requested: 2_000, fits: 1_000, max_bytes: 64_000 })
    );
    assert!(with(TreeAmount::Total(1_000), 64 * 1_000).is_ok());
    let Some(ScatterError::Density { fits, .. }) =
        with(TreeAmount::PerHectare(1e6), u64::MAX).err()
    else {
        panic!("too dense")
    };
    assert!(with(TreeAmount::PerHectare(fits), u64::MAX).is_ok());
    assert!(matches!(
        with(TreeAmount::PerHectare(400.0), 640).err(),
        Some(ScatterError::Memory { fits: 10, .. })
    ));
}

#[test]
fn settings_and_species_that_cannot_be_used_are_named() {
    let base = ScatterSettings::default();
    for bad in [
        ScatterSettings { season: 1.5, ..base.clone() },
        ScatterSettings { tile_m: f32::NAN, ..base.clone() },
        ScatterSettings { cover_tile_m: 0.0, ..base.clone() },
        ScatterSettings { cover_per_m2: -1.0, ..base.clone() },
        ScatterSettings { spacing_m: Some(0.0), ..base.clone() },
        ScatterSettings { amount: TreeAmount::PerHectare(f32::NAN), ..base.clone() },
    ] {
        let error = scatter_over(Cliffs { side: 100.0 }, bad.clone()).err();
        assert!(matches!(error, Some(ScatterError::Setting { .. })), "{bad:?}: {error:?}");
    }
    let ground = Arc::new(Cliffs { side: 100.0 });
    let biomes = Arc::new(Biomes::new(&*ground, &BiomeSettings::default()));
    let with = |species| Scatter::new(ground.clone(), biomes.clone(), species, base.clone()).err();
    assert_eq!(with(vec![]), Some(ScatterError::NoSpecies { given: 0 }));
    assert_eq!(
        with(vec![ScatterSpecies::new("fern", 1.0, 1.0)]),
        Some(ScatterError::NoSpecies { given: 1 })
    );
    let error = with(vec![ScatterSpecies::new("oak", f32::NAN, 1.0)]).expect("no height");
    assert!(error.to_string().contains("height_m of species `oak` is NaN"), "{error}");
}

#[test]
fn forests_are_closed_and_meadows_hold_lone_trees() {
    let settings = ScatterSettings { seed: 4, ..ScatterSettings::default() };
    let scatter = scatter_over(Heightfield::rolling(1000.0, 128, 2), settings).expect("it fits");
    // Trees in squares of 25 m: many squares empty, many full, some with a tree or two.
    let mut squares = vec![0u32; 40 * 40];
    let trees = all(&scatter);
    for tree in trees.iter().filter(|t| name(&scatter, t) != "shrub") {
        let [x, z] =
            [tree.position.x, tree.position.z].map(|v| ((v + 500.0) / 25.0).min(39.0) as usize);
        squares[z * 40 + x] += 1;
    }
    let share = |f: fn(u32) -> bool| squares.iter().filter(|&&n| f(n)).count() as f32 / 1600.0;
    assert!(share(|n| n == 0) > 0.1, "open: {}", share(|n| n == 0));
    assert!(share(|n| n >= 14) > 0.3, "dense: {}", share(|n| n >= 14));
    assert!(share(|n| (1..=3).contains(&n)) > 0.04, "lone: {}", share(|n| (1..=3).contains(&n)));
}

#[test]
fn conifers_stand_higher_than_broadleaves_and_willows_by_the_water() {
    let scatter = scatter_over(
        Cliffs { side: 4000.0 },
        ScatterSettings { amount: TreeAmount::Total(60_000), ..ScatterSettings::default() },
    )
    .expect("it fits");
    let trees = all(&scatter);
    let mean = |wanted: &str| {
        let heights: Vec<f32> =
            trees.iter().filter(|t| name(&scatter, t) == wanted).map(|t| t.position.y).collect();
        assert!(heights.len() > 100, "{wanted}: {}", heights.len());
        heights.iter().sum::<f32>() / heights.len() as f32
    };
    assert!(mean("spruce") > mean("oak") + 40.0, "{} {}", mean("spruce"), mean("oak"));
    assert!(mean("willow") < 12.0, "{}", mean("willow"));
    // Trees become small towards the tree line.
    let size = |range: std::ops::Range<f32>| {
        let sizes: Vec<f32> = trees
            .iter()
            .filter(|t| name(&scatter, t) == "scots_pine" && range.contains(&t.position.y))
            .map(|t| t.scale)
            .collect();
        sizes.iter().sum::<f32>() / sizes.len() as f32
    };
    let highest = trees.iter().map(|t| t.position.y).fold(0.0, f32::max);
    assert!(size(highest - 60.0..highest) < 0.75 * size(0.0..highest * 0.5));
    let [_, top] = scatter.ground().height_range();
    assert!(highest < 0.85 * top, "{highest} of {top}");
}

#[test]
fn leaves_turn_with_the_season_and_evergreens_do_not() {
    let summer = scatter_over(Cliffs { side: 400.0 }, ScatterSettings::default()).expect("it fits");
    let (middle, late) = (summer.with_season(0.5), summer.with_season(1.0));
    let [a, b, c] = [&summer, &middle, &late].map(all);
    assert_eq!(a.len(), c.len());
    let mut turned = [0, 0];
    for ((a, b), c) in a.iter().zip(&b).zip(&c) {
        assert_eq!((a.position, a.rotation, a.species), (c.position, c.rotation, c.species));
        let deciduous = summer.species()[usize::from(a.species)].habitat.deciduous;
        assert_eq!((a.autumn, c.autumn), (0.0, if deciduous { 1.0 } else { 0.0 }));
        if deciduous {
            turned[usize::from(b.autumn > 0.5)] += 1;
        }
    }
    assert!(turned[0] > a.len() / 10 && turned[1] > a.len() / 10, "{turned:?}");
}

#[test]
fn crowns_are_expected_where_trees_are() {
    let scatter =
        scatter_over(Cliffs { side: 1000.0 }, ScatterSettings::default()).expect("it fits");
    let trees = all(&scatter);
    let squares = (0..400).map(|i| Vec2::new((i % 20) as f32, (i / 20) as f32) * 50.0 - 475.0);
    let (mut in_forest, mut outside) = (vec![], vec![]);
    for at in squares {
        let cover = scatter.canopy_cover(at.x, at.y);
        assert!((0.0..=1.0).contains(&cover));
        let near =
            trees.iter().filter(|t| Vec2::new(t.position.x, t.position.z).distance(at) < 15.0);
        if cover > 0.6 { &mut in_forest } else { &mut outside }.push(near.count());
    }
    let mean = |v: &[usize]| v.iter().sum::<usize>() as f32 / v.len().max(1) as f32;
    assert!(in_forest.len() > 30 && outside.len() > 30);
    assert!(mean(&in_forest) > 3.0 * mean(&outside), "{} {}", mean(&in_forest), mean(&outside));
}
