//! The points of a tree laid out for drawing: level by level, cluster by cluster ([`lod::clusters`](crate::lod::clusters)).
//!
//! In: a baked tree; out: which point lies where in GPU memory, and the box of each cluster. What is drawn of a cluster is
//! one run of memory, and a cluster covers few pixels: both halves are read, and the visibility buffer is written, in
//! few cache lines. O(n log n).

use super::tree_data::TreeData;
use crate::{
    lod::clusters::{CLUSTERS, level_count, list_points},
    math::bounding::Aabb,
};
use bevy::math::Vec3;

/// Neighbouring points of a tree, in progressive order.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cluster {
    /// Of its points, model space.
    pub bounds: Aabb,
    /// Place of its first point in [`TreeClusters::points`].
    pub first: u32,
    /// Its points, from there on.
    pub count: u32,
}

/// The layout of a tree.
#[derive(Clone, Debug, PartialEq)]
pub struct TreeClusters {
    /// Points by their index in the progressive order, as they lie in memory. Those of lower levels occur again.
    pub points: Vec<u32>,
    /// Of all levels, from level 0.
    pub clusters: Vec<Cluster>,
    /// Levels, 1 to [`LEVELS`](crate::lod::clusters::LEVELS).
    pub level_count: u32,
}

impl TreeClusters {
    /// Lays out a tree.
    pub fn of(tree: &TreeData) -> Self {
        let n0 = tree.point_count() as u32;
        let positions: Vec<Vec3> = tree.hot.iter().map(|hot| hot.position(&tree.bounds)).collect();
        let level_count = level_count(n0);
        let mut out = Self { points: vec![], clusters: vec![], level_count };
        for level in 0..level_count {
            let mut all: Vec<u32> = (0..list_points(level, level_count, n0)).collect();
            split(&positions, &mut all, CLUSTERS[level as usize], &mut |cluster| {
                // The split has mixed them.
                cluster.sort_unstable();
                let bounds = Aabb::of(cluster.iter().map(|i| positions[*i as usize]));
                let first = out.points.len() as u32;
                out.clusters.push(Cluster { bounds, first, count: cluster.len() as u32 });
                out.points.extend_from_slice(cluster);
            });
        }
        out
    }
}

/// Halves points at the median of their longest side until there are `parts`, a power of 2.
fn split(positions: &[Vec3], points: &mut [u32], parts: u32, out: &mut dyn FnMut(&mut [u32])) {
    if parts == 1 {
        return out(points);
    }
    let extent = Aabb::of(points.iter().map(|i| positions[*i as usize])).extent();
    let axis = (0..3).fold(0, |best, axis| if extent[axis] > extent[best] { axis } else { best });
    let middle = points.len() / 2;
    if middle > 0 {
        points.select_nth_unstable_by(middle, |a, b| {
            let by_place = positions[*a as usize][axis].total_cmp(&positions[*b as usize][axis]);
            by_place.then(a.cmp(b))
        });
    }
    let (low, high) = points.split_at_mut(middle);
    split(positions, low, parts / 2, out);
    split(positions, high, parts / 2, out);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        asset::synthetic::synthetic_tree,
        lod::clusters::{FIRST_CLUSTER, cluster_points, level_of},
    };

    #[test]
    fn every_level_holds_the_start_of_the_order_once() {
        for n0 in [1, 40, 256, 300, 2048, 5000, 40_000] {
            let tree = synthetic_tree(n0, 3);
            let layout = TreeClusters::of(&tree);
            assert_eq!(layout, TreeClusters::of(&tree));
            for level in 0..layout.level_count as usize {
                let first = FIRST_CLUSTER[level] as usize;
                let clusters = &layout.clusters[first..first + CLUSTERS[level] as usize];
                let mut points = vec![];
                for cluster in clusters {
                    let range = cluster.first as usize..(cluster.first + cluster.count) as usize;
                    let own = &layout.points[range];
                    assert!(own.is_sorted(), "progressive");
                    points.extend_from_slice(own);
                }
                points.sort_unstable();
                let all = list_points(level as u32, layout.level_count, n0 as u32);
                assert_eq!(points, (0..all).collect::<Vec<_>>(), "level {level} of {n0}");
                let sizes = clusters.iter().map(|cluster| cluster.count);
                assert!(sizes.clone().max() <= sizes.min().map(|n| n + 1), "equal shares");
            }
        }
    }

    /// Lines of 64 bytes that `bytes` at these places of a list touch.
    fn lines(places: impl Iterator<Item = u32>, bytes: u32) -> usize {
        places.map(|place| place * bytes / 64).collect::<std::collections::BTreeSet<_>>().len()
    }

    #[test]
    fn a_draw_reads_few_cache_lines_and_what_is_seen_of_it_too() {
        let tree = synthetic_tree(40_000, 3);
        let layout = TreeClusters::of(&tree);
        for count in [100, 256, 1000, 2048, 10_000, 40_000] {
            let level = level_of(count, layout.level_count);
            let first = FIRST_CLUSTER[level as usize] as usize;
            let clusters = &layout.clusters[first..][..CLUSTERS[level as usize] as usize];
            let all = list_points(level, layout.level_count, 40_000);
            let places: Vec<u32> = clusters
                .iter()
                .flat_map(|c| c.first..c.first + cluster_points(count, c.count, all))
                .collect();
            // Hot halves: what a draw reads at least, and two lines more for each cluster.
            let read = lines(places.iter().copied(), 8);
            assert!(read <= places.len() * 8 / 64 + 2 * clusters.len(), "{read} for {count}");
            // Cold halves of what 1 m³ of the crown shows: of the list in progressive order each point has a line of its
            // own, until the draw is most of the tree.
            let middle = tree.bounds.center();
            let seen = |point: u32| {
                let p = tree.surfel(point as usize).expect("it is a point").position;
                (p - middle).abs().max_element() < 0.5
            };
            let here = places.iter().copied().filter(|p| seen(layout.points[*p as usize]));
            let (clustered, flat) = (lines(here, 8), lines((0..count).filter(|p| seen(*p)), 8));
            println!("{count} points: {read} lines read, {clustered} of {flat} where 1 m³ is seen");
            assert!(clustered <= flat + 2, "{clustered} of {flat} for {count}");
        }
    }

    #[test]
    fn boxes_hold_their_points_and_are_small() {
        let tree = synthetic_tree(40_000, 3);
        let layout = TreeClusters::of(&tree);
        let mut volume = 0.0;
        for cluster in &layout.clusters[FIRST_CLUSTER[2] as usize..] {
            let slack = tree.bounds.extent() * 1e-3;
            for i in &layout.points[cluster.first as usize..][..cluster.count as usize] {
                let p = tree.surfel(*i as usize).expect("it is a point").position;
                assert!(p.cmpge(cluster.bounds.min - slack).all());
                assert!(p.cmple(cluster.bounds.max + slack).all());
            }
            volume += cluster.bounds.extent().element_product();
        }
        assert!(volume <= 1.01 * tree.bounds.extent().element_product());
    }
}
