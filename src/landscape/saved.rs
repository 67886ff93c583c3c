//! A forest as text: settings, species, a mark of the ground and the edits; trees are scattered again. O(edits).

use super::{
    EditError, ForestEdits, Ground, PlantedForest, Scatter, ScatterSettings, ScatterSpecies, TreeId,
};
use bevy::math::{IVec2, Vec2};
use serde::{Deserialize, Serialize};
use std::{collections::BTreeMap, sync::Arc};

/// Of the text. Another number is refused.
const VERSION: u32 = 1;
/// Heights of the same ground may differ by this much between machines, in metres.
const SAME_HEIGHT_M: f32 = 0.02;

/// Tells grounds apart: side, and heights at a few places.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GroundMark {
    /// Metres.
    pub side_m: f32,
    /// Metres; nothing where there is no ground.
    pub heights: Vec<Option<f32>>,
}

impl GroundMark {
    /// The mark of a ground. 16 heights.
    pub fn of(ground: &dyn Ground) -> Self {
        let side_m = ground.side_m();
        let height = |i: u32| {
            // Turned, so that rows and columns differ.
            let at = (Vec2::new((i % 4) as f32, (i / 4) as f32) / 4.0 - 0.36) * 0.8;
            let at = Vec2::new(at.x + 0.1 * at.y, at.y - 0.1 * at.x) * side_m;
            Some(ground.height(at.x, at.y)).filter(|h| h.is_finite())
        };
        Self { side_m, heights: (0..16).map(height).collect() }
    }

    fn is_like(&self, other: &Self) -> bool {
        let same = |pair: (&Option<f32>, &Option<f32>)| match pair {
            (Some(a), Some(b)) => (a - b).abs() <= SAME_HEIGHT_M,
            (a, b) => a == b,
        };
        self.side_m == other.side_m
            && self.heights.len() == other.heights.len()
            && std::iter::zip(&self.heights, &other.heights).all(same)
    }
}

/// A forest as it was saved, before there is ground to plant it on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SavedForest {
    /// Of the text.
    pub version: u32,
    /// To scatter with: [`Scatter::new`] with these, [`Self::species`] and the same ground and biomes.
    pub settings: ScatterSettings,
    /// The species.
    pub species: Vec<ScatterSpecies>,
    /// Of the ground it grew on.
    pub ground: GroundMark,
    /// The edits.
    pub edits: ForestEdits,
}

impl SavedForest {
    pub(super) fn of(scatter: &Scatter, edits: &ForestEdits) -> Self {
        Self {
            version: VERSION,
            settings: scatter.settings().clone(),
            species: scatter.species().to_vec(),
            ground: GroundMark::of(&**scatter.ground()),
            edits: edits.clone(),
        }
    }

    /// Reads what [`PlantedForest::to_json`] wrote.
    ///
    /// # Errors
    /// [`EditError::Text`] or [`EditError::Version`].
    pub fn parse(text: &str) -> Result<Self, EditError> {
        #[derive(Deserialize)]
        struct Head {
            version: u32,
        }
        let problem = |error: serde_json::Error| EditError::Text { problem: error.to_string() };
        // First the version: other versions may hold anything else.
        let found = serde_json::from_str::<Head>(text).map_err(problem)?.version;
        if found != VERSION {
            return Err(EditError::Version { found, expected: VERSION });
        }
        serde_json::from_str(text).map_err(problem)
    }

    /// Plants it: the forest as it was.
    ///
    /// # Errors
    /// [`EditError::Different`] if `scatter` has other settings (the season may differ), species or another ground;
    /// [`EditError::Tree`] or [`EditError::Missing`] for edits that cannot be.
    pub fn plant(self, scatter: Arc<Scatter>) -> Result<PlantedForest, EditError> {
        let different = |what: &str, saved: String, here: String| {
            Err(EditError::Different { what: what.to_owned(), saved, here })
        };
        let here = scatter.settings();
        let same =
            ScatterSettings { season: here.season, max_bytes: here.max_bytes, ..self.settings };
        if same != *here {
            return different("settings", format!("{same:?}"), format!("{here:?}"));
        }
        if let Some((saved, here)) =
            std::iter::zip(&self.species, scatter.species()).find(|(a, b)| a != b)
        {
            return different("species", format!("{saved:?}"), format!("{here:?}"));
        }
        let counts = [self.species.len(), scatter.species().len()];
        if counts[0] != counts[1] {
            return different("a number of species,", counts[0].to_string(), counts[1].to_string());
        }
        let ground = GroundMark::of(&**scatter.ground());
        if !self.ground.is_like(&ground) {
            return different("ground", format!("{:?}", self.ground), format!("{ground:?}"));
        }
        let mut forest = PlantedForest::new(scatter);
        forest.edits = self.edits;
        let edits = forest.edits.clone();
        let mut counts = BTreeMap::new();
        for id in edits.all_gone() {
            if let TreeId::Scattered { tile, index } = id {
                let count = counts
                    .entry(tile)
                    .or_insert_with(|| forest.scatter().tile(IVec2::from_array(tile)).len());
                if index as usize >= *count {
                    return Err(EditError::Missing { id });
                }
            }
            forest.mark_gone(id);
        }
        for (id, tree) in edits.all_placed() {
            forest.check(tree)?;
            forest.here(id, tree, true);
        }
        Ok(forest)
    }
}
