//! Chunks around the cameras: eyes in, meshes and textures made in background tasks, the best cut of what is ready shown.
//!
//! A chunk is made in a task (`landscape::chunk`), kept until memory is short, and drawn when it is in the cut; a parent
//! stays until all four children are on the GPU. When the sun moves, textures are made again, nearest first.
//! `scene` makes a chunk, `tasks` says which and when, `show` what of them is seen; here is what is kept.

mod scene;
mod show;
mod tasks;

pub(super) use show::{Frame, tell_shaders};

use super::{
    Landscape, TerrainCounters, TerrainLod,
    grain::grain,
    material::{GroundChunk, GroundMaterial, image},
    sky::Sun,
};
use crate::landscape::{
    chunk::ChunkMesh,
    quadtree::{CHUNK_QUADS, CHUNK_TRIANGLES, ChunkKey, Eye, MOST_LEVELS, Quadtree},
};
use bevy::{
    camera::{
        primitives::{Aabb, Frustum},
        visibility::NoAutoAabb,
    },
    light::{NotShadowCaster, NotShadowReceiver},
    platform::{collections::HashMap, time::Instant},
    prelude::*,
    tasks::{ComputeTaskPool, Task, futures::check_ready},
};
use scene::{Made, Scene, SunState, make};
use std::sync::{Arc, OnceLock};

struct Slot {
    entity: Entity,
    material: Handle<GroundMaterial>,
    bounds: Aabb,
    middle: Vec3,
    bytes: usize,
    sun: u32,
    made_at: u64,
    used_at: u64,
    shown: bool,
}

/// All chunks of the present landscape.
#[derive(Resource, Default)]
pub(super) struct Chunks {
    scene: Option<Arc<Scene>>,
    sun: Option<Arc<SunState>>,
    slots: HashMap<ChunkKey, Slot>,
    /// In the order of their start.
    tasks: Vec<(ChunkKey, Task<Made>)>,
    grain: Handle<Image>,
    eyes: Vec<Eye>,
    splits: [f32; MOST_LEVELS],
    /// Errors are this much larger, to stay within the triangles.
    coarser: f32,
    frame: u64,
    bytes: usize,
}

/// Forgets everything when another landscape is set.
pub(super) fn begin_anew(
    mut commands: Commands,
    landscape: Option<Res<Landscape>>,
    mut chunks: ResMut<Chunks>,
    mut images: ResMut<Assets<Image>>,
) {
    if landscape.as_ref().is_some_and(|l| !l.is_changed())
        || (landscape.is_none() && chunks.scene.is_none())
    {
        return;
    }
    for slot in chunks.slots.values() {
        commands.entity(slot.entity).despawn();
    }
    // Tasks of the old landscape are cancelled as they are dropped.
    *chunks =
        Chunks { coarser: 1.0, grain: chunks.grain.clone(), frame: chunks.frame, ..default() };
    let Some(landscape) = landscape else { return };
    // The default handle is Bevy's white image.
    if chunks.grain == Handle::default() {
        let made = grain();
        chunks.grain = images.add(image(made.bytes, made.side, made.mips, false));
    }
    chunks.scene = Some(Arc::new(Scene {
        tree: Quadtree::new(&*landscape.ground),
        landscape: landscape.clone(),
        silhouette: OnceLock::new(),
        triangles: ChunkMesh::triangles(),
    }));
}

/// A camera that looks at the ground.
type Viewer<'a> = (&'a Camera, &'a GlobalTransform, &'a Projection, &'a Frustum);

/// Where chunks are put.
#[derive(bevy::ecs::system::SystemParam)]
pub(super) struct ChunkAssets<'w> {
    meshes: ResMut<'w, Assets<Mesh>>,
    images: ResMut<'w, Assets<Image>>,
    materials: ResMut<'w, Assets<GroundMaterial>>,
    frame: Res<'w, Frame>,
}

#[expect(clippy::too_many_arguments, reason = "a system's parameters")]
pub(super) fn stream_chunks(
    mut commands: Commands,
    mut chunks: ResMut<Chunks>,
    mut assets: ChunkAssets,
    lod: Res<TerrainLod>,
    mut counters: ResMut<TerrainCounters>,
    cameras: Query<Viewer, With<Camera3d>>,
    suns: Query<(&GlobalTransform, Has<Sun>), With<DirectionalLight>>,
    mut visibilities: Query<&mut Visibility>,
) {
    let began = Instant::now();
    let chunks = &mut *chunks;
    let Some(scene) = chunks.scene.clone() else { return };
    chunks.frame += 1;
    let sun = chunks.follow_sun(&suns);
    let viewers: Vec<_> = cameras.iter().filter(|v| v.0.is_active).collect();
    chunks.look(&scene, &viewers, &lod);

    let spent = || began.elapsed().as_secs_f32() * 1e3 >= lod.main_thread_ms;
    let mut cut = chunks.cut(&scene);
    if lod.wait {
        // Coarse ones first, which finer ones may replace; then nothing is missing.
        while !cut.missing.is_empty() {
            chunks.tasks.clear();
            for some in cut.missing.chunks(64) {
                let made = ComputeTaskPool::get().scope(|scope| {
                    for key in some {
                        let (scene, sun) = (&scene, &sun);
                        scope.spawn(async move { make(scene, sun, *key, true) });
                    }
                });
                for made in made {
                    chunks.put(&mut commands, &mut assets, &scene, made, &lod);
                }
            }
            cut = chunks.cut(&scene);
        }
    } else {
        let mut running = Vec::new();
        for (key, mut task) in std::mem::take(&mut chunks.tasks) {
            match if spent() { None } else { check_ready(&mut task) } {
                Some(made) => chunks.put(&mut commands, &mut assets, &scene, made, &lod),
                None => running.push((key, task)),
            }
        }
        chunks.tasks = running;
    }
    for key in &cut.used {
        if let Some(slot) = chunks.slots.get_mut(key) {
            slot.used_at = chunks.frame;
        }
    }
    chunks.forget(&mut commands, &lod);
    let old = chunks.paint_again(&mut assets, &scene, &sun, &cut, &lod);
    if !lod.wait {
        chunks.start(&scene, &sun, &cut, &old, &lod);
    }
    chunks.show(&mut visibilities);
    *counters = TerrainCounters {
        chunks: chunks.slots.len(),
        drawn: cut.drawn.len(),
        triangles: chunks.in_view(&cut, &viewers) * CHUNK_TRIANGLES,
        pending: cut.missing.len() + old.len(),
        main_thread_ms: began.elapsed().as_secs_f32() * 1e3,
        memory_mb: chunks.bytes as f32 / 1e6,
    };
}

impl Chunks {
    fn put(
        &mut self,
        commands: &mut Commands,
        assets: &mut ChunkAssets,
        scene: &Scene,
        made: Made,
        lod: &TerrainLod,
    ) {
        let Made { key, mesh, corners, texture, sun } = made;
        let side = texture.width();
        let texture_bytes = texture.data.as_ref().map_or(0, Vec::len);
        let painting = assets.images.add(texture);
        if let Some(slot) = self.slots.get_mut(&key) {
            if let Some(mut material) = assets.materials.get_mut(&slot.material) {
                material.painting = painting;
            }
            slot.sun = sun;
            return;
        }
        let (Some(mesh), Some(corners)) = (mesh, corners) else {
            return; // Forgotten while its texture was made again.
        };
        let material = assets.materials.add(GroundMaterial {
            frame: assets.frame.0.clone(),
            chunk: GroundChunk::new(&scene.tree, key, side),
            painting,
            grain: self.grain.clone(),
            receive_shadows: lod.receive_shadows,
        });
        let [low, high] = mesh.range;
        let half = 0.5 * scene.tree.chunk_m(key.level.into());
        let bounds = Aabb::from_min_max(Vec3::new(-half, low, -half), Vec3::new(half, high, half));
        // Vertices: 5 numbers; indices: 2 bytes.
        let posts = (CHUNK_QUADS + 1) * (CHUNK_QUADS + 5);
        let bytes = texture_bytes + posts * 20 + CHUNK_TRIANGLES * 6;
        let entity = commands.spawn((
            Name::new("ground chunk"),
            Mesh3d(assets.meshes.add(corners)),
            MeshMaterial3d(material.clone()),
            Transform::from_translation(mesh.middle),
            GlobalTransform::from_translation(mesh.middle),
            Visibility::Hidden,
            (bounds, NoAutoAabb, NotShadowCaster),
        ));
        let entity = entity.id();
        if !lod.receive_shadows {
            commands.entity(entity).insert(NotShadowReceiver);
        }
        self.bytes += bytes;
        let (made_at, middle) = (self.frame, mesh.middle);
        let slot = Slot {
            entity,
            material,
            bounds,
            middle,
            bytes,
            sun,
            made_at,
            used_at: made_at,
            shown: false,
        };
        self.slots.insert(key, slot);
    }

    /// Makes room: what was not needed longest goes first; what this frame needs stays.
    fn forget(&mut self, commands: &mut Commands, lod: &TerrainLod) {
        let limit = lod.memory_mb.max(16) as usize * 1_000_000;
        if self.bytes <= limit {
            return;
        }
        let mut unused: Vec<_> = self
            .slots
            .iter()
            .filter(|(_, slot)| slot.used_at < self.frame && !slot.shown)
            .map(|(key, slot)| (slot.used_at, *key))
            .collect();
        unused.sort_unstable();
        for (_, key) in unused {
            if self.bytes <= limit {
                break;
            }
            if let Some(slot) = self.slots.remove(&key) {
                commands.entity(slot.entity).despawn();
                self.bytes -= slot.bytes;
            }
        }
    }
}
