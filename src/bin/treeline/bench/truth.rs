//! What the pictures are held against: full meshes, 4 × 4 samples a pixel, averaged in linear light after tone mapping.
//!
//! Rendered once and kept: a thousand trees take a minute or more on a software driver. Rendered in tiles, so that no target
//! is larger than devices allow, each with a part of the same view.

use super::{
    BenchArgs, child,
    plan::Configuration,
    scenes::{self, BenchScene, SceneArg},
    stand::Stand,
    tree::Tree,
};
use crate::{
    headless::step,
    options::{ToolError, ToolResult, write_png},
};
use bevy::{
    camera::{primitives::MeshAabb, visibility::NoFrustumCulling},
    prelude::*,
};
use bevy_treeline::{asset::BakeCache, math::image_error::box_downsample_linear};
use image::{RgbaImage, imageops};
use indicatif::{ProgressBar, ProgressStyle};
use std::path::PathBuf;

/// Samples along each side of a pixel.
const SUPERSAMPLE: u32 = 4;
/// Longest side of a tile, pixels of the truth: targets of 5120 are within the limits of any device.
const TILE: u32 = 1280;
/// Raised when the same scene gives another picture.
const VERSION: u32 = 1;

/// Where a truth is kept: the picture, and what trees cover of it (as alpha).
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TruthFiles {
    pub picture: PathBuf,
    pub cover: PathBuf,
}

impl TruthFiles {
    /// Those of a configuration, whatever its technique.
    pub fn of(
        args: &BenchArgs,
        configuration: &Configuration,
        scene: &dyn BenchScene,
        tree: &Tree,
    ) -> Self {
        let mut hasher = blake3::Hasher::new();
        let pose = scene.place(0).to_matrix().to_cols_array();
        let text = format!(
            "{VERSION} {} {} {} {:?} {pose:?}",
            args.scene.name(),
            configuration.instances,
            args.seed,
            args.size
        );
        hasher.update(text.as_bytes()).update(&tree.model.content_hash);
        let cache = if args.bake.no_cache {
            None
        } else {
            args.bake.cache.clone().or_else(BakeCache::default_folder)
        };
        let folder = cache.unwrap_or_else(|| args.out.clone()).join("truth");
        let name = hasher.finalize().to_hex();
        let file = |kind: &str| folder.join(format!("{}-{kind}.png", &name[..24]));
        Self { picture: file("picture"), cover: file("cover") }
    }

    pub fn exist(&self) -> bool {
        self.picture.exists() && self.cover.exists()
    }
}

/// Why there is no truth for a configuration, if so.
pub fn too_large(args: &BenchArgs, configuration: &Configuration, tree: &Tree) -> Option<String> {
    let triangles = configuration.instances.saturating_mul(tree.triangles());
    (args.scene == SceneArg::Baseline && triangles > args.truth_triangles).then(|| {
        format!(
            "no image errors at {} trees: the truth would have {:.0} M triangles (--truth-triangles sets the bound)",
            configuration.instances,
            triangles as f64 / 1e6
        )
    })
}

/// Renders the truth of a configuration to its files.
pub fn render(args: &BenchArgs, configuration: &Configuration) -> ToolResult {
    let tree = Tree::load(&args.tree)?;
    let scene = scenes::scene(args, configuration, &tree);
    let files = TruthFiles::of(args, configuration, &*scene, &tree);
    let mut app = child::app(|_| ())?;
    let (width, height) = args.size;
    let tiles: Vec<UVec2> = (0..height.div_ceil(TILE))
        .flat_map(|row| (0..width.div_ceil(TILE)).map(move |column| UVec2::new(column, row) * TILE))
        .collect();
    let scenery = scene.set_up(app.world_mut());
    // Bevy's frustum is that of a whole picture of the tile's shape.
    plant(app.world_mut(), &tree, scene.trees(), tiles.len() == 1);
    let mut stand = Stand::new(app, &*scene, scenery, args.size);

    let bar = ProgressBar::new(tiles.len() as u64 + 1);
    let style = ProgressStyle::with_template("rendering the truth {bar:30} {pos}/{len}  {elapsed}");
    bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
    bar.tick();
    stand.set_active(false);
    // Meshes and textures upload.
    for _ in 0..3 {
        step(&mut stand.app);
    }
    stand.set_active(true);
    let mut picture = RgbaImage::new(width, height);
    for at in tiles {
        let size = (UVec2::from(args.size) - at).min(UVec2::splat(TILE));
        imageops::replace(&mut picture, &part(&mut stand, at, size)?, at.x.into(), at.y.into());
        bar.inc(1);
    }
    stand.show_trees_alone();
    stand.show_part(UVec2::ZERO, args.size.into(), 1);
    step(&mut stand.app);
    let cover = stand.picture()?;
    bar.finish_and_clear();
    write_png(&files.cover, &cover)?;
    write_png(&files.picture, &picture)
}

/// A part of the picture, supersampled.
fn part(stand: &mut Stand, at: UVec2, size: UVec2) -> ToolResult<RgbaImage> {
    stand.show_part(at, size, SUPERSAMPLE);
    step(&mut stand.app);
    let large = stand.picture()?;
    let pixels = box_downsample_linear(&large, large.width(), large.height(), SUPERSAMPLE)
        .map_err(|error| ToolError::Message(error.to_string()))?;
    Ok(RgbaImage::from_raw(size.x, size.y, pixels).unwrap_or_default())
}

/// Full meshes, each with its box: Bevy would compute it from all vertices, for each entity.
fn plant(world: &mut World, tree: &Tree, places: &[Transform], frustum_culling: bool) {
    for part in tree.parts(world) {
        let Some(bounds) = part.mesh.compute_aabb() else { continue };
        let mesh = Mesh3d(world.resource_mut::<Assets<Mesh>>().add(part.mesh));
        let material = MeshMaterial3d(part.material);
        let entities = places.iter().map(|place| (mesh.clone(), material.clone(), bounds, *place));
        let entities: Vec<Entity> = world.spawn_batch(entities.collect::<Vec<_>>()).collect();
        if !frustum_culling {
            entities.into_iter().for_each(|entity| {
                world.entity_mut(entity).insert(NoFrustumCulling);
            });
        }
    }
}
