//! Farthest-point order: each point is the one farthest from all before it (Gonzalez 1985; Hochbaum and Shmoys 1985).
//!
//! Exact for the whole list. Every point keeps its distance to the nearest point chosen; the largest such distance is the
//! radius, which only ever falls. A newly chosen point can change only points within the radius, found in a grid that is
//! rebuilt without the chosen points whenever the radius has halved. Each halving visits a point a bounded number of times,
//! so on a surface the cost is O(n log n) visits and heap steps for each of the log(extent / spacing) halvings.

use crate::math::{hash::SplitMix64, point_grid::PointGrid};
use bevy::math::Vec3;
use std::collections::{BinaryHeap, binary_heap::PeekMut};

/// How often progress is told, in points.
const PROGRESS_STEP: usize = 4096;
/// All keys are corrected at once, which is cheaper than one by one, whenever the radius has shrunk by this factor.
const HEAP_REBUILD: f32 = 0.85;
/// Slot of a point that is not in the grid: it is chosen, or coincides with one that is.
const NOT_IN_GRID: u32 = u32::MAX;

/// Points not chosen yet, with the squared distance of each to the nearest chosen one.
struct Frontier {
    grid: PointGrid,
    /// By slot.
    squared: Vec<f32>,
    /// Slot of each rank.
    slots: Vec<u32>,
    /// Rank of each slot.
    ranks: Vec<u32>,
    cell: f32,
}

impl Frontier {
    fn new(points: &[Vec3], ranks: &[u32], squared: &[f32], total: usize, cell: f32) -> Self {
        let grid = PointGrid::new(points, cell);
        let by_slot = |i: &u32| *i as usize;
        let ranks: Vec<u32> = grid.ids().iter().map(|i| ranks[by_slot(i)]).collect();
        let squared = grid.ids().iter().map(|i| squared[by_slot(i)]).collect();
        let mut slots = vec![NOT_IN_GRID; total];
        for (slot, &rank) in ranks.iter().enumerate() {
            slots[rank as usize] = slot as u32;
        }
        Self { grid, squared, slots, ranks, cell }
    }

    /// The same without points at distance 0, with cells of the new size.
    fn shrunk(&self, cell: f32) -> Self {
        let left: Vec<usize> = (0..self.ranks.len()).filter(|&i| self.squared[i] > 0.0).collect();
        let points: Vec<Vec3> = left.iter().map(|&i| self.grid.points()[i]).collect();
        let ranks: Vec<u32> = left.iter().map(|&i| self.ranks[i]).collect();
        let squared: Vec<f32> = left.iter().map(|&i| self.squared[i]).collect();
        Self::new(&points, &ranks, &squared, self.slots.len(), cell)
    }

    fn squared(&self, rank: u32) -> f32 {
        match self.slots[rank as usize] {
            NOT_IN_GRID => 0.0,
            slot => self.squared[slot as usize],
        }
    }
}

/// Heap key of a point: squared distances are not negative, so their bits sort as they do.
fn key(squared: f32, rank: u32) -> u64 {
    u64::from(squared.to_bits()) << 32 | u64::from(rank)
}

/// Takes the rank and squared distance of the farthest point.
fn pop_farthest(heap: &mut BinaryHeap<u64>, frontier: &Frontier) -> Option<(u32, f32)> {
    loop {
        let mut top = heap.peek_mut()?;
        let rank = *top as u32;
        let squared = frontier.squared(rank);
        let current = key(squared, rank);
        if *top == current {
            PeekMut::pop(top);
            return Some((rank, squared));
        }
        // Distances only fall: a key that is too high is corrected when it reaches the top.
        *top = current;
    }
}

/// The farthest-point order of `positions`; the first point and ties are decided by `seed`. Coincident points come last.
pub fn order(positions: &[Vec3], seed: u64, progress: &(dyn Fn(f32) + Sync)) -> Vec<u32> {
    // Points of an LDI lie on a lattice and tie all the time: the rank in a shuffle decides.
    let id_of_rank = super::random::order(positions.len(), SplitMix64(seed).next_u64());
    let Some(&first) = id_of_rank.last() else { return vec![] };
    let points: Vec<Vec3> = id_of_rank.iter().map(|&id| positions[id as usize]).collect();
    let start = positions[first as usize];
    let ranks: Vec<u32> = (0..points.len() as u32).collect();
    let squared: Vec<f32> = points.iter().map(|p| p.distance_squared(start)).collect();
    let radius = squared.iter().copied().fold(0.0, f32::max).sqrt();
    // An infinite distance in its key makes the first point the first to be chosen; the others' keys are their distances.
    let last = points.len() as u32 - 1;
    let heap_key =
        |rank: u32, squared: f32| key(if rank == last { f32::INFINITY } else { squared }, rank);
    let mut heap: BinaryHeap<u64> =
        std::iter::zip(&ranks, &squared).map(|(&rank, &s)| heap_key(rank, s)).collect();
    let mut frontier = Frontier::new(&points, &ranks, &squared, points.len(), radius);
    let mut order = Vec::with_capacity(points.len());
    order.push(first);
    heap.pop();
    let mut heap_radius = radius;
    while let Some((rank, squared)) = pop_farthest(&mut heap, &frontier) {
        order.push(id_of_rank[rank as usize]);
        if order.len() % PROGRESS_STEP == 0 {
            progress(order.len() as f32 / positions.len() as f32);
        }
        let radius = squared.sqrt();
        if radius == 0.0 {
            continue;
        }
        if radius < frontier.cell * 0.5 {
            frontier = frontier.shrunk(radius);
        }
        if radius < heap_radius * HEAP_REBUILD {
            heap_radius = radius;
            let mut keys = heap.into_vec();
            keys.iter_mut().for_each(|k| *k = key(frontier.squared(*k as u32), *k as u32));
            heap = BinaryHeap::from(keys);
        }
        let Frontier { grid, squared, .. } = &mut frontier;
        grid.for_each_within(points[rank as usize], radius, |slot, distance| {
            let nearest = &mut squared[slot];
            *nearest = nearest.min(distance);
        });
    }
    order
}
