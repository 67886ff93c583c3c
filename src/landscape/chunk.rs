//! A chunk of ground as plain data: ground, biomes, sun and a key in; vertices and a texture out. O(posts + texels), about
//! 12 ms, off the main thread.

use super::{
    Biomes, Ground,
    paint::{Painter, TEXTURE_BORDER, TEXTURE_SIDE},
    quadtree::{CHUNK_QUADS, ChunkKey, Quadtree},
    shade::ShadeSource,
    sunlight::SunShadow,
};
use bevy::math::{Vec2, Vec3};

/// Posts a side of a chunk.
const POSTS: usize = CHUNK_QUADS + 1;

/// What a chunk is made from.
pub struct ChunkSource<'a> {
    /// Heights.
    pub ground: &'a dyn Ground,
    /// What grows where.
    pub biomes: &'a Biomes,
    /// Where the chunks are.
    pub tree: &'a Quadtree,
    /// Shadows of the ground.
    pub shadow: &'a SunShadow,
    /// Towards the sun, unit.
    pub to_sun: Vec3,
    /// Trees that throw shadows.
    pub shade: Option<&'a dyn ShadeSource>,
}

/// Vertices and what bounds them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ChunkMesh {
    /// Metres from [`Self::middle`], y from height 0; the last are the skirts' lower ends.
    pub positions: Vec<[f32; 3]>,
    /// Height on the parent's grid, and the post's column + 64 · its row.
    pub morphs: Vec<[f32; 2]>,
    /// Middle of the chunk at height 0.
    pub middle: Vec3,
    /// Least and greatest y, water and skirts included.
    pub range: [f32; 2],
}

impl ChunkMesh {
    /// Heights of a chunk at its own level and where its vertices morph to.
    pub fn new(ground: &dyn Ground, tree: &Quadtree, key: ChunkKey) -> Self {
        let level = usize::from(key.level);
        let (quad, corner) = (tree.quad_m(level), tree.corner(key));
        let at = |i: usize, k: usize| corner + Vec2::new(i as f32, k as f32) * quad;
        let heights: Vec<f32> = (0..POSTS * POSTS)
            .map(|n| at(n % POSTS, n / POSTS))
            .map(|p| ground.height(p.x, p.y))
            .collect();
        let height = |i: usize, k: usize| heights[k * POSTS + i];
        // On the parent's triangles, whose diagonals run from (x, z + 1) to (x + 1, z) as ours do.
        let parent = |i: usize, k: usize| match (i % 2, k % 2) {
            (0, 0) => height(i, k),
            (1, 0) => 0.5 * (height(i - 1, k) + height(i + 1, k)),
            (0, _) => 0.5 * (height(i, k - 1) + height(i, k + 1)),
            _ => 0.5 * (height(i + 1, k - 1) + height(i - 1, k + 1)),
        };
        let half = 0.5 * quad * CHUNK_QUADS as f32;
        let mut mesh = Self {
            middle: Vec3::new(corner.x + half, 0.0, corner.y + half),
            range: [f32::INFINITY, f32::NEG_INFINITY],
            ..Self::default()
        };
        let water = ground.water_level().unwrap_or(f32::NEG_INFINITY);
        let mut add = |i: usize, k: usize, drop: f32| {
            let (y, target) = (height(i, k) - drop, parent(i, k) - drop);
            mesh.positions.push([i as f32 * quad - half, y, k as f32 * quad - half]);
            mesh.morphs.push([target, (i + 64 * k) as f32]);
            mesh.range[0] = mesh.range[0].min(y.min(target));
            mesh.range[1] = mesh.range[1].max(y.max(target).max(water));
        };
        for k in 0..POSTS {
            for i in 0..POSTS {
                add(i, k, 0.0);
            }
        }
        // Skirts hide the gaps beside a coarser chunk whose children are not made yet.
        for side in 0..4 {
            for n in 0..POSTS {
                let (i, k) = border(side, n);
                add(i, k, 0.4 * quad);
            }
        }
        mesh
    }

    /// Corners of the triangles of every chunk, counter-clockwise from above.
    pub fn triangles() -> Vec<u16> {
        let mut corners = Vec::with_capacity(CHUNK_QUADS * CHUNK_QUADS * 6 + CHUNK_QUADS * 24);
        let post = |i: usize, k: usize| (k * POSTS + i) as u16;
        for k in 0..CHUNK_QUADS {
            for i in 0..CHUNK_QUADS {
                let [a, b, c, d] = [post(i, k), post(i + 1, k), post(i, k + 1), post(i + 1, k + 1)];
                corners.extend([a, c, b, b, c, d]);
            }
        }
        for side in 0..4 {
            let low = |n: usize| (POSTS * POSTS + side * POSTS + n) as u16;
            for n in 0..CHUNK_QUADS {
                let top = |n: usize| {
                    let (i, k) = border(side, n);
                    post(i, k)
                };
                corners.extend([top(n), low(n), top(n + 1), low(n), low(n + 1), top(n + 1)]);
            }
        }
        corners
    }
}

/// Post `n` along a side, walking so that skirts face outwards.
fn border(side: usize, n: usize) -> (usize, usize) {
    let m = CHUNK_QUADS - n;
    match side {
        0 => (m, 0),
        1 => (0, n),
        2 => (n, CHUNK_QUADS),
        _ => (CHUNK_QUADS, m),
    }
}

/// A texture with its smaller copies, RGBA8: sRGB albedo, and in A how much of the sun arrives (linear).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ChunkTexture {
    /// All copies, largest first.
    pub bytes: Vec<u8>,
    /// Side of the largest.
    pub side: u32,
    /// Copies.
    pub mips: u32,
}

/// Place of the chunk in its texture: uv = share of the chunk · x + y.
pub const TEXTURE_PLACE: [f32; 2] = [
    (TEXTURE_SIDE - 2 * TEXTURE_BORDER) as f32 / TEXTURE_SIDE as f32,
    TEXTURE_BORDER as f32 / TEXTURE_SIDE as f32,
];

impl ChunkTexture {
    /// Paints a chunk.
    pub fn new(source: &ChunkSource, key: ChunkKey) -> Self {
        Painter::new(source, key).paint()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::landscape::{BiomeSettings, NoiseTerrain, TerrainSettings, sunlight::Silhouette};

    fn terrain() -> NoiseTerrain {
        NoiseTerrain::new(&TerrainSettings { side_m: 2000.0, ..Default::default() }).expect("good")
    }

    #[test]
    fn a_wholly_morphed_chunk_is_its_parent() {
        let ground = terrain();
        let tree = Quadtree::new(&ground);
        let parent = ChunkKey { level: 2, x: 1, z: 2 };
        let coarse = ChunkMesh::new(&ground, &tree, parent);
        for child in parent.children().expect("it has some") {
            let fine = ChunkMesh::new(&ground, &tree, child);
            let offset = fine.middle - coarse.middle;
            for (position, morph) in fine.positions.iter().zip(&fine.morphs).take(POSTS * POSTS) {
                let quad = tree.quad_m(2);
                let x = (position[0] + offset.x) / quad + 0.5 * CHUNK_QUADS as f32;
                let z = (position[2] + offset.z) / quad + 0.5 * CHUNK_QUADS as f32;
                let (i, k) = ((x as usize).min(CHUNK_QUADS - 1), (z as usize).min(CHUNK_QUADS - 1));
                let (fx, fz) = (x - i as f32, z - k as f32);
                let at = |i: usize, k: usize| coarse.positions[k * POSTS + i][1];
                let (a, b, c, d) = (at(i, k), at(i + 1, k), at(i, k + 1), at(i + 1, k + 1));
                let surface = if fx + fz <= 1.0 {
                    a + (b - a) * fx + (c - a) * fz
                } else {
                    d + (c - d) * (1.0 - fx) + (b - d) * (1.0 - fz)
                };
                assert!((surface - morph[0]).abs() < 0.01, "{surface} against {}", morph[0]);
            }
        }
    }

    #[test]
    fn all_triangles_of_the_ground_face_up_and_skirts_face_out() {
        let ground = terrain();
        let tree = Quadtree::new(&ground);
        let mesh = ChunkMesh::new(&ground, &tree, ChunkKey { level: 1, x: 3, z: 3 });
        let triangles = ChunkMesh::triangles();
        assert_eq!(triangles.len() / 3, crate::landscape::quadtree::CHUNK_TRIANGLES);
        for (n, t) in triangles.chunks_exact(3).enumerate() {
            let p = |k: usize| Vec3::from(mesh.positions[usize::from(t[k])]);
            let normal = (p(1) - p(0)).cross(p(2) - p(0));
            if n < CHUNK_QUADS * CHUNK_QUADS * 2 {
                assert!(normal.y > 0.0, "triangle {n}");
            } else {
                let out = (p(0) + p(1) + p(2)).with_y(0.0);
                assert!(normal.dot(out) > 0.0, "skirt {n}");
            }
        }
    }

    #[test]
    fn textures_are_whole_repeatable_and_lit_by_the_sun() {
        let ground = terrain();
        let tree = Quadtree::new(&ground);
        let biomes = Biomes::new(&ground, &BiomeSettings::default());
        let silhouette = Silhouette::of(&ground);
        let key = ChunkKey { level: 1, x: 5, z: 5 };
        let texture = |to_sun: Vec3| {
            let shadow = silhouette.shadows(to_sun);
            let source = ChunkSource {
                ground: &ground,
                biomes: &biomes,
                tree: &tree,
                shadow: &shadow,
                to_sun,
                shade: None,
            };
            ChunkTexture::new(&source, key)
        };
        let noon = texture(Vec3::new(0.3, 0.9, 0.2).normalize());
        let texels: usize = (0..noon.mips).map(|m| (noon.side as usize >> m).pow(2)).sum();
        assert_eq!(noon.bytes.len(), texels * 4);
        assert_eq!(noon, texture(Vec3::new(0.3, 0.9, 0.2).normalize()));
        let sun = |t: &ChunkTexture| {
            t.bytes.iter().skip(3).step_by(4).map(|b| f64::from(*b)).sum::<f64>()
        };
        let evening = texture(Vec3::new(0.95, 0.12, 0.2).normalize());
        assert!(sun(&evening) < 0.6 * sun(&noon), "{} {}", sun(&evening), sun(&noon));
        let distinct: std::collections::BTreeSet<_> =
            noon.bytes.chunks_exact(4).map(|t| [t[0], t[1], t[2]]).collect();
        assert!(distinct.len() > 500, "no flat patches: {} colours", distinct.len());
    }
}
