//! Forests with edits: what holds whatever is done to them, and that text brings them back.

use super::{scatter_tests::scatter_over, test_ground::Cliffs, *};
use bevy::math::{Quat, Vec3};
use proptest::prelude::*;
use std::sync::{Arc, OnceLock};

fn scatter() -> Arc<Scatter> {
    static MADE: OnceLock<Arc<Scatter>> = OnceLock::new();
    let make = || {
        let settings = ScatterSettings { tile_m: 64.0, ..ScatterSettings::default() };
        Arc::new(scatter_over(Cliffs { side: 300.0 }, settings).expect("it fits"))
    };
    Arc::clone(MADE.get_or_init(make))
}

fn tree(x: f32, z: f32) -> ScatteredTree {
    ScatteredTree {
        position: Vec3::new(x, 1.0, z),
        rotation: Quat::from_rotation_y(x),
        scale: 0.7,
        species: 1,
        tint: [120, 130, 128],
        autumn: 0.25,
        seed: 9,
    }
}

/// All trees of a forest by name.
fn all(forest: &PlantedForest) -> Vec<(TreeId, ScatteredTree)> {
    let mut all: Vec<_> = forest.scatter().tiles().flat_map(|t| forest.trees_in(t)).collect();
    all.sort_by_key(|(id, _)| *id);
    all
}

#[derive(Clone, Debug)]
enum Edit {
    Add(f32, f32),
    Remove(usize),
    Move(usize, f32, f32),
}

fn edits() -> impl Strategy<Value = Vec<Edit>> {
    let place = || (-149f32..149.0, -149f32..149.0);
    let edit = prop_oneof![
        place().prop_map(|(x, z)| Edit::Add(x, z)),
        any::<usize>().prop_map(Edit::Remove),
        (any::<usize>(), place()).prop_map(|(i, (x, z))| Edit::Move(i, x, z)),
    ];
    prop::collection::vec(edit, 0..24)
}

/// The forest, and what it should hold, kept as a plain list.
fn edited(edits: &[Edit]) -> (PlantedForest, Vec<(TreeId, ScatteredTree)>) {
    let mut forest = PlantedForest::new(scatter());
    let mut list = all(&forest);
    for edit in edits {
        match *edit {
            Edit::Add(x, z) => {
                list.push((forest.add(tree(x, z)).expect("plantable"), tree(x, z)));
            }
            Edit::Remove(i) => {
                let (id, gone) = list.remove(i % list.len());
                assert_eq!(forest.remove(id), Ok(gone));
                assert_eq!(forest.remove(id), Err(EditError::Missing { id }));
            }
            Edit::Move(i, x, z) => {
                let i = i % list.len();
                let moved = ScatteredTree { position: Vec3::new(x, 2.0, z), ..list[i].1 };
                assert_eq!(forest.replace(list[i].0, moved), Ok(list[i].1));
                list[i].1 = moved;
            }
        }
    }
    list.sort_by_key(|(id, _)| *id);
    (forest, list)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    #[test]
    fn a_forest_holds_what_edits_made_of_it_and_text_brings_it_back(edits in edits()) {
        let (forest, list) = edited(&edits);
        prop_assert_eq!(&all(&forest), &list);
        let text = forest.to_json();
        let back = SavedForest::parse(&text).expect("own text").plant(scatter()).expect("the same ground");
        prop_assert_eq!(back.edits(), forest.edits());
        prop_assert_eq!(all(&back), list);
        prop_assert_eq!(back.to_json(), text);
    }

    #[test]
    fn nearest_trees_are_those_of_a_search_through_all(edits in edits(), x in -200f32..200.0, z in -200f32..200.0, radius in 0f32..90.0) {
        let (forest, list) = edited(&edits);
        let at = Vec3::new(x, 20.0, z);
        let found: Vec<TreeId> = forest.within(at, radius).iter().map(|f| f.id).collect();
        let mut expected: Vec<(f32, TreeId)> =
            list.iter().map(|(id, t)| (t.position.distance(at), *id)).filter(|(d, _)| *d <= radius).collect();
        expected.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        prop_assert_eq!(&found, &expected.iter().map(|e| e.1).collect::<Vec<_>>());
        prop_assert_eq!(forest.nearest(at, radius).map(|f| f.id), found.first().copied());
    }

    #[test]
    fn edits_of_different_trees_commute(seed in any::<u64>()) {
        let base = PlantedForest::new(scatter());
        let names = all(&base);
        let mut rng = crate::math::hash::SplitMix64(seed);
        let mut chosen: Vec<usize> = (0..names.len()).collect();
        rng.shuffle(&mut chosen);
        chosen.truncate(8);
        let apply = |order: &[usize]| {
            let mut forest = base.clone();
            for &i in order {
                let (id, tree) = names[i];
                let moved = ScatteredTree { position: -tree.position, ..tree };
                let done = if i % 2 == 0 { forest.remove(id) } else { forest.replace(id, moved) };
                assert_eq!(done, Ok(tree));
            }
            (forest.edits().clone(), all(&forest))
        };
        let forward = apply(&chosen);
        chosen.reverse();
        prop_assert_eq!(forward, apply(&chosen));
    }
}

#[test]
fn what_was_added_and_removed_leaves_no_trace_but_its_number() {
    let mut forest = PlantedForest::new(scatter());
    let before = all(&forest);
    let id = forest.add(tree(3.0, 4.0)).expect("plantable");
    assert_eq!(forest.nearest(Vec3::new(3.0, 1.0, 4.0), 0.1).map(|f| f.id), Some(id));
    assert_eq!(forest.remove(id), Ok(tree(3.0, 4.0)));
    assert_eq!((all(&forest), forest.edits().len()), (before, 0));
    assert_ne!(forest.add(tree(3.0, 4.0)), Ok(id));
}

#[test]
fn trees_that_cannot_be_drawn_are_refused() {
    let mut forest = PlantedForest::new(scatter());
    let good = tree(0.0, 0.0);
    for bad in [
        ScatteredTree { position: Vec3::NAN, ..good },
        tree(150.0, 0.0),
        ScatteredTree { scale: 0.0, ..good },
        ScatteredTree { rotation: Quat::from_xyzw(0.0, 0.0, 0.0, 0.0), ..good },
        ScatteredTree { species: 99, ..good },
        ScatteredTree { autumn: 2.0, ..good },
    ] {
        assert!(matches!(forest.add(bad), Err(EditError::Tree { .. })), "{bad:?}");
    }
    let nobody = TreeId::Scattered { tile: [0, 0], index: u32::MAX };
    assert_eq!(forest.replace(nobody, good), Err(EditError::Missing { id: nobody }));
    assert_eq!(forest.get(TreeId::Added(0)), None);
}

#[test]
fn texts_that_are_no_forest_of_here_are_refused_with_the_reason() {
    let mut forest = PlantedForest::new(scatter());
    forest.add(tree(1.0, 2.0)).expect("plantable");
    let text = forest.to_json();
    let parse = |text: &str| SavedForest::parse(text).err();
    assert!(matches!(parse("{"), Some(EditError::Text { .. })));
    assert!(matches!(parse(&text[..text.len() / 2]), Some(EditError::Text { .. })));
    let newer = text.replace("\"version\": 1", "\"version\": 7");
    assert_eq!(parse(&newer), Some(EditError::Version { found: 7, expected: 1 }));
    assert!(matches!(
        parse(&text.replace("\"next\": 1", "\"next\": 0")),
        Some(EditError::Text { .. })
    ));
    let saved = SavedForest::parse(&text).expect("own text");
    let planted = |change: fn(&mut SavedForest)| {
        let mut saved = saved.clone();
        change(&mut saved);
        saved.plant(scatter()).err()
    };
    assert_eq!(planted(|_| ()), None);
    assert_eq!(planted(|s| s.settings.season = 1.0), None);
    for different in [
        planted(|s| s.settings.seed = 2),
        planted(|s| s.species[0].height_m = 1.0),
        planted(|s| drop(s.species.pop())),
        planted(|s| s.ground.side_m = 1.0),
        planted(|s| s.ground.heights[3] = Some(1e4)),
    ] {
        assert!(matches!(different, Some(EditError::Different { .. })), "{different:?}");
    }
    let nobody = planted(|s| s.edits.remove(TreeId::Scattered { tile: [0, 0], index: 1 << 30 }));
    assert!(matches!(nobody, Some(EditError::Missing { .. })));
}
