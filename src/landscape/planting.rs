//! A planted forest in the scene: what a game inserts and reads. `streaming` keeps tiles around the cameras.
//!
//! In: [`Planting`] (forest and baked trees) and [`PlantingSettings`]. Out: one [`Forest`](crate::Forest) entity a tile with
//! [`ForestTile`], and [`PlantingCounters`]. Tiles are made in background tasks; the main thread only spawns them.

use super::{EditError, PlantedForest, ScatteredTree, TreeId, streaming};
use crate::{asset::TreeAsset, forest::TreeInstance};
use bevy::{camera::visibility::VisibilitySystems, prelude::*, transform::TransformSystems};
use std::{
    collections::BTreeSet,
    ops::Range,
    sync::{
        Arc,
        atomic::{AtomicU64, Ordering},
    },
};

/// Streams the tiles of [`Planting`] around every active [`Camera3d`]. Without that resource it does nothing.
#[derive(Default)]
pub struct PlantingPlugin;

impl Plugin for PlantingPlugin {
    fn build(&self, app: &mut App) {
        app.init_resource::<PlantingSettings>()
            .init_resource::<PlantingCounters>()
            .init_resource::<streaming::Tiles>()
            .add_systems(
                PostUpdate,
                // Where cameras are is known, and what is spawned is still seen this frame.
                streaming::stream_tiles
                    .after(TransformSystems::Propagate)
                    .before(VisibilitySystems::VisibilityPropagate),
            );
    }
}

/// What a species is drawn with.
#[derive(Clone, Debug, Default)]
pub struct PlantingSpecies {
    /// In summer, and all year where there is no other: one or several plants of the species, of which each tree is one.
    /// Without any the species is not drawn.
    pub summer: Vec<Handle<TreeAsset>>,
    /// For trees whose leaves have turned ([`ScatteredTree::autumn`] ≥ 0.5); may be empty.
    pub autumn: Vec<Handle<TreeAsset>>,
    /// Metres per unit of the model: its height in metres at scale 1 over its height as modelled, > 0.
    pub unit_scale: f32,
}

/// Which handles a species uses.
#[derive(Clone, Debug)]
struct Kind {
    summer: Range<u16>,
    autumn: Range<u16>,
    unit_scale: f32,
    shown: bool,
}

/// Handles of all species, and which of them a tree uses.
#[derive(Clone, Debug, Default)]
pub(super) struct Wardrobe {
    pub handles: Vec<Handle<TreeAsset>>,
    kinds: Vec<Kind>,
}

impl Wardrobe {
    fn new(species: &[PlantingSpecies]) -> Self {
        let mut wardrobe = Self::default();
        for species in species {
            let mut hang = |handles: &[Handle<TreeAsset>]| {
                let first = wardrobe.handles.len() as u16;
                wardrobe.handles.extend_from_slice(handles);
                first..wardrobe.handles.len() as u16
            };
            let (summer, autumn) = (hang(&species.summer), hang(&species.autumn));
            let unit_scale = species.unit_scale;
            wardrobe.kinds.push(Kind { summer, autumn, unit_scale, shown: true });
        }
        wardrobe
    }

    /// The tree as a forest draws it; `None` for a species without a model, or one that is not shown.
    pub fn dress(&self, tree: &ScatteredTree) -> Option<TreeInstance> {
        let kind = self.kinds.get(usize::from(tree.species)).filter(|kind| kind.shown)?;
        let turned = tree.autumn >= 0.5 && !kind.autumn.is_empty();
        let plants = if turned { &kind.autumn } else { &kind.summer };
        // The seed also spreads the switch to meshes, which is finer than a few plants: its low bits choose.
        let plant = (plants.start..plants.end).nth(usize::from(tree.seed) % plants.len().max(1))?;
        Some(TreeInstance {
            position: tree.position,
            rotation: tree.rotation,
            scale: tree.scale * kind.unit_scale,
            species: plant,
            tint: tree.tint,
            seed: tree.seed,
        })
    }
}

/// The forest to draw. Insert it to plant, replace it to plant another, remove it to clear everything.
#[derive(Resource)]
pub struct Planting {
    forest: PlantedForest,
    pub(super) wardrobe: Arc<Wardrobe>,
    /// Tiles of trees that edits touched since the last frame.
    pub(super) touched: BTreeSet<[i32; 2]>,
    /// All tiles are to be made again.
    pub(super) touched_all: bool,
    /// Tells one planting from the next.
    pub(super) serial: u64,
}

impl Planting {
    /// Draws `forest` with these trees, in the order of [`Scatter::species`](super::Scatter::species). Species beyond the list are not drawn.
    pub fn new(forest: PlantedForest, species: &[PlantingSpecies]) -> Self {
        static PLANTINGS: AtomicU64 = AtomicU64::new(1);
        Self {
            forest,
            wardrobe: Arc::new(Wardrobe::new(species)),
            touched: BTreeSet::new(),
            touched_all: false,
            serial: PLANTINGS.fetch_add(1, Ordering::Relaxed),
        }
    }

    /// The forest, to ask for trees or to save.
    pub fn forest(&self) -> &PlantedForest {
        &self.forest
    }

    /// Plants a tree: [`PlantedForest::add`].
    ///
    /// # Errors
    /// As there.
    pub fn add(&mut self, tree: ScatteredTree) -> Result<TreeId, EditError> {
        let id = self.forest.add(tree)?;
        self.touch(&tree);
        Ok(id)
    }

    /// Removes a tree: [`PlantedForest::remove`].
    ///
    /// # Errors
    /// As there.
    pub fn remove(&mut self, id: TreeId) -> Result<ScatteredTree, EditError> {
        let tree = self.forest.remove(id)?;
        self.touch(&tree);
        Ok(tree)
    }

    /// Moves or changes a tree: [`PlantedForest::replace`].
    ///
    /// # Errors
    /// As there.
    pub fn replace(&mut self, id: TreeId, tree: ScatteredTree) -> Result<ScatteredTree, EditError> {
        let before = self.forest.replace(id, tree)?;
        self.touch(&before);
        self.touch(&tree);
        Ok(before)
    }

    /// Another time of the year, 0 summer to 1 late autumn. Tiles change over the next frames, nearest first.
    pub fn set_season(&mut self, season: f32) {
        self.forest.set_season(season);
        self.touched_all = true;
    }

    /// Shows or hides a species, by its index. Tiles change over the next frames, nearest first.
    pub fn set_shown(&mut self, species: usize, shown: bool) {
        if let Some(kind) = Arc::make_mut(&mut self.wardrobe).kinds.get_mut(species) {
            kind.shown = shown;
            self.touched_all = true;
        }
    }

    fn touch(&mut self, tree: &ScatteredTree) {
        self.touched.insert(self.forest.tile_of(tree.position).to_array());
    }
}

/// How much is planted, and how fast.
#[derive(Resource, Clone, Debug, PartialEq)]
pub struct PlantingSettings {
    /// Trees and shrubs stand in tiles nearer than this to a camera, metres. Default: 4,000.
    pub tree_distance_m: f32,
    /// Ground cover stands in tiles nearer than this, metres. Default: 120.
    pub cover_distance_m: f32,
    /// Main-thread work a frame, milliseconds; at least one tile that is ready is taken. Default: 2.
    pub main_thread_ms: f32,
    /// Plants in the scene at most, ground cover included; the farthest tiles give way. Default: 4,000,000 (128 MB twice).
    pub max_trees: usize,
    /// Every frame has all its tiles, however long that takes: for pictures and tests. Default: false.
    pub wait: bool,
}

impl Default for PlantingSettings {
    fn default() -> Self {
        Self {
            tree_distance_m: 4_000.0,
            cover_distance_m: 120.0,
            main_thread_ms: 2.0,
            max_trees: 4_000_000,
            wait: false,
        }
    }
}

impl PlantingSettings {
    /// Where the points of a tile's plants thin out to nothing, so that tiles come and go unseen.
    pub(super) fn view_range(&self, cover: bool) -> Range<f32> {
        // Cover is small where it ends; trees end in haze.
        let (distance, share) =
            if cover { (self.cover_distance_m, 0.55) } else { (self.tree_distance_m, 0.9) };
        distance * share..distance
    }
}

/// On every entity that the plugin spawned beside its [`Forest`](crate::Forest).
#[derive(Component, Clone, Copy, Debug, PartialEq, Eq)]
pub struct ForestTile {
    /// As [`Scatter::tile`](super::Scatter::tile) or [`Scatter::cover_tile`](super::Scatter::cover_tile) number it.
    pub tile: IVec2,
    /// Ground cover instead of trees.
    pub cover: bool,
}

/// What streaming did in the last frame.
#[derive(Resource, Clone, Copy, Debug, Default, PartialEq)]
pub struct PlantingCounters {
    /// Tiles of trees that are planted; empty ones too.
    pub tree_tiles: usize,
    /// Tiles of ground cover that are planted.
    pub cover_tiles: usize,
    /// Trees and shrubs in the scene.
    pub trees: usize,
    /// Plants of the ground cover in the scene.
    pub cover: usize,
    /// Tiles that are wanted but not there yet, or not up to date.
    pub pending: usize,
    /// Tiles that [`PlantingSettings::max_trees`] left out.
    pub refused: usize,
    /// Time the main thread spent, milliseconds; with [`PlantingSettings::wait`] waiting is included.
    pub main_thread_ms: f32,
}
