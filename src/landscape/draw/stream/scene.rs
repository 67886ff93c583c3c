//! What a chunk is made of, and the making: landscape, sun and chunk in; mesh and texture out. Runs in any thread.

use crate::landscape::{
    chunk::{ChunkMesh, ChunkSource, ChunkTexture},
    draw::{Landscape, material::image},
    quadtree::{ChunkKey, Quadtree},
    sunlight::{Silhouette, SunShadow},
};
use bevy::{
    asset::RenderAssetUsages,
    mesh::{Indices, PrimitiveTopology},
    prelude::*,
};
use std::sync::OnceLock;

/// A direction of the sun, and the shadows for it: made by the first task that needs them.
pub(super) struct SunState {
    pub to_sun: Vec3,
    pub version: u32,
    pub shadow: OnceLock<SunShadow>,
}

/// What tasks read.
pub(super) struct Scene {
    pub landscape: Landscape,
    pub tree: Quadtree,
    pub silhouette: OnceLock<Silhouette>,
    pub triangles: Vec<u16>,
}

/// A chunk on its way to the GPU.
pub(super) struct Made {
    pub key: ChunkKey,
    /// `None` if only the texture was made again.
    pub mesh: Option<ChunkMesh>,
    pub corners: Option<Mesh>,
    pub texture: Image,
    pub sun: u32,
}

/// Paints a chunk, and shapes it `with_mesh`.
pub(super) fn make(scene: &Scene, sun: &SunState, key: ChunkKey, with_mesh: bool) -> Made {
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
