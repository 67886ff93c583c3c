//! The components a game adds.

use super::{
    forest_index::ForestIndex,
    instance::{PackedTree, TreeInstance},
};
use crate::{asset::TreeAsset, lod::fade::ViewRange};
use bevy::prelude::*;
use std::{ops::Range, sync::Arc};

/// One entity, one tree: near the camera its mesh, farther away its points. Moves with its `Transform`; scales that
/// differ by axis are drawn as their mean.
#[derive(Component, Clone, Debug, Default, Reflect)]
#[reflect(Component)]
#[require(Transform, Visibility, LodState)]
pub struct TreeImpostor {
    /// The baked tree: a `.treeline` file, or a model (`.glb`, `.gltf`, `.obj`, `.ply`) that is baked when it loads.
    pub tree: Handle<TreeAsset>,
    /// Colour factor per channel, 128 = unchanged.
    pub tint: [u8; 3],
    /// Decides where in its range this tree changes between mesh and points.
    pub seed: u8,
}

impl TreeImpostor {
    /// A tree with its own colours.
    pub fn new(tree: Handle<TreeAsset>) -> Self {
        Self { tree, tint: [128; 3], seed: 0 }
    }
}

/// What was chosen for a [`TreeImpostor`], by the camera that shows it largest. Written every frame.
#[derive(Component, Clone, Copy, Debug, Default, PartialEq, Reflect)]
#[reflect(Component)]
pub struct LodState {
    /// From that camera to the middle of the tree, world units. 0 while the tree loads or without a camera.
    pub distance: f32,
    /// `d0 = s Z0`, world units.
    pub d0: f32,
    /// Points drawn.
    pub points: u32,
    /// `N0`.
    pub points_baked: u32,
    /// Coverage of the mesh, 0 to 1.
    pub mesh: f32,
}

/// Many trees of several species, without an entity each. The entity's `Transform` places the whole.
///
/// A landscape is best made of many forests, one per tile of some hundred metres: what changes is sent to the GPU forest by
/// forest, and forests out of sight cost next to nothing. [`RenderLayers`](bevy::camera::visibility::RenderLayers) of
/// the entity say which cameras see it.
///
/// ```
/// # use bevy::prelude::*; use bevy_treeline::{Forest, TreeInstance};
/// # fn plant(mut commands: Commands, server: Res<AssetServer>) {
/// let mut forest = Forest::new([server.load("oak.glb"), server.load("birch.glb")]);
/// for i in 0..10_000u32 {
///     let at = Vec3::new((i % 100) as f32 * 6.0, 0.0, (i / 100) as f32 * 6.0);
///     forest.push(TreeInstance::at(at).with_yaw(i as f32).with_species((i % 2) as u16));
/// }
/// commands.spawn(forest);
/// # }
/// ```
#[derive(Component, Clone, Debug, Default)]
#[require(Transform, Visibility, ForestIndex)]
pub struct Forest {
    // Both are shared with the render world, which tells a change by the pointer: a change to the trees copies them.
    species: Arc<[Handle<TreeAsset>]>,
    instances: Arc<Vec<PackedTree>>,
    view_range: ViewRange,
}

impl Forest {
    /// An empty forest of these species.
    pub fn new(species: impl IntoIterator<Item = Handle<TreeAsset>>) -> Self {
        Self { species: species.into_iter().collect(), ..default() }
    }

    /// With points that thin out to nothing between two distances from the camera's eye to a tree, in world units: all
    /// are drawn nearer than `range.start`, none beyond `range.end`. They leave one by one and do not grow meanwhile.
    /// Default: drawn at every distance. Numbers out of order are moved to `0 ≤ start ≤ end`.
    ///
    /// For ground cover, and for the edge of what is streamed. Parallel views have no distances and draw all. Costs
    /// nothing per tree; forests wholly beyond their range are skipped.
    pub fn with_view_range(mut self, range: Range<f32>) -> Self {
        self.set_view_range(Some(range));
        self
    }

    /// Changes what [`Forest::with_view_range`] says; `None`: drawn at every distance.
    pub fn set_view_range(&mut self, range: Option<Range<f32>>) {
        self.view_range = range.map_or(ViewRange::default(), |r| ViewRange::new(r.start, r.end));
    }

    /// The distances between which points thin out to nothing, if there are any.
    pub fn view_range(&self) -> Option<Range<f32>> {
        let range = self.view_range;
        range.is_bounded().then_some(range.begin..range.end)
    }

    /// With these trees too.
    pub fn with(mut self, trees: impl IntoIterator<Item = TreeInstance>) -> Self {
        Arc::make_mut(&mut self.instances).extend(trees.into_iter().map(|t| t.pack()));
        self
    }

    /// Adds a tree; its index is the number of trees before. A species that does not exist is not drawn.
    pub fn push(&mut self, tree: TreeInstance) {
        Arc::make_mut(&mut self.instances).push(tree.pack());
    }

    /// Replaces the tree at `index`; false if there is none.
    pub fn set(&mut self, index: usize, tree: TreeInstance) -> bool {
        let Some(slot) = Arc::make_mut(&mut self.instances).get_mut(index) else { return false };
        *slot = tree.pack();
        true
    }

    /// Removes the tree at `index` and puts the last tree in its place; `None` if there is none. O(1).
    pub fn swap_remove(&mut self, index: usize) -> Option<TreeInstance> {
        let all = Arc::make_mut(&mut self.instances);
        (index < all.len()).then(|| TreeInstance::unpack(&all.swap_remove(index)))
    }

    /// The tree at `index`.
    pub fn get(&self, index: usize) -> Option<TreeInstance> {
        self.instances.get(index).map(TreeInstance::unpack)
    }

    /// Number of trees.
    pub fn len(&self) -> usize {
        self.instances.len()
    }

    /// True without trees.
    pub fn is_empty(&self) -> bool {
        self.instances.is_empty()
    }

    /// Every tree, in order.
    pub fn iter(&self) -> impl Iterator<Item = TreeInstance> + '_ {
        self.instances.iter().map(TreeInstance::unpack)
    }

    /// The species, in the order that [`TreeInstance::species`] counts.
    pub fn species(&self) -> &[Handle<TreeAsset>] {
        &self.species
    }

    /// [`Forest::view_range`] as selection reads it.
    pub(crate) fn fade_range(&self) -> ViewRange {
        self.view_range
    }

    /// The species, shared.
    pub(crate) fn shared_species(&self) -> &Arc<[Handle<TreeAsset>]> {
        &self.species
    }

    /// The trees in their 32-byte form, shared.
    pub(crate) fn packed(&self) -> &Arc<Vec<PackedTree>> {
        &self.instances
    }
}
