//! The near-mesh pool: trees near a camera are ordinary Bevy meshes, so materials and shadows are Bevy's own.
//!
//! Each frame the trees within their switch distance of any camera get a mesh entity per part; trees that leave give
//! it back. Selection is told which instances have one ([`NearMeshes::is_ready`]): only then do points fade out, so a
//! mesh that is still loading, or beyond the limit of the pool, leaves no hole.
//!
//! Cost: a comparison per forest and camera, plus the trees near a camera.

use super::{
    components::{Forest, TreeImpostor},
    forest_index::ForestIndex,
    instance::TreeInstance,
    lod_state::{impostor_instance, view_points},
    select::{SpeciesShape, ViewPoint, select_instance},
    settings::TreelineSettings,
};
use crate::{
    asset::{NearMesh, TreeAsset},
    lod::fade::ViewRange,
};
use bevy::{
    camera::{
        primitives::Aabb,
        visibility::{RenderLayers, VisibilityRange},
    },
    core_pipeline::prepass::{DeferredPrepass, DepthPrepass, MotionVectorPrepass, NormalPrepass},
    platform::collections::{HashMap, HashSet},
    prelude::*,
};

/// Frames between spawning a mesh and letting its points go: its buffers and pipelines are prepared meanwhile.
const WARM_UP_FRAMES: u32 = 3;
/// A mesh is spawned this much farther than it starts to fade in, as a factor, so that it is warm by then.
const SPAWN_MARGIN: f32 = 1.15;

/// A mesh entity of the pool. Remove or change it as you like: the pool notices and does without.
#[derive(Component, Clone, Copy, Debug)]
pub struct NearMeshPart;

/// A tree that has a mesh in the scene: the entity of its [`Forest`] or [`TreeImpostor`], and its index (0 there).
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct NearTree {
    /// Entity with the component.
    pub owner: Entity,
    /// Index of the tree in its forest.
    pub index: u32,
}

/// Cameras whose prepass writes depth and nothing else. Bevy 0.19 does not dither there, so a mesh that dithers in would
/// leave sky where its undithered depth has rejected the points behind. While such a camera is active, meshes appear
/// at once over the complete points, and only the points fade.
type DepthOnlyPrepass = (
    With<Camera3d>,
    With<DepthPrepass>,
    Without<NormalPrepass>,
    Without<MotionVectorPrepass>,
    Without<DeferredPrepass>,
);

struct Slot {
    parts: Vec<Entity>,
    frames: u32,
    instance: TreeInstance,
    mesh: AssetId<NearMesh>,
    layers: RenderLayers,
    dithered: bool,
}

/// Materials of near meshes by their source and tint.
type TintedMaterials = HashMap<(AssetId<StandardMaterial>, [u8; 3]), Handle<StandardMaterial>>;

/// The pool. Its limit is yours to set.
#[derive(Resource)]
pub struct NearMeshes {
    /// Trees at most that are meshes at one time, nearest first; the others stay points. Default: 96.
    pub max_trees: usize,
    slots: HashMap<NearTree, Slot>,
    tinted: TintedMaterials,
    /// Trees within range that the limit left as points, last frame.
    left_as_points: usize,
}

impl Default for NearMeshes {
    fn default() -> Self {
        Self { max_trees: 96, slots: default(), tinted: default(), left_as_points: 0 }
    }
}

impl NearMeshes {
    /// Whether a tree's mesh has been in the scene for long enough to be drawn.
    pub fn is_ready(&self, owner: Entity, index: u32) -> bool {
        self.slots.get(&NearTree { owner, index }).is_some_and(|slot| slot.frames >= WARM_UP_FRAMES)
    }

    /// Every ready tree, in no order.
    pub fn ready(&self) -> impl Iterator<Item = NearTree> + '_ {
        self.slots.iter().filter(|(_, slot)| slot.frames >= WARM_UP_FRAMES).map(|(tree, _)| *tree)
    }

    /// Trees that are meshes now.
    pub fn len(&self) -> usize {
        self.slots.len()
    }

    /// True without any.
    pub fn is_empty(&self) -> bool {
        self.slots.is_empty()
    }

    /// Trees within range last frame that [`NearMeshes::max_trees`] left as points.
    pub fn left_as_points(&self) -> usize {
        self.left_as_points
    }
}

/// How far meshes of some species reach.
#[derive(Clone, Copy, Debug, Default)]
struct Reach {
    /// Largest `s`.
    pixel: f32,
    /// Largest radius.
    radius: f32,
}

impl Reach {
    /// Of those species that have meshes; `None` if none has one.
    fn of<'a>(species: impl Iterator<Item = &'a TreeAsset>) -> Option<Self> {
        species.filter(|asset| asset.near_mesh.is_some()).fold(None, |all: Option<Self>, asset| {
            let all = all.unwrap_or_default();
            Some(Self {
                pixel: all.pixel.max(asset.data.pixel),
                radius: all.radius.max(asset.data.bounds.radius()),
            })
        })
    }

    /// From the eye to the farthest position of a tree of at most `scale` that may want its mesh.
    fn distance(&self, scale: f32, view: &ViewPoint, settings: &TreelineSettings) -> f32 {
        let d0 = self.pixel * scale * view.z0;
        d0.max(settings.min_mesh_distance) * SPAWN_MARGIN + self.radius * scale
    }
}

struct Wanted {
    tree: NearTree,
    instance: TreeInstance,
    mesh: AssetId<NearMesh>,
    layers: RenderLayers,
    shape: SpeciesShape,
    /// Distance as a share of the switch distance: smaller is more urgent.
    urgency: f32,
    fade: std::ops::Range<f32>,
    /// Inside the band for some camera.
    dithered: bool,
}

/// The most urgent opinion of a tree; `None` if no view wants its mesh. No view is parallel.
fn wanted(
    views: &[(ViewPoint, TreelineSettings)],
    tree: NearTree,
    instance: TreeInstance,
    (view_range, layers): (ViewRange, Option<&RenderLayers>),
    asset: &TreeAsset,
    meshes: &Assets<NearMesh>,
) -> Option<Wanted> {
    let mesh = asset.near_mesh.as_ref()?.id();
    // Without the mesh loaded there is nothing to show.
    meshes.get(mesh)?;
    let shape = asset.shape();
    let mut best: Option<Wanted> = None;
    for (view, settings) in views {
        let selection = select_instance(view, settings, &shape, &instance, view_range, true);
        if selection.distance >= view_range.end {
            continue;
        }
        let band = selection.band;
        let urgency = selection.distance / band.far;
        let dithered = selection.distance > band.middle * 0.9;
        let fade = band.middle..band.far;
        let best = best.get_or_insert(Wanted {
            tree,
            instance,
            mesh,
            layers: layers.cloned().unwrap_or_default(),
            shape,
            urgency,
            fade: fade.clone(),
            dithered,
        });
        best.urgency = best.urgency.min(urgency);
        best.dithered |= dithered;
        // The mesh is complete wherever any view starts to drop points.
        best.fade = best.fade.start.max(fade.start)..best.fade.end.max(fade.end);
    }
    best.filter(|best| best.urgency < SPAWN_MARGIN)
}

#[expect(
    clippy::too_many_arguments,
    clippy::type_complexity,
    reason = "a system's parameters are its dependencies"
)]
pub(super) fn update_near_meshes(
    mut commands: Commands,
    mut pool: ResMut<NearMeshes>,
    cameras: Query<(&Camera, &GlobalTransform, Option<&TreelineSettings>), With<Camera3d>>,
    depth_only: Query<&Camera, DepthOnlyPrepass>,
    mut forests: Query<(
        Entity,
        &Forest,
        &mut ForestIndex,
        Ref<GlobalTransform>,
        &InheritedVisibility,
        Option<&RenderLayers>,
    )>,
    impostors: Query<(
        Entity,
        &TreeImpostor,
        &GlobalTransform,
        &InheritedVisibility,
        Option<&RenderLayers>,
    )>,
    trees: Res<Assets<TreeAsset>>,
    meshes: Res<Assets<NearMesh>>,
    mut materials: ResMut<Assets<StandardMaterial>>,
    parts: Query<(), With<NearMeshPart>>,
) {
    let mut views = view_points(cameras.iter());
    views.retain(|(view, _)| !view.orthographic);
    let at_once = depth_only.iter().any(|camera| camera.is_active);
    let mut all: Vec<Wanted> = vec![];
    let farthest = Reach::of(trees.iter().map(|(_, asset)| asset));
    for (owner, forest, mut index, transform, visibility, layers) in &mut forests {
        // Unchanged by this: nobody but this system reads it.
        let place = index.bypass_change_detection().place(&transform);
        let is_near = views.iter().any(|(view, settings)| {
            farthest.is_some_and(|farthest| {
                let reach = farthest.distance(place.scale, view, settings) + place.radius;
                // What is not a number is looked at.
                let is_beyond = place.center.distance_squared(view.position) > reach * reach;
                !is_beyond
            })
        });
        if !is_near || !visibility.get() {
            continue;
        }
        let affine = transform.affine();
        let scale = transform.scale().abs().max_element();
        let assets: Vec<_> = forest.species().iter().map(|species| trees.get(species)).collect();
        let mut candidates: Vec<u32> = vec![];
        let Some(reach) = Reach::of(assets.iter().copied().flatten()) else { continue };
        for (view, settings) in &views {
            let reach = reach.distance(scale * index.max_scale, view, settings);
            let eye = affine.inverse().transform_point3(view.position);
            candidates.extend(index.near(forest, eye, reach / scale.max(1e-6)));
        }
        candidates.sort_unstable();
        candidates.dedup();
        for i in candidates {
            let Some(instance) = forest.get(i as usize) else { continue };
            let Some(asset) = assets.get(usize::from(instance.species)).copied().flatten() else {
                continue;
            };
            let tree = NearTree { owner, index: i };
            let of_forest = (forest.fade_range(), layers);
            let instance = instance.in_world(&affine);
            all.extend(wanted(&views, tree, instance, of_forest, asset, &meshes));
        }
    }
    for (owner, impostor, transform, visibility, layers) in &impostors {
        let Some(asset) = trees.get(&impostor.tree).filter(|_| visibility.get()) else { continue };
        let instance = impostor_instance(impostor, transform);
        let tree = NearTree { owner, index: 0 };
        all.extend(wanted(&views, tree, instance, (default(), layers), asset, &meshes));
    }
    all.sort_by(|a, b| a.urgency.total_cmp(&b.urgency).then(a.tree.cmp(&b.tree)));
    pool.left_as_points = all.len().saturating_sub(pool.max_trees);
    all.truncate(pool.max_trees);

    let pool = &mut *pool;
    let keep: HashSet<NearTree> = all.iter().map(|w| w.tree).collect();
    pool.slots.retain(|tree, slot| {
        let alive = slot.parts.iter().all(|part| parts.contains(*part)) || slot.frames == 0;
        let kept = keep.contains(tree) && alive;
        if !kept {
            for part in &slot.parts {
                commands.entity(*part).try_despawn();
            }
        }
        kept
    });
    for w in all {
        let Some(mesh) = meshes.get(w.mesh) else { continue };
        // Swapped trees and reloaded models: same key, other tree.
        let stale = |slot: &Slot| {
            let other_tint = slot.instance.tint != w.instance.tint;
            slot.mesh != w.mesh || other_tint || slot.layers != w.layers
        };
        if pool.slots.get(&w.tree).is_some_and(stale) {
            for part in pool.slots.remove(&w.tree).into_iter().flat_map(|slot| slot.parts) {
                commands.entity(part).try_despawn();
            }
        }
        let transform = Transform {
            translation: w.instance.position
                + w.instance.rotation * (w.shape.center * w.instance.scale),
            rotation: w.instance.rotation,
            scale: Vec3::splat(w.instance.scale),
        };
        let end_margin = if at_once { w.fade.end..w.fade.end } else { w.fade.clone() };
        let range = VisibilityRange { start_margin: 0.0..0.0, end_margin, use_aabb: false };
        let tinted = &mut pool.tinted;
        let mut material_of = |source: &Handle<StandardMaterial>| {
            near_material(tinted, &mut materials, source, w.instance.tint)
        };
        match pool.slots.get_mut(&w.tree) {
            Some(slot) => {
                slot.frames = slot.frames.saturating_add(1);
                for entity in &slot.parts {
                    let mut entity = commands.entity(*entity);
                    if slot.instance != w.instance {
                        entity.insert(transform);
                    }
                    // Once given, it stays: Bevy 0.19 stops drawing a mesh whose range is removed.
                    if w.dithered || slot.dithered {
                        entity.insert(range.clone());
                    }
                }
                slot.instance = w.instance;
                slot.dithered |= w.dithered;
            }
            None => {
                let spawned = mesh.parts.iter().map(|part| {
                    let mut entity = commands.spawn((
                        NearMeshPart,
                        Name::new("near tree"),
                        Mesh3d(part.mesh.clone()),
                        MeshMaterial3d(material_of(&part.material)),
                        transform,
                        w.layers.clone(),
                        // Bevy would otherwise walk every vertex of every tree that comes near.
                        Aabb { center: part.center.into(), half_extents: part.half_extents.into() },
                    ));
                    if w.dithered {
                        entity.insert(range.clone());
                    }
                    entity.id()
                });
                let parts = spawned.collect();
                let slot = Slot {
                    parts,
                    frames: 0,
                    instance: w.instance,
                    mesh: w.mesh,
                    layers: w.layers,
                    dithered: w.dithered,
                };
                pool.slots.insert(w.tree, slot);
            }
        }
    }
}

/// The material of a part for a tint.
fn near_material(
    made: &mut TintedMaterials,
    materials: &mut Assets<StandardMaterial>,
    source: &Handle<StandardMaterial>,
    tint: [u8; 3],
) -> Handle<StandardMaterial> {
    // 16 steps a channel bound the number of materials; 128 stays exact.
    let tint = tint.map(|t| t.saturating_add(8) & 0xf0);
    if tint == [128; 3] {
        return source.clone();
    }
    let Some(original) = materials.get(source) else { return source.clone() };
    let key = (source.id(), tint);
    if let Some(handle) = made.get(&key) {
        return handle.clone();
    }
    let mut material = original.clone();
    let [red, green, blue] = tint.map(|t| f32::from(t) / 128.0);
    let base = material.base_color.to_linear();
    material.base_color =
        LinearRgba::new(base.red * red, base.green * green, base.blue * blue, base.alpha).into();
    let handle = materials.add(material);
    made.insert(key, handle.clone());
    handle
}
