//! What the CPU knows of each triangle: the GPU writes a triangle's number, and this table has the rest.
//!
//! In: model and directions; out: exact face normal, material and keeping direction per triangle, in model order (mesh
//! by mesh). O(triangles × directions); 17 bytes a triangle.

use crate::{
    bake::{
        peel::{PeelDirection, most_parallel},
        source::{SourceMesh, SourceModel},
    },
    math::triangle::normal_and_area,
};
use bevy::math::Vec3;

/// Columns of one row per triangle.
#[derive(Debug, Default)]
pub(super) struct TriangleTable {
    /// Unit, on the winding's front side; zero for triangles without area, which are never drawn.
    pub(super) face_normals: Vec<Vec3>,
    /// Material index of the model.
    pub(super) materials: Vec<u16>,
    /// The direction whose samples of this triangle are kept.
    pub(super) directions: Vec<u8>,
}

impl TriangleTable {
    /// Checks the model and fills the table.
    ///
    /// # Errors
    /// What rule of [`SourceModel`] is broken where.
    pub(super) fn of(model: &SourceModel, directions: &[PeelDirection]) -> Result<Self, String> {
        let count = model.meshes.iter().map(|mesh| mesh.triangles.len()).sum::<usize>();
        // The GPU numbers triangles from 1 in 32 bits, and their corners in chunks.
        if count >= u32::MAX as usize {
            return Err(format!("{count} triangles, but at most {} can be peeled", u32::MAX - 1));
        }
        let mut table = Self {
            face_normals: Vec::with_capacity(count),
            materials: Vec::with_capacity(count),
            directions: Vec::with_capacity(count),
        };
        for (i, mesh) in model.meshes.iter().enumerate() {
            let name = &mesh.name;
            if mesh.material >= model.materials.len() {
                let (material, have) = (mesh.material, model.materials.len());
                return Err(format!(
                    "mesh {i} (`{name}`) has material {material}, but there are {have}"
                ));
            }
            let material = u16::try_from(mesh.material).map_err(|_| {
                format!("mesh {i} (`{name}`) has material {}, above 65535", mesh.material)
            })?;
            if mesh.normals.len() != mesh.positions.len() {
                let (normals, positions) = (mesh.normals.len(), mesh.positions.len());
                return Err(format!(
                    "mesh {i} (`{name}`) has {normals} normals for {positions} positions"
                ));
            }
            for triangle in &mesh.triangles {
                let normal = corner_positions(mesh, *triangle)
                    .and_then(|[a, b, c]| normal_and_area(a, b, c))
                    .map_or(Vec3::ZERO, |(n, _)| n);
                table.face_normals.push(normal);
                table.materials.push(material);
                table.directions.push(most_parallel(directions, normal) as u8);
            }
        }
        Ok(table)
    }
}

/// The corners of a triangle, or nothing if an index is out of range or a coordinate is not finite.
pub(super) fn corner_positions(mesh: &SourceMesh, triangle: [u32; 3]) -> Option<[Vec3; 3]> {
    let corner = |i: u32| mesh.positions.get(i as usize).copied().filter(|p| p.is_finite());
    let [a, b, c] = triangle;
    Some([corner(a)?, corner(b)?, corner(c)?])
}
