//! Trees on the ground: a heightfield and settings in, a list of trees out. O(area / spacing² + sites log sites).
//!
//! Sites are a Poisson-disc set by dart throwing on a grid in phases (after Wei 2008, "Parallel Poisson Disk Sampling",
//! section 3): cells of one phase cannot conflict, so the set does not depend on the order within it. The forest pattern
//! then ranks the sites and the best `count` get a tree: patches fill before meadows, with ragged edges and lone trees.

use super::{Field, ForestPattern, Heightfield};
use crate::math::hash::{SplitMix64, mix_bits};
use bevy::math::{Vec2, Vec3};
use rayon::prelude::*;
use thiserror::Error;

/// Darts a cell. Sites per spacing²: 0.61 with 6, 0.64 with 12, 0.66 with 24, 0.67 with 40 (all that fit: 0.70).
const ROUNDS: u32 = 12;
/// A phase is every third cell in x and z: points of two such cells are further apart than the spacing.
const PHASE: i32 = 3;
/// The most cells a side of the dart grid; the spacing is widened if the ground would need more.
const MOST_GRID_CELLS: f32 = 8_192.0;

/// How trees are scattered.
#[derive(Clone, Debug, PartialEq)]
pub struct ScatterSettings {
    /// Trees, exactly. Default: 2,000.
    pub count: usize,
    /// Smallest distance between two trunks in metres, ≥ 0.5. Default: 3.6.
    pub spacing_m: f32,
    /// Size of a forest patch in metres. Default: 180.
    pub patch_m: f32,
    /// No trees on steeper ground, in degrees. Default: 32.
    pub max_slope_deg: f32,
    /// Smallest and largest scale of a tree. Default: 0.7 to 1.3.
    pub scale: [f32; 2],
    /// Number of species, ≥ 1; 0 prefers low ground, the last high ground. Default: 3.
    pub species: usize,
    /// Seed of everything. Default: 1.
    pub seed: u64,
}

impl Default for ScatterSettings {
    fn default() -> Self {
        Self {
            count: 2_000,
            spacing_m: 3.6,
            patch_m: 180.0,
            max_slope_deg: 32.0,
            scale: [0.7, 1.3],
            species: 3,
            seed: 1,
        }
    }
}

/// A place for a tree.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScatteredTree {
    /// Foot of the trunk: on the ground, a few centimetres into it, more on slopes.
    pub position: Vec3,
    /// Turn around y in radians, 0 to 2π.
    pub yaw: f32,
    /// Uniform scale.
    pub scale: f32,
    /// Index of the species, below [`ScatterSettings::species`].
    pub species: usize,
    /// Multiplied with the tree's colours, 255 is 1; alpha 255.
    pub tint: [u8; 4],
    /// Random bits for everything else that differs from tree to tree.
    pub seed: u8,
}

/// Why trees could not be scattered.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum ScatterError {
    /// There is no room for so many.
    #[error(
        "scatter: {requested} trees at least {spacing_m} m apart do not fit on {side_m} m x {side_m} m of ground, {fits} do; \
         ask for at most that many, lower the spacing or enlarge the ground"
    )]
    Room {
        /// Trees asked for.
        requested: usize,
        /// Trees that fit.
        fits: usize,
        /// The spacing in force.
        spacing_m: f32,
        /// Side of the ground.
        side_m: f32,
    },
    /// A setting cannot be used.
    #[error("scatter: {what} is {value}; it must be {must}")]
    Setting {
        /// Which.
        what: &'static str,
        /// What it is.
        value: f32,
        /// What it must be.
        must: &'static str,
    },
}

/// Scatters exactly `settings.count` trees, sorted by site (rows of the dart grid, so neighbours lie close in the list).
///
/// # Errors
/// [`ScatterError::Room`] with the number that fits, or [`ScatterError::Setting`] for a spacing, scale or species
/// that cannot be used.
pub fn scatter(
    field: &Heightfield,
    settings: &ScatterSettings,
) -> Result<Vec<ScatteredTree>, ScatterError> {
    check(settings)?;
    let steepest = settings.max_slope_deg.to_radians();
    let sites: Vec<Vec2> = poisson_sites(field.side_m(), settings.spacing_m, settings.seed)
        .into_par_iter()
        .filter(|site| field.slope(site.x, site.y) <= steepest)
        .collect();
    if sites.len() < settings.count {
        return Err(ScatterError::Room {
            requested: settings.count,
            fits: sites.len(),
            spacing_m: settings.spacing_m,
            side_m: field.side_m(),
        });
    }
    let pattern = ForestPattern::new(settings.seed, settings.patch_m);
    let mut ranked: Vec<(f32, u32)> = sites
        .par_iter()
        .enumerate()
        .map(|(i, site)| {
            let mut rng = site_rng(settings.seed, *site);
            // Noise in the rank makes edges ragged and thins the stand; one site in forty may stand alone in a meadow.
            let lone = if rng.next_f32() < 0.025 { rng.range(0.1, 0.6) } else { 0.0 };
            (pattern.forestness(site.x, site.y) + rng.range(-0.13, 0.13) + lone, i as u32)
        })
        .collect();
    if settings.count < ranked.len() {
        ranked
            .select_nth_unstable_by(settings.count, |a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        ranked.truncate(settings.count);
    }
    ranked.sort_unstable_by_key(|&(_, site)| site);
    let planter = Planter::new(field, settings);
    Ok(ranked.into_par_iter().map(|(_, site)| planter.plant(sites[site as usize])).collect())
}

fn check(settings: &ScatterSettings) -> Result<(), ScatterError> {
    let refuse = |what, value, must| Err(ScatterError::Setting { what, value, must });
    let [small, large] = settings.scale;
    if !(settings.spacing_m >= 0.5 && settings.spacing_m.is_finite()) {
        return refuse("spacing_m", settings.spacing_m, "at least 0.5 and finite");
    }
    if !(small > 0.0 && small.is_finite()) {
        return refuse("scale[0]", small, "positive and finite");
    }
    if !(large >= small && large.is_finite()) {
        return refuse("scale[1]", large, "at least scale[0] and finite");
    }
    if settings.species == 0 {
        return refuse("species", 0.0, "at least 1");
    }
    if settings.max_slope_deg.is_nan() {
        return refuse("max_slope_deg", settings.max_slope_deg, "a number");
    }
    Ok(())
}

/// A generator that depends on the place only.
fn site_rng(seed: u64, site: Vec2) -> SplitMix64 {
    let place = u64::from(mix_bits(site.x.to_bits())) << 32
        | u64::from(mix_bits(site.y.to_bits().rotate_left(7)));
    SplitMix64(seed ^ place)
}

/// Points on a square of `side_m` around the origin, no two nearer than `spacing_m`, by rows of the grid.
fn poisson_sites(side_m: f32, spacing_m: f32, seed: u64) -> Vec<Vec2> {
    // Cells as wide as a disc's inscribed square hold one point at most.
    let cells =
        (side_m * std::f32::consts::SQRT_2 / spacing_m).ceil().clamp(1.0, MOST_GRID_CELLS) as i32;
    let cell_m = side_m / cells as f32;
    let spacing_squared = spacing_m * spacing_m;
    let mut grid: Vec<Option<Vec2>> = vec![None; (cells * cells) as usize];
    // Cells that can hold a point too near.
    let reach = (spacing_m / cell_m).ceil() as i32;
    for round in 0..ROUNDS {
        for phase in 0..PHASE * PHASE {
            // Phases in another order each round, so that no cell always comes first.
            let phase = (phase * 2 + round as i32 * 4) % (PHASE * PHASE);
            let throw = |x: i32, z: i32| {
                let cell = z * cells + x;
                if grid[cell as usize].is_some() {
                    return None;
                }
                let mut rng = SplitMix64(seed ^ (cell as u64) << 8 ^ u64::from(round) << 48);
                rng.next_u64();
                let corner = Vec2::new(x as f32, z as f32);
                let dart =
                    (corner + Vec2::new(rng.next_f32(), rng.next_f32())) * cell_m - side_m * 0.5;
                let (xs, zs) = ([x - reach, x + reach], [z - reach, z + reach]);
                let [[left, right], [near, far]] =
                    [xs, zs].map(|ends| ends.map(|i| i.clamp(0, cells - 1)));
                let free = (near..=far).all(|nz| {
                    let row = (nz * cells + left) as usize..=(nz * cells + right) as usize;
                    grid[row]
                        .iter()
                        .flatten()
                        .all(|other| other.distance_squared(dart) >= spacing_squared)
                });
                free.then_some((cell as usize, dart))
            };
            let rows: Vec<i32> = (phase / PHASE..cells).step_by(PHASE as usize).collect();
            let darts: Vec<(usize, Vec2)> = rows
                .into_par_iter()
                .flat_map_iter(|z| {
                    (phase % PHASE..cells).step_by(PHASE as usize).filter_map(move |x| throw(x, z))
                })
                .collect();
            for (cell, dart) in darts {
                grid[cell] = Some(dart);
            }
        }
    }
    grid.into_iter().flatten().collect()
}

/// Turns sites into trees.
struct Planter<'a> {
    field: &'a Heightfield,
    settings: &'a ScatterSettings,
    low: f32,
    span: f32,
    stands: Vec<Field>,
    hue: Field,
}

impl<'a> Planter<'a> {
    fn new(field: &'a Heightfield, settings: &'a ScatterSettings) -> Self {
        let [low, high] = field.height_range();
        let stand = |i: usize| {
            Field::new(settings.seed ^ (0xA11CE + i as u64), 3, settings.patch_m.max(5.0))
        };
        Self {
            field,
            settings,
            low,
            span: (high - low).max(1.0),
            stands: (0..settings.species).map(stand).collect(),
            hue: Field::new(settings.seed ^ 0x00C0_FFEE, 2, 70.0),
        }
    }

    fn plant(&self, site: Vec2) -> ScatteredTree {
        // Not the ranking's numbers again: trees of one rank would be alike.
        let mut rng = SplitMix64(site_rng(self.settings.seed, site).next_u64());
        let ground = self.field.height(site.x, site.y);
        let [small, large] = self.settings.scale;
        // The mean of two numbers: most trees are of middle size.
        let size = 0.5 * (rng.next_f32() + rng.next_f32());
        let scale = small + (large - small) * size;
        let sink = (0.04 + 0.3 * self.field.slope(site.x, site.y).tan()).min(0.3) * scale;
        let species = self.species(site, ground, &mut rng);
        ScatteredTree {
            position: Vec3::new(site.x, ground - sink, site.y),
            yaw: rng.range(0.0, std::f32::consts::TAU),
            scale,
            species,
            tint: self.tint(site, &mut rng),
            seed: (rng.next_u64() >> 56) as u8,
        }
    }

    /// The species that likes the place most: its own noise (stands), its altitude, and some chance (mixed stands).
    fn species(&self, site: Vec2, ground: f32, rng: &mut SplitMix64) -> usize {
        let altitude = (ground - self.low) / self.span;
        let last = (self.stands.len() - 1).max(1) as f32;
        let liking = |(i, stand): (usize, &Field)| {
            let distance = (altitude - i as f32 / last).abs();
            (stand.at(site.x, site.y) - 0.9 * distance + rng.range(0.0, 0.35), i)
        };
        let best = self.stands.iter().enumerate().map(liking).max_by(|a, b| a.0.total_cmp(&b.0));
        best.map_or(0, |(_, i)| i)
    }

    /// A little brighter, yellower or greener than the neighbour, more alike within 70 m.
    fn tint(&self, site: Vec2, rng: &mut SplitMix64) -> [u8; 4] {
        let warm = 0.6 * self.hue.at(site.x, site.y) + rng.range(-0.5, 0.5);
        let light = rng.range(0.78, 1.0);
        let channel = |share: f32| (255.0 * (light * share).clamp(0.0, 1.0)).round() as u8;
        [channel(0.94 + 0.1 * warm), channel(0.97), channel(0.92 - 0.12 * warm), 255]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn nearest_pair(trees: &[ScatteredTree]) -> f32 {
        let mut by_x: Vec<Vec2> =
            trees.iter().map(|t| Vec2::new(t.position.x, t.position.z)).collect();
        by_x.sort_by(|a, b| a.x.total_cmp(&b.x));
        let mut nearest = f32::INFINITY;
        for (i, a) in by_x.iter().enumerate() {
            let limit = nearest;
            let beside = by_x[i + 1..].iter().take_while(|b| b.x - a.x < limit);
            nearest = beside.map(|b| a.distance(*b)).fold(nearest, f32::min);
        }
        nearest
    }

    #[test]
    fn the_sites_fill_the_ground_as_well_as_dart_throwing_can() {
        // Random sequential packing of discs ends at a cover of 0.547, which is 0.70 sites per spacing².
        let sites = poisson_sites(300.0, 3.0, 7).len() as f32;
        let density = sites * 9.0 / 90_000.0;
        assert!(density > 0.62, "{density} sites per spacing²");
    }

    #[test]
    fn forests_have_edges_and_meadows_lone_trees() {
        let field = Heightfield::rolling(1000.0, 128, 2);
        let settings = ScatterSettings { count: 12_000, ..ScatterSettings::default() };
        let trees = scatter(&field, &settings).expect("room");
        // Trees in squares of 25 m: many squares empty, many full, some with a tree or two.
        let mut squares = vec![0u32; 40 * 40];
        for tree in &trees {
            let [x, z] =
                [tree.position.x, tree.position.z].map(|v| ((v + 500.0) / 25.0).min(39.0) as usize);
            squares[z * 40 + x] += 1;
        }
        let share = |f: fn(u32) -> bool| squares.iter().filter(|&&n| f(n)).count() as f32 / 1600.0;
        assert!(share(|n| n == 0) > 0.25, "open: {}", share(|n| n == 0));
        assert!(share(|n| n >= 20) > 0.12, "dense: {}", share(|n| n >= 20));
        assert!(
            share(|n| (1..=3).contains(&n)) > 0.04,
            "lone: {}",
            share(|n| (1..=3).contains(&n))
        );
        for species in 0..3 {
            let part =
                trees.iter().filter(|t| t.species == species).count() as f32 / trees.len() as f32;
            assert!(part > 0.08, "species {species}: {part}");
        }
    }

    #[test]
    fn too_many_trees_are_refused_with_the_number_that_fits() {
        let field = Heightfield::rolling(60.0, 16, 1);
        let mut settings = ScatterSettings { count: 1_000_000, ..ScatterSettings::default() };
        let Err(ScatterError::Room { fits, .. }) = scatter(&field, &settings) else {
            panic!("no room for these")
        };
        settings.count = fits;
        assert_eq!(scatter(&field, &settings).expect("room").len(), fits);
        settings.count = fits + 1;
        assert!(scatter(&field, &settings).is_err());
    }

    #[test]
    fn settings_that_cannot_be_used_are_named() {
        let field = Heightfield::rolling(60.0, 4, 1);
        let base = ScatterSettings { count: 1, ..ScatterSettings::default() };
        for bad in [
            ScatterSettings { spacing_m: f32::NAN, ..base.clone() },
            ScatterSettings { spacing_m: 0.0, ..base.clone() },
            ScatterSettings { scale: [0.0, 1.0], ..base.clone() },
            ScatterSettings { scale: [2.0, 1.0], ..base.clone() },
            ScatterSettings { species: 0, ..base.clone() },
            ScatterSettings { max_slope_deg: f32::NAN, ..base.clone() },
        ] {
            assert!(matches!(scatter(&field, &bad), Err(ScatterError::Setting { .. })), "{bad:?}");
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]
        #[test]
        fn trees_keep_their_distance_stand_on_the_ground_and_are_as_many_as_asked(
            seed in any::<u64>(), spacing_m in 1.5f32..9.0, side_m in 20.0f32..260.0, share in 0.0f32..1.0,
        ) {
            let field = Heightfield::rolling(side_m, 24, seed);
            let mut settings = ScatterSettings { count: usize::MAX, spacing_m, seed, ..ScatterSettings::default() };
            let Err(ScatterError::Room { fits, .. }) = scatter(&field, &settings) else { panic!("usize::MAX trees") };
            settings.count = (fits as f32 * share) as usize;
            let trees = scatter(&field, &settings).expect("room");
            prop_assert_eq!(trees.len(), settings.count);
            prop_assert_eq!(&trees, &scatter(&field, &settings).expect("room"));
            prop_assert!(nearest_pair(&trees) >= spacing_m * 0.9999);
            for tree in &trees {
                let Vec3 { x, y, z } = tree.position;
                let sunk = field.height(x, z) - y;
                prop_assert!((0.0..0.45).contains(&sunk), "sunk {}", sunk);
                prop_assert!(x.abs() <= side_m * 0.5 && z.abs() <= side_m * 0.5);
                prop_assert!(field.slope(x, z) <= 32f32.to_radians());
                prop_assert!(tree.species < 3 && tree.scale >= 0.7 && tree.scale <= 1.3);
            }
        }
    }
}
