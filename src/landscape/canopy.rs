//! Where crowns are, coarsely: trees in, heights on a grid out. O(trees); a query is O(1).

use super::ScatteredTree;
use bevy::math::Vec2;
use std::f32::consts::TAU;

/// Height of a tree of scale 1 in metres, rounded up.
pub(super) const TREE_HEIGHT_M: f32 = 16.0;
/// Radius of a crown of scale 1 in metres, with room for the camera.
const CROWN_RADIUS_M: f32 = 5.5;

/// Heights of crowns on a grid of cells, 0 where there are none.
pub(super) struct Canopy {
    side_m: f32,
    cells: usize,
    /// Metres above the ground.
    pub heights: Vec<f32>,
}

impl Canopy {
    pub(super) fn open(side_m: f32) -> Self {
        let cells = ((side_m / 2.5) as usize).clamp(8, 2048);
        Self { side_m, cells, heights: vec![0.0; cells * cells] }
    }

    pub(super) fn middle(&self, cell: usize) -> Vec2 {
        let index = Vec2::new((cell % self.cells) as f32, (cell / self.cells) as f32);
        (index + 0.5) / self.cells as f32 * self.side_m - self.side_m * 0.5
    }

    fn coordinate(&self, metres: f32) -> usize {
        let share = (metres / self.side_m + 0.5).clamp(0.0, 1.0);
        ((share * self.cells as f32) as usize).min(self.cells - 1)
    }

    pub(super) fn add_tree(&mut self, tree: &ScatteredTree) {
        if !(tree.scale.is_finite() && tree.position.is_finite()) {
            return; // Not drawn either.
        }
        let reach = CROWN_RADIUS_M * tree.scale;
        let at = tree.position;
        for z in self.coordinate(at.z - reach)..=self.coordinate(at.z + reach) {
            for x in self.coordinate(at.x - reach)..=self.coordinate(at.x + reach) {
                let height = &mut self.heights[z * self.cells + x];
                *height = height.max(TREE_HEIGHT_M * tree.scale);
            }
        }
    }

    pub(super) fn height(&self, x: f32, z: f32) -> f32 {
        self.heights[self.coordinate(z) * self.cells + self.coordinate(x)]
    }

    /// Share of 16 places around at `radius` metres that bear forest.
    pub(super) fn cover(&self, at: Vec2, radius: f32) -> f32 {
        let places = (0..16).map(|i| at + Vec2::from_angle(TAU * i as f32 / 16.0) * radius);
        places.filter(|p| self.height(p.x, p.y) > 0.0).count() as f32 / 16.0
    }
}
