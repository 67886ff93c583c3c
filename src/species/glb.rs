//! [`PlainTree`] → bytes of a binary glTF 2.0 file without extensions. O(n).
//!
//! Positions and normals are `f32`, colours normalised `u8` RGBA (linear, as glTF says), indices `u16` where they fit.
//! Source: Khronos glTF 2.0 specification, sections 3.6 (accessors), 3.7 (meshes) and 4.4 (GLB).

use super::{PlainPart, PlainTree};
use crate::math::bounding::Aabb;
use serde_json::{Value, json};

const MAGIC: u32 = 0x4654_6C67;
const CHUNK_JSON: u32 = 0x4E4F_534A;
const CHUNK_BINARY: u32 = 0x004E_4942;
const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;
const UNSIGNED_BYTE: u32 = 5121;
const UNSIGNED_SHORT: u32 = 5123;
const UNSIGNED_INT: u32 = 5125;
const FLOAT: u32 = 5126;

/// The binary chunk and the tables that describe it.
#[derive(Default)]
struct Writer {
    binary: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
}

impl Writer {
    /// Appends `bytes`, padded to 4, with a view and an accessor; returns the accessor's index.
    fn push(&mut self, bytes: &[u8], target: u32, mut accessor: Value) -> usize {
        accessor["bufferView"] = json!(self.views.len());
        self.views.push(json!({
            "buffer": 0,
            "byteOffset": self.binary.len(),
            "byteLength": bytes.len(),
            "target": target,
        }));
        self.binary.extend_from_slice(bytes);
        self.binary.resize(self.binary.len().next_multiple_of(4), 0);
        self.accessors.push(accessor);
        self.accessors.len() - 1
    }

    fn push_part(&mut self, part: &PlainPart, material: usize) -> Value {
        let count = part.positions.len();
        let bounds = Aabb::of(part.positions.iter().copied());
        let vectors = |list: &[bevy::math::Vec3]| -> Vec<u8> {
            list.iter().flat_map(|v| v.to_array()).flat_map(f32::to_le_bytes).collect()
        };
        let colors: Vec<u8> = part
            .colors
            .iter()
            .flatten()
            .map(|c| (c.clamp(0.0, 1.0) * 255.0).round() as u8)
            .collect();
        let positions = self.push(
            &vectors(&part.positions),
            ARRAY_BUFFER,
            json!({
                "componentType": FLOAT, "type": "VEC3", "count": count,
                "min": bounds.min.to_array(), "max": bounds.max.to_array(),
            }),
        );
        let normals = self.push(
            &vectors(&part.normals),
            ARRAY_BUFFER,
            json!({ "componentType": FLOAT, "type": "VEC3", "count": count }),
        );
        let colors = self.push(
            &colors,
            ARRAY_BUFFER,
            json!({ "componentType": UNSIGNED_BYTE, "normalized": true, "type": "VEC4", "count": count }),
        );
        let flat = part.triangles.as_flattened();
        // 65535 itself is the restart value and may not be used.
        let (bytes, component): (Vec<u8>, u32) = if count <= 65_535 {
            (flat.iter().flat_map(|&i| (i as u16).to_le_bytes()).collect(), UNSIGNED_SHORT)
        } else {
            (flat.iter().flat_map(|i| i.to_le_bytes()).collect(), UNSIGNED_INT)
        };
        let indices = self.push(
            &bytes,
            ELEMENT_ARRAY_BUFFER,
            json!({ "componentType": component, "type": "SCALAR", "count": flat.len() }),
        );
        json!({
            "attributes": { "POSITION": positions, "NORMAL": normals, "COLOR_0": colors },
            "indices": indices,
            "material": material,
        })
    }
}

/// Bytes of a GLB file with one node and mesh called `name` and a primitive and a material per part. Parts without
/// triangles are left out (glTF forbids empty accessors); a tree of none gives an empty scene.
pub fn write_glb(tree: &PlainTree, name: &str) -> Vec<u8> {
    let parts: Vec<&PlainPart> =
        tree.parts.iter().filter(|part| !part.triangles.is_empty()).collect();
    let mut writer = Writer::default();
    let primitives: Vec<Value> =
        parts.iter().enumerate().map(|(material, part)| writer.push_part(part, material)).collect();
    let materials: Vec<Value> = parts
        .iter()
        .map(|part| {
            json!({
                "name": part.name,
                "doubleSided": part.double_sided,
                "pbrMetallicRoughness": {
                    "baseColorFactor": [1.0, 1.0, 1.0, 1.0],
                    "metallicFactor": 0.0,
                    "roughnessFactor": part.roughness,
                },
            })
        })
        .collect();
    let mut document = json!({
        "asset": { "version": "2.0", "generator": "bevy_treeline" },
        "scene": 0,
        "scenes": [{ "name": name, "nodes": [] }],
    });
    if !parts.is_empty() {
        document["scenes"][0]["nodes"] = json!([0]);
        document["nodes"] = json!([{ "name": name, "mesh": 0 }]);
        document["meshes"] = json!([{ "name": name, "primitives": primitives }]);
        document["materials"] = json!(materials);
        document["buffers"] = json!([{ "byteLength": writer.binary.len() }]);
        document["bufferViews"] = json!(writer.views);
        document["accessors"] = json!(writer.accessors);
    }
    let mut text = document.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');

    let chunk = |bytes: &mut Vec<u8>, kind: u32, content: &[u8]| {
        bytes.extend((content.len() as u32).to_le_bytes());
        bytes.extend(kind.to_le_bytes());
        bytes.extend(content);
    };
    let mut bytes = Vec::with_capacity(28 + text.len() + writer.binary.len());
    bytes.extend(MAGIC.to_le_bytes());
    bytes.extend(2u32.to_le_bytes());
    bytes.extend([0; 4]); // Length, known at the end.
    chunk(&mut bytes, CHUNK_JSON, &text);
    if !writer.binary.is_empty() {
        chunk(&mut bytes, CHUNK_BINARY, &writer.binary);
    }
    let length = (bytes.len() as u32).to_le_bytes();
    bytes[8..12].copy_from_slice(&length);
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::species::{grow, preset, species_names};
    use gltf::mesh::Mode;

    #[test]
    fn the_gltf_crate_reads_back_what_was_written() {
        for name in species_names() {
            let tree = grow(&preset(name).expect("a preset"), 1, 0.0);
            let bytes = write_glb(&tree, name);
            let file = gltf::Gltf::from_slice(&bytes).expect("valid GLB");
            let blob = file.blob.as_deref().expect("a binary chunk");
            let mesh = file.meshes().next().expect("a mesh");
            assert_eq!(mesh.name(), Some(*name));
            assert_eq!(mesh.primitives().len(), tree.parts.len());
            for (primitive, part) in mesh.primitives().zip(&tree.parts) {
                assert_eq!(primitive.mode(), Mode::Triangles);
                assert_eq!(primitive.material().double_sided(), part.double_sided);
                let reader = primitive.reader(|_| Some(blob));
                let positions: Vec<[f32; 3]> =
                    reader.read_positions().expect("positions").collect();
                assert!(positions.iter().zip(&part.positions).all(|(a, b)| *a == b.to_array()));
                assert_eq!(positions.len(), part.positions.len());
                assert_eq!(reader.read_normals().expect("normals").count(), positions.len());
                let colors = reader.read_colors(0).expect("colours").into_rgba_f32();
                for (a, b) in colors.zip(&part.colors) {
                    assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() <= 0.5 / 255.0 + 1e-5));
                }
                let indices: Vec<u32> =
                    reader.read_indices().expect("indices").into_u32().collect();
                assert_eq!(indices, part.triangles.as_flattened());
                let bounds = primitive.bounding_box();
                assert!(
                    positions
                        .iter()
                        .all(|p| (0..3).all(|k| p[k] >= bounds.min[k] && p[k] <= bounds.max[k]))
                );
            }
        }
    }

    #[test]
    fn an_empty_tree_is_a_valid_file() {
        let file =
            gltf::Gltf::from_slice(&write_glb(&PlainTree::default(), "none")).expect("valid GLB");
        assert_eq!(file.meshes().count(), 0);
    }
}
