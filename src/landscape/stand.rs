//! How much of which species grows where: ground, biomes and habitats in, densities out, at a place or on a grid.
//!
//! Two layers have the same form: trees with shrubs, and ground cover. Densities are relative: 1 is a closed stand of
//! middle age, or a full meadow. O(octaves · species) a place; the grid spares that at every tree.

use super::{Biome, Biomes, Field, Ground, PlantKind, ScatterSpecies, Site, smoothstep};
use crate::math::hash::SplitMix64;
use bevy::math::Vec2;
use std::sync::Arc;

/// Trees in meadows, relative to a closed stand, where they are common.
const LONE: f32 = 0.02;

/// Which plants a layer holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Layer {
    /// Trees and shrubs.
    Trees,
    /// Ground cover.
    Cover,
}

/// What all plants of a place have in common.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Spot {
    /// Sum of the relative densities of all species; 0 where nothing grows.
    pub density: f32,
    /// 0 young to 1 old, alike within a stand.
    pub age: f32,
    /// See [`Biome::forest`].
    pub forest: f32,
    /// See [`Biome::vigour`].
    pub vigour: f32,
    /// See [`Biome::altitude`].
    pub altitude: f32,
}

/// One layer of plants.
pub(super) struct Stands {
    pub ground: Arc<dyn Ground>,
    pub biomes: Arc<Biomes>,
    pub species: Arc<[ScatterSpecies]>,
    /// Indices of the species of this layer, and the noise of each.
    pub members: Vec<(u16, Field)>,
    layer: Layer,
    ages: Field,
    patches: Field,
    /// Largest share of a tree in forests and among lone trees: what a full stand is measured by.
    full: [f32; 2],
}

impl Stands {
    pub fn new(
        ground: Arc<dyn Ground>,
        biomes: Arc<Biomes>,
        species: Arc<[ScatterSpecies]>,
        layer: Layer,
        seed: u64,
    ) -> Self {
        let mut streams = SplitMix64(seed ^ 0x0057_A4D5 ^ (layer as u64) << 32);
        let members: Vec<(u16, Field)> = species
            .iter()
            .enumerate()
            .map(|(i, s)| (i, s.habitat.kind, streams.next_u64()))
            .filter(|(_, kind, _)| (*kind == PlantKind::Cover) == (layer == Layer::Cover))
            .map(|(i, kind, seed)| {
                let wavelength_m = match kind {
                    PlantKind::Tree => 190.0,
                    PlantKind::Shrub => 45.0,
                    PlantKind::Cover => 13.0,
                };
                (i as u16, Field::new(seed, 2, wavelength_m))
            })
            .collect();
        let most = |share: fn(&ScatterSpecies) -> f32| {
            let trees = members.iter().map(|(i, _)| &species[usize::from(*i)]);
            trees.filter(|s| s.habitat.kind == PlantKind::Tree).map(share).fold(0.0, f32::max)
        };
        let full =
            [most(|s| s.habitat.in_broadleaf.max(s.habitat.in_conifer)), most(|s| s.habitat.lone)];
        let (ages_m, patches_m) = if layer == Layer::Cover { (40.0, 9.0) } else { (210.0, 70.0) };
        Self {
            ground,
            biomes,
            species,
            members,
            layer,
            ages: Field::new(streams.next_u64(), 2, ages_m),
            patches: Field::new(streams.next_u64(), 2, patches_m),
            full,
        }
    }

    /// The spot at (x, z); `shares` gets the relative density of each member.
    pub fn at(&self, x: f32, z: f32, shares: &mut [f32]) -> Spot {
        self.at_site(x, z, &self.ground.site(x, z), shares)
    }

    /// [`Self::at`] with the site known.
    pub fn at_site(&self, x: f32, z: f32, site: &Site, shares: &mut [f32]) -> Spot {
        shares.fill(0.0);
        // No ground here, or water.
        if !(site.height_m.is_finite() && site.slope.is_finite() && site.above_water_m > 0.3) {
            return Spot::default();
        }
        // Beside a hole the wider differences are not numbers.
        let curvature = if site.curvature.is_finite() { site.curvature } else { 0.0 };
        let biome = self.biomes.at(x, z, &Site { curvature, ..*site });
        let age = (0.5 + 1.1 * self.ages.at(x, z)).clamp(0.0, 1.0);
        match self.layer {
            Layer::Trees => self.trees(x, z, site, &biome, age, shares),
            Layer::Cover => self.cover(x, z, site, &biome, shares),
        }
        Spot {
            density: shares.iter().sum(),
            age,
            forest: biome.forest,
            vigour: biome.vigour,
            altitude: biome.altitude,
        }
    }

    fn trees(&self, x: f32, z: f32, site: &Site, biome: &Biome, age: f32, shares: &mut [f32]) {
        let open = (biome.grass - biome.forest).max(0.0);
        // Trees do not stand alone far above the others.
        let open = open * (1.0 - smoothstep(0.9, 1.05, biome.altitude));
        if biome.forest <= 0.0 && open <= 0.0 {
            return;
        }
        let patch = self.patches.at(x, z);
        // Old stands are thin, young ones dense.
        let closed = biome.forest * (1.45 - 0.9 * age);
        let lone = open * LONE * (0.15 + smoothstep(0.0, 0.4, patch)) * (0.4 + 0.6 * biome.vigour);
        let edge = 4.0 * biome.forest * (biome.grass - biome.forest).max(0.0);
        let dwarf = open * (1.0 - biome.vigour);
        let mut sums = [0.0; 2];
        for ((i, noise), share) in self.members.iter().zip(&mut *shares) {
            let habitat = &self.species[usize::from(*i)].habitat;
            let fit = habitat.fit(biome, site);
            if fit <= 0.0 {
                continue;
            }
            // Stands of one species among mixed ones.
            let liking = fit * (3.2 * noise.at(x, z)).exp();
            let mix =
                habitat.in_broadleaf + (habitat.in_conifer - habitat.in_broadleaf) * biome.conifer;
            *share = liking;
            match habitat.kind {
                PlantKind::Shrub => {
                    let thicket = smoothstep(0.05, 0.45, noise.at(x, z));
                    *share = fit
                        * (mix * (0.5 * edge + 0.22 * biome.forest)
                            + habitat.lone * (open * 0.16 * thicket * thicket + 0.1 * dwarf));
                }
                _ => {
                    sums[0] += liking * mix;
                    sums[1] += liking * habitat.lone;
                }
            }
        }
        // Where only misfits could grow the stand is thin.
        let full = |sum: f32, most: f32| {
            if sum > 0.0 { (sum / (0.15 * most)).min(1.0) / sum } else { 0.0 }
        };
        let scale = [closed * full(sums[0], self.full[0]), lone * full(sums[1], self.full[1])];
        for ((i, _), share) in self.members.iter().zip(shares) {
            let habitat = &self.species[usize::from(*i)].habitat;
            if habitat.kind == PlantKind::Tree {
                let mix = habitat.in_broadleaf
                    + (habitat.in_conifer - habitat.in_broadleaf) * biome.conifer;
                *share *= scale[0] * mix + scale[1] * habitat.lone;
            }
        }
    }

    fn cover(&self, x: f32, z: f32, site: &Site, biome: &Biome, shares: &mut [f32]) {
        let open = (biome.grass - biome.forest).max(0.0);
        // Thin soil between the stones carries little.
        let soil = biome.grass * biome.grass;
        if soil <= 0.0 {
            return;
        }
        let bare = 0.45 + 0.55 * smoothstep(-0.35, 0.2, self.patches.at(x, z));
        for ((i, noise), share) in self.members.iter().zip(shares) {
            let habitat = &self.species[usize::from(*i)].habitat;
            let fit = habitat.fit(biome, site);
            if fit <= 0.0 {
                continue;
            }
            let mix =
                habitat.in_broadleaf + (habitat.in_conifer - habitat.in_broadleaf) * biome.conifer;
            let patch = 0.2 + 1.6 * smoothstep(-0.15, 0.4, noise.at(x, z));
            *share = fit * soil * bare * patch * (biome.forest * mix + open * habitat.lone);
        }
    }

    /// Height and normal where `species` can stand; `None` in water, on cliffs and where there is no ground.
    pub fn footing(&self, x: f32, z: f32, species: u16) -> Option<(f32, bevy::math::Vec3)> {
        let height = self.ground.height(x, z);
        let dry = self.ground.water_level().is_none_or(|level| height > level + 0.3);
        if !(height.is_finite() && dry) {
            return None;
        }
        let normal = self.ground.normal(x, z);
        let steepest = self.species[usize::from(species)].habitat.max_slope_deg.to_radians();
        (normal.y >= steepest.cos()).then_some((height, normal))
    }
}

/// Spots at the corners of cells, and what lies between.
pub(super) struct StandGrid {
    corner: Vec2,
    step_m: f32,
    row: usize,
    spots: Vec<Spot>,
    /// Of each spot, the shares of all members.
    shares: Vec<f32>,
    members: usize,
}

impl StandGrid {
    /// `cells`² cells of `step_m` from `corner`.
    pub fn new(stands: &Stands, corner: Vec2, step_m: f32, cells: usize) -> Self {
        let (row, members) = (cells + 1, stands.members.len());
        let mut shares = vec![0.0; row * row * members];
        let places =
            (0..row * row).map(|i| corner + Vec2::new((i % row) as f32, (i / row) as f32) * step_m);
        let spots = places
            .enumerate()
            .map(|(i, p)| stands.at(p.x, p.y, &mut shares[i * members..(i + 1) * members]))
            .collect();
        Self { corner, step_m, row, spots, shares, members }
    }

    /// Whether nothing grows here.
    pub fn is_bare(&self) -> bool {
        self.spots.iter().all(|s| s.density <= 0.0)
    }

    /// The densest spot.
    pub fn densest(&self) -> f32 {
        self.spots.iter().map(|s| s.density).fold(0.0, f32::max)
    }

    /// The four corners of the cell at a place, and their weights.
    fn corners(&self, place: Vec2) -> [(usize, f32); 4] {
        let last = (self.row - 2) as f32;
        let at = ((place - self.corner) / self.step_m).clamp(Vec2::ZERO, Vec2::splat(last + 1.0));
        let cell = at.floor().min(Vec2::splat(last));
        let f = at - cell;
        let first = cell.y as usize * self.row + cell.x as usize;
        [
            (first, (1.0 - f.x) * (1.0 - f.y)),
            (first + 1, f.x * (1.0 - f.y)),
            (first + self.row, (1.0 - f.x) * f.y),
            (first + self.row + 1, f.x * f.y),
        ]
    }

    /// Density at a place.
    pub fn density(&self, place: Vec2) -> f32 {
        self.corners(place).iter().map(|(i, w)| self.spots[*i].density * w).sum()
    }

    /// Everything at a place, and a member picked by the number (0 to 1) in proportion to the shares there.
    pub fn pick(&self, place: Vec2, number: f32) -> (Spot, usize) {
        let corners = self.corners(place);
        let mut spot = Spot::default();
        for (i, w) in corners {
            let s = &self.spots[i];
            // What a place is like counts as much as grows there.
            let weight = w * s.density;
            spot.density += weight;
            spot.age += weight * s.age;
            spot.forest += weight * s.forest;
            spot.vigour += weight * s.vigour;
            spot.altitude += weight * s.altitude;
        }
        let total = spot.density.max(f32::MIN_POSITIVE);
        for value in [&mut spot.age, &mut spot.forest, &mut spot.vigour, &mut spot.altitude] {
            *value /= total;
        }
        let mut left = number * total;
        let mut picked = 0;
        for (i, w) in corners {
            for (member, share) in
                self.shares[i * self.members..][..self.members].iter().enumerate()
            {
                if share * w > 0.0 {
                    picked = member;
                    left -= share * w;
                    if left < 0.0 {
                        return (spot, member);
                    }
                }
            }
        }
        // Rounding left a rest: the last that grows here.
        (spot, picked)
    }
}
