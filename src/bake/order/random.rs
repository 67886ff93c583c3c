//! A random permutation: what the paper settles on (Bærentzen 2005, §5). O(n).

use crate::math::hash::SplitMix64;

/// A random order of `count` points.
pub fn order(count: usize, seed: u64) -> Vec<u32> {
    let mut order: Vec<u32> = (0..count as u32).collect();
    SplitMix64(seed).shuffle(&mut order);
    order
}
