//! Slices of one long array, by best fit: where in a buffer each of thousands of things of different sizes lies.
//!
//! In: lengths; out: where a slice of that length begins. Nothing ever moves. Places depend on the calls alone, so
//! equal calls give equal places. `allocate`, `release`: O(log slices); memory: O(gaps).

use std::collections::{BTreeMap, BTreeSet};

/// Which parts of `0..capacity` are free. Units are the caller's.
#[derive(Clone, Debug, Default)]
pub struct SliceAllocator {
    capacity: u32,
    free: u32,
    /// Length of each gap by its begin. Gaps never touch.
    gaps: BTreeMap<u32, u32>,
    /// The same as (length, begin), to find the shortest that fits.
    by_length: BTreeSet<(u32, u32)>,
}

impl SliceAllocator {
    /// All of `0..capacity` free.
    pub fn new(capacity: u32) -> Self {
        let mut new = Self::default();
        new.grow(capacity);
        new
    }

    /// End of the array.
    pub fn capacity(&self) -> u32 {
        self.capacity
    }

    /// Units that are not in a slice.
    pub fn free(&self) -> u32 {
        self.free
    }

    /// Units that are in slices.
    pub fn used(&self) -> u32 {
        self.capacity - self.free
    }

    /// The begin of a new slice of `length`, in the shortest gap that holds it (the first of several). `None` if no gap
    /// does. A slice of no length begins at 0 and needs no release.
    pub fn allocate(&mut self, length: u32) -> Option<u32> {
        if length == 0 {
            return Some(0);
        }
        let &(gap, begin) = self.by_length.range((length, 0)..).next()?;
        self.remove_gap(begin, gap);
        self.insert_gap(begin + length, gap - length);
        self.free -= length;
        Some(begin)
    }

    /// Gives back the slice that `allocate(length)` placed at `begin`.
    ///
    /// # Panics
    /// If a part of it is free already or beyond the end: slices would overlap later.
    pub fn release(&mut self, begin: u32, length: u32) {
        if length == 0 {
            return;
        }
        let end = begin.checked_add(length).filter(|end| *end <= self.capacity);
        let end = end.expect("a slice lies within the array");
        let (mut from, mut to) = (begin, end);
        if let Some((&before, &gap)) = self.gaps.range(..end).next_back() {
            assert!(before + gap <= begin, "{begin}..{end} is free already");
            if before + gap == begin {
                self.remove_gap(before, gap);
                from = before;
            }
        }
        if let Some(&gap) = self.gaps.get(&end) {
            self.remove_gap(end, gap);
            to = end + gap;
        }
        self.insert_gap(from, to - from);
        self.free += length;
    }

    /// Moves the end to `capacity`; a smaller one than now changes nothing.
    pub fn grow(&mut self, capacity: u32) {
        let added = capacity.saturating_sub(self.capacity);
        let begin = self.capacity;
        self.capacity += added;
        self.release(begin, added);
    }

    fn insert_gap(&mut self, begin: u32, length: u32) {
        if length > 0 {
            self.gaps.insert(begin, length);
            self.by_length.insert((length, begin));
        }
    }

    fn remove_gap(&mut self, begin: u32, length: u32) {
        self.gaps.remove(&begin);
        self.by_length.remove(&(length, begin));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Gaps and slices tile the array, gaps apart from each other.
    fn check(allocator: &SliceAllocator, slices: &[(u32, u32)]) {
        let mut parts: Vec<(u32, u32, bool)> =
            slices.iter().filter(|s| s.1 > 0).map(|&(b, l)| (b, l, false)).collect();
        parts.extend(allocator.gaps.iter().map(|(&b, &l)| (b, l, true)));
        parts.sort_unstable();
        let mut end = 0;
        let mut after_gap = false;
        for (begin, length, is_gap) in parts {
            assert_eq!(begin, end, "parts follow each other: {allocator:?}");
            assert!(!(is_gap && after_gap), "gaps that touch are one: {allocator:?}");
            (end, after_gap) = (begin + length, is_gap);
        }
        assert_eq!(end, allocator.capacity());
        assert_eq!(allocator.free(), allocator.gaps.values().sum::<u32>());
        let sorted: BTreeSet<_> = allocator.gaps.iter().map(|(&b, &l)| (l, b)).collect();
        assert_eq!(sorted, allocator.by_length);
    }

    proptest! {
        #[test]
        fn slices_and_gaps_tile_the_array_whatever_is_done(
            capacity in 0u32..200,
            steps in proptest::collection::vec((0u8..8, 0u32..60), 0..200),
        ) {
            let mut allocator = SliceAllocator::new(capacity);
            let mut slices: Vec<(u32, u32)> = vec![];
            for (what, value) in steps {
                match what {
                    0..4 => {
                        let largest = allocator.gaps.values().copied().max().unwrap_or(0);
                        match allocator.allocate(value) {
                            Some(begin) => slices.push((begin, value)),
                            None => prop_assert!(value > largest, "{value} fits into {largest}"),
                        }
                    }
                    4..7 if !slices.is_empty() => {
                        let (begin, length) = slices.swap_remove(value as usize % slices.len());
                        allocator.release(begin, length);
                    }
                    _ => allocator.grow(allocator.capacity() + value % 20),
                }
                check(&allocator, &slices);
            }
            for (begin, length) in slices.drain(..) {
                allocator.release(begin, length);
            }
            check(&allocator, &[]);
            prop_assert_eq!(allocator.used(), 0);
        }
    }

    #[test]
    fn the_shortest_gap_that_fits_is_used_again() {
        let mut allocator = SliceAllocator::new(100);
        let places = [10, 5, 20, 5, 30].map(|length| allocator.allocate(length));
        assert_eq!(places, [0, 10, 15, 35, 40].map(Some));
        allocator.release(15, 20);
        allocator.release(0, 10);
        assert_eq!(allocator.allocate(8), Some(0));
        assert_eq!(allocator.allocate(20), Some(15));
        assert_eq!(allocator.allocate(31), None);
        allocator.grow(101);
        assert_eq!(allocator.allocate(31), Some(70));
        assert_eq!((allocator.capacity(), allocator.free()), (101, 2));
    }

    #[test]
    #[should_panic(expected = "free already")]
    fn a_slice_cannot_be_given_back_twice() {
        let mut allocator = SliceAllocator::new(10);
        let begin = allocator.allocate(4).expect("there is room");
        allocator.release(begin, 4);
        allocator.release(begin, 4);
    }
}
