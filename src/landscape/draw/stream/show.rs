//! What of the chunks is seen: cameras in; the cut, its visibility and what the shaders are told out. O(chunks).

use super::{Chunks, Viewer, scene::Scene};
use crate::landscape::{
    Daylight,
    draw::{TerrainLod, material::LandscapeFrame, sky::CurrentLight},
    quadtree::{CHUNK_TRIANGLES, ChunkKey, Cut, Eye},
};
use bevy::{prelude::*, render::storage::ShaderBuffer};

/// Frames between the making of a chunk and its use: its data has to reach the GPU.
const FRAMES_TO_GPU: u64 = 2;
/// Eyes that the shaders know.
const MOST_EYES: usize = 4;

/// What the shaders of a landscape read every frame.
#[derive(Resource)]
pub(in crate::landscape::draw) struct Frame(pub Handle<ShaderBuffer>);

impl FromWorld for Frame {
    fn from_world(world: &mut World) -> Self {
        let mut buffers = world.resource_mut::<Assets<ShaderBuffer>>();
        Self(buffers.add(ShaderBuffer::from(LandscapeFrame::default())))
    }
}

impl Chunks {
    /// Eyes of the cameras, and the distances at which chunks split for them.
    pub(super) fn look(&mut self, scene: &Scene, viewers: &[Viewer], lod: &TerrainLod) {
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

    /// What is drawn if all that is made may be, and what is missing.
    pub(super) fn cut(&self, scene: &Scene) -> Cut {
        let ready = |key: ChunkKey| self.slots.contains_key(&key);
        scene.tree.cut(&self.eyes, &self.splits, &ready)
    }

    /// Chunks that at least one camera may see; those that are not made yet count for nothing.
    pub(super) fn in_view(&self, cut: &Cut, viewers: &[Viewer]) -> usize {
        let seen = |key: &&ChunkKey| {
            let Some(slot) = self.slots.get(*key) else { return false };
            let place = bevy::math::Affine3A::from_translation(slot.middle);
            viewers
                .iter()
                .any(|(.., frustum)| frustum.intersects_obb(&slot.bounds, &place, true, false))
        };
        cut.drawn.iter().filter(seen).count()
    }

    /// Shows the cut of what has reached the GPU.
    pub(super) fn show(&mut self, visibilities: &mut Query<&mut Visibility>) {
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
pub(in crate::landscape::draw) fn tell_shaders(
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
