//! A scattered forest with its edits: trees by tile, and nearest trees.
//!
//! A tile's trees cost what [`Scatter::tile`] costs; queries keep the last tiles they needed.

use super::{ForestEdits, SavedForest, Scatter, ScatteredTree, TreeId};
use bevy::math::{IVec2, Vec3, Vec3Swizzles};
use std::{
    collections::{BTreeMap, BTreeSet},
    sync::{Arc, Mutex, PoisonError},
};
use thiserror::Error;

/// Tiles that queries keep.
const KEPT_TILES: usize = 16;
/// Why a forest could not be edited or read.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum EditError {
    /// No such tree.
    #[error("forest: there is no tree {id:?}; it was removed, or belongs to another forest")]
    Missing {
        /// The name.
        id: TreeId,
    },
    /// A tree that cannot be planted.
    #[error("forest: a tree with {what} cannot be planted; it must be {must}")]
    Tree {
        /// What is wrong.
        what: String,
        /// What it must be.
        must: String,
    },
    /// The text is not a forest.
    #[error("forest: the text cannot be read: {problem}; it may be cut off or no saved forest")]
    Text {
        /// What the parser says.
        problem: String,
    },
    /// Written by another version.
    #[error(
        "forest: the text has version {found}, this program reads {expected}; use the program that wrote it"
    )]
    Version {
        /// In the text.
        found: u32,
        /// Of this program.
        expected: u32,
    },
    /// Saved with something else than what it is to be planted with.
    #[error(
        "forest: it was saved with {what} {saved}, but here it is {here}; the same trees would not grow"
    )]
    Different {
        /// What differs.
        what: String,
        /// In the text.
        saved: String,
        /// Here.
        here: String,
    },
}

/// A tree that a query found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FoundTree {
    /// Its name.
    pub id: TreeId,
    /// The tree.
    pub tree: ScatteredTree,
    /// From the place asked about to the foot, metres.
    pub distance_m: f32,
}

/// Everything a tile's trees follow from; goes to any thread.
#[derive(Clone)]
pub struct TilePlan {
    scatter: Arc<Scatter>,
    tile: IVec2,
    gone: BTreeSet<u32>,
    placed: Vec<(TreeId, ScatteredTree)>,
}

impl TilePlan {
    /// The trees that stand in the tile: scattered ones by index, then those placed by hand, by name.
    pub fn trees(&self) -> Vec<(TreeId, ScatteredTree)> {
        let tile = self.tile.to_array();
        let scattered = self.scatter.tile(self.tile).into_iter().zip(0..);
        let mut trees: Vec<(TreeId, ScatteredTree)> = scattered
            .filter(|(_, index)| !self.gone.contains(index))
            .map(|(tree, index)| (TreeId::Scattered { tile, index }, tree))
            .collect();
        trees.extend(&self.placed);
        trees
    }
}

type KeptTile = (IVec2, Arc<Vec<(TreeId, ScatteredTree)>>);

/// A scattered forest with its edits.
pub struct PlantedForest {
    scatter: Arc<Scatter>,
    pub(super) edits: ForestEdits,
    /// Indices that are gone, and trees placed by hand, by tile.
    tiles: BTreeMap<[i32; 2], (BTreeSet<u32>, BTreeSet<TreeId>)>,
    kept: Mutex<Vec<KeptTile>>,
}

impl Clone for PlantedForest {
    fn clone(&self) -> Self {
        let (scatter, edits) = (Arc::clone(&self.scatter), self.edits.clone());
        Self { scatter, edits, tiles: self.tiles.clone(), kept: Mutex::default() }
    }
}

impl PlantedForest {
    /// The forest as scattered.
    pub fn new(scatter: Arc<Scatter>) -> Self {
        let (edits, tiles) = (ForestEdits::default(), BTreeMap::new());
        Self { scatter, edits, tiles, kept: Mutex::default() }
    }

    /// The forest without its edits.
    pub fn scatter(&self) -> &Arc<Scatter> {
        &self.scatter
    }

    /// The edits in force.
    pub fn edits(&self) -> &ForestEdits {
        &self.edits
    }

    /// The same forest at another time of the year, 0 to 1; trees placed by hand stay as they are.
    pub fn set_season(&mut self, season: f32) {
        self.scatter = Arc::new(self.scatter.with_season(season));
        self.forget_kept();
    }

    /// The tile that a place lies in.
    pub fn tile_of(&self, position: Vec3) -> IVec2 {
        (position.xz() / self.scatter.tile_size_m()).floor().as_ivec2()
    }

    /// Plants a tree anywhere above or in the ground, also where none would grow.
    ///
    /// # Errors
    /// [`EditError::Tree`] for a tree that cannot be drawn.
    pub fn add(&mut self, tree: ScatteredTree) -> Result<TreeId, EditError> {
        self.check(&tree)?;
        let id = self.edits.add(tree);
        self.here(id, &tree, true);
        Ok(id)
    }

    /// Removes a tree and returns it. O(1), and a tile to scatter if it was not kept.
    ///
    /// # Errors
    /// [`EditError::Missing`].
    pub fn remove(&mut self, id: TreeId) -> Result<ScatteredTree, EditError> {
        let tree = self.get(id).ok_or(EditError::Missing { id })?;
        self.lift(id);
        self.edits.remove(id);
        self.mark_gone(id);
        Ok(tree)
    }

    /// Puts `tree` in the place of another, which keeps its name: moves it, turns it, makes it another species. Returns
    /// the tree before.
    ///
    /// # Errors
    /// [`EditError::Missing`] or [`EditError::Tree`].
    pub fn replace(&mut self, id: TreeId, tree: ScatteredTree) -> Result<ScatteredTree, EditError> {
        self.check(&tree)?;
        let before = self.get(id).ok_or(EditError::Missing { id })?;
        self.lift(id);
        self.edits.replace(id, tree);
        self.mark_gone(id);
        self.here(id, &tree, true);
        Ok(before)
    }

    /// The tree of that name; `None` if it was removed or never was.
    pub fn get(&self, id: TreeId) -> Option<ScatteredTree> {
        if let Some(tree) = self.edits.placed(id) {
            return Some(*tree);
        }
        let TreeId::Scattered { tile, .. } = id else { return None };
        let kept = self.kept(IVec2::from_array(tile));
        kept.iter().find(|(other, _)| *other == id).map(|(_, tree)| *tree)
    }

    /// What the tile's trees follow from. O(edits of the tile).
    pub fn plan(&self, tile: IVec2) -> TilePlan {
        let edits = self.tiles.get(&tile.to_array());
        let (gone, names) = edits.cloned().unwrap_or_default();
        let placed = |id| self.edits.placed(id).map(|tree| (id, *tree));
        TilePlan {
            scatter: Arc::clone(&self.scatter),
            tile,
            gone,
            placed: names.into_iter().filter_map(placed).collect(),
        }
    }

    /// The trees that stand in a tile now.
    pub fn trees_in(&self, tile: IVec2) -> Vec<(TreeId, ScatteredTree)> {
        self.plan(tile).trees()
    }

    /// All trees whose foot is within `radius` metres, nearest first. O(trees of the tiles it meets).
    pub fn within(&self, position: Vec3, radius: f32) -> Vec<FoundTree> {
        if !(position.is_finite() && radius >= 0.0) {
            return vec![];
        }
        let size = self.scatter.tile_size_m();
        let [first, last] = self.scatter.tile_range();
        let low = ((position.xz() - radius) / size).floor().as_ivec2();
        let high = ((position.xz() + radius) / size).floor().as_ivec2();
        let inside = low.max(first).y..=high.min(last).y;
        let tiles = inside
            .flat_map(|z| (low.max(first).x..=high.min(last).x).map(move |x| IVec2::new(x, z)));
        let mut found: Vec<FoundTree> = vec![];
        for tile in tiles {
            let trees = self.kept(tile);
            found.extend(trees.iter().filter_map(|(id, tree)| {
                let distance_m = tree.position.distance(position);
                (distance_m <= radius).then_some(FoundTree { id: *id, tree: *tree, distance_m })
            }));
        }
        found.sort_by(|a, b| a.distance_m.total_cmp(&b.distance_m).then(a.id.cmp(&b.id)));
        found
    }

    /// The nearest tree within `radius` metres.
    pub fn nearest(&self, position: Vec3, radius: f32) -> Option<FoundTree> {
        self.within(position, radius).into_iter().next()
    }

    /// The forest as JSON text: settings, species and edits, not the trees.
    pub fn to_json(&self) -> String {
        let saved = SavedForest::of(&self.scatter, &self.edits);
        serde_json::to_string_pretty(&saved).expect("plain numbers, lists and names")
    }

    pub(super) fn check(&self, tree: &ScatteredTree) -> Result<(), EditError> {
        let wrong = |what: String, must: &str| Err(EditError::Tree { what, must: must.to_owned() });
        let half = self.scatter.ground().side_m() * 0.5;
        let aside = tree.position.xz().abs().max_element();
        if !(tree.position.is_finite() && aside < half) {
            let must = format!("finite and within {half} m of the middle in x and z");
            return wrong(format!("position {}", tree.position), &must);
        }
        if !(tree.scale.is_finite() && tree.scale > 0.0) {
            return wrong(format!("scale {}", tree.scale), "positive and finite");
        }
        if !(tree.rotation.is_finite() && tree.rotation.length_squared() > 1e-6) {
            return wrong(format!("rotation {}", tree.rotation), "finite and not 0");
        }
        if !(0.0..=1.0).contains(&tree.autumn) {
            return wrong(format!("autumn {}", tree.autumn), "0 to 1");
        }
        let species = self.scatter.species().len();
        if usize::from(tree.species) >= species {
            return wrong(format!("species {}", tree.species), &format!("below {species}"));
        }
        Ok(())
    }

    /// Takes note that a placed tree stands in its tile, or does not.
    pub(super) fn here(&mut self, id: TreeId, tree: &ScatteredTree, stands: bool) {
        let tile = self.tile_of(tree.position);
        let names = &mut self.tiles.entry(tile.to_array()).or_default().1;
        if stands {
            names.insert(id)
        } else {
            names.remove(&id)
        };
        self.forget_kept();
    }

    fn lift(&mut self, id: TreeId) {
        if let Some(tree) = self.edits.placed(id).copied() {
            self.here(id, &tree, false);
        }
    }

    pub(super) fn mark_gone(&mut self, id: TreeId) {
        if let TreeId::Scattered { tile, index } = id {
            self.tiles.entry(tile).or_default().0.insert(index);
            self.forget_kept();
        }
    }

    fn forget_kept(&mut self) {
        self.kept.get_mut().unwrap_or_else(PoisonError::into_inner).clear();
    }

    fn kept(&self, tile: IVec2) -> Arc<Vec<(TreeId, ScatteredTree)>> {
        let find = |kept: &Vec<KeptTile>| {
            kept.iter().find(|(t, _)| *t == tile).map(|(_, k)| Arc::clone(k))
        };
        if let Some(trees) = find(&self.kept.lock().unwrap_or_else(PoisonError::into_inner)) {
            return trees;
        }
        // Not under the lock: scattering takes milliseconds.
        let trees = Arc::new(self.trees_in(tile));
        let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        if kept.len() >= KEPT_TILES {
            kept.remove(0);
        }
        kept.push((tile, Arc::clone(&trees)));
        trees
    }
}
