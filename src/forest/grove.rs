//! Groves: the trees of a block drawn as one progressively ordered list of (instance, point) samples, whose prefix is its
//! level of detail. Beyond the distance where a tree gets a handful of points, a block then costs what its points cost.
//!
//! Selection gives tree i `floor(n + hash)` points, and `n = t(w k)`: its *weight* `w = N0 s²` is a property of the tree,
//! the *view scale* `k = q Z0² / d²` of the view, and `t` thins small trees (`lod::prefix_count`). So point r of it is drawn
//! from `k = t⁻¹(r + 1 − hash) / w` on, the *threshold* of that sample. Sorted by threshold, the samples drawn at any k are a prefix. Distances within a block differ, but only
//! move each tree's own k: the prefix is taken for the largest k of the block, and whoever draws a sample compares
//! its point with what selection gives that tree. A grove so draws exactly the points that its trees would.
//!
//! In: up to 256 instances and what is known of their species; out: [`GroveList`]. O(samples · log trees).

use super::{instance::TreeInstance, select::SpeciesShape};
use crate::{
    gpu::types::{GpuTreeInstance, SELECT_WORKGROUP},
    lod::prefix_count::unthinned,
};
use std::{
    cmp::{Ordering, Reverse},
    collections::BinaryHeap,
};

/// Most samples of a grove for each of its trees, unless asked otherwise.
pub const SAMPLES_PER_TREE: usize = 10;

/// Most samples of a grove: lengths are kept in 16 bits.
pub const MOST_SAMPLES: usize = u16::MAX as usize;

/// Points of a tree that a sample can name: its rank has 8 bits.
const MOST_RANKS: u32 = 256;

/// Octaves of the view scale for which a grove knows the length of its prefix: a factor of 256 in distance.
pub const OCTAVES: usize = 16;

/// Thresholds are lowered by this share, so that no rounding in the f32 of selection, of a distance or of
/// [`GroveList::prefix_length`] (a dozen operations and a root, each within 2.5 ulp on a GPU) draws a point that a prefix lacks.
const SLACK: f64 = 6e-6;

/// One block of instances as a list of samples.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct GroveList {
    /// By threshold: place of the instance in the block << 8 | point in the progressive order of its tree.
    pub samples: Vec<u16>,
    /// The list holds every point that is drawn where the largest view scale of the block is below this.
    pub complete_below: f32,
    /// Threshold of the last sample; marks count octaves from here. 0 for an empty list.
    pub top: f32,
    /// Mark j, for view scales from `top / 2^j` down to `top / 2^(j+1)`: samples with thresholds up to its upper end
    /// | correction of what is interpolated within << 16.
    pub marks: [u32; OCTAVES],
}

impl GroveList {
    /// Length of a prefix that holds every sample drawn where the largest view scale is `view_scale`. Exact up to
    /// interpolation within an octave, and never too short.
    pub fn prefix_length(&self, view_scale: f32) -> u32 {
        let count = |mark: u32| mark & 0xffff;
        let ratio = view_scale / self.top;
        // What is not a number, as of an empty list, is not below.
        let is_below = ratio < 1.0;
        if !is_below {
            return count(self.marks[0]);
        }
        // Octave and place in it are the exponent and the fraction of an f32.
        let bits = ratio.to_bits();
        let octave = (126 - (bits >> 23)) as usize;
        if octave >= OCTAVES - 1 {
            return count(self.marks[OCTAVES - 1]);
        }
        let fraction = f32::from_bits(bits & 0x7f_ffff | 0x3f80_0000) - 1.0;
        let (high, low) = (count(self.marks[octave]), count(self.marks[octave + 1]));
        let between = low as f32 + (high - low) as f32 * fraction;
        (between.ceil() as u32 + (self.marks[octave] >> 16)).min(high)
    }
}

/// The view scale k of a view at distance `d`: quality `q`, `Z0` pixels per world unit at distance 1.
pub fn view_scale(quality: f32, z0: f32, d: f32) -> f32 {
    let pixels = z0 / d.max(1e-6);
    quality * pixels * pixels
}

/// A tree of the block, while its samples are listed.
struct Tree {
    lane: u32,
    hash: f64,
    weight: f64,
    points: u32,
}

impl Tree {
    /// From an instance (world space) at a place in the block. `None` where nothing would ever be drawn.
    fn new(lane: usize, instance: &GpuTreeInstance, shape: &SpeciesShape) -> Option<Self> {
        let s = f64::from(shape.pixel) * f64::from(instance.scale());
        let weight = f64::from(shape.point_count) * s * s;
        let somewhere = instance.position().is_finite();
        (somewhere && weight.is_finite() && weight > 0.0).then(|| Self {
            lane: lane as u32,
            hash: f64::from(TreeInstance::from_compact(instance).hash()),
            weight,
            points: shape.point_count,
        })
    }

    /// The view scale from which point `rank` is drawn, less [`SLACK`].
    fn threshold(&self, rank: u32) -> f32 {
        let wanted = (f64::from(rank) + 1.0) * (1.0 - SLACK) - self.hash;
        round_down((unthinned(wanted.max(0.0)) / self.weight) * (1.0 - SLACK))
    }
}

/// The largest f32 that is not above `x` ≥ 0.
fn round_down(x: f64) -> f32 {
    let near = x.min(f64::from(f32::MAX)) as f32;
    if f64::from(near) > x { near.next_down() } else { near }
}

/// The next sample of a tree, ordered by threshold, then by place in the block.
struct Next {
    threshold: f32,
    tree: usize,
    rank: u32,
}

impl Ord for Next {
    fn cmp(&self, other: &Self) -> Ordering {
        self.threshold.total_cmp(&other.threshold).then(self.tree.cmp(&other.tree))
    }
}

impl PartialOrd for Next {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Next {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for Next {}

/// Lists the samples of a block of instances, which are in world space: what is drawn at view scales up to `up_to`, but at
/// most `samples` of them (and [`MOST_SAMPLES`]). `shape_of` is `None` for species that are not resident. Trees of no size,
/// or nowhere, are left out.
///
/// # Panics
/// If there are more than 256 instances.
pub fn grove_list(
    instances: &[GpuTreeInstance],
    shape_of: impl Fn(u16) -> Option<SpeciesShape>,
    samples: usize,
    up_to: f32,
) -> GroveList {
    assert!(instances.len() <= SELECT_WORKGROUP as usize, "a grove is one block of instances");
    let tree = |(lane, instance): (usize, &GpuTreeInstance)| {
        let shape = shape_of(instance.species() as u16)?;
        Tree::new(lane, instance, &shape)
    };
    let trees: Vec<Tree> = instances.iter().enumerate().filter_map(tree).collect();
    let next = |tree: usize, rank: u32| {
        (rank < trees[tree].points)
            .then(|| Reverse(Next { threshold: trees[tree].threshold(rank), tree, rank }))
    };
    let mut waiting: BinaryHeap<_> = (0..trees.len()).filter_map(|tree| next(tree, 0)).collect();
    let (mut list, mut thresholds) = (vec![], vec![]);
    let most = samples.min(MOST_SAMPLES);
    // A tree much larger than the others ends the list: nearer than that they are looked at one by one.
    while list.len() < most
        && waiting
            .peek()
            .is_some_and(|Reverse(next)| next.rank < MOST_RANKS && next.threshold <= up_to)
        && let Some(Reverse(Next { threshold, tree, rank })) = waiting.pop()
    {
        list.push((trees[tree].lane << 8 | rank) as u16);
        thresholds.push(threshold);
        waiting.extend(next(tree, rank + 1));
    }
    let beyond = waiting.peek().map_or(f32::INFINITY, |Reverse(next)| next.threshold);
    let top = thresholds.last().copied().unwrap_or(0.0);
    GroveList { samples: list, complete_below: beyond, top, marks: marks(&thresholds, top) }
}

/// Counts and corrections of each octave below `top`; `thresholds` ascend to it.
fn marks(thresholds: &[f32], top: f32) -> [u32; OCTAVES] {
    let up_to = |scale: f32| thresholds.partition_point(|t| *t <= scale) as u32;
    let mut end = top;
    let mut list = GroveList { top, ..Default::default() };
    for mark in &mut list.marks {
        *mark = up_to(end);
        end *= 0.5;
    }
    // What interpolation would miss: largest where a sample has just been reached.
    let mut corrections = [0; OCTAVES];
    for (octave, correction) in corrections.iter_mut().enumerate().take(OCTAVES - 1) {
        let (high, low) = (list.marks[octave] as usize, list.marks[octave + 1] as usize);
        for (index, threshold) in thresholds.iter().enumerate().take(high).skip(low) {
            let missed = (index as u32 + 1).saturating_sub(list.prefix_length(*threshold));
            *correction = missed.max(*correction);
        }
    }
    for (mark, correction) in list.marks.iter_mut().zip(corrections) {
        *mark |= correction << 16;
    }
    list.marks
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        forest::{
            select::{ViewPoint, select_instance},
            settings::TreelineSettings,
        },
        lod::{
            fade::ViewRange,
            prefix_count::{round_count, thinned},
            thinning::FACTOR_STEPS,
        },
        math::hash::SplitMix64,
    };
    use bevy::math::Vec3;
    use proptest::prelude::*;

    const SPECIES: [SpeciesShape; 3] = [
        SpeciesShape {
            center: Vec3::new(0.0, 6.0, 0.0),
            point_count: 400_000,
            pixel: 0.02,
            surface_area: 90.0,
            mean_leaf_area: 0.005,
            area_factors: [1.0; FACTOR_STEPS],
        },
        SpeciesShape {
            center: Vec3::new(0.3, 0.5, 0.0),
            point_count: 5_000,
            pixel: 0.01,
            surface_area: 2.0,
            mean_leaf_area: 0.001,
            area_factors: [1.0; FACTOR_STEPS],
        },
        SpeciesShape {
            center: Vec3::new(0.0, 0.1, 0.0),
            point_count: 3,
            pixel: 0.1,
            surface_area: 0.05,
            mean_leaf_area: 0.0,
            area_factors: [1.0; FACTOR_STEPS],
        },
    ];

    fn shape_of(species: u16) -> Option<SpeciesShape> {
        SPECIES.get(usize::from(species)).copied()
    }

    /// A block about 60 m wide.
    fn block(seed: u64, count: usize) -> Vec<TreeInstance> {
        let mut random = SplitMix64(seed);
        let tree = |_| TreeInstance {
            position: Vec3::new(random.range(-30.0, 30.0), 0.0, random.range(-30.0, 30.0)),
            scale: random.range(0.5, 1.6),
            species: random.below(3) as u16,
            seed: random.below(256) as u8,
            ..TreeInstance::default()
        };
        (0..count).map(tree).collect()
    }

    fn packed(trees: &[TreeInstance]) -> Vec<GpuTreeInstance> {
        trees.iter().map(TreeInstance::compact).collect()
    }

    fn list_of(trees: &[TreeInstance], samples: usize) -> GroveList {
        let packed = packed(trees);
        grove_list(&packed, shape_of, samples, f32::INFINITY)
    }

    /// What selection draws of each tree, and the largest view scale.
    fn selected(trees: &[TreeInstance], eye: Vec3, quality: f32) -> (Vec<u32>, f32) {
        let view = ViewPoint { position: eye, z0: 869.0, orthographic: false };
        let settings = TreelineSettings { quality, ..Default::default() };
        let mut largest = 0.0f32;
        let count = |tree: &TreeInstance| {
            let tree = TreeInstance::from_compact(&tree.compact());
            let shape = &SPECIES[usize::from(tree.species)];
            let found =
                select_instance(&view, &settings, shape, &tree, ViewRange::default(), false);
            largest = largest.max(view_scale(quality, view.z0, found.distance));
            found.draw.count
        };
        (trees.iter().map(count).collect(), largest)
    }

    /// The samples of a prefix that their own trees draw.
    fn drawn(list: &GroveList, length: u32, counts: &[u32]) -> Vec<u16> {
        let own = |sample: &&u16| u32::from(**sample & 0xff) < counts[usize::from(**sample >> 8)];
        let mut drawn: Vec<u16> =
            list.samples[..length as usize].iter().filter(own).copied().collect();
        drawn.sort_unstable();
        drawn
    }

    proptest! {
        #[test]
        fn a_grove_draws_what_its_trees_would(seed: u64, count in 0usize..=256, exponent in 1.7f32..5.0, quality in 0.3f32..4.0) {
            let trees = block(seed, count);
            let list = list_of(&trees, count * SAMPLES_PER_TREE);
            let (counts, largest) = selected(&trees, Vec3::new(0.0, 20.0, 10f32.powf(exponent)), quality);
            if largest < list.complete_below {
                let expected: Vec<u16> = (0u32..)
                    .zip(&counts)
                    .flat_map(|(lane, n)| (0..*n).map(move |rank| (lane << 8 | rank) as u16))
                    .collect();
                prop_assert_eq!(drawn(&list, list.prefix_length(largest), &counts), expected);
            } else {
                let all: u32 = counts.iter().sum();
                prop_assert!(all as usize + 300 > list.samples.len(), "{} points would have fitted", all);
            }
        }

        #[test]
        fn prefixes_are_never_short_and_hardly_too_long(seed: u64, count in 1usize..=256, octaves in 0.0f32..18.0) {
            let trees = block(seed, count);
            let list = list_of(&trees, count * SAMPLES_PER_TREE);
            let k = list.top.min(1e12) * (-octaves).exp2();
            let exact: u32 = trees
                .iter()
                .map(|tree| {
                    let shape = SPECIES[usize::from(tree.species)];
                    let s = f64::from(shape.pixel) * f64::from(tree.scale);
                    let wanted = thinned((f64::from(shape.point_count) * s * s * f64::from(k)) as f32);
                    round_count(wanted.min(shape.point_count as f32), tree.hash())
                })
                .sum();
            let length = list.prefix_length(k);
            prop_assert!(length >= exact, "{} of {}", length, exact);
            prop_assert!(f64::from(length) <= f64::from(exact) * 1.1 + 40.0, "{} for {}", length, exact);
        }

        #[test]
        fn lists_nest(seed: u64, count in 1usize..=256, samples in 0usize..1000) {
            let trees = block(seed, count);
            let (short, long) = (list_of(&trees, samples), list_of(&trees, samples + 100));
            prop_assert_eq!(&short.samples[..], &long.samples[..short.samples.len()]);
            prop_assert!(short.complete_below <= long.complete_below && short.top <= short.complete_below);
            prop_assert_eq!(&short, &list_of(&trees, samples));
        }

        #[test]
        fn a_list_for_far_views_is_complete_for_them(seed: u64, count in 1usize..=256, octaves in 0.0f32..12.0) {
            let trees = block(seed, count);
            let whole = list_of(&trees, count * SAMPLES_PER_TREE);
            let up_to = whole.top.min(1e12) * (-octaves).exp2();
            let list = grove_list(&packed(&trees), shape_of, count * SAMPLES_PER_TREE, up_to);
            prop_assert_eq!(&list.samples[..], &whole.samples[..list.samples.len()]);
            prop_assert!(list.complete_below > up_to || list.samples.len() == whole.samples.len());
            prop_assert!(list.top <= up_to && list.complete_below <= whole.complete_below);
        }
    }

    #[test]
    fn a_list_of_all_points_is_complete_however_near() {
        let tree = TreeInstance::default().with_species(2);
        let list = list_of(&[tree; 4], 100);
        assert_eq!((list.samples.len(), list.complete_below), (12, f32::INFINITY));
        assert_eq!(list.prefix_length(f32::INFINITY), 12);
        // Equal trees come in the order of the block, and every tree's points in order.
        assert_eq!(list.samples[..5], [0, 1 << 8, 2 << 8, 3 << 8, 1]);
    }

    #[test]
    fn absurd_trees_are_left_out() {
        let good = TreeInstance::default();
        let trees = [
            TreeInstance { scale: 0.0, ..good },
            TreeInstance { scale: f32::NAN, ..good },
            TreeInstance { scale: f32::INFINITY, ..good },
            TreeInstance { position: Vec3::new(0.0, f32::NAN, 0.0), ..good },
            good.with_species(3),
            good,
        ];
        let list = list_of(&trees, 20);
        assert!(list.samples.len() == 20 && list.samples.iter().all(|sample| sample >> 8 == 5));
        let nothing = list_of(&trees[..5], 20);
        assert_eq!((nothing.samples.len(), nothing.prefix_length(1e9)), (0, 0));
        assert_eq!(
            list_of(&[], 20),
            GroveList { complete_below: f32::INFINITY, ..Default::default() }
        );
    }

    #[test]
    fn a_prefix_far_away_is_short() {
        let trees = block(3, 256);
        let list = list_of(&trees, 256 * 6);
        let lengths =
            [1.0, 0.25, 1.0 / 16.0, 1e-9].map(|share| list.prefix_length(list.top * share));
        assert_eq!(lengths[0], 1536);
        // Large trees, of many points, are thinned less.
        assert!((280..390).contains(&lengths[1]) && (75..150).contains(&lengths[2]), "{lengths:?}");
        assert!(lengths[3] < 10);
    }
}
