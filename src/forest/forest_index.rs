//! Finds the trees of a forest near a point without looking at all of them.

use super::components::Forest;
use crate::math::bounding::Aabb;
use bevy::{platform::collections::HashMap, prelude::*};

/// Side of a cell, in units of the forest.
const CELL: f32 = 32.0;

/// Trees by cell of a horizontal grid. Kept beside each [`Forest`].
#[derive(Component, Default)]
pub(super) struct ForestIndex {
    cells: HashMap<IVec2, Vec<u32>>,
    /// Largest instance scale.
    pub max_scale: f32,
}

fn cell_of(position: Vec3) -> IVec2 {
    (position.xz() / CELL).floor().as_ivec2()
}

impl ForestIndex {
    fn build(forest: &Forest) -> Self {
        let mut index = Self::default();
        for (i, tree) in forest.iter().enumerate() {
            index.cells.entry(cell_of(tree.position)).or_default().push(i as u32);
            index.max_scale = index.max_scale.max(tree.scale);
        }
        index
    }

    /// Indices of trees whose cell meets the square of `radius` around `center`, ascending. O(found + cells).
    pub fn near(&self, center: Vec3, radius: f32) -> Vec<u32> {
        let square = Aabb { min: center - radius, max: center + radius };
        let (low, high) = (cell_of(square.min), cell_of(square.max));
        // Cells at infinity are at the ends of `i32`.
        let span = high.as_i64vec2() - low.as_i64vec2() + 1;
        let mut found: Vec<u32> = if span.x.saturating_mul(span.y) > self.cells.len() as i64 {
            let inside = |cell: IVec2| cell.cmpge(low).all() && cell.cmple(high).all();
            self.cells
                .iter()
                .filter(|(cell, _)| inside(**cell))
                .flat_map(|(_, trees)| trees)
                .copied()
                .collect()
        } else {
            let cells =
                (low.y..=high.y).flat_map(|y| (low.x..=high.x).map(move |x| IVec2::new(x, y)));
            cells.filter_map(|cell| self.cells.get(&cell)).flatten().copied().collect()
        };
        found.sort_unstable();
        found
    }
}

pub(super) fn index_forests(
    mut commands: Commands,
    forests: Query<(Entity, &Forest), Changed<Forest>>,
) {
    for (entity, forest) in &forests {
        commands.entity(entity).insert(ForestIndex::build(forest));
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
        let index = ForestIndex::build(&forest);
        for (center, radius) in [
            (Vec3::ZERO, 20.0),
            (Vec3::new(60.0, 3.0, -50.0), 75.0),
            (Vec3::ZERO, 1e6),
            (Vec3::ZERO, f32::INFINITY),
        ] {
            let found = index.near(center, radius);
            let missed =
                (0..2500u32).filter(|&i| at(i).distance(center) < radius && !found.contains(&i));
            assert_eq!(missed.count(), 0);
            assert!(found.is_sorted());
        }
    }
}
