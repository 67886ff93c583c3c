//! The look of ground from above: biomes, slope, altitude and sun in; albedo and sunlight of every texel out. O(texels).
//!
//! Heights at every texel → normals over a texel's width, so that light is the mean over the texel and stays when the
//! level changes → biomes at every second texel → colours of soils mixed with noise of several sizes (none shorter than
//! two texels) → sun by N · L, shadows of mountains and trees → smaller copies.

use super::{
    Biome, Site,
    chunk::{ChunkSource, ChunkTexture},
    gradient_noise::{OFFSET, fractal, noise},
    quadtree::ChunkKey,
    shade::ShadeMap,
    smoothstep,
};
use crate::math::quantize::linear_to_srgb8;
use bevy::math::{Vec2, Vec3};

/// Texels a side, and those on each side that repeat the neighbours, so that seams do not show.
pub(super) const TEXTURE_SIDE: usize = 128;
pub(super) const TEXTURE_BORDER: usize = 2;
/// Sizes: 128 to 8.
const MIPS: usize = 5;
/// Texels between biomes.
const BIOME_STEP: usize = 2;
const BIOMES: usize = TEXTURE_SIDE / BIOME_STEP + 1;
/// Texels wider than this show no single trees.
const TREE_TEXEL_M: f32 = 2.2;

/// Linear albedos.
const MEADOW_LUSH: Vec3 = Vec3::new(0.060, 0.102, 0.026);
const MEADOW_DRY: Vec3 = Vec3::new(0.112, 0.118, 0.044);
const MEADOW_HIGH: Vec3 = Vec3::new(0.090, 0.100, 0.044);
const HEATH: Vec3 = Vec3::new(0.078, 0.072, 0.040);
const FOREST_FLOOR: Vec3 = Vec3::new(0.052, 0.046, 0.024);
const MOSS: Vec3 = Vec3::new(0.042, 0.066, 0.018);
const ROCK_DARK: Vec3 = Vec3::new(0.115, 0.108, 0.100);
const ROCK_LIGHT: Vec3 = Vec3::new(0.245, 0.228, 0.205);
const SCREE: Vec3 = Vec3::new(0.205, 0.190, 0.170);
const SNOW: Vec3 = Vec3::new(0.80, 0.83, 0.88);
const SAND: Vec3 = Vec3::new(0.285, 0.245, 0.175);
const SILT: Vec3 = Vec3::new(0.105, 0.095, 0.065);

/// Paints one chunk.
pub(super) struct Painter<'a> {
    source: &'a ChunkSource<'a>,
    corner: Vec2,
    texel_m: f32,
    /// With a texel more on every side.
    heights: Vec<f32>,
}

/// Noise at a texel.
struct Grain {
    /// 200 m and more.
    broad: f32,
    /// 20 to 60 m.
    middle: f32,
    /// 3 to 12 m.
    small: f32,
    /// 1 m.
    fine: f32,
}

const WIDE: usize = TEXTURE_SIDE + 2;

impl<'a> Painter<'a> {
    pub fn new(source: &'a ChunkSource<'a>, key: ChunkKey) -> Self {
        let inner = (TEXTURE_SIDE - 2 * TEXTURE_BORDER) as f32;
        let texel_m = source.tree.chunk_m(key.level.into()) / inner;
        // Middle of the first texel.
        let corner = source.tree.corner(key) + (0.5 - TEXTURE_BORDER as f32) * texel_m;
        let heights = (0..WIDE * WIDE)
            .map(|n| corner + (Vec2::new((n % WIDE) as f32, (n / WIDE) as f32) - 1.0) * texel_m)
            .map(|p| source.ground.height(p.x, p.y))
            .collect();
        Self { source, corner, texel_m, heights }
    }

    pub fn paint(&self) -> ChunkTexture {
        let to_sun = self.source.to_sun;
        let biomes = self.biomes();
        let mut shade = ShadeMap::open(self.corner, self.texel_m, TEXTURE_SIDE);
        match self.source.shade {
            Some(trees) if self.texel_m <= TREE_TEXEL_M => shade.stamp(trees, to_sun),
            Some(trees) => shade.cover(trees, to_sun),
            None => {}
        }
        let texels = (0..TEXTURE_SIDE * TEXTURE_SIDE).map(|n| {
            let (x, z) = (n % TEXTURE_SIDE, n / TEXTURE_SIDE);
            let place = self.corner + Vec2::new(x as f32, z as f32) * self.texel_m;
            let height = self.height(x, z);
            let normal = self.normal(x, z);
            let (biome, moisture) = between(&biomes, x, z);
            let grain = self.grain(place);
            let above = self.source.ground.water_level().map_or(f32::INFINITY, |w| height - w);
            let albedo = soil(&biome, moisture, normal.y, above, &grain) * shade.sky[n];
            let lit = self.source.shadow.lit(place.x, place.y, height);
            let sun = normal.dot(to_sun).max(0.0) * lit * shade.sun[n];
            [albedo.x, albedo.y, albedo.z, sun]
        });
        packed(texels.collect())
    }

    fn height(&self, x: usize, z: usize) -> f32 {
        self.heights[(z + 1) * WIDE + x + 1]
    }

    /// Mean over two texels, exactly: differences of heights are integrals of slopes.
    fn normal(&self, x: usize, z: usize) -> Vec3 {
        let at = (z + 1) * WIDE + x + 1;
        let dx = self.heights[at + 1] - self.heights[at - 1];
        let dz = self.heights[at + WIDE] - self.heights[at - WIDE];
        Vec3::new(-dx, 2.0 * self.texel_m, -dz).normalize()
    }

    /// Biome and moisture at every second texel.
    fn biomes(&self) -> Vec<(Biome, f32)> {
        let water = self.source.ground.water_level();
        (0..BIOMES * BIOMES)
            .map(|n| {
                let (x, z) = ((n % BIOMES) * BIOME_STEP, (n / BIOMES) * BIOME_STEP);
                let place = self.corner + Vec2::new(x as f32, z as f32) * self.texel_m;
                let (x, z) = (x.min(TEXTURE_SIDE - 1), z.min(TEXTURE_SIDE - 1));
                let (height_m, normal) = (self.height(x, z), self.normal(x, z));
                let site = Site {
                    height_m,
                    normal,
                    slope: normal.y.clamp(-1.0, 1.0).acos(),
                    curvature: self.curvature(x, z),
                    moisture: self.source.ground.moisture(place.x, place.y),
                    above_water_m: water.map_or(f32::INFINITY, |level| height_m - level),
                };
                (self.source.biomes.at(place.x, place.y, &site), site.moisture)
            })
            .collect()
    }

    fn curvature(&self, x: usize, z: usize) -> f32 {
        let step = ((12.0 / self.texel_m) as usize).clamp(1, 24);
        let span = step as f32 * self.texel_m;
        let at = |x: usize, z: usize| self.heights[z.min(WIDE - 1) * WIDE + x.min(WIDE - 1)];
        let (x, z) = (x + 1, z + 1);
        let around = at(x + step, z)
            + at(x.saturating_sub(step), z)
            + at(x, z + step)
            + at(x, z.saturating_sub(step));
        (around - 4.0 * at(x, z)) / (span * span)
    }

    /// Noise that the texels can hold: shorter waves fade, as they do in the smaller copies of finer chunks.
    fn grain(&self, at: Vec2) -> Grain {
        let keep = |wave_m: f32| smoothstep(1.5, 4.0, wave_m / self.texel_m);
        let wave = |wave_m: f32, octaves: u32, seed: u32| {
            let kept = keep(wave_m);
            if kept > 0.0 { kept * fractal(at / wave_m + OFFSET, octaves, seed) } else { 0.0 }
        };
        Grain {
            broad: fractal(at / 310.0, 2, 0xB0) * keep(310.0),
            middle: wave(47.0, 2, 0xB1),
            small: wave(9.0, 2, 0xB2),
            fine: keep(1.7) * noise(at / 1.7, 0xB3).value,
        }
    }
}

fn between(biomes: &[(Biome, f32)], x: usize, z: usize) -> (Biome, f32) {
    let (i, k) = (x / BIOME_STEP, z / BIOME_STEP);
    let [fx, fz] = [x, z].map(|v| (v % BIOME_STEP) as f32 / BIOME_STEP as f32);
    let corners =
        [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(dx, dz)| &biomes[(k + dz) * BIOMES + i + dx]);
    let weights = [(1.0 - fx) * (1.0 - fz), fx * (1.0 - fz), (1.0 - fx) * fz, fx * fz];
    let mix = |part: &dyn Fn(&(Biome, f32)) -> f32| {
        corners.iter().zip(weights).map(|(b, w)| part(b) * w).sum::<f32>()
    };
    let biome = Biome {
        forest: mix(&|b| b.0.forest),
        conifer: mix(&|b| b.0.conifer),
        grass: mix(&|b| b.0.grass),
        rock: mix(&|b| b.0.rock),
        scree: mix(&|b| b.0.scree),
        snow: mix(&|b| b.0.snow),
        shore: mix(&|b| b.0.shore),
        altitude: mix(&|b| b.0.altitude),
        wet: mix(&|b| b.0.wet),
        vigour: mix(&|b| b.0.vigour),
    };
    (biome, mix(&|b| b.1))
}

/// Linear albedo of the ground.
fn soil(biome: &Biome, moisture: f32, up: f32, above_water: f32, grain: &Grain) -> Vec3 {
    let Grain { broad, middle, small, fine } = *grain;
    let dry = 1.0 - smoothstep(-0.1, 1.0, moisture + 0.55 * broad + 0.4 * middle + 0.3 * small);
    let lush = MEADOW_LUSH.lerp(MEADOW_DRY, dry);
    // High meadows are olive, not green; patches of heath lie in them.
    let grass = lush
        .lerp(MEADOW_HIGH, 0.55 * smoothstep(0.45, 0.95, biome.conifer + 0.2 * broad))
        .lerp(HEATH, 0.7 * smoothstep(0.0, 0.55, middle + 0.6 * small - 0.3 * broad));
    let litter = FOREST_FLOOR.lerp(MOSS, smoothstep(-0.3, 0.6, middle + 0.7 * small + 0.3 * broad));
    let forest = smoothstep(0.05, 0.8, biome.forest + 0.5 * small + 0.25 * middle + 0.2 * fine);
    let meadow = grass.lerp(litter, forest);
    let rock = ROCK_DARK
        .lerp(ROCK_LIGHT, smoothstep(-0.45, 0.5, middle + 0.7 * small + 0.35 * fine))
        .lerp(MEADOW_HIGH, 0.35 * smoothstep(0.1, 0.5, small - 0.4 * middle) * up);
    let scree = SCREE.lerp(ROCK_DARK, smoothstep(0.1, 0.6, small + 0.4 * fine) * 0.6);
    let wet = 1.0 - smoothstep(0.1, 1.1, above_water + 0.3 * small);
    let shore = SAND.lerp(SILT, smoothstep(-0.1, 0.5, middle + 0.4 * small)) * (1.0 - 0.45 * wet);
    // Borders between soils follow the grain instead of the grid.
    let edge = 0.55 * small + 0.35 * fine + 0.3 * middle;
    let share = |part: f32, sign: f32| {
        let inner = part * (1.0 - part) * 4.0;
        (part + sign * edge * inner * 0.8).max(0.0)
    };
    let parts = [
        (share(biome.grass, 1.0), meadow),
        (share(biome.rock, -1.0), rock),
        (share(biome.scree, -0.6), scree),
        (share(biome.snow, 0.8), SNOW),
        (share(biome.shore, -1.0), shore),
    ];
    let total: f32 = parts.iter().map(|p| p.0).sum();
    let mixed = parts.iter().map(|(part, color)| *color * *part).sum::<Vec3>() / total.max(1e-3);
    let brightness = 1.0 + 0.10 * broad + 0.12 * middle + 0.14 * small + 0.16 * fine;
    mixed * brightness.clamp(0.5, 1.5)
}

fn packed(texels: Vec<[f32; 4]>) -> ChunkTexture {
    let mut bytes = Vec::new();
    let (mut level, mut side) = (texels, TEXTURE_SIDE);
    for mip in 0..MIPS {
        bytes.extend(level.iter().flat_map(|[r, g, b, sun]| {
            let sun = (sun.clamp(0.0, 1.0) * 255.0 + 0.5) as u8;
            [linear_to_srgb8(*r), linear_to_srgb8(*g), linear_to_srgb8(*b), sun]
        }));
        if mip + 1 < MIPS {
            side /= 2;
            level = (0..side * side)
                .map(|n| {
                    let at = (n / side) * 2 * (side * 2) + (n % side) * 2;
                    let four = [at, at + 1, at + side * 2, at + side * 2 + 1];
                    [0, 1, 2, 3].map(|c| four.iter().map(|i| level[*i][c]).sum::<f32>() * 0.25)
                })
                .collect();
        }
    }
    ChunkTexture { bytes, side: TEXTURE_SIDE as u32, mips: MIPS as u32 }
}
