//! Which pieces of ground at which detail: eyes and distances in, chunks out. O(chunks drawn).
//!
//! A quadtree over the square whose chunks all have the same grid of quads (CDLOD: Strugar 2009, "Continuous
//! Distance-Dependent Level of Detail for Rendering Heightmaps"). A node is split iff it is nearer than the distance of
//! its level; vertices reach their parent's grid before that distance, so a change of level moves nothing. Distances at
//! least double from level to level and exceed a node's diagonal, so neighbours differ by one level at most.

use super::Ground;
use crate::math::hash::SplitMix64;
use bevy::math::{Vec2, Vec3};

/// Quads a side of every chunk: few, because a triangle smaller than 16 pixels costs a software driver as much as one of
/// 16; what is smaller than a quad is in the chunk's texture.
pub const CHUNK_QUADS: usize = 16;
/// Triangles of a chunk with its skirts.
pub const CHUNK_TRIANGLES: usize = 2 * CHUNK_QUADS * CHUNK_QUADS + 8 * CHUNK_QUADS;
/// Most levels: 64 km in chunks of 64 m are 11.
pub const MOST_LEVELS: usize = 12;
/// Side of the finest chunk in metres, about.
const LEAF_M: f32 = 64.0;
/// Least distance of a level in sides of its chunk. √2 would do for the rules above; more leaves room to morph in.
const LEAST_SIDES: f32 = 1.8;
/// More detail than this is not worth its chunks.
const MOST_SIDES: f32 = 3.0;

/// A chunk: level 0 is the finest; x and z count chunks of its level from the corner of least x and z.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct ChunkKey {
    /// 0 is the finest.
    pub level: u8,
    /// Column.
    pub x: u32,
    /// Row.
    pub z: u32,
}

impl ChunkKey {
    /// The four of the next finer level; none below level 0.
    pub fn children(self) -> Option<[Self; 4]> {
        let level = self.level.checked_sub(1)?;
        let child = |dx, dz| Self { level, x: 2 * self.x + dx, z: 2 * self.z + dz };
        Some([child(0, 0), child(1, 0), child(0, 1), child(1, 1)])
    }
}

/// Who looks, and how far the nearest ground is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Eye {
    /// Where.
    pub position: Vec3,
    /// To the nearest ground, metres: no chunk is nearer.
    pub ground_m: f32,
}

impl Eye {
    /// Measures the distance to the ground around; it changes smoothly with the position.
    pub fn over(ground: &dyn Ground, position: Vec3) -> Self {
        let here = (position.y - ground.height(position.x, position.z)).abs();
        // Only ground within `here` can be nearer than what is below.
        let rings = [0.25, 0.5, 0.75, 1.0].into_iter().flat_map(|r| (0..12).map(move |k| (r, k)));
        let around = rings.map(|(r, k)| {
            let offset = Vec2::from_angle(k as f32 * std::f32::consts::TAU / 12.0) * (r * here);
            let (x, z) = (position.x + offset.x, position.z + offset.y);
            position.distance(Vec3::new(x, ground.height(x, z), z))
        });
        Self { position, ground_m: around.fold(here, f32::min) }
    }

    /// The distance that decides detail: along the ground, and to the ground. Used by the shader too.
    pub fn distance(&self, along: f32) -> f32 {
        along.hypot(self.ground_m)
    }
}

/// The tree over a square of ground.
#[derive(Clone, Debug, PartialEq)]
pub struct Quadtree {
    side_m: f32,
    levels: usize,
    /// What a quad of each level misses, metres.
    errors_m: [f32; MOST_LEVELS],
}

/// What to draw and what to make.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Cut {
    /// Covers the square once, if the root is ready.
    pub drawn: Vec<ChunkKey>,
    /// What is missing for the wanted cut and the way to it, most urgent first.
    pub missing: Vec<ChunkKey>,
    /// Of the wanted cut and the way to it: not to be thrown away.
    pub used: Vec<ChunkKey>,
    /// The wanted cut is drawn.
    pub complete: bool,
}

impl Quadtree {
    /// A tree over the square of `ground`, with errors measured at some 200 quads a level.
    pub fn new(ground: &dyn Ground) -> Self {
        let side_m = ground.side_m();
        let depth = (side_m / LEAF_M).log2().round().clamp(0.0, MOST_LEVELS as f32 - 1.0) as usize;
        let mut tree = Self { side_m, levels: depth + 1, errors_m: [0.0; MOST_LEVELS] };
        let mut random = SplitMix64(0x9_0AD);
        for level in 0..tree.levels {
            let quad = tree.quad_m(level);
            let mut misses: Vec<f32> = (0..200)
                .map(|_| {
                    let span = (side_m - quad).max(0.0);
                    let x = (random.next_f32() - 0.5) * span;
                    let z = (random.next_f32() - 0.5) * span;
                    let corner = |dx: f32, dz: f32| ground.height(x + dx * quad, z + dz * quad);
                    let middle = 0.5 * (corner(0.5, -0.5) + corner(-0.5, 0.5));
                    (ground.height(x, z) - middle).abs()
                })
                .collect();
            misses.sort_by(f32::total_cmp);
            tree.errors_m[level] = misses[misses.len() * 95 / 100];
        }
        tree
    }

    /// Levels, at least 1; the last is the root.
    pub fn levels(&self) -> usize {
        self.levels
    }

    /// The chunk that is the whole square.
    pub fn root(&self) -> ChunkKey {
        ChunkKey { level: (self.levels - 1) as u8, x: 0, z: 0 }
    }

    /// Side of a quad of a level in metres: exactly twice that of the level below.
    pub fn quad_m(&self, level: usize) -> f32 {
        let leaf = self.side_m / (1u32 << (self.levels - 1)) as f32 / CHUNK_QUADS as f32;
        leaf * (1u32 << level) as f32
    }

    /// Side of a chunk of a level in metres.
    pub fn chunk_m(&self, level: usize) -> f32 {
        self.quad_m(level) * CHUNK_QUADS as f32
    }

    /// The corner of least x and z of a chunk.
    pub fn corner(&self, key: ChunkKey) -> Vec2 {
        let chunk = self.chunk_m(key.level.into());
        Vec2::new(key.x as f32, key.z as f32) * chunk - self.side_m * 0.5
    }

    /// Distance in metres below which a node of each level is split, for an error of `error_px` on a screen with
    /// `px_per_unit` pixels a metre at a distance of 1 m. That of level 0 is where its vertices begin to morph.
    pub fn split_distances(&self, px_per_unit: f32, error_px: f32) -> [f32; MOST_LEVELS] {
        let mut splits = [f32::MAX; MOST_LEVELS];
        let mut below = 0.0f32;
        for (level, split) in splits.iter_mut().enumerate().take(self.levels) {
            let chunk = self.chunk_m(level);
            let wanted = self.errors_m[level] * px_per_unit / error_px.max(0.1);
            // Doubling keeps neighbours within a level of each other.
            below = wanted.clamp(LEAST_SIDES * chunk, MOST_SIDES * chunk).max(2.0 * below);
            *split = below;
        }
        splits
    }

    /// Distances between which vertices of a level morph to the next level's grid.
    pub fn morph_range(&self, level: usize, splits: &[f32; MOST_LEVELS]) -> [f32; 2] {
        if level + 1 >= self.levels {
            return [f32::MAX, f32::MAX];
        }
        let end = splits[level + 1];
        let start = splits[level] + std::f32::consts::SQRT_2 * self.chunk_m(level);
        [start.min(0.98 * end), end]
    }

    /// Distance of a chunk from the nearest eye.
    pub fn distance(&self, key: ChunkKey, eyes: &[Eye]) -> f32 {
        let corner = self.corner(key);
        let chunk = self.chunk_m(key.level.into());
        let to = |eye: &Eye| {
            let at = Vec2::new(eye.position.x, eye.position.z);
            eye.distance(at.distance(at.clamp(corner, corner + chunk)))
        };
        eyes.iter().map(to).fold(f32::INFINITY, f32::min)
    }

    /// The chunks for these eyes, out of those that are `ready`. Where finer ones are not, the coarser one stays.
    pub fn cut(
        &self,
        eyes: &[Eye],
        splits: &[f32; MOST_LEVELS],
        ready: &dyn Fn(ChunkKey) -> bool,
    ) -> Cut {
        let mut walk =
            Walk { tree: self, eyes, splits, ready, missing: Vec::new(), used: Vec::new() };
        let mut cut = Cut::default();
        let root = self.root();
        cut.complete = walk.want(root);
        walk.draw(root, &mut cut.drawn);
        // Urgent is what is large on the screen; keys break ties, so that the order is the same every time.
        walk.missing.sort_by(|a, b| b.0.total_cmp(&a.0).then(b.1.cmp(&a.1)));
        cut.used = walk.used;
        cut.missing = walk.missing.into_iter().map(|(_, key)| key).collect();
        cut
    }
}

struct Walk<'a> {
    tree: &'a Quadtree,
    eyes: &'a [Eye],
    splits: &'a [f32; MOST_LEVELS],
    ready: &'a dyn Fn(ChunkKey) -> bool,
    missing: Vec<(f32, ChunkKey)>,
    used: Vec<ChunkKey>,
}

impl Walk<'_> {
    fn children(&self, key: ChunkKey) -> Option<[ChunkKey; 4]> {
        let near = self.tree.distance(key, self.eyes) < self.splits[usize::from(key.level)];
        key.children().filter(|_| near)
    }

    /// Notes what is missing; true if the wanted cut is ready.
    fn want(&mut self, key: ChunkKey) -> bool {
        let children = self.children(key);
        self.used.push(key);
        if !(self.ready)(key) {
            let chunk = self.tree.chunk_m(key.level.into());
            self.missing.push((chunk / self.tree.distance(key, self.eyes).max(1.0), key));
        }
        match children {
            Some(children) => children.map(|child| self.want(child)).into_iter().all(|ready| ready),
            None => (self.ready)(key),
        }
    }

    fn drawable(&self, key: ChunkKey) -> bool {
        (self.ready)(key)
            || self.children(key).is_some_and(|c| c.into_iter().all(|child| self.drawable(child)))
    }

    fn draw(&self, key: ChunkKey, drawn: &mut Vec<ChunkKey>) {
        match self.children(key) {
            Some(children) if children.iter().all(|child| self.drawable(*child)) => {
                children.into_iter().for_each(|child| self.draw(child, drawn));
            }
            _ if (self.ready)(key) => drawn.push(key),
            _ => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    struct Hills(f32);
    impl Ground for Hills {
        fn side_m(&self) -> f32 {
            self.0
        }
        fn height(&self, x: f32, z: f32) -> f32 {
            40.0 * (x * 0.01).sin() * (z * 0.013).cos()
        }
        fn height_range(&self) -> [f32; 2] {
            [-40.0, 40.0]
        }
        fn detail_m(&self) -> f32 {
            1.0
        }
    }

    /// In leaves: corner, side.
    fn span(key: ChunkKey) -> (u32, u32, u32) {
        (key.x << key.level, key.z << key.level, 1 << key.level)
    }

    fn covers_once(tree: &Quadtree, drawn: &[ChunkKey]) -> bool {
        let side = 1u64 << (tree.levels() - 1);
        let area: u64 = drawn.iter().map(|k| u64::from(span(*k).2).pow(2)).sum();
        let apart = |a: ChunkKey, b: ChunkKey| {
            let ((ax, az, a), (bx, bz, b)) = (span(a), span(b));
            ax + a <= bx || bx + b <= ax || az + a <= bz || bz + b <= az
        };
        area == side * side
            && drawn.iter().enumerate().all(|(i, a)| drawn[..i].iter().all(|b| apart(*a, *b)))
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]
        #[test]
        fn a_cut_covers_the_square_once_and_neighbours_differ_by_a_level(
            side_m in 300.0f32..65_536.0, x in -0.6f32..0.6, z in -0.6f32..0.6, up in 0.0f32..900.0,
            px in 300.0f32..2500.0, error in 0.5f32..8.0,
        ) {
            let ground = Hills(side_m);
            let tree = Quadtree::new(&ground);
            let (x, z) = (x * side_m, z * side_m);
            let eye = Eye::over(&ground, Vec3::new(x, ground.height(x, z) + up, z));
            let splits = tree.split_distances(px, error);
            let cut = tree.cut(&[eye], &splits, &|_| true);
            prop_assert!(cut.complete && cut.missing.is_empty());
            prop_assert!(covers_once(&tree, &cut.drawn));
            for a in &cut.drawn {
                for b in &cut.drawn {
                    let ((ax, az, s), (bx, bz, t)) = (span(*a), span(*b));
                    let touch = ax <= bx + t && bx <= ax + s && az <= bz + t && bz <= az + s;
                    prop_assert!(!touch || a.level.abs_diff(b.level) <= 1, "{a:?} beside {b:?}");
                }
            }
            // On an edge between levels the finer side has morphed wholly, the coarser one not at all.
            for a in &cut.drawn {
                for b in cut.drawn.iter().filter(|b| b.level == a.level + 1) {
                    let ((ax, az, s), (bx, bz, t)) = (span(*a), span(*b));
                    if !(ax <= bx + t && bx <= ax + s && az <= bz + t && bz <= az + s) { continue; }
                    let leaf = tree.chunk_m(0);
                    let low = Vec2::new(ax.max(bx) as f32, az.max(bz) as f32) * leaf - side_m * 0.5;
                    let high = Vec2::new((ax + s).min(bx + t) as f32, (az + s).min(bz + t) as f32) * leaf - side_m * 0.5;
                    for k in 0..=8 {
                        let d = eye.distance(low.lerp(high, k as f32 / 8.0).distance(Vec2::new(x, z)));
                        let fine_end = tree.morph_range(a.level.into(), &splits)[1];
                        let coarse_start = tree.morph_range(b.level.into(), &splits)[0];
                        prop_assert!(d >= fine_end * 0.9999 && d <= coarse_start * 1.0001, "{} {} {}", d, fine_end, coarse_start);
                    }
                }
            }
        }

        #[test]
        fn without_all_chunks_the_square_is_covered_by_coarser_ones(seed in any::<u64>(), share in 0.0f32..1.0) {
            let ground = Hills(4096.0);
            let tree = Quadtree::new(&ground);
            let splits = tree.split_distances(870.0, 2.0);
            let eye = Eye::over(&ground, Vec3::new(100.0, 30.0, -400.0));
            let root = tree.root();
            let ready = |k: ChunkKey| {
                let id = u64::from(k.level) << 40 | u64::from(k.x) << 20 | u64::from(k.z);
                k == root || SplitMix64(seed ^ id).next_f32() < share
            };
            let cut = tree.cut(&[eye], &splits, &ready);
            prop_assert!(covers_once(&tree, &cut.drawn));
            prop_assert!(cut.drawn.iter().all(|k| ready(*k)));
            prop_assert!(cut.missing.iter().all(|k| !ready(*k)));
        }
    }

    #[test]
    fn detail_costs_about_as_many_chunks_on_any_ground() {
        let count = |side_m: f32| {
            let ground = Hills(side_m);
            let tree = Quadtree::new(&ground);
            let eye = Eye::over(&ground, Vec3::new(0.0, 42.0, 0.0));
            tree.cut(&[eye], &tree.split_distances(870.0, 2.5), &|_| true).drawn.len()
        };
        let (small, large) = (count(1024.0), count(65_536.0));
        println!("{small} chunks on 1 km, {large} on 64 km");
        assert!(small < 250 && large < 700, "{small} {large}");
    }
}
