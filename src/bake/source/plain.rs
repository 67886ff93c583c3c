//! Grown plants → source models. O(vertices).

use super::{SourceMaterial, SourceMesh, SourceModel};
use crate::species::{PlainPart, PlainTree};
use bevy::math::Vec4;

/// The model of a grown plant: a mesh and a material for each part, colours at the vertices. `name` is for messages. Its
/// content hash is that of its vertices, so that its bake is cached like that of a file.
pub fn model_of_plain_tree(name: &str, tree: &PlainTree) -> SourceModel {
    let parts: Vec<_> = tree.parts.iter().filter(|part| !part.triangles.is_empty()).collect();
    let meshes = parts.iter().enumerate().map(|(material, part)| SourceMesh {
        name: part.name.clone(),
        positions: part.positions.clone(),
        normals: part.normals.clone(),
        uvs: vec![],
        colors: part.colors.iter().map(|color| Vec4::from_array(*color)).collect(),
        triangles: part.triangles.clone(),
        material,
    });
    let materials = parts.iter().map(|part| SourceMaterial {
        name: part.name.clone(),
        double_sided: part.double_sided,
        perceptual_roughness: part.roughness,
        // As for files: what is seen from both sides is foliage.
        is_leaf: part.double_sided,
        // Bent to the light; turned to the eye they would sprinkle the crown with dark leaves.
        keeps_normals: part.double_sided,
        ..SourceMaterial::default()
    });
    SourceModel {
        name: name.to_owned(),
        meshes: meshes.collect(),
        materials: materials.collect(),
        content_hash: content_hash(&parts),
        ..SourceModel::default()
    }
}

/// BLAKE3 of everything that a bake reads. The vertices, not the parameters: a better generator means another tree.
fn content_hash(parts: &[&PlainPart]) -> [u8; 32] {
    let mut hasher = blake3::Hasher::new();
    hasher.update(b"bevy_treeline plant");
    for part in parts {
        for text in [part.name.as_bytes(), &[u8::from(part.double_sided)]] {
            hasher.update(&(text.len() as u64).to_le_bytes()).update(text);
        }
        hasher.update(&part.roughness.to_le_bytes());
        for count in [part.positions.len(), part.triangles.len()] {
            hasher.update(&(count as u64).to_le_bytes());
        }
        let vectors = part.positions.iter().chain(&part.normals).flat_map(|v| v.to_array());
        let numbers: Vec<u8> = vectors
            .chain(part.colors.iter().copied().flatten())
            .flat_map(f32::to_le_bytes)
            .chain(part.triangles.iter().flatten().flat_map(|i| i.to_le_bytes()))
            .collect();
        hasher.update(&numbers);
    }
    *hasher.finalize().as_bytes()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bake::near_mesh_sources;
    use crate::species::{grow, preset};

    #[test]
    fn a_grown_plant_becomes_a_model_with_all_of_its_triangles() {
        let tree = grow(&preset("flower").expect("a preset"), 1, 0.0);
        let model = model_of_plain_tree("flower", &tree);
        assert_eq!(model.triangle_count(), tree.triangle_count());
        assert_eq!(model.materials.len(), 2);
        assert!(model.materials.iter().all(|m| m.is_leaf && m.double_sided));
        assert!(model.meshes.iter().all(|m| m.colors.len() == m.positions.len()));
        let near = near_mesh_sources(&model, true);
        assert_eq!(near.len(), 2);
    }

    #[test]
    fn the_hash_is_that_of_the_plant_not_of_its_name() {
        let flower = |seed| grow(&preset("flower").expect("a preset"), seed, 0.0);
        let hash = |name, seed| model_of_plain_tree(name, &flower(seed)).content_hash;
        assert_eq!(hash("a", 1), hash("b", 1));
        assert_ne!(hash("a", 1), hash("a", 2));
        assert_ne!(hash("a", 1), [0; 32]);
    }

    #[test]
    fn wood_is_no_leaf() {
        let model = model_of_plain_tree("oak", &grow(&preset("oak").expect("a preset"), 1, 0.0));
        let leaf: Vec<_> = model.materials.iter().map(|m| (m.name.as_str(), m.is_leaf)).collect();
        assert_eq!(leaf, [("bark", false), ("leaves", true)]);
    }
}
