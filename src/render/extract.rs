//! Main world → render world: which trees there are. Surfels and instances are shared, not copied.

use crate::{
    asset::{TreeAsset, TreeData},
    forest::{Forest, NearMeshes, NearTree, TreeImpostor, TreeInstance},
    gpu::types::GpuTreeInstance,
};
use bevy::{math::Affine3A, platform::collections::HashMap, prelude::*, render::Extract};
use std::sync::Arc;

/// A forest as the render world sees it.
#[derive(Clone)]
pub(super) struct ExtractedForest {
    pub entity: Entity,
    pub species: Vec<AssetId<TreeAsset>>,
    pub instances: Arc<Vec<GpuTreeInstance>>,
    pub transform: Affine3A,
}

/// A single tree, already in world space.
#[derive(Clone, Copy)]
pub(super) struct ExtractedImpostor {
    pub entity: Entity,
    pub species: AssetId<TreeAsset>,
    pub instance: TreeInstance,
}

/// Everything visible this frame, in a fixed order.
#[derive(Resource, Default)]
pub(super) struct ExtractedTrees {
    pub forests: Vec<ExtractedForest>,
    pub impostors: Vec<ExtractedImpostor>,
    /// The loaded species that these use, by asset id.
    pub species: Vec<(AssetId<TreeAsset>, Arc<TreeData>)>,
    /// Trees whose near mesh is in the scene, sorted.
    pub near: Vec<NearTree>,
}

pub(super) fn extract_trees(
    mut extracted: ResMut<ExtractedTrees>,
    forests: Extract<Query<(Entity, &Forest, &GlobalTransform, &InheritedVisibility)>>,
    impostors: Extract<Query<(Entity, &TreeImpostor, &GlobalTransform, &InheritedVisibility)>>,
    assets: Extract<Res<Assets<TreeAsset>>>,
    near: Extract<Res<NearMeshes>>,
) {
    let extracted = &mut *extracted;
    extracted.forests.clear();
    extracted.impostors.clear();
    let mut used: HashMap<AssetId<TreeAsset>, Arc<TreeData>> = default();
    let mut add_species = |id: AssetId<TreeAsset>| {
        if !used.contains_key(&id)
            && let Some(asset) = assets.get(id)
        {
            used.insert(id, asset.data.clone());
        }
    };
    for (entity, forest, transform, visibility) in &forests {
        if !visibility.get() {
            continue;
        }
        let species: Vec<_> = forest.species().iter().map(Handle::id).collect();
        species.iter().copied().for_each(&mut add_species);
        extracted.forests.push(ExtractedForest {
            entity,
            species,
            instances: forest.packed().clone(),
            transform: transform.affine(),
        });
    }
    for (entity, impostor, transform, visibility) in &impostors {
        if !visibility.get() {
            continue;
        }
        add_species(impostor.tree.id());
        extracted.impostors.push(ExtractedImpostor {
            entity,
            species: impostor.tree.id(),
            instance: crate::forest::impostor_instance(impostor, transform),
        });
    }
    // Entities and assets come in any order; the picture must not depend on it.
    extracted.forests.sort_by_key(|f| f.entity);
    extracted.impostors.sort_by_key(|i| i.entity);
    extracted.species = used.into_iter().collect();
    extracted.species.sort_by_key(|(id, _)| *id);
    extracted.near.clear();
    extracted.near.extend(near.ready());
    extracted.near.sort_unstable();
}
