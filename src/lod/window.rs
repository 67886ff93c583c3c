//! Which part of its progressive list a tree shows in a frame, where a history of frames adds up.
//!
//! A prefix shows the same points in every frame. A window begins elsewhere in each: eight frames show about eight times as
//! many points at the cost of one. Windows begin where the list begins a new, finer lattice (at multiples of `N / 2^m`), or
//! end there: in between, a window holds two lattices that do not complement each other, which shows as stripes.

/// Frames after which windows come again.
pub const WINDOW_CYCLE: u32 = 8;

/// Index of the first of `count` points of a list of `total` in frame `turn`, any number: the windows of
/// [`WINDOW_CYCLE`] turns in sequence differ while the list has other points to show, and together are as even as one.
///
/// The list is cut into `2^m` slots, the most that hold `count`. A window is the beginning of a slot, or, where there are
/// fewer slots than turns, its end: the order of a lattice list is its own mirror image.
pub fn window_start(count: u32, total: u32, turn: u32) -> u32 {
    if count == 0 || count >= total {
        return 0;
    }
    let bits = (total / count).ilog2();
    let slots = (1 << bits).min(WINDOW_CYCLE);
    let slot = turn % slots;
    if (turn / slots) % 2 == 1 && slots < WINDOW_CYCLE {
        return (((slot + 1) * total) >> bits) - count;
    }
    (slot * total) >> bits
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn windows_lie_within_the_list() {
        for total in [1, 7, 64, 1000, 535_286, 500_000_000] {
            for count in [0, 1, 2, 3, total / 9, total / 5, total / 2, total - 1, total] {
                let count = count.min(total);
                for turn in 0..40 {
                    let start = window_start(count, total, turn);
                    assert!(start + count <= total, "{count} of {total}, turn {turn}: {start}");
                    assert_eq!(start, window_start(count, total, turn + 2 * WINDOW_CYCLE));
                }
            }
        }
    }

    #[test]
    fn eight_frames_show_eight_times_the_points_of_one() {
        let total = 10_000;
        for count in [3, 100, 600, 1000, 1249] {
            let starts: BTreeSet<u32> =
                (0..8).map(|turn| window_start(count, total, turn)).collect();
            let apart = starts.iter().zip(starts.iter().skip(1)).all(|(a, b)| b - a >= count);
            assert!(starts.len() == 8 && apart, "{count}: {starts:?}");
        }
    }

    #[test]
    fn windows_of_much_of_the_list_show_all_of_it() {
        let total = 10_000;
        for count in [1251, 2000, 3000, 4999, 5000, 7000, 9999] {
            let shown: BTreeSet<u32> = (0..8)
                .map(|turn| window_start(count, total, turn))
                .flat_map(|start| start..start + count)
                .collect();
            assert_eq!(shown.len(), total as usize, "windows of {count}");
        }
    }
}
