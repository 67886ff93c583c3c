//! Main world → render world: which trees there are. Surfels and instances are shared, not copied.
//!
//! In: forests, single trees, species, near meshes. Out: [`ExtractedTrees`], where forests stay from frame to frame and say
//! when they changed. Cost: a comparison per forest, a copy per single tree; nothing per tree of a forest.

use crate::{
    asset::{TreeAsset, TreeData},
    forest::{
        Forest, GroveSettings, NearMeshes, NearTree, PackedTree, TreeImpostor, TreeInstance,
        UploadBudget,
    },
    lod::fade::ViewRange,
};
use bevy::{
    camera::visibility::RenderLayers, ecs::entity::EntityHashMap, math::Affine3A,
    platform::collections::HashMap, prelude::*, render::Extract,
};
use std::sync::Arc;

/// A visible forest as the render world sees it.
pub(super) struct ExtractedForest {
    pub species: Arc<[Handle<TreeAsset>]>,
    pub instances: Arc<Vec<PackedTree>>,
    pub transform: Affine3A,
    pub view_range: ViewRange,
    pub layers: RenderLayers,
    /// [`ExtractedTrees::revision`] when its trees, species or transform changed last.
    pub packed_revision: u64,
    /// Frame in which it was seen last.
    frame: u64,
}

/// A single tree, already in world space.
#[derive(Clone)]
pub(super) struct ExtractedImpostor {
    pub entity: Entity,
    pub species: AssetId<TreeAsset>,
    pub instance: TreeInstance,
    pub layers: RenderLayers,
}

/// Everything visible this frame.
#[derive(Resource, Default)]
pub(super) struct ExtractedTrees {
    pub forests: EntityHashMap<ExtractedForest>,
    /// Grows in each frame in which a forest comes, changes or goes.
    pub revision: u64,
    /// By entity.
    pub impostors: Vec<ExtractedImpostor>,
    /// The loaded species that these use, by asset id.
    pub species: Vec<(AssetId<TreeAsset>, Arc<TreeData>)>,
    /// Trees whose near mesh is in the scene, sorted.
    pub near: Vec<NearTree>,
    pub upload_budget: UploadBudget,
    pub groves: GroveSettings,
    /// How many forests name a species.
    uses: HashMap<AssetId<TreeAsset>, usize>,
    frame: u64,
}

impl ExtractedTrees {
    /// Takes over what a forest is now, and says whether that is something else. Equal pointers are equal trees: what is
    /// shared is copied when it is changed.
    fn update_forest(
        &mut self,
        entity: Entity,
        forest: &Forest,
        transform: Affine3A,
        layers: &RenderLayers,
    ) -> bool {
        let next = self.revision + 1;
        let (species, instances) = (forest.shared_species(), forest.packed());
        let Some(known) = self.forests.get_mut(&entity) else {
            count_uses(&mut self.uses, species, 1);
            let new = ExtractedForest {
                species: species.clone(),
                instances: instances.clone(),
                transform,
                view_range: forest.fade_range(),
                layers: layers.clone(),
                packed_revision: next,
                frame: self.frame,
            };
            self.forests.insert(entity, new);
            return true;
        };
        known.frame = self.frame;
        let view_range = forest.fade_range();
        let mut is_changed = known.view_range != view_range || known.layers != *layers;
        if is_changed {
            known.view_range = view_range;
            known.layers = layers.clone();
        }
        if !Arc::ptr_eq(&known.species, species) {
            count_uses(&mut self.uses, &known.species, -1);
            count_uses(&mut self.uses, species, 1);
            known.species = species.clone();
            known.packed_revision = next;
        }
        if !Arc::ptr_eq(&known.instances, instances) {
            known.instances = instances.clone();
            known.packed_revision = next;
        }
        if known.transform != transform {
            known.transform = transform;
            known.packed_revision = next;
        }
        is_changed |= known.packed_revision == next;
        is_changed
    }

    /// Forgets forests that were not seen this frame.
    fn forget_forests(&mut self) {
        let Self { forests, uses, frame, .. } = self;
        forests.retain(|_, forest| {
            let is_seen = forest.frame == *frame;
            if !is_seen {
                count_uses(uses, &forest.species, -1);
            }
            is_seen
        });
    }
}

fn count_uses(
    uses: &mut HashMap<AssetId<TreeAsset>, usize>,
    species: &[Handle<TreeAsset>],
    by: isize,
) {
    for id in species.iter().map(Handle::id) {
        let count = uses.entry(id).or_default();
        *count = count.saturating_add_signed(by);
        if *count == 0 {
            uses.remove(&id);
        }
    }
}

type PlacedQuery<'w, 's, T> = Query<
    'w,
    's,
    (
        Entity,
        &'static T,
        &'static GlobalTransform,
        &'static InheritedVisibility,
        Option<&'static RenderLayers>,
    ),
>;

pub(super) fn extract_trees(
    mut extracted: ResMut<ExtractedTrees>,
    forests: Extract<PlacedQuery<Forest>>,
    impostors: Extract<PlacedQuery<TreeImpostor>>,
    assets: Extract<Res<Assets<TreeAsset>>>,
    near: Extract<Res<NearMeshes>>,
    upload_budget: Extract<Res<UploadBudget>>,
    groves: Extract<Res<GroveSettings>>,
) {
    let extracted = &mut *extracted;
    extracted.upload_budget = **upload_budget;
    extracted.groves = **groves;
    extracted.frame += 1;
    let everyone = RenderLayers::default();
    let (mut seen, mut is_changed) = (0, false);
    for (entity, forest, transform, visibility, layers) in &forests {
        if visibility.get() {
            let layers = layers.unwrap_or(&everyone);
            is_changed |= extracted.update_forest(entity, forest, transform.affine(), layers);
            seen += 1;
        }
    }
    if extracted.forests.len() > seen {
        extracted.forget_forests();
        is_changed = true;
    }
    extracted.revision += u64::from(is_changed);

    extracted.impostors.clear();
    let mut used: HashMap<AssetId<TreeAsset>, Arc<TreeData>> = default();
    let mut add_species = |id: AssetId<TreeAsset>| {
        if !used.contains_key(&id)
            && let Some(asset) = assets.get(id)
        {
            used.insert(id, asset.data.clone());
        }
    };
    extracted.uses.keys().copied().for_each(&mut add_species);
    for (entity, impostor, transform, visibility, layers) in &impostors {
        if !visibility.get() {
            continue;
        }
        add_species(impostor.tree.id());
        extracted.impostors.push(ExtractedImpostor {
            entity,
            species: impostor.tree.id(),
            instance: crate::forest::impostor_instance(impostor, transform),
            layers: layers.unwrap_or(&everyone).clone(),
        });
    }
    // Entities and assets come in any order; the picture must not depend on it.
    extracted.impostors.sort_by_key(|i| i.entity);
    extracted.species = used.into_iter().collect();
    extracted.species.sort_by_key(|(id, _)| *id);
    extracted.near.clear();
    extracted.near.extend(near.ready());
    extracted.near.sort_unstable();
}
