//! Sub-tree units: a tree near the eye is drawn cluster by cluster, so that the hidden part of its crown is not drawn.
//!
//! A tree's points are kept in up to three *levels*. Level 0 is one list, a prefix of the progressive order; levels 1 and
//! 2 are 8 and 32 clusters of neighbouring points, each its own progressive list. A draw of `n` points takes the first
//! level that was made for so many, and from each of its clusters the same share.

/// Levels of a large tree.
pub const LEVELS: usize = 3;

/// Clusters of each level.
pub const CLUSTERS: [u32; LEVELS] = [1, 8, 32];

/// Place of each level's first cluster among all of a species.
pub const FIRST_CLUSTER: [u32; LEVELS] = [0, 1, 9];

/// Most points that are drawn from each level: 64 points (a work item) from a cluster, and more than that from the next
/// level's clusters would waste less.
pub const LEVEL_POINTS: [u32; LEVELS] = [256, 2048, u32::MAX];

/// Points that the lists of each level hold together: the start of the progressive order. Eight times what is drawn,
/// so that windows of the lists that move each frame show as many different points; the last level holds all.
pub const LIST_POINTS: [u32; LEVELS] = [2048, 16384, u32::MAX];

/// Levels of a tree of `n0` points: no more than can be drawn from.
pub fn level_count(n0: u32) -> u32 {
    1 + LEVEL_POINTS.iter().take_while(|most| n0 > **most).count() as u32
}

/// The level that a draw of `count` points is taken from.
pub fn level_of(count: u32, level_count: u32) -> u32 {
    let level = LEVEL_POINTS.iter().take_while(|most| count > **most).count() as u32;
    level.min(level_count - 1)
}

/// Points in all lists of a level of a tree of `n0` points.
pub fn list_points(level: u32, level_count: u32, n0: u32) -> u32 {
    if level + 1 == level_count { n0 } else { n0.min(LIST_POINTS[level as usize]) }
}

/// Points that a draw of `count` takes from a cluster of `size` points, of `all` in the lists of its level: its share,
/// rounded. All clusters together give `count`, but for rounding.
pub fn cluster_points(count: u32, size: u32, all: u32) -> u32 {
    let share = size as f32 / all as f32;
    ((count as f32 * share + 0.5) as u32).min(size)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn levels_hold_what_is_drawn_from_them() {
        for (n0, levels) in [(1, 1), (256, 1), (257, 2), (2048, 2), (2049, 3), (500_000, 3)] {
            assert_eq!(level_count(n0), levels, "{n0}");
            for count in [1, 256, 257, 2048, 2049, 20_000, n0].map(|n: u32| n.min(n0)) {
                let level = level_of(count, levels);
                assert!(count <= list_points(level, levels, n0), "{count} of {n0}");
            }
        }
    }

    #[test]
    fn clusters_follow_each_other() {
        let mut first = 0;
        for level in 0..LEVELS {
            assert_eq!(FIRST_CLUSTER[level], first);
            first += CLUSTERS[level];
        }
    }

    proptest! {
        #[test]
        fn clusters_share_a_draw(sizes in proptest::collection::vec(1u32..5000, 32), share in 0.0f32..1.0) {
            let all: u32 = sizes.iter().sum();
            let count = (all as f32 * share) as u32;
            let drawn: u32 = sizes.iter().map(|size| cluster_points(count, *size, all)).sum();
            prop_assert!(drawn.abs_diff(count) <= 17, "{drawn} of {count}");
            let whole: u32 = sizes.iter().map(|size| cluster_points(all, *size, all)).sum();
            prop_assert_eq!(whole, all);
        }
    }
}
