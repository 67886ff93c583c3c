//! Normals where a file has none: triangles → unit vectors. O(vertices + triangles), sums in double precision.

use super::SourceMesh;
use bevy::math::{DVec3, Vec3};

/// Twice the triangle's area along its normal (counter-clockwise side). Exactly zero if its corners lie on a line.
pub fn face_cross([a, b, c]: [Vec3; 3]) -> DVec3 {
    let a = a.as_dvec3();
    (b.as_dvec3() - a).cross(c.as_dvec3() - a)
}

/// Unit normal of a triangle; none if it has no area.
pub fn face_normal(corners: [Vec3; 3]) -> Option<Vec3> {
    unit(face_cross(corners))
}

fn unit(v: DVec3) -> Option<Vec3> {
    v.try_normalize().map(|v| v.as_vec3())
}

/// One smooth normal a vertex: the sum of the normals of its triangles, weighted by their areas. A vertex of none, or
/// whose triangles cancel out, gets the normal of its last triangle with an area, or else +Y.
///
/// Indices must be in range ([`super::check()`] sees to that).
pub fn smooth(positions: &[Vec3], triangles: &[[u32; 3]]) -> Vec<Vec3> {
    let corners = |t: &[u32; 3]| t.map(|i| positions[i as usize]);
    let mut sums = vec![DVec3::ZERO; positions.len()];
    for triangle in triangles {
        let cross = face_cross(corners(triangle));
        for &i in triangle {
            sums[i as usize] += cross;
        }
    }
    let mut normals: Vec<_> = sums.into_iter().map(unit).collect();
    for triangle in triangles {
        for &i in triangle {
            if normals[i as usize].is_none() {
                normals[i as usize] = face_normal(corners(triangle));
            }
        }
    }
    normals.into_iter().map(|n| n.unwrap_or(Vec3::Y)).collect()
}

/// Gives every triangle its own three vertices and its face normal, as glTF asks for where normals are left out
/// (glTF 2.0 §3.7.2.1).
pub fn flatten(mesh: &mut SourceMesh) {
    fn unshare<T: Copy>(values: &[T], triangles: &[[u32; 3]]) -> Vec<T> {
        if values.is_empty() {
            return Vec::new();
        }
        triangles.iter().flatten().map(|&i| values[i as usize]).collect()
    }
    let triangles = &mesh.triangles;
    mesh.normals = triangles
        .iter()
        .flat_map(|t| {
            let corners = t.map(|i| mesh.positions[i as usize]);
            [face_normal(corners).unwrap_or(Vec3::Y); 3]
        })
        .collect();
    mesh.positions = unshare(&mesh.positions, triangles);
    mesh.uvs = unshare(&mesh.uvs, triangles);
    mesh.colors = unshare(&mesh.colors, triangles);
    mesh.triangles = (0..triangles.len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
}

#[cfg(test)]
mod tests {
    use super::*;
    use bevy::math::Vec2;

    #[test]
    fn smooth_normals_weigh_areas() {
        // A large triangle in the plane of X and Y and a small one in that of X and Z share vertex 0.
        let positions = [Vec3::ZERO, Vec3::X * 4.0, Vec3::Y * 4.0, Vec3::Z, Vec3::X, Vec3::ONE];
        let normals = smooth(&positions, &[[0, 1, 2], [0, 3, 4]]);
        assert!(normals[0].distance(Vec3::new(0.0, 1.0, 16.0).normalize()) < 1e-6);
        assert_eq!(normals[2], Vec3::Z);
        assert_eq!(normals[3], Vec3::Y);
        assert_eq!(normals[5], Vec3::Y, "a loose vertex has a unit normal too");
    }

    #[test]
    fn two_sides_of_a_sheet_do_not_cancel_to_nothing() {
        let positions = [Vec3::ZERO, Vec3::X, Vec3::Z];
        let normals = smooth(&positions, &[[0, 1, 2], [0, 2, 1]]);
        assert!(normals.iter().all(|n| n.y.abs() == 1.0));
    }

    #[test]
    fn flat_meshes_share_nothing() {
        let mut mesh = SourceMesh {
            positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::Z],
            uvs: vec![Vec2::ZERO, Vec2::X, Vec2::Y, Vec2::ONE],
            triangles: vec![[0, 1, 2], [0, 3, 1]],
            ..SourceMesh::default()
        };
        flatten(&mut mesh);
        assert_eq!(mesh.triangles, [[0, 1, 2], [3, 4, 5]]);
        assert_eq!(mesh.normals, [Vec3::Z, Vec3::Z, Vec3::Z, Vec3::Y, Vec3::Y, Vec3::Y]);
        assert_eq!(mesh.uvs[4], Vec2::ONE);
        assert_eq!((mesh.positions.len(), mesh.colors.len()), (6, 0));
    }
}
