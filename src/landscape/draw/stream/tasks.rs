//! Which chunks to make and when: missing ones and those in old light in, background tasks out. O(chunks in the cut).

use super::{
    ChunkAssets, Chunks,
    scene::{Scene, SunState, make},
};
use crate::landscape::{
    draw::{TerrainLod, sky::Sun},
    quadtree::{ChunkKey, Cut},
};
use bevy::{
    prelude::*,
    tasks::{AsyncComputeTaskPool, ComputeTaskPool},
};
use std::sync::{Arc, OnceLock};

/// Textures are made again when the sun has moved by this angle in radians.
const SUN_STEP: f32 = 0.012;

impl Chunks {
    pub(super) fn follow_sun(
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

    /// What is drawn in the light of an earlier sun, nearest first; made at once if the app waits.
    pub(super) fn paint_again(
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
    pub(super) fn start(
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
}
