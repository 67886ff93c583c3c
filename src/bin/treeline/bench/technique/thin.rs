//! Meshes with fewer triangles, as a skilled user of Bevy makes them: bark by `meshopt`, foliage by leaving leaves out.
//!
//! Simplifiers make trees bald: of an aspen's leaf area, 4 % is left at 2 % of its triangles. So a share of the leaves
//! stays, each grown about its middle until the area is what it was.

use bevy::{
    asset::RenderAssetUsages,
    mesh::{Indices, PrimitiveTopology, VertexAttributeValues},
    prelude::*,
};
use meshopt::{SimplifyOptions, VertexDataAdapter, simplify};
use std::collections::HashMap;

/// Positions and indices of a triangle list.
struct Triangles {
    positions: Vec<[f32; 3]>,
    indices: Vec<u32>,
}

impl Triangles {
    fn of(mesh: &Mesh) -> Option<Self> {
        let positions = mesh.attribute(Mesh::ATTRIBUTE_POSITION)?.as_float3()?.to_vec();
        let indices = mesh.indices()?.iter().map(|i| i as u32).collect();
        Some(Self { positions, indices })
    }
}

/// Wood with about `share` of its triangles. What is no indexed triangle list stays as it is.
pub fn thin_wood(mesh: &Mesh, share: f32) -> Mesh {
    let Some(Triangles { positions, indices }) = Triangles::of(mesh) else { return mesh.clone() };
    let wanted = ((indices.len() / 3) as f32 * share).max(4.0) as usize * 3;
    let bytes: &[u8] = bytemuck::cast_slice(&positions);
    let Ok(vertices) = VertexDataAdapter::new(bytes, size_of::<[f32; 3]>(), 0) else {
        return mesh.clone();
    };
    // Whatever the error: the number of triangles is what was asked for.
    let indices = simplify(&indices, &vertices, wanted, 1.0, SimplifyOptions::None, None);
    with_triangles(mesh, &positions, &indices)
}

/// Foliage with about `share` of its leaves (connected parts), larger by as much as keeps their area.
pub fn thin_leaves(mesh: &Mesh, share: f32) -> Mesh {
    let Some(Triangles { positions, indices }) = Triangles::of(mesh) else { return mesh.clone() };
    let leaf_of = leaves(&positions, &indices);
    let mut all: Vec<u32> = indices.iter().map(|&i| leaf_of[i as usize]).collect();
    all.sort_unstable();
    all.dedup();
    // Any even choice will do; this one is the baseline's.
    let mut seed = 12_345u64;
    let mut kept: Vec<u32> = all.clone();
    kept.retain(|_| {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((seed >> 33) as f32 / 2_147_483_648.0) < share
    });
    if kept.is_empty() {
        kept.extend(all.first());
    }
    let mut middles: HashMap<u32, (Vec3, f32)> =
        kept.iter().map(|leaf| (*leaf, default())).collect();
    for (position, leaf) in positions.iter().zip(&leaf_of) {
        if let Some((sum, count)) = middles.get_mut(leaf) {
            *sum += Vec3::from_array(*position);
            *count += 1.0;
        }
    }
    let growth = (all.len() as f32 / kept.len().max(1) as f32).sqrt();
    let grown = positions.iter().zip(&leaf_of).map(|(position, leaf)| match middles.get(leaf) {
        Some((sum, count)) => {
            let middle = *sum / *count;
            (middle + (Vec3::from_array(*position) - middle) * growth).to_array()
        }
        None => *position,
    });
    let grown: Vec<[f32; 3]> = grown.collect();
    let stays = |triangle: &&[u32]| middles.contains_key(&leaf_of[triangle[0] as usize]);
    let indices: Vec<u32> = indices.chunks_exact(3).filter(stays).flatten().copied().collect();
    with_triangles(mesh, &grown, &indices)
}

/// The leaf of each vertex: the connected part it is in, by a number of its own. Vertices at one place are one.
fn leaves(positions: &[[f32; 3]], indices: &[u32]) -> Vec<u32> {
    fn root(parent: &mut [u32], mut i: u32) -> u32 {
        while parent[i as usize] != i {
            parent[i as usize] = parent[parent[i as usize] as usize];
            i = parent[i as usize];
        }
        i
    }
    let mut first_at: HashMap<[u32; 3], u32> = HashMap::new();
    let mut parent: Vec<u32> = (0..positions.len() as u32)
        .map(|i| *first_at.entry(positions[i as usize].map(f32::to_bits)).or_insert(i))
        .collect();
    for triangle in indices.chunks_exact(3) {
        for corner in &triangle[1..] {
            let (a, b) = (root(&mut parent, triangle[0]), root(&mut parent, *corner));
            parent[a as usize] = b;
        }
    }
    (0..positions.len() as u32).map(|i| root(&mut parent, i)).collect()
}

/// A mesh of some of the vertices of `mesh`, at `positions`.
fn with_triangles(mesh: &Mesh, positions: &[[f32; 3]], indices: &[u32]) -> Mesh {
    let mut number = vec![u32::MAX; positions.len()];
    let mut used: Vec<usize> = vec![];
    let renumbered = indices.iter().map(|&i| {
        let number = &mut number[i as usize];
        if *number == u32::MAX {
            *number = used.len() as u32;
            used.push(i as usize);
        }
        *number
    });
    let renumbered: Vec<u32> = renumbered.collect();
    let mut out = Mesh::new(PrimitiveTopology::TriangleList, RenderAssetUsages::default());
    for (attribute, values) in mesh.attributes() {
        let values = match values {
            _ if attribute.id == Mesh::ATTRIBUTE_POSITION.id => {
                VertexAttributeValues::Float32x3(used.iter().map(|&i| positions[i]).collect())
            }
            VertexAttributeValues::Float32x2(v) => {
                VertexAttributeValues::Float32x2(used.iter().map(|&i| v[i]).collect())
            }
            VertexAttributeValues::Float32x3(v) => {
                VertexAttributeValues::Float32x3(used.iter().map(|&i| v[i]).collect())
            }
            VertexAttributeValues::Float32x4(v) => {
                VertexAttributeValues::Float32x4(used.iter().map(|&i| v[i]).collect())
            }
            // Models of this tool have no others.
            _ => continue,
        };
        out.insert_attribute(*attribute, values);
    }
    out.with_inserted_indices(Indices::U32(renumbered))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn area(mesh: &Mesh) -> f32 {
        let Triangles { positions, indices } = Triangles::of(mesh).expect("triangles");
        let at = |i: u32| Vec3::from_array(positions[i as usize]);
        let of = |t: &[u32]| 0.5 * (at(t[1]) - at(t[0])).cross(at(t[2]) - at(t[0])).length();
        indices.chunks_exact(3).map(of).sum()
    }

    fn triangles(mesh: &Mesh) -> usize {
        mesh.indices().expect("indices").len() / 3
    }

    /// Quads of one size in a row, each of two triangles that share no vertex.
    fn quads(count: u32) -> Mesh {
        let mut positions: Vec<[f32; 3]> = vec![];
        for i in 0..count {
            let x = i as f32 * 3.0;
            let corner = |dx: f32, dy: f32| [x + dx, dy, 0.0];
            positions.extend([corner(0.0, 0.0), corner(1.0, 0.0), corner(1.0, 2.0)]);
            positions.extend([corner(0.0, 0.0), corner(1.0, 2.0), corner(0.0, 2.0)]);
        }
        let indices: Vec<u32> = (0..positions.len() as u32).collect();
        let uvs = vec![[0.25f32, 0.75]; positions.len()];
        Mesh::new(PrimitiveTopology::TriangleList, RenderAssetUsages::default())
            .with_inserted_attribute(Mesh::ATTRIBUTE_POSITION, positions)
            .with_inserted_attribute(Mesh::ATTRIBUTE_UV_0, uvs)
            .with_inserted_indices(Indices::U32(indices))
    }

    #[test]
    fn thinned_foliage_keeps_its_area_and_whole_leaves() {
        let full = quads(2_000);
        for share in [0.1, 0.02] {
            let thin = thin_leaves(&full, share);
            let left = triangles(&thin) as f32 / triangles(&full) as f32;
            assert!((0.6 * share..1.4 * share).contains(&left), "{share}: {left}");
            assert_eq!(triangles(&thin) % 2, 0, "half a leaf");
            assert!((area(&thin) / area(&full) - 1.0).abs() < 0.01);
            let uvs = thin.attribute(Mesh::ATTRIBUTE_UV_0).expect("kept");
            assert_eq!(uvs.len(), thin.count_vertices());
        }
    }

    #[test]
    fn a_single_leaf_is_never_lost() {
        assert_eq!(triangles(&thin_leaves(&quads(1), 0.02)), 2);
    }

    #[test]
    fn thinned_wood_has_about_the_triangles_asked_for() {
        let trunk = Cylinder::new(0.3, 8.0).mesh().resolution(64).segments(32).build();
        let thin = thin_wood(&trunk, 0.1);
        let left = triangles(&thin) as f32 / triangles(&trunk) as f32;
        assert!(left < 0.2, "{left}");
        assert!(triangles(&thin) >= 4);
    }
}
