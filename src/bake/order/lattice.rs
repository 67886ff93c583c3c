//! Lattice order: by the bits of the LDI cell, finest first, so that every prefix is an even lattice. O(n log n).
//!
//! The quarter of cells with even column and row comes first, then the quarter on its diagonals, then the rest; each
//! quarter is ordered in the same way by the next bits. Only integers of the cell are used, not positions.

use crate::bake::peel::PeelSample;
use crate::math::hash::{SplitMix64, mix_bits};
use rayon::prelude::*;

/// The quincunx order of the four cells of a 2×2 block, by x | y << 1: a cell, the one diagonal to it, then the others.
const QUINCUNX: [u32; 4] = [0, 2, 3, 1];

/// The lattice order of samples (as peeling lists them).
///
/// The lattice is moved by an offset for each direction and for each side that faces it: front and back of a trunk or a
/// leaf would else have their points on the same lines of sight. (An offset for each layer scatters them as well, but a
/// surface changes its layer wherever something begins to cover it, and the lattice would break there.)
pub fn order(samples: &[PeelSample], seed: u64) -> Vec<u32> {
    let mut random = SplitMix64(seed);
    let salt = random.next_u64() as u32;
    let offsets: Vec<[u16; 2]> =
        (0..512).map(|_| [0; 2].map(|_: u16| random.next_u64() as u16)).collect();
    let mut keys: Vec<(u64, u32)> = samples
        .par_iter()
        .enumerate()
        .map(|(index, sample)| {
            let [dx, dy] = offsets[usize::from(sample.direction) * 2 + usize::from(front(sample))];
            let key = key(sample.cell[0].wrapping_add(dx), sample.cell[1].wrapping_add(dy));
            // Cells of different directions and layers tie; the hash prefers none of them.
            let tie = mix_bits(index as u32 ^ salt);
            (u64::from(key) << 32 | u64::from(tie), index as u32)
        })
        .collect();
    keys.par_sort_unstable();
    keys.into_iter().map(|(_, index)| index).collect()
}

/// Which side of its triangle the direction sees, by the sign of the normal's largest coordinate: for X, Y and Z that is
/// exactly the side, for others it still is the same for all of a smooth surface but at the borders of octants.
fn front(sample: &PeelSample) -> bool {
    let normal = sample.face_normal.to_array();
    let largest = normal.into_iter().fold(0.0f32, |a, b| if b.abs() > a.abs() { b } else { a });
    largest > 0.0
}

/// Rank of an LDI cell: its bit pairs, finest first, as digits of a number in base 4.
pub fn key(x: u16, y: u16) -> u32 {
    (0..16).fold(0, |key, bit| {
        let pair = (x >> bit & 1) | (y >> bit & 1) << 1;
        key * 4 + QUINCUNX[usize::from(pair)]
    })
}
