//! GLB files by hand: sound ones, and ones with a single fault.

use serde_json::{Value, json};

/// A mesh of triangles with an optional texture, not checked in any way.
pub struct Glb {
    pub positions: Vec<[f32; 3]>,
    pub indices: Vec<u32>,
    /// glTF material; the texture, if there is one, is added as its base colour.
    pub material: Value,
    /// Bytes of an image file.
    pub texture: Option<Vec<u8>>,
}

impl Glb {
    /// A square of 2 × 2 units that leans against the axes.
    pub fn square() -> Self {
        Self {
            positions: vec![[-1.0, 0.0, 0.0], [1.0, 0.0, 0.3], [1.0, 2.0, 0.4], [-1.0, 2.0, 0.1]],
            indices: vec![0, 1, 2, 0, 2, 3],
            material: json!({}),
            texture: None,
        }
    }

    /// The file.
    pub fn bytes(&self) -> Vec<u8> {
        let count = self.positions.len();
        let mut binary: Vec<u8> =
            self.positions.iter().flatten().flat_map(|v| v.to_le_bytes()).collect();
        let positions = binary.len();
        binary.extend(self.indices.iter().flat_map(|i| i.to_le_bytes()));
        let mut views = vec![
            json!({ "buffer": 0, "byteOffset": 0, "byteLength": positions }),
            json!({ "buffer": 0, "byteOffset": positions, "byteLength": binary.len() - positions }),
        ];
        let mut accessors = vec![
            // The bounds are the square's, whatever lies in it.
            json!({ "bufferView": 0, "componentType": 5126, "type": "VEC3", "count": count,
                    "min": [-1.0, 0.0, 0.0], "max": [1.0, 2.0, 0.4] }),
            json!({ "bufferView": 1, "componentType": 5125, "type": "SCALAR", "count": self.indices.len() }),
        ];
        let mut attributes = json!({ "POSITION": 0 });
        let mut material = self.material.clone();
        let mut root = json!({
            "asset": { "version": "2.0" }, "scene": 0, "scenes": [{ "nodes": [0] }], "nodes": [{ "mesh": 0 }],
        });
        if let Some(texture) = &self.texture {
            let start = binary.len();
            let uvs = (0..count).flat_map(|i| [(i % 2) as f32, (i / 2 % 2) as f32]);
            binary.extend(uvs.flat_map(f32::to_le_bytes));
            views.push(json!({ "buffer": 0, "byteOffset": start, "byteLength": count * 8 }));
            accessors.push(
                json!({ "bufferView": 2, "componentType": 5126, "type": "VEC2", "count": count }),
            );
            attributes["TEXCOORD_0"] = json!(2);
            views.push(
                json!({ "buffer": 0, "byteOffset": binary.len(), "byteLength": texture.len() }),
            );
            binary.extend(texture);
            root["images"] = json!([{ "bufferView": 3, "mimeType": "image/png" }]);
            root["textures"] = json!([{ "source": 0 }]);
            material["pbrMetallicRoughness"]["baseColorTexture"] = json!({ "index": 0 });
        }
        root["buffers"] = json!([{ "byteLength": binary.len() }]);
        root["bufferViews"] = json!(views);
        root["accessors"] = json!(accessors);
        root["materials"] = json!([material]);
        let primitive = json!({ "attributes": attributes, "indices": 1, "material": 0 });
        root["meshes"] = json!([{ "name": "square", "primitives": [primitive] }]);
        container(&root, &binary)
    }
}

/// A GLB of this JSON and these bytes (no BIN chunk if there are none).
pub fn container(json: &Value, binary: &[u8]) -> Vec<u8> {
    let chunk = |kind: &[u8; 4], bytes: &[u8], filler: u8| {
        let mut padded = bytes.to_vec();
        padded.resize(bytes.len().next_multiple_of(4), filler);
        [&(padded.len() as u32).to_le_bytes()[..], kind, &padded].concat()
    };
    let mut chunks = chunk(b"JSON", json.to_string().as_bytes(), b' ');
    if !binary.is_empty() {
        chunks.extend(chunk(b"BIN\0", binary, 0));
    }
    let length = 12 + chunks.len() as u32;
    [b"glTF", &2u32.to_le_bytes()[..], &length.to_le_bytes(), &chunks].concat()
}

/// A sound PNG of 4 × 4 pixels.
pub fn png() -> Vec<u8> {
    let mut bytes = std::io::Cursor::new(vec![]);
    let image = image::RgbaImage::from_pixel(4, 4, image::Rgba([40, 160, 30, 255]));
    image.write_to(&mut bytes, image::ImageFormat::Png).expect("a small image");
    bytes.into_inner()
}
