//! Places that keep their distance at every density: side and spacing in, ranked points of a few tiles out.
//!
//! Each tile is a Poisson-disc set thrown in four levels, the spacing falling by √2 from level to level (hierarchical
//! discs: McCool & Fiume 1992, "Hierarchical Poisson Disk Sampling Distributions"), so every prefix is as even as its
//! density lets it be. The first level is put in another order in each tile of the ground: sparse stands do not
//! repeat. Tiles wrap around, and all variants have the same points along the border, so any may lie beside any other.
//! Building is O(variants · side² / spacing²), some 15 ms a variant of 16,000 points.

use crate::math::hash::{SplitMix64, mix_bits};
use bevy::math::{IVec2, Vec2};
use rayon::prelude::*;

/// Radii of the levels in units of the spacing.
const LEVELS: [f32; 4] = [2.828_427, 2.0, std::f32::consts::SQRT_2, 1.0];
/// Darts a free cell and level. 8 give 0.60 points per spacing² (all that fit: 0.70).
const ROUNDS: u32 = 8;
/// Different tiles.
const VARIANTS: u64 = 8;
/// The smallest side in units of the spacing: several of the widest discs.
pub(super) const LEAST_SIDE: f32 = 14.0;

/// Ranked places of a tile, in several variants.
pub(super) struct BlueNoise {
    side_m: f32,
    variants: Vec<Variant>,
}

struct Variant {
    /// In the tile, 0 to side; by level.
    points: Vec<Vec2>,
    /// Points of the first level.
    first: usize,
}

/// A place for a plant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Candidate {
    /// In the tile, 0 to side.
    pub place: Vec2,
    /// Taken where the density is above this, 1/m².
    pub at_density: f32,
    /// Of the variant: with the tile's number it identifies the candidate.
    pub index: u32,
}

impl BlueNoise {
    /// Points no nearer than `spacing_m` to each other, on tiles of `side_m` ≥ [`LEAST_SIDE`] spacings.
    pub fn new(side_m: f32, spacing_m: f32, seed: u64) -> Self {
        let first = throw(side_m, spacing_m, SplitMix64(seed), &[]);
        // Nobody beyond the border is nearer than the spacing to what lies further inside.
        let at_border = |p: Vec2| is_at_border(p, side_m, spacing_m);
        let kept: Vec<(Vec2, usize)> =
            first.iter().copied().filter(|(p, _)| at_border(*p)).collect();
        let others = (1..VARIANTS).into_par_iter().map(|i| {
            throw(
                side_m,
                spacing_m,
                SplitMix64(seed ^ i.wrapping_mul(0xD1B5_4A32_D192_ED03)),
                &kept,
            )
        });
        let mut all: Vec<Vec<(Vec2, usize)>> = others.collect();
        all.insert(0, first);
        let variants = all.into_iter().map(|points| Variant {
            first: points.iter().filter(|(_, level)| *level == 0).count(),
            points: points.into_iter().map(|(p, _)| p).collect(),
        });
        Self { side_m, variants: variants.collect() }
    }

    /// The density up to which every variant has points, 1/m².
    pub fn most_per_m2(&self) -> f32 {
        let fewest = self.variants.iter().map(|v| v.points.len()).min().unwrap_or(0);
        fewest as f32 / (self.side_m * self.side_m)
    }

    /// Candidates of a tile that are taken at densities below `density` (1/m²). O(first level + candidates).
    pub fn candidates(
        &self,
        tile: IVec2,
        seed: u64,
        density: f32,
    ) -> impl Iterator<Item = Candidate> {
        let key = tile_key(tile, seed);
        let variant = &self.variants[(key >> 40) as usize % self.variants.len()];
        let area = self.side_m * self.side_m;
        let density = density.min(self.most_per_m2());
        let end =
            ((density * area).ceil().max(0.0) as usize).clamp(variant.first, variant.points.len());
        variant.points[..end].iter().enumerate().filter_map(move |(i, &place)| {
            let rank = if i < variant.first {
                let bits = mix_bits(key as u32 ^ (i as u32).wrapping_mul(0x85EB_CA6B));
                // Above 0, so that a density of 0 takes nothing.
                ((bits >> 8) as f32 + 0.5) / 16_777_216.0 * variant.first as f32
            } else {
                i as f32 + 0.5
            };
            let at_density = rank / area;
            (at_density < density).then_some(Candidate { place, at_density, index: i as u32 })
        })
    }
}

/// Whether a point could be too near to one of the next tile.
fn is_at_border(place: Vec2, side_m: f32, spacing_m: f32) -> bool {
    place.min(Vec2::splat(side_m) - place).min_element() <= 1.01 * spacing_m
}

/// 64 bits of a tile.
pub(super) fn tile_key(tile: IVec2, seed: u64) -> u64 {
    let place = u64::from(tile.x as u32) << 32 | u64::from(tile.y as u32);
    SplitMix64(seed ^ SplitMix64(place).next_u64()).next_u64()
}

/// Points thrown so far, by cells of a grid that wraps around.
struct Grid {
    cells: i32,
    side_m: f32,
    /// First point of a cell, and the next of the same cell.
    heads: Vec<u32>,
    next: Vec<u32>,
}

const NONE: u32 = u32::MAX;

impl Grid {
    fn new(side_m: f32, cell_m: f32, points: &[(Vec2, usize)]) -> Self {
        let cells = ((side_m / cell_m) as i32).max(1);
        let heads = vec![NONE; (cells * cells) as usize];
        let mut grid = Self { cells, side_m, heads, next: vec![] };
        for (point, _) in points {
            grid.push(*point);
        }
        grid
    }

    fn cell(&self, place: Vec2) -> [i32; 2] {
        [place.x, place.y]
            .map(|v| ((v / self.side_m * self.cells as f32) as i32).min(self.cells - 1))
    }

    fn push(&mut self, place: Vec2) {
        let [x, z] = self.cell(place);
        let head = &mut self.heads[(z * self.cells + x) as usize];
        self.next.push(*head);
        *head = self.next.len() as u32 - 1;
    }

    fn in_cell(&self, x: i32, z: i32) -> impl Iterator<Item = usize> + '_ {
        let some = |i: u32| (i != NONE).then_some(i);
        let head = self.heads[(z * self.cells + x) as usize];
        std::iter::successors(some(head), move |i| some(self.next[*i as usize])).map(|i| i as usize)
    }

    /// Whether no point is too near to a dart of `level`.
    fn is_free(&self, points: &[(Vec2, usize)], dart: Vec2, level: usize, spacing_m: f32) -> bool {
        let [x, z] = self.cell(dart);
        // Cells are at least 1/√2 of the level's radius wide.
        (-2..=2).all(|dz| {
            (-2..=2).all(|dx| {
                let (x, z) = ((x + dx).rem_euclid(self.cells), (z + dz).rem_euclid(self.cells));
                self.in_cell(x, z).all(|i| {
                    let (other, of) = points[i];
                    let radius = LEVELS[level.max(of)] * spacing_m;
                    let apart = (other - dart).abs();
                    let apart = apart.min(Vec2::splat(self.side_m) - apart);
                    apart.length_squared() >= radius * radius
                })
            })
        })
    }
}

/// Points with their levels, by level; those of `kept` are among them.
fn throw(
    side_m: f32,
    spacing_m: f32,
    mut rng: SplitMix64,
    kept: &[(Vec2, usize)],
) -> Vec<(Vec2, usize)> {
    let mut points = kept.to_vec();
    for (level, radius) in LEVELS.into_iter().enumerate() {
        let mut grid =
            Grid::new(side_m, radius * spacing_m * std::f32::consts::FRAC_1_SQRT_2, &points);
        let occupied = |grid: &Grid, points: &[(Vec2, usize)], cell: i32| {
            grid.in_cell(cell % grid.cells, cell / grid.cells).any(|i| points[i].1 <= level)
        };
        let mut open: Vec<i32> =
            (0..grid.cells * grid.cells).filter(|cell| !occupied(&grid, &points, *cell)).collect();
        let cell_m = side_m / grid.cells as f32;
        for _ in 0..ROUNDS {
            rng.shuffle(&mut open);
            open.retain(|&cell| {
                let corner = Vec2::new((cell % grid.cells) as f32, (cell / grid.cells) as f32);
                let dart = (corner + Vec2::new(rng.next_f32(), rng.next_f32())) * cell_m;
                // Along the border all variants have the points that are kept, and no others.
                if !kept.is_empty() && is_at_border(dart, side_m, spacing_m) {
                    return true;
                }
                // Rounding can reach the far border, which is the near one.
                if dart.max_element() >= side_m || !grid.is_free(&points, dart, level, spacing_m) {
                    return true;
                }
                points.push((dart, level));
                grid.push(dart);
                false
            });
        }
    }
    // In no order within a level: a prefix is then even too.
    rng.shuffle(&mut points);
    points.sort_by_key(|(_, level)| *level);
    points
}

#[cfg(test)]
mod tests {
    use super::*;

    fn nearest_pair(points: &[Vec2]) -> f32 {
        let mut sorted = points.to_vec();
        sorted.sort_by(|a, b| a.x.total_cmp(&b.x));
        let mut nearest = f32::INFINITY;
        for (i, a) in sorted.iter().enumerate() {
            let limit = nearest;
            let beside = sorted[i + 1..].iter().take_while(|b| b.x - a.x < limit);
            nearest = beside.map(|b| a.distance(*b)).fold(nearest, f32::min);
        }
        nearest
    }

    /// All candidates below a density of 3 × 3 tiles.
    fn block(noise: &BlueNoise, density: f32) -> Vec<Vec2> {
        block_of(noise, density, 7)
    }

    fn block_of(noise: &BlueNoise, density: f32, seed: u64) -> Vec<Vec2> {
        let tiles = (0..9).map(|i| IVec2::new(i % 3 - 1, i / 3 - 1));
        tiles
            .flat_map(|t| {
                let corner = t.as_vec2() * noise.side_m;
                noise
                    .candidates(t, seed, density)
                    .map(move |c| corner + c.place)
                    .collect::<Vec<_>>()
            })
            .collect()
    }

    #[test]
    fn points_keep_their_distance_across_the_borders_of_tiles() {
        for seed in 0..6 {
            let noise = BlueNoise::new(40.0, 2.0, seed);
            for variants in 0..20 {
                let points = block_of(&noise, 1.0, variants);
                assert!(nearest_pair(&points) >= 1.999, "{}", nearest_pair(&points));
            }
        }
    }

    #[test]
    fn tiles_are_as_full_as_dart_throwing_can() {
        let noise = BlueNoise::new(100.0, 1.5, 9);
        let per_spacing2 = noise.most_per_m2() * 2.25;
        assert!(per_spacing2 > 0.58, "{per_spacing2}");
    }

    #[test]
    fn sparse_prefixes_are_wider_apart_and_as_many_as_their_density_says() {
        let noise = BlueNoise::new(64.0, 1.0, 5);
        let first = noise.variants.iter().map(|v| v.first).max().expect("variants") as f32 / 4096.0;
        for (density, least) in [(0.5 * first, 2.8), (first, 2.0), (2.0 * first, 1.4)] {
            let points = block(&noise, density);
            let expected = density * (3.0f32 * 64.0).powi(2);
            assert!(
                (points.len() as f32 / expected - 1.0).abs() < 0.06,
                "{density}: {} of {expected}",
                points.len()
            );
            // Across borders only the least distance holds.
            let inside: Vec<Vec2> = points
                .into_iter()
                .filter(|p| p.x > 0.0 && p.x < 64.0 && p.y > 0.0 && p.y < 64.0)
                .collect();
            assert!(nearest_pair(&inside) >= least * 0.999, "{density}: {}", nearest_pair(&inside));
        }
    }

    #[test]
    fn no_density_takes_nothing_and_tiles_differ() {
        let noise = BlueNoise::new(32.0, 1.0, 5);
        assert_eq!(noise.candidates(IVec2::ZERO, 1, 0.0).count(), 0);
        assert_eq!(
            noise.candidates(IVec2::ZERO, 1, f32::NAN).count(),
            noise.candidates(IVec2::ZERO, 1, f32::MAX).count()
        );
        let tile =
            |x| noise.candidates(IVec2::new(x, 3), 1, 0.04).map(|c| c.index).collect::<Vec<_>>();
        assert_ne!(tile(0), tile(1));
        assert_eq!(tile(1), tile(1));
    }
}
