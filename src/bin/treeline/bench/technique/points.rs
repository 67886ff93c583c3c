//! This crate: forests of points, with meshes near the camera.

use super::{Technique, Work};
use crate::{bench::row::Row, options::ToolResult, scene};
use bevy::{
    core_pipeline::prepass::{DepthPrepass, NormalPrepass},
    prelude::*,
};
use bevy_treeline::{
    CacheLocation, Forest, TreeInstance, TreelineCounters, TreelinePlugin, TreelineSettings,
};
use std::{collections::BTreeMap, time::Instant};

/// Side of the square of ground whose trees are one forest, metres.
const FOREST_M: f32 = 192.0;

/// What a variant may change.
struct Points {
    settings: TreelineSettings,
    /// Trees near the camera are meshes.
    near_meshes: bool,
    msaa: bool,
    baked_points: u64,
    surfel_bytes: usize,
}

/// A named change of the settings.
struct Variant {
    name: &'static str,
    apply: fn(&mut Points),
}

/// All variants: `points+name`.
const VARIANTS: &[Variant] = &[
    Variant { name: "nearmeshes-off", apply: |points| points.near_meshes = false },
    Variant { name: "msaa4", apply: |points| points.msaa = true },
];

/// Their names.
pub fn variants() -> Vec<&'static str> {
    VARIANTS.iter().map(|variant| variant.name).collect()
}

pub fn make(names: &[&str]) -> Result<Box<dyn Technique>, String> {
    let settings = TreelineSettings::default();
    let mut points =
        Points { settings, near_meshes: true, msaa: false, baked_points: 0, surfel_bytes: 0 };
    for name in names {
        let Some(variant) = VARIANTS.iter().find(|variant| variant.name == *name) else {
            return Err(format!("`{name}` is no variant of it"));
        };
        (variant.apply)(&mut points);
    }
    Ok(Box::new(points))
}

impl Technique for Points {
    fn build(&self, app: &mut App) {
        // Trees come from the benchmark, which keeps them in the tool's cache.
        app.add_plugins(TreelinePlugin { cache: CacheLocation::Off, ..default() });
    }

    fn plant(&mut self, app: &mut App, work: &mut Work) -> ToolResult {
        if let Some(quality) = work.args.quality {
            self.settings.quality = quality;
        }
        let start = Instant::now();
        let baked = work.tree.bake(work.args)?;
        if !baked.from_cache {
            work.baking = start.elapsed();
        }
        work.row.bake_s = Some(baked.data.statistics.seconds.total);
        self.baked_points = baked.data.point_count() as u64;
        self.surfel_bytes = baked.data.byte_count();
        let world = app.world_mut();
        let tree = scene::add_tree(world, &baked, self.near_meshes);
        let mut forests: BTreeMap<[i32; 2], Vec<TreeInstance>> = BTreeMap::new();
        for (i, place) in work.trees.iter().enumerate() {
            let tile = (place.translation.xz() / FOREST_M).floor().as_ivec2().to_array();
            forests.entry(tile).or_default().push(TreeInstance {
                position: place.translation,
                rotation: place.rotation,
                scale: place.scale.y,
                seed: i as u8,
                ..default()
            });
        }
        for trees in forests.into_values() {
            world.spawn(Forest::new([tree.clone()]).with(trees));
        }
        Ok(())
    }

    fn set_up_camera(&self, camera: &mut EntityWorldMut) {
        let msaa = if self.msaa { Msaa::Sample4 } else { Msaa::Off };
        camera.insert((DepthPrepass, NormalPrepass, msaa, self.settings.clone()));
    }

    fn read(&self, app: &App, camera: Entity, row: &mut Row) {
        row.points_baked = Some(self.baked_points);
        row.bytes_per_point = Some(self.surfel_bytes as f64 / self.baked_points.max(1) as f64);
        row.vram_surfels_mb = Some(self.surfel_bytes as f64 / f64::from(1 << 20));
        let counters = app.world().resource::<TreelineCounters>().of(camera);
        let Some(counters) = counters else { return };
        row.points_drawn = Some(counters.points.into());
        row.work_items = Some(counters.items.into());
        row.culled_tiles = Some(counters.culled_tiles.into());
        row.culled_frustum = Some(counters.culled_frustum.into());
        row.culled_small = Some(counters.culled_small.into());
        row.item_overflow = Some(counters.item_overflow.into());
        if counters.covered_pixels > 0 {
            row.overdraw = Some(f64::from(counters.points) / f64::from(counters.covered_pixels));
        }
        row.bytes_read = Some(counters.bytes_read());
    }
}
