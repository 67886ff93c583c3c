//! What was changed by hand: trees added, moved and removed, by names that stay. Pure; O(log edits) an edit.
//!
//! Only the outcome is kept, so the order of edits to different trees does not matter.

use super::ScatteredTree;
use bevy::math::{IVec2, Quat, Vec3};
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};

/// The name of a tree: stays while others come and go.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TreeId {
    /// Place `index` in the list of [`Scatter::tile`](super::Scatter::tile).
    Scattered {
        /// The tile, x and z, even if the tree was moved to another since.
        tile: [i32; 2],
        /// In the tile's list.
        index: u32,
    },
    /// Added by hand, counted from 0.
    Added(u64),
}

/// Changes to a scattered forest.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "EditList", into = "EditList")]
pub struct ForestEdits {
    /// Scattered trees that are no more.
    removed: BTreeSet<TreeId>,
    /// Added trees, and scattered ones that were moved or changed.
    placed: BTreeMap<TreeId, ScatteredTree>,
    /// The next added tree's number.
    next: u64,
}

impl ForestEdits {
    /// Adds a tree.
    pub fn add(&mut self, tree: ScatteredTree) -> TreeId {
        let id = TreeId::Added(self.next);
        self.next += 1;
        self.placed.insert(id, tree);
        id
    }

    /// Removes a tree; removing it again changes nothing. Whether a scattered tree of that name ever was is not known here.
    pub fn remove(&mut self, id: TreeId) {
        self.placed.remove(&id);
        if let TreeId::Scattered { .. } = id {
            self.removed.insert(id);
        }
    }

    /// Puts a tree in the place of the one of that name: moves it or changes anything else. Brings back a removed scattered
    /// tree; false, and nothing changes, for an added tree that is no more or never was.
    pub fn replace(&mut self, id: TreeId, tree: ScatteredTree) -> bool {
        if matches!(id, TreeId::Added(_)) && !self.placed.contains_key(&id) {
            return false;
        }
        self.removed.remove(&id);
        self.placed.insert(id, tree);
        true
    }

    /// Takes back what was done to a scattered tree.
    pub fn restore(&mut self, id: TreeId) {
        if let TreeId::Scattered { .. } = id {
            self.removed.remove(&id);
            self.placed.remove(&id);
        }
    }

    /// Whether a scattered tree is not where it was scattered.
    pub fn is_gone(&self, id: TreeId) -> bool {
        self.removed.contains(&id) || self.placed.contains_key(&id)
    }

    /// An added, moved or changed tree.
    pub fn placed(&self, id: TreeId) -> Option<&ScatteredTree> {
        self.placed.get(&id)
    }

    /// All added, moved and changed trees, by name.
    pub fn all_placed(&self) -> impl Iterator<Item = (TreeId, &ScatteredTree)> {
        self.placed.iter().map(|(id, tree)| (*id, tree))
    }

    /// Names of all scattered trees that were removed, moved or changed.
    pub fn all_gone(&self) -> impl Iterator<Item = TreeId> {
        let moved = self.placed.keys().filter(|id| matches!(id, TreeId::Scattered { .. }));
        self.removed.iter().chain(moved).copied()
    }

    /// Number of edits that are in force.
    pub fn len(&self) -> usize {
        self.removed.len() + self.placed.len()
    }

    /// True without edits.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

impl TreeId {
    /// The tile a scattered tree was scattered in.
    pub fn scattered_in(self) -> Option<IVec2> {
        match self {
            Self::Scattered { tile, .. } => Some(IVec2::from_array(tile)),
            Self::Added(_) => None,
        }
    }
}

/// Plain lists: keys of JSON objects are strings, tree names are not.
#[derive(Clone, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct EditList {
    next: u64,
    removed: Vec<TreeId>,
    placed: Vec<PlacedTree>,
}

#[derive(Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct PlacedTree {
    id: TreeId,
    position: [f32; 3],
    rotation: [f32; 4],
    scale: f32,
    species: u16,
    tint: [u8; 3],
    autumn: f32,
    seed: u8,
}

impl From<ForestEdits> for EditList {
    fn from(edits: ForestEdits) -> Self {
        let placed = edits.placed.iter().map(|(id, tree)| PlacedTree {
            id: *id,
            position: tree.position.to_array(),
            rotation: tree.rotation.to_array(),
            scale: tree.scale,
            species: tree.species,
            tint: tree.tint,
            autumn: tree.autumn,
            seed: tree.seed,
        });
        Self {
            next: edits.next,
            placed: placed.collect(),
            removed: edits.removed.into_iter().collect(),
        }
    }
}

impl TryFrom<EditList> for ForestEdits {
    type Error = String;

    fn try_from(list: EditList) -> Result<Self, String> {
        let mut edits = Self { next: list.next, ..Self::default() };
        for id in list.removed {
            if matches!(id, TreeId::Added(_)) {
                return Err(format!("removed tree {id:?} was added, so it would not be listed"));
            }
            edits.removed.insert(id);
        }
        for placed in list.placed {
            let id = placed.id;
            let tree = ScatteredTree {
                position: Vec3::from_array(placed.position),
                rotation: Quat::from_array(placed.rotation),
                scale: placed.scale,
                species: placed.species,
                tint: placed.tint,
                autumn: placed.autumn,
                seed: placed.seed,
            };
            if matches!(id, TreeId::Added(number) if number >= edits.next) {
                return Err(format!("tree {id:?} is not below the next number, {}", edits.next));
            }
            if edits.removed.contains(&id) || edits.placed.insert(id, tree).is_some() {
                return Err(format!("tree {id:?} is listed twice"));
            }
        }
        Ok(edits)
    }
}
