//! The order of a crown's triangles: from the outside in. O(triangles).
//!
//! A near mesh is drawn from outside, and what is drawn first hides the rest before it is shaded (Sander et al. 2007, "Fast triangle
//! reordering for vertex locality and reduced overdraw"). A static order cannot know the side of the camera, but the shells of a
//! crown hide its inside from all sides. Within a shell the order stays, and with it the locality of vertices.

use crate::math::bounding::Aabb;
use bevy::math::Vec3;

/// Shells of a crown. More of them would tear neighbours apart, and with them what the vertex cache holds.
const SHELLS: f32 = 12.0;

/// Sorts triangles by their shell in the ellipsoid of the positions' box, the outermost first.
pub fn outside_first(positions: &[Vec3], triangles: &mut [[u32; 3]]) {
    let bounds = Aabb::of(positions.iter().copied());
    let (center, half) = (bounds.center(), (bounds.extent() * 0.5).max(Vec3::splat(1e-9)));
    triangles.sort_by_cached_key(|triangle| {
        // By one corner, so that the triangles of a card, which begin at the same, stay together.
        let place = (positions[triangle[0] as usize] - center) / half;
        -(place.length() * SHELLS) as i32
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn outer_triangles_come_first_and_neighbours_stay_together() {
        let positions: Vec<Vec3> =
            [0.1, 3.0, 1.0, 3.02, 3.2].into_iter().flat_map(|x| [Vec3::X * x, Vec3::X * -x]).collect();
        let mut triangles = vec![[0, 1, 2], [2, 3, 1], [4, 5, 6], [3, 2, 0], [7, 0, 1]];
        outside_first(&positions, &mut triangles);
        assert_eq!(triangles, [[2, 3, 1], [3, 2, 0], [7, 0, 1], [4, 5, 6], [0, 1, 2]]);
    }

    #[test]
    fn a_flat_model_keeps_its_order() {
        let mut triangles = vec![[0, 1, 2], [2, 1, 0]];
        outside_first(&[Vec3::ZERO; 3], &mut triangles);
        assert_eq!(triangles, [[0, 1, 2], [2, 1, 0]]);
    }
}
