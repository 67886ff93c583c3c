//! Sizes of a model: bounds, counts, areas. Each linear in the triangles (leaf components: O(n α(n))).

use super::normals::face_cross;
use super::{SourceAlpha, SourceMaterial, SourceMesh, SourceModel};
use crate::math::bounding::Aabb;
use bevy::math::Vec3;
use std::collections::HashMap;

/// Each edge of a masked triangle is cut in this many parts; the mask is sampled at the centres of the
/// `MASK_STEPS²` equal triangles that makes.
const MASK_STEPS: usize = 4;

impl SourceMesh {
    /// Corners of triangle `t`. O(1).
    ///
    /// # Panics
    /// If the mesh has no such triangle, or never passed [`super::check()`] and its indices are out of range.
    pub fn corners(&self, t: usize) -> [Vec3; 3] {
        self.triangles[t].map(|i| self.positions[i as usize])
    }

    /// Area of triangle `t` in square model units. O(1).
    ///
    /// # Panics
    /// As [`SourceMesh::corners`].
    pub fn triangle_area(&self, t: usize) -> f64 {
        face_cross(self.corners(t)).length() * 0.5
    }
}

impl SourceModel {
    /// Box around all triangles; empty if there are none. O(n).
    pub fn bounds(&self) -> Aabb {
        let corners = |mesh: &SourceMesh| {
            Aabb::of(mesh.triangles.iter().flatten().map(|&i| mesh.positions[i as usize]))
        };
        self.meshes.iter().map(corners).fold(Aabb::default(), Aabb::union)
    }

    /// Triangles of all meshes. O(meshes).
    pub fn triangle_count(&self) -> usize {
        self.meshes.iter().map(|mesh| mesh.triangles.len()).sum()
    }

    /// Area of all triangles, one side each, holes of masked textures included, in square model units. O(n).
    pub fn surface_area(&self) -> f32 {
        let area = |mesh: &SourceMesh| -> f64 {
            (0..mesh.triangles.len()).map(|t| mesh.triangle_area(t)).sum()
        };
        self.meshes.iter().map(area).sum::<f64>() as f32
    }

    /// Mean area of a leaf in square model units, 0 if no material is foliage: the opaque area of foliage, divided by
    /// the number of its connected parts (triangles that share a corner position belong together). O(n α(n)).
    pub fn mean_leaf_area(&self) -> f32 {
        let mut parts = Partition::default();
        let mut corner_of_position = HashMap::new();
        let mut area = 0.0f64;
        for mesh in &self.meshes {
            let Some(material) = self.materials.get(mesh.material).filter(|m| m.is_leaf) else {
                continue;
            };
            for t in 0..mesh.triangles.len() {
                let corners = mesh.corners(t).map(|position| {
                    // Adding 0 turns −0 into +0: equal positions have equal bits.
                    let bits = (position + Vec3::ZERO).to_array().map(f32::to_bits);
                    *corner_of_position.entry(bits).or_insert_with(|| parts.add())
                });
                parts.join(corners[0], corners[1]);
                parts.join(corners[0], corners[2]);
                area += mesh.triangle_area(t) * self.opaque_share(mesh, material, t);
            }
        }
        if parts.count == 0 { 0.0 } else { (area / parts.count as f64) as f32 }
    }

    /// Share of a triangle that its material's mask leaves, 0 to 1.
    fn opaque_share(&self, mesh: &SourceMesh, material: &SourceMaterial, t: usize) -> f64 {
        let SourceAlpha::Mask(cutoff) = material.alpha else { return 1.0 };
        let triangle = mesh.triangles[t].map(|i| i as usize);
        let is_opaque = |weights: [f32; 3]| {
            let mut alpha = material.base_color.w;
            if let Some(texture) = &material.base_color_texture
                && !mesh.uvs.is_empty()
            {
                let uv = (0..3).map(|k| mesh.uvs[triangle[k]] * weights[k]).sum();
                alpha *= f32::from(self.nearest_texel(texture, uv)[3]) / 255.0;
            }
            if !mesh.colors.is_empty() {
                alpha *= (0..3).map(|k| mesh.colors[triangle[k]].w * weights[k]).sum::<f32>();
            }
            alpha >= cutoff
        };
        let step = 1.0 / MASK_STEPS as f32;
        let mut opaque = 0;
        for i in 0..MASK_STEPS {
            for j in 0..MASK_STEPS - i {
                // The upright sub-triangle at (i, j), and beside it the inverted one, if there is one.
                let inverted = i + j + 1 < MASK_STEPS;
                for third in [1.0 / 3.0, 2.0 / 3.0].into_iter().take(1 + usize::from(inverted)) {
                    let (u, v) = ((i as f32 + third) * step, (j as f32 + third) * step);
                    opaque += usize::from(is_opaque([1.0 - u - v, u, v]));
                }
            }
        }
        opaque as f64 / (MASK_STEPS * MASK_STEPS) as f64
    }
}

/// Disjoint sets with path halving (Tarjan and van Leeuwen 1984); the smaller number becomes the root.
#[derive(Default)]
struct Partition {
    parent: Vec<usize>,
    /// Sets there are.
    count: usize,
}

impl Partition {
    /// A new set of one element; returns the element.
    fn add(&mut self) -> usize {
        self.parent.push(self.parent.len());
        self.count += 1;
        self.parent.len() - 1
    }

    fn root(&mut self, mut i: usize) -> usize {
        while self.parent[i] != i {
            self.parent[i] = self.parent[self.parent[i]];
            i = self.parent[i];
        }
        i
    }

    fn join(&mut self, a: usize, b: usize) {
        let (a, b) = (self.root(a), self.root(b));
        if a != b {
            self.parent[a.max(b)] = a.min(b);
            self.count -= 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bake::source::{SourceImage, SourceTexture, SourceWrap};
    use bevy::math::{Mat3, Vec2};

    /// `count` unit squares side by side, far enough apart not to touch, two triangles each without shared vertices.
    fn squares(count: usize) -> SourceModel {
        let mut mesh = SourceMesh::default();
        for i in 0..count {
            let x = 2.0 * i as f32;
            for (u, v) in [(0, 0), (1, 0), (1, 1), (0, 0), (1, 1), (0, 1)] {
                mesh.positions.push(Vec3::new(
                    x + u as f32,
                    v as f32,
                    if u == 0 { -0.0 } else { 0.0 },
                ));
                mesh.uvs.push(Vec2::new(u as f32, v as f32));
            }
            let first = 6 * i as u32;
            mesh.triangles.push([first, first + 1, first + 2]);
            mesh.triangles.push([first + 3, first + 4, first + 5]);
        }
        let leaf = SourceMaterial { is_leaf: true, ..SourceMaterial::default() };
        SourceModel { meshes: vec![mesh], materials: vec![leaf], ..SourceModel::default() }
    }

    #[test]
    fn a_leaf_is_what_hangs_together() {
        let mut model = squares(5);
        assert_eq!(model.triangle_count(), 10);
        assert_eq!(model.surface_area(), 5.0);
        assert_eq!(model.bounds().extent(), Vec3::new(9.0, 1.0, 0.0));
        assert_eq!(model.mean_leaf_area(), 1.0);
        model.materials[0].is_leaf = false;
        assert_eq!(model.mean_leaf_area(), 0.0);
    }

    #[test]
    fn holes_of_the_mask_are_no_leaf() {
        let mut model = squares(3);
        // Left half opaque, right half a hole.
        let rgba8 = [[0, 255, 0, 255], [0, 255, 0, 0]].concat();
        model.images.push(SourceImage { width: 2, height: 1, rgba8 });
        model.materials[0].base_color_texture = Some(SourceTexture {
            image: 0,
            wrap: [SourceWrap::ClampToEdge; 2],
            nearest: true,
            uv_transform: Mat3::IDENTITY,
        });
        model.materials[0].alpha = SourceAlpha::Mask(0.5);
        assert!((model.mean_leaf_area() - 0.5).abs() < 1e-6, "{}", model.mean_leaf_area());
        assert_eq!(model.surface_area(), 3.0);
        model.materials[0].base_color.w = 0.4;
        assert_eq!(model.mean_leaf_area(), 0.0);
    }

    #[test]
    fn an_empty_model_measures_nothing() {
        let model = SourceModel::default();
        assert!(model.bounds().is_empty());
        assert_eq!((model.triangle_count(), model.surface_area()), (0, 0.0));
        assert_eq!(model.mean_leaf_area(), 0.0);
    }
}
