//! Finds the trees of a forest near a point without looking at all of them, and forests near a point without looking
//! at their trees.
//!
//! In: forests that changed; out: their bounds at once, O(trees), and a grid of their trees when a camera first comes near.

use super::components::Forest;
use crate::math::bounding::Aabb;
use bevy::{platform::collections::HashMap, prelude::*};

/// Side of a cell, in units of the forest.
const CELL: f32 = 32.0;

/// Where the trees of a forest are. Required by [`Forest`].
#[derive(Component, Debug, Default)]
pub(super) struct ForestIndex {
    /// Of the positions, in units of the forest.
    bounds: Aabb,
    /// Largest instance scale.
    pub max_scale: f32,
    /// `None`: the forest changed.
    place: Option<ForestPlace>,
    /// Trees by cell of a horizontal grid. `None`: nobody has asked since the forest changed.
    cells: Option<HashMap<IVec2, Vec<u32>>>,
}

/// A forest in the world.
#[derive(Clone, Copy, Debug)]
pub(super) struct ForestPlace {
    /// Middle of the sphere around the positions of its trees.
    pub center: Vec3,
    /// Radius of that sphere.
    pub radius: f32,
    /// Largest scale of any of its trees.
    pub scale: f32,
}

fn cell_of(position: Vec3) -> IVec2 {
    (position.xz() / CELL).floor().as_ivec2()
}

impl ForestIndex {
    /// Everything but the grid. O(trees).
    fn measure(forest: &Forest) -> Self {
        let mut index = Self::default();
        for tree in forest.packed().iter() {
            let position = tree.position;
            // What is nowhere is near nothing.
            if position.is_finite() {
                index.bounds = index.bounds.including(position);
            }
            index.max_scale = index.max_scale.max(tree.scale);
        }
        index
    }

    /// Where the forest stands in the world; kept until it or its transform changes.
    pub fn place(&mut self, transform: &Ref<GlobalTransform>) -> ForestPlace {
        if let Some(place) = self.place.filter(|_| !transform.is_changed()) {
            return place;
        }
        let scale = transform.scale().abs().max_element();
        let place = if self.bounds.is_empty() {
            ForestPlace { center: transform.translation(), radius: 0.0, scale: 0.0 }
        } else {
            ForestPlace {
                center: transform.transform_point(self.bounds.center()),
                radius: self.bounds.radius() * scale,
                scale: self.max_scale * scale,
            }
        };
        self.place = Some(place);
        place
    }

    /// Indices of trees whose cell meets the square of `radius` around `center`, ascending. O(found + cells), and
    /// O(trees) the first time.
    pub fn near(&mut self, forest: &Forest, center: Vec3, radius: f32) -> Vec<u32> {
        let cells = self.cells.get_or_insert_with(|| {
            let mut cells: HashMap<IVec2, Vec<u32>> = default();
            for (i, tree) in forest.packed().iter().enumerate() {
                cells.entry(cell_of(tree.position)).or_default().push(i as u32);
            }
            cells
        });
        let square = Aabb { min: center - radius, max: center + radius };
        let (low, high) = (cell_of(square.min), cell_of(square.max));
        // Cells at infinity are at the ends of `i32`.
        let span = high.as_i64vec2() - low.as_i64vec2() + 1;
        let mut found: Vec<u32> = if span.x.saturating_mul(span.y) > cells.len() as i64 {
            let inside = |cell: IVec2| cell.cmpge(low).all() && cell.cmple(high).all();
            let met = cells.iter().filter(|(cell, _)| inside(**cell));
            met.flat_map(|(_, trees)| trees).copied().collect()
        } else {
            let met =
                (low.y..=high.y).flat_map(|y| (low.x..=high.x).map(move |x| IVec2::new(x, y)));
            met.filter_map(|cell| cells.get(&cell)).flatten().copied().collect()
        };
        found.sort_unstable();
        found
    }
}

pub(super) fn index_forests(mut forests: Query<(&Forest, &mut ForestIndex), Changed<Forest>>) {
    for (forest, mut index) in &mut forests {
        *index = ForestIndex::measure(forest);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::forest::TreeInstance;

    #[test]
    fn near_finds_every_tree_within_the_radius() {
        let at =
            |i: u32| Vec3::new((i % 50) as f32 * 7.0 - 100.0, 0.0, (i / 50) as f32 * 9.0 - 200.0);
        let forest = Forest::new([]).with((0..2500).map(|i| TreeInstance::at(at(i))));
        let mut index = ForestIndex::measure(&forest);
        for (center, radius) in [
            (Vec3::ZERO, 20.0),
            (Vec3::new(60.0, 3.0, -50.0), 75.0),
            (Vec3::ZERO, 1e6),
            (Vec3::ZERO, f32::INFINITY),
        ] {
            let found = index.near(&forest, center, radius);
            let missed =
                (0..2500u32).filter(|&i| at(i).distance(center) < radius && !found.contains(&i));
            assert_eq!(missed.count(), 0);
            assert!(found.is_sorted());
        }
    }
}
