//! Any mesh as ground: triangles in, the highest hit under a vertical line out. Building is O(triangles), a query
//! O(triangles of a cell), on average a few.

use super::Ground;
use crate::math::bounding::Aabb;
use bevy::math::{Vec2, Vec3, Vec3Swizzles};
use thiserror::Error;

/// Triangles that are wanted in a cell, on average.
const PER_CELL: f32 = 2.0;
/// The most cells a side.
const MOST_CELLS: f32 = 2048.0;
/// No ground.
const NONE: f32 = f32::NAN;

/// Why a mesh is no ground.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum MeshGroundError {
    /// No triangle faces up or down.
    #[error(
        "mesh ground: none of the {triangles} triangles has an area seen from above; give a mesh that lies, y up"
    )]
    Empty {
        /// Triangles given.
        triangles: usize,
    },
    /// A triangle names a vertex that does not exist.
    #[error(
        "mesh ground: triangle {triangle} names vertex {vertex}, but there are {vertices}; check the indices"
    )]
    Index {
        /// Which triangle.
        triangle: usize,
        /// The vertex it names.
        vertex: u32,
        /// Vertices given.
        vertices: usize,
    },
    /// A vertex is not a place.
    #[error(
        "mesh ground: vertex {vertex} is at {position}; coordinates must be finite and below 1e6"
    )]
    Position {
        /// Which vertex.
        vertex: usize,
        /// Where it is said to be.
        position: Vec3,
    },
}

/// A mesh as [`Ground`], in the mesh's own space, y up. Where there are several surfaces the highest counts.
///
/// Outside the mesh and in its holes [`Ground::height`] is not a number: nothing is scattered there.
#[derive(Clone, Debug)]
pub struct MeshGround {
    positions: Vec<Vec3>,
    triangles: Vec<[u32; 3]>,
    bounds: Aabb,
    cells: [usize; 2],
    /// Per cell, where its triangles begin in `members`, and the end.
    starts: Vec<u32>,
    members: Vec<u32>,
    detail_m: f32,
}

impl MeshGround {
    /// Ground of these triangles, which may face either way.
    ///
    /// # Errors
    /// If an index or a position cannot be used, or nothing can be stood on.
    pub fn new(positions: &[Vec3], triangles: &[[u32; 3]]) -> Result<Self, MeshGroundError> {
        let usable = |p: &Vec3| p.is_finite() && p.abs().max_element() < 1e6;
        if let Some((vertex, &position)) = positions.iter().enumerate().find(|(_, p)| !usable(p)) {
            return Err(MeshGroundError::Position { vertex, position });
        }
        for (triangle, corners) in triangles.iter().enumerate() {
            if let Some(&vertex) = corners.iter().find(|v| **v as usize >= positions.len()) {
                return Err(MeshGroundError::Index { triangle, vertex, vertices: positions.len() });
            }
        }
        let area = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|v| positions[v as usize].xz());
            (b - a).perp_dot(c - a).abs() * 0.5
        };
        // Walls are never hit from above.
        let lying: Vec<[u32; 3]> = triangles.iter().filter(|t| area(t) > 0.0).copied().collect();
        if lying.is_empty() {
            return Err(MeshGroundError::Empty { triangles: triangles.len() });
        }
        let bounds = Aabb::of(lying.iter().flatten().map(|v| positions[*v as usize]));
        let extent = bounds.extent();
        let per_side = |length: f32, other: f32| {
            let share = (length / other.max(1e-6)).clamp(1e-3, 1e3);
            (lying.len() as f32 / PER_CELL * share).sqrt().ceil().clamp(1.0, MOST_CELLS) as usize
        };
        let cells = [per_side(extent.x, extent.z), per_side(extent.z, extent.x)];
        let total: f32 = lying.iter().map(area).sum();
        // The side of a square of a mean triangle's area.
        let detail_m = (total / lying.len() as f32).sqrt().clamp(1e-3, 1e4);
        let mut ground = Self {
            positions: positions.to_vec(),
            triangles: lying,
            bounds,
            cells,
            starts: vec![],
            members: vec![],
            detail_m,
        };
        ground.sort_into_cells();
        Ok(ground)
    }

    /// The highest ground under and above (x, z): height and unit normal, up; `None` in holes and outside. O(cell).
    pub fn hit(&self, x: f32, z: f32) -> Option<(f32, Vec3)> {
        let at = Vec2::new(x, z);
        let (low, high) = (self.bounds.min.xz(), self.bounds.max.xz());
        if !(at.cmpge(low).all() && at.cmple(high).all()) {
            return None;
        }
        let [cx, cz] = self.cell(at);
        let cell = cz * self.cells[0] + cx;
        let members = &self.members[self.starts[cell] as usize..self.starts[cell + 1] as usize];
        let hits = members.iter().filter_map(|t| self.hit_triangle(*t as usize, at));
        hits.max_by(|a, b| a.0.total_cmp(&b.0))
    }

    fn corners(&self, triangle: usize) -> [Vec3; 3] {
        self.triangles[triangle].map(|v| self.positions[v as usize])
    }

    fn hit_triangle(&self, triangle: usize, at: Vec2) -> Option<(f32, Vec3)> {
        let [a, b, c] = self.corners(triangle);
        let area = (b - a).xz().perp_dot((c - a).xz());
        let part = |p: Vec3, q: Vec3| (q.xz() - p.xz()).perp_dot(at - p.xz()) / area;
        let (of_a, of_b, of_c) = (part(b, c), part(c, a), part(a, b));
        // No gap between neighbours by rounding.
        if of_a.min(of_b).min(of_c) < -1e-5 {
            return None;
        }
        let normal = (b - a).cross(c - a).normalize_or(Vec3::Y);
        Some((a.y * of_a + b.y * of_b + c.y * of_c, normal * normal.y.signum()))
    }

    fn cell(&self, at: Vec2) -> [usize; 2] {
        let share = (at - self.bounds.min.xz()) / self.bounds.extent().xz().max(Vec2::splat(1e-6));
        let index = |share: f32, cells: usize| ((share * cells as f32) as usize).min(cells - 1);
        [index(share.x, self.cells[0]), index(share.y, self.cells[1])]
    }

    /// Counting sort: how many in each cell, then where.
    fn sort_into_cells(&mut self) {
        let row = self.cells[0];
        let spans: Vec<[[usize; 2]; 2]> = (0..self.triangles.len())
            .map(|t| {
                let around = Aabb::of(self.corners(t));
                [self.cell(around.min.xz()), self.cell(around.max.xz())]
            })
            .collect();
        let cells_of = |[low, high]: &[[usize; 2]; 2]| {
            let (xs, zs) = (low[0]..=high[0], low[1]..=high[1]);
            zs.flat_map(move |z| xs.clone().map(move |x| z * row + x))
        };
        let mut starts = vec![0u32; row * self.cells[1] + 1];
        for cell in spans.iter().flat_map(cells_of) {
            starts[cell + 1] += 1;
        }
        for i in 1..starts.len() {
            starts[i] += starts[i - 1];
        }
        let mut next = starts.clone();
        self.members = vec![0; *starts.last().expect("one more than cells") as usize];
        for (triangle, span) in spans.iter().enumerate() {
            for cell in cells_of(span) {
                self.members[next[cell] as usize] = triangle as u32;
                next[cell] += 1;
            }
        }
        self.starts = starts;
    }
}

impl Ground for MeshGround {
    /// The square around the origin that holds the mesh.
    fn side_m(&self) -> f32 {
        let reach = self.bounds.min.abs().max(self.bounds.max.abs());
        2.0 * reach.x.max(reach.z)
    }

    fn height(&self, x: f32, z: f32) -> f32 {
        self.hit(x, z).map_or(NONE, |(height, _)| height)
    }

    fn height_range(&self) -> [f32; 2] {
        [self.bounds.min.y, self.bounds.max.y]
    }

    fn detail_m(&self) -> f32 {
        self.detail_m
    }

    /// Of the triangle: differences of heights would see the drop beside an edge. Up where there is no ground.
    fn normal(&self, x: f32, z: f32) -> Vec3 {
        self.hit(x, z).map_or(Vec3::Y, |(_, normal)| normal)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::landscape::Heightfield;
    use proptest::prelude::*;

    fn quad(y: f32, half: f32) -> ([Vec3; 4], [[u32; 3]; 2]) {
        let corner = |x: f32, z: f32| Vec3::new(x * half, y, z * half);
        let corners = [corner(-1.0, -1.0), corner(-1.0, 1.0), corner(1.0, 1.0), corner(1.0, -1.0)];
        (corners, [[0, 1, 2], [0, 2, 3]])
    }

    #[test]
    fn the_highest_surface_counts_and_there_is_none_beyond_the_mesh() {
        let ((mut positions, mut triangles), (roof, _)) = (
            {
                let (p, t) = quad(1.0, 10.0);
                (p.to_vec(), t.to_vec())
            },
            quad(5.0, 2.0),
        );
        positions.extend(roof);
        // The roof faces down.
        triangles.extend([[4, 6, 5], [4, 7, 6]]);
        let ground = MeshGround::new(&positions, &triangles).expect("a ground");
        assert_eq!(ground.height(6.0, -3.0), 1.0);
        assert_eq!(ground.hit(1.0, 1.0), Some((5.0, Vec3::Y)));
        assert!(ground.height(10.1, 0.0).is_nan() && ground.height(f32::NAN, 0.0).is_nan());
        assert_eq!((ground.side_m(), ground.height_range()), (20.0, [1.0, 5.0]));
    }

    #[test]
    fn bad_meshes_are_refused_with_what_is_wrong() {
        let (positions, triangles) = quad(0.0, 1.0);
        assert_eq!(
            MeshGround::new(&positions, &[]).err(),
            Some(MeshGroundError::Empty { triangles: 0 })
        );
        let error = MeshGround::new(&positions, &[[0, 1, 9]]).err();
        assert_eq!(error, Some(MeshGroundError::Index { triangle: 0, vertex: 9, vertices: 4 }));
        let mut nowhere = positions;
        nowhere[2].y = f32::NAN;
        assert!(matches!(
            MeshGround::new(&nowhere, &triangles),
            Err(MeshGroundError::Position { vertex: 2, .. })
        ));
        let wall = [Vec3::ZERO, Vec3::X, Vec3::Y];
        assert!(matches!(MeshGround::new(&wall, &[[0, 1, 2]]), Err(MeshGroundError::Empty { .. })));
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(32))]
        #[test]
        fn a_heightfields_mesh_has_the_heights_of_the_heightfield(seed in any::<u64>(), x in -49.9f32..49.9, z in -49.9f32..49.9) {
            let field = Heightfield::rolling(100.0, 24, seed);
            let (positions, triangles) = field.triangles();
            let ground = MeshGround::new(&positions, &triangles).expect("a ground");
            prop_assert!((ground.height(x, z) - field.height(x, z)).abs() < 1e-3);
        }
    }
}
