//! This crate: forests of points, with meshes near the camera.

use super::{Made, Technique, Work};
use crate::{
    bench::{row::Row, scenes::SceneArg},
    options::ToolResult,
    scene,
};
use bevy::{
    core_pipeline::prepass::{DeferredPrepass, DepthPrepass, NormalPrepass},
    pbr::DefaultOpaqueRendererMethod,
    prelude::*,
    render::{renderer::RenderDevice, settings::WgpuFeatures},
};
use bevy_treeline::{
    CacheLocation, Forest, NearMeshes, Occlusion, TreeInstance, TreelineCounters, TreelinePlugin,
    TreelineSettings, TreelineTaa,
};
use std::{collections::BTreeMap, time::Instant};

/// Side of the square of ground whose trees are one forest, metres.
const FOREST_M: f32 = 192.0;

/// Points that fit a frame of the landscape, millions: as in `fly`, from inside of forests.
const LANDSCAPE_CAPACITY_M: f32 = 96.0;

const BYTES_OF_A_MB: f64 = (1 << 20) as f64;

/// GPU memory of this crate's buffers without surfels, as wgpu's allocator knows it; none where it does not tell.
fn own_buffers_mb(app: &App) -> Option<f64> {
    let device = app.world().get_resource::<RenderDevice>()?;
    let report = device.wgpu_device().generate_allocator_report()?;
    let counts = |name: &str| name.starts_with("treeline_") && !name.contains("surfels");
    let own = report.allocations.iter().filter(|allocation| counts(&allocation.name));
    Some(own.map(|allocation| allocation.size as f64).sum::<f64>() / BYTES_OF_A_MB)
}

/// What a variant may change.
struct Points {
    settings: TreelineSettings,
    /// Trees near the camera are meshes.
    near_meshes: bool,
    msaa: bool,
    /// Near meshes are shaded once a pixel, however many triangles meet in it.
    deferred: bool,
    /// `TreelineTaa`.
    taa: bool,
    /// Instead of `--quality`.
    quality: Option<f32>,
    baked_points: u64,
    surfel_bytes: usize,
}

/// A named change of the settings.
struct Variant {
    name: &'static str,
    apply: fn(&mut Points),
}

/// All that go by a name alone: `points+name`.
const VARIANTS: &[Variant] = &[
    Variant { name: "nearmeshes-off", apply: |points| points.near_meshes = false },
    Variant { name: "occlusion-off", apply: |points| points.settings.occlusion = Occlusion::Off },
    Variant {
        name: "occlusion-exact",
        apply: |points| points.settings.occlusion = Occlusion::Exact,
    },
    Variant { name: "forward", apply: |points| points.deferred = false },
    Variant { name: "taa", apply: |points| points.taa = true },
    Variant { name: "samples4", apply: |points| points.settings.samples = 4 },
    Variant {
        name: "msaa4",
        apply: |points| {
            points.msaa = true;
            // Bevy shades nothing once a pixel where a pixel has several samples.
            points.deferred = false;
        },
    },
];

/// A setting that a number follows: `points+q0.5`.
struct Numbered {
    name: &'static str,
    apply: fn(&mut Points, f32),
}

/// All of them.
const NUMBERED: &[Numbered] = &[
    Numbered { name: "q", apply: |points, quality| points.quality = Some(quality) },
    Numbered { name: "mesh", apply: |points, metres| points.settings.min_mesh_distance = metres },
    Numbered { name: "contrast", apply: |points, strength| points.settings.contrast = strength },
];

/// Their names.
pub fn variants() -> Vec<String> {
    let named = VARIANTS.iter().map(|variant| variant.name.to_owned());
    named.chain(NUMBERED.iter().map(|setting| format!("{}<number>", setting.name))).collect()
}

fn apply(name: &str, points: &mut Points) -> Result<(), String> {
    if let Some(variant) = VARIANTS.iter().find(|variant| variant.name == name) {
        (variant.apply)(points);
        return Ok(());
    }
    let number_of = |setting: &Numbered| name.strip_prefix(setting.name)?.parse::<f32>().ok();
    let known = NUMBERED.iter().find_map(|setting| Some((setting, number_of(setting)?)));
    let Some((setting, number)) = known else {
        return Err(format!("`{name}` is no variant of it"));
    };
    (setting.apply)(points, number);
    let quality = points.quality.unwrap_or(points.settings.quality);
    let (_, moved) = TreelineSettings { quality, ..points.settings.clone() }.clamped();
    match moved.first() {
        Some(field) => Err(format!("`{name}` is out of the range of `TreelineSettings::{field}`")),
        None => Ok(()),
    }
}

pub fn make(names: &[&str]) -> Made {
    let mut points = Points {
        settings: TreelineSettings::default(),
        near_meshes: true,
        msaa: false,
        deferred: true,
        taa: false,
        quality: None,
        baked_points: 0,
        surfel_bytes: 0,
    };
    for name in names {
        apply(name, &mut points)?;
    }
    Ok(Box::new(points))
}

impl Technique for Points {
    fn can_run(&self, _scene: SceneArg, _features: WgpuFeatures) -> Result<(), String> {
        Ok(())
    }

    fn build(&self, app: &mut App) {
        // Trees come from the benchmark, which keeps them in the tool's cache.
        app.add_plugins(TreelinePlugin { cache: CacheLocation::Off, ..default() });
        if self.deferred {
            app.insert_resource(DefaultOpaqueRendererMethod::deferred());
        }
    }

    fn plant(&mut self, app: &mut App, work: &mut Work) -> ToolResult {
        if let Some(quality) = self.quality.or(work.args.quality) {
            self.settings.quality = quality;
        }
        let Some(places) = work.scene.trees() else {
            // The scene has planted them.
            self.settings.point_capacity_millions = LANDSCAPE_CAPACITY_M;
            self.baked_points = work.scene.points_baked().unwrap_or(0);
            self.surfel_bytes = self.baked_points as usize * size_of::<[u32; 4]>();
            if !self.near_meshes {
                app.world_mut().resource_mut::<NearMeshes>().max_trees = 0;
            }
            return Ok(());
        };
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
        for (i, place) in places.iter().enumerate() {
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
        if self.deferred {
            camera.remove::<NormalPrepass>().insert(DeferredPrepass);
        }
        if self.taa {
            camera.insert(TreelineTaa::default());
        }
    }

    fn is_settled(&self, app: &App, camera: Entity) -> bool {
        let counters = app.world().resource::<TreelineCounters>().of(camera);
        // A history is full when it holds as many frames as it averages.
        let history = if self.taa { TreelineTaa::default().frames_at_rest as u64 } else { 0 };
        counters
            .is_some_and(|c| c.waiting_forests == 0 && c.pending_groves == 0 && c.frame > history)
    }

    fn read(&self, app: &App, camera: Entity, row: &mut Row) {
        row.points_baked = Some(self.baked_points);
        row.bytes_per_point = Some(self.surfel_bytes as f64 / self.baked_points.max(1) as f64);
        row.vram_surfels_mb = Some(self.surfel_bytes as f64 / BYTES_OF_A_MB);
        row.vram_mb = own_buffers_mb(app);
        let counters = app.world().resource::<TreelineCounters>().of(camera);
        let Some(counters) = counters else { return };
        row.points_drawn = Some(counters.points.into());
        row.work_items = Some(counters.items.into());
        row.culled_tiles = Some(counters.culled_tiles.into());
        row.culled_frustum = Some(counters.culled_frustum.into());
        row.culled_small = Some(counters.culled_small.into());
        row.culled_occluded = Some(counters.culled_occluded.into());
        row.item_overflow = Some(counters.item_overflow.into());
        if counters.covered_pixels > 0 {
            row.overdraw = Some(f64::from(counters.points) / f64::from(counters.covered_pixels));
        }
        row.bytes_read = Some(counters.bytes_read());
    }
}
