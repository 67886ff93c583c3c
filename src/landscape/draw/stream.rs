//! Chunks around the cameras: eyes in, meshes and textures made in background tasks, the best cut of what is ready shown.
//!
//! A chunk is made in a task (`landscape::chunk`), kept until memory is short, and drawn when it is in the cut; a parent
//! stays until all four children are on the GPU. When the sun moves, textures are made again, nearest first.

use super::{
    Landscape, TerrainCounters, TerrainLod,
    grain::grain,
    material::{GroundChunk, GroundMaterial, LandscapeFrame, image},
    sky::{CurrentLight, Sun},
};
use crate::landscape::{
    Daylight,
    chunk::{ChunkMesh, ChunkSource, ChunkTexture},
    quadtree::{CHUNK_QUADS, CHUNK_TRIANGLES, ChunkKey, Cut, Eye, MOST_LEVELS, Quadtree},
    sunlight::{Silhouette, SunShadow},
};
use bevy::{
    asset::RenderAssetUsages,
    camera::{
        primitives::{Aabb, Frustum},
        visibility::NoAutoAabb,
    },
    light::{NotShadowCaster, NotShadowReceiver},
    mesh::{Indices, PrimitiveTopology},
    platform::{collections::HashMap, time::Instant},
    prelude::*,
    render::storage::ShaderBuffer,
    tasks::{AsyncComputeTaskPool, ComputeTaskPool, Task, futures::check_ready},
};
use std::sync::{Arc, OnceLock};

/// Frames between the making of a chunk and its use: its data has to reach the GPU.
const FRAMES_TO_GPU: u64 = 2;
/// Textures are made again when the sun has moved by this angle in radians.
const SUN_STEP: f32 = 0.012;
/// Eyes that the shaders know.
const MOST_EYES: usize = 4;

/// What the shaders of a landscape read every frame.
#[derive(Resource)]
pub(super) struct Frame(pub Handle<ShaderBuffer>);

impl FromWorld for Frame {
    fn from_world(world: &mut World) -> Self {
        let mut buffers = world.resource_mut::<Assets<ShaderBuffer>>();
        Self(buffers.add(ShaderBuffer::from(LandscapeFrame::default())))
    }
}

/// A direction of the sun, and the shadows for it: made by the first task that needs them.
struct SunState {
    to_sun: Vec3,
    version: u32,
    shadow: OnceLock<SunShadow>,
}

/// What tasks read.
struct Scene {
    landscape: Landscape,
    tree: Quadtree,
    silhouette: OnceLock<Silhouette>,
    triangles: Vec<u16>,
}

struct Made {
    key: ChunkKey,
    /// `None` if only the texture was made again.
    mesh: Option<ChunkMesh>,
    corners: Option<Mesh>,
    texture: Image,
    sun: u32,
}

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

fn make(scene: &Scene, sun: &SunState, key: ChunkKey, with_mesh: bool) -> Made {
    let Scene { landscape, tree, .. } = scene;
    let ground = &*landscape.ground;
    let silhouette = || scene.silhouette.get_or_init(|| Silhouette::of(ground));
    let source = ChunkSource {
        ground,
        biomes: &landscape.biomes,
        tree,
        shadow: sun.shadow.get_or_init(|| silhouette().shadows(sun.to_sun)),
        to_sun: sun.to_sun,
        shade: landscape.shade.as_deref(),
    };
    let painted = ChunkTexture::new(&source, key);
    let texture = image(painted.bytes, painted.side, painted.mips, true);
    let mut mesh = with_mesh.then(|| ChunkMesh::new(ground, tree, key));
    let corners = mesh.as_mut().map(|made| {
        Mesh::new(PrimitiveTopology::TriangleList, RenderAssetUsages::RENDER_WORLD)
            .with_inserted_attribute(Mesh::ATTRIBUTE_POSITION, std::mem::take(&mut made.positions))
            .with_inserted_attribute(Mesh::ATTRIBUTE_UV_0, std::mem::take(&mut made.morphs))
            .with_inserted_indices(Indices::U16(scene.triangles.clone()))
    });
    Made { key, mesh, corners, texture, sun: sun.version }
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
    fn follow_sun(
        &mut self,
        suns: &Query<(&GlobalTransform, Has<Sun>), With<DirectionalLight>>,
    ) -> Arc<SunState> {
        // Our own sun, or whichever light there is.
        let light = suns.iter().max_by_key(|(_, ours)| *ours);
        let to_sun = light.map_or(Vec3::Y, |(transform, _)| transform.back().into());
        let version = match &self.sun {
            Some(sun) if sun.to_sun.angle_between(to_sun) < SUN_STEP => return sun.clone(),
            Some(sun) => sun.version + 1,
            None => 0,
        };
        let sun = Arc::new(SunState { to_sun, version, shadow: OnceLock::new() });
        self.sun = Some(sun.clone());
        sun
    }

    fn look(&mut self, scene: &Scene, viewers: &[Viewer], lod: &TerrainLod) {
        let mut sharpest = 1.0f32;
        self.eyes.clear();
        for (camera, transform, projection, _) in viewers {
            if self.eyes.len() < MOST_EYES {
                self.eyes.push(Eye::over(&*scene.landscape.ground, transform.translation()));
            }
            let height = camera.physical_viewport_size().map_or(720.0, |size| size.y as f32);
            if let Projection::Perspective(perspective) = projection {
                sharpest = sharpest.max(height * 0.5 / (perspective.fov * 0.5).tan());
            }
        }
        let error = lod.error_px.clamp(0.5, 16.0) * self.coarser;
        self.splits = scene.tree.split_distances(sharpest, error);
        // Slow to fall, so that it does not swing.
        let every = |_: ChunkKey| true;
        let cut = scene.tree.cut(&self.eyes, &self.splits, &every);
        let triangles = self.in_view(&cut, viewers) * CHUNK_TRIANGLES;
        if triangles > lod.max_triangles {
            self.coarser = (self.coarser * 1.08).min(64.0);
        } else if triangles * 10 < lod.max_triangles * 8 {
            self.coarser = (self.coarser * 0.995).max(1.0);
        }
    }

    fn cut(&self, scene: &Scene) -> Cut {
        let ready = |key: ChunkKey| self.slots.contains_key(&key);
        scene.tree.cut(&self.eyes, &self.splits, &ready)
    }

    /// Chunks that at least one camera may see; those that are not made count by their square.
    fn in_view(&self, cut: &Cut, viewers: &[Viewer]) -> usize {
        let seen = |key: &&ChunkKey| {
            let Some(slot) = self.slots.get(*key) else { return false };
            let place = bevy::math::Affine3A::from_translation(slot.middle);
            viewers
                .iter()
                .any(|(.., frustum)| frustum.intersects_obb(&slot.bounds, &place, true, false))
        };
        cut.drawn.iter().filter(seen).count()
    }

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

    /// What is drawn in the light of an earlier sun, nearest first; made at once if the app waits.
    fn paint_again(
        &mut self,
        assets: &mut ChunkAssets,
        scene: &Scene,
        sun: &SunState,
        cut: &Cut,
        lod: &TerrainLod,
    ) -> Vec<ChunkKey> {
        let old = |key: &&ChunkKey| self.slots.get(*key).is_some_and(|s| s.sun != sun.version);
        let mut old: Vec<_> = cut.drawn.iter().filter(old).copied().collect();
        let distance = |key: &ChunkKey| scene.tree.distance(*key, &self.eyes);
        old.sort_by(|a, b| distance(a).total_cmp(&distance(b)).then(a.cmp(b)));
        if !lod.wait {
            return old;
        }
        let made = ComputeTaskPool::get().scope(|scope| {
            for key in &old {
                scope.spawn(async move { make(scene, sun, *key, false) });
            }
        });
        for made in made {
            let Some(slot) = self.slots.get_mut(&made.key) else { continue };
            slot.sun = made.sun;
            if let Some(mut material) = assets.materials.get_mut(&slot.material) {
                material.painting = assets.images.add(made.texture);
            }
        }
        Vec::new()
    }

    /// Starts tasks for what is most urgent: holes before old light.
    fn start(
        &mut self,
        scene: &Arc<Scene>,
        sun: &Arc<SunState>,
        cut: &Cut,
        old: &[ChunkKey],
        lod: &TerrainLod,
    ) {
        let pool = AsyncComputeTaskPool::get();
        let most = 2 * pool.thread_num().max(1);
        let full = self.bytes > lod.memory_mb.max(16) as usize * 1_000_000;
        let missing = cut.missing.iter().filter(|_| !full).map(|key| (*key, true));
        for (key, with_mesh) in missing.chain(old.iter().map(|key| (*key, false))) {
            if self.tasks.len() >= most {
                break;
            }
            if self.tasks.iter().any(|(running, _)| *running == key) {
                continue;
            }
            let (scene, sun) = (scene.clone(), sun.clone());
            self.tasks.push((key, pool.spawn(async move { make(&scene, &sun, key, with_mesh) })));
        }
    }

    /// Shows the cut of what has reached the GPU.
    fn show(&mut self, visibilities: &mut Query<&mut Visibility>) {
        let Some(scene) = self.scene.clone() else { return };
        let frame = self.frame;
        let ready = |key: ChunkKey| {
            self.slots.get(&key).is_some_and(|slot| slot.made_at + FRAMES_TO_GPU <= frame)
        };
        let drawn = scene.tree.cut(&self.eyes, &self.splits, &ready).drawn;
        let drawn: std::collections::BTreeSet<_> = drawn.into_iter().collect();
        for (key, slot) in &mut self.slots {
            let show = drawn.contains(key);
            if show != slot.shown
                && let Ok(mut visibility) = visibilities.get_mut(slot.entity)
            {
                *visibility = if show { Visibility::Inherited } else { Visibility::Hidden };
                slot.shown = show;
            }
        }
    }
}

/// Eyes, distances, light and water for the shaders.
pub(super) fn tell_shaders(
    chunks: Res<Chunks>,
    light: Res<CurrentLight>,
    time: Res<Time>,
    frame: Res<Frame>,
    mut buffers: ResMut<Assets<ShaderBuffer>>,
) {
    let Daylight { zenith, horizon, glow, disc, sun_direction, .. } = light.0;
    let mut told = LandscapeFrame {
        zenith: zenith.extend(0.0),
        horizon: horizon.extend(0.0),
        glow: glow.extend(0.0),
        disc: disc.extend(0.0),
        sun_direction: sun_direction.extend(0.0),
        water: Vec4::new(-1e9, time.elapsed_secs_wrapped(), 0.0, 0.0),
        ..default()
    };
    if let Some(scene) = &chunks.scene {
        for (to, eye) in told.eyes.iter_mut().zip(&chunks.eyes) {
            *to = eye.position.extend(eye.ground_m);
        }
        for (level, to) in told.morphs.iter_mut().enumerate().take(scene.tree.levels()) {
            let [start, end] = scene.tree.morph_range(level, &chunks.splits);
            *to = Vec4::new(start, 1.0 / (end - start).max(1e-3), 0.0, 0.0);
        }
        let ground = &scene.landscape.ground;
        told.water.x = ground.water_level().unwrap_or(-1e9);
        told.water.z = chunks.eyes.len() as f32;
        told.water.w = ground.side_m() * 0.5;
    }
    if let Some(mut buffer) = buffers.get_mut(&frame.0) {
        buffer.set_data(told);
    }
}
