//! Hand-made files: what is read, and what is refused with which words.

use super::super::{SourceAlpha, SourceError, SourceModel, SourceWrap, parse_model};
use bevy::math::{Vec2, Vec3, Vec4};
use std::io;

/// A GLB of `json` and `bin`.
fn glb(json: &str, bin: &[u8]) -> Vec<u8> {
    let pad = |bytes: &[u8], fill: u8| {
        let mut bytes = bytes.to_vec();
        bytes.resize(bytes.len().next_multiple_of(4), fill);
        bytes
    };
    let (json, bin) = (pad(json.as_bytes(), b' '), pad(bin, 0));
    let mut out = b"glTF".to_vec();
    let mut put = |number: usize| out.extend((number as u32).to_le_bytes());
    put(2);
    put(28 + json.len() + bin.len());
    put(json.len());
    out.extend(b"JSON");
    out.extend(&json);
    out.extend((bin.len() as u32).to_le_bytes());
    out.extend(b"BIN\0");
    out.extend(&bin);
    out
}

fn read(json: &str, bin: &[u8]) -> Result<SourceModel, SourceError> {
    parse_model("oak.glb", &glb(json, bin), &mut |_| Err(io::ErrorKind::NotFound.into()))
}

fn floats(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

/// Four corners of a unit square in the plane of X and Y.
fn square() -> Vec<u8> {
    floats(&[0., 0., 0., 1., 0., 0., 1., 1., 0., 0., 1., 0.])
}

/// JSON with the square's positions in view 0 and a mesh with one primitive. The parts are inserted as they are.
struct Parts {
    root: &'static str,
    node: &'static str,
    primitive: &'static str,
    accessors: &'static str,
    views: &'static str,
    length: usize,
}

const PLAIN: Parts =
    Parts { root: "", node: "", primitive: "", accessors: "", views: "", length: 48 };

impl Parts {
    fn json(&self) -> String {
        let Self { root, node, primitive, accessors, views, length } = self;
        format!(
            r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0]}}],
            "nodes":[{{"mesh":0{node}}}],
            "meshes":[{{"name":"crown","primitives":[{{"attributes":{{"POSITION":0{primitive}}}]}}],
            "accessors":[{{"bufferView":0,"componentType":5126,"count":4,"type":"VEC3",
            "min":[0,0,0],"max":[1,1,0]}}{accessors}],
            "bufferViews":[{{"buffer":0,"byteLength":48}}{views}],
            "buffers":[{{"byteLength":{length}}}]{root}}}"#
        )
    }
}

const FAN: &str = r#"},"mode":6"#;
const STRIP: &str = r#"},"mode":5"#;
const END: &str = "}";

#[test]
fn strips_fans_and_lists_give_the_same_square_with_flat_normals() {
    for (primitive, count) in [(FAN, 2), (STRIP, 2), (END, 1)] {
        let mut bin = square();
        if primitive == STRIP {
            // Strips zigzag.
            bin[24..].rotate_left(12);
        }
        let model = read(&Parts { primitive, ..PLAIN }.json(), &bin).unwrap();
        let mesh = &model.meshes[0];
        assert_eq!((mesh.triangles.len(), mesh.positions.len()), (count, 3 * count));
        assert_eq!(mesh.name, "crown");
        assert_eq!(model.surface_area(), 0.5 * count as f32);
        assert!(mesh.normals.iter().all(|n| *n == Vec3::Z), "{primitive} turned a triangle");
        assert_eq!(model.materials[0].name, "default");
    }
    let mixed = read(&Parts { primitive: END, ..PLAIN }.json(), &square()).unwrap();
    assert_eq!(mixed.warnings, ["mesh `crown`: its last triangle is incomplete"]);
}

#[test]
fn mirrored_and_scaled_nodes_keep_their_front_sides_and_normals() {
    let accessors = r#",{"bufferView":1,"componentType":5126,"count":4,"type":"VEC3"}"#;
    let views = r#",{"buffer":0,"byteOffset":48,"byteLength":48}"#;
    let primitive = r#","NORMAL":1},"mode":6"#;
    let node = r#","scale":[-2,1,0.5],"translation":[0,0,3]"#;
    let parts = Parts { node, primitive, accessors, views, length: 96, ..PLAIN };
    let slanted = Vec3::new(1.0, 0.0, 1.0);
    let mut bin = square();
    bin.extend(floats(&[slanted; 4].map(|n| n.to_array()).concat()));
    let model = read(&parts.json(), &bin).unwrap();
    let mesh = &model.meshes[0];
    assert_eq!(mesh.positions[2], Vec3::new(-2.0, 1.0, 3.0));
    assert!(mesh.normals[0].distance(Vec3::new(-0.5, 0.0, 2.0).normalize()) < 1e-6);
    let face = super::normals::face_normal(mesh.corners(0)).unwrap();
    assert_eq!(face, Vec3::Z, "the winding is turned with the mirror");
}

#[test]
fn sparse_quantised_and_interleaved_accessors_are_decoded() {
    // Positions: sparse over zeros. UVs: normalised bytes 4 apart. Colours: normalised shorts, three of four components.
    let json = r#"{"asset":{"version":"2.0"},"nodes":[{"mesh":0}],
        "extensionsUsed":["KHR_mesh_quantization"],"extensionsRequired":["KHR_mesh_quantization"],
        "materials":[{"pbrMetallicRoughness":{"baseColorTexture":{"index":0,"texCoord":1}}}],
        "textures":[{"source":0}],"images":[{"uri":"URI"}],
        "meshes":[{"primitives":[{"attributes":{"POSITION":0,"TEXCOORD_1":1,"COLOR_0":2},"material":0}]}],
        "accessors":[
        {"componentType":5122,"count":3,"type":"VEC3","min":[0,0,0],"max":[7,7,7],
         "sparse":{"count":2,"indices":{"bufferView":0,"componentType":5121},"values":{"bufferView":1}}},
        {"bufferView":2,"componentType":5121,"normalized":true,"count":3,"type":"VEC2"},
        {"bufferView":3,"componentType":5123,"normalized":true,"count":3,"type":"VEC3"}],
        "bufferViews":[{"buffer":0,"byteLength":2},{"buffer":0,"byteOffset":2,"byteLength":12},
        {"buffer":0,"byteOffset":14,"byteLength":10,"byteStride":4},{"buffer":0,"byteOffset":24,"byteLength":18}],
        "buffers":[{"byteLength":42}]}"#;
    let png = {
        let mut bytes = io::Cursor::new(Vec::new());
        image::GrayImage::new(1, 1).write_to(&mut bytes, image::ImageFormat::Png).unwrap();
        bytes.into_inner()
    };
    let percent: String = png.iter().map(|b| format!("%{b:02x}")).collect();
    let json = json.replace("URI", &format!("data:image/jpeg,{percent}"));
    let mut bin = vec![1, 2];
    bin.extend([7i16, 0, 0, 0, -5, 0].map(|v| v.to_le_bytes()).concat());
    bin.extend([0u8, 255, 9, 9, 51, 0, 9, 9, 255, 255]);
    bin.extend([0u16, 65535, 13107].repeat(3).iter().flat_map(|v| v.to_le_bytes()));
    let model = read(&json, &bin).unwrap();
    let mesh = &model.meshes[0];
    assert_eq!(mesh.positions, [Vec3::ZERO, Vec3::X * 7.0, Vec3::Y * -5.0]);
    assert_eq!(mesh.uvs, [Vec2::Y, Vec2::new(0.2, 0.0), Vec2::ONE]);
    assert_eq!(mesh.colors[1], Vec4::new(0.0, 1.0, 0.2, 1.0));
    assert_eq!(model.images[0].rgba8, [0, 0, 0, 255]);
}

#[test]
fn materials_say_what_they_look_like() {
    let root = r#","materials":[{"name":"Leaf","doubleSided":true,"alphaMode":"BLEND",
        "extensions":{"KHR_materials_unlit":{}},
        "pbrMetallicRoughness":{"baseColorFactor":[0.1,0.2,0.3,0.9],"roughnessFactor":0.25,"metallicFactor":0.5,
        "baseColorTexture":{"index":0,"extensions":{"KHR_texture_transform":
        {"offset":[0.5,0],"rotation":1.5707963,"scale":[2,3],"texCoord":1}}}}}],
        "textures":[{"source":0,"sampler":0}],"samplers":[{"magFilter":9728,"wrapS":33071,"wrapT":33648}],
        "images":[{"uri":"leaf%20a.png"}]"#;
    let primitive = r#","TEXCOORD_1":1},"mode":6,"material":0"#;
    let accessors = r#",{"bufferView":0,"componentType":5126,"count":4,"type":"VEC2"}"#;
    let parts = Parts { root, primitive, accessors, ..PLAIN };
    let mut asked = Vec::new();
    let mut png = io::Cursor::new(Vec::new());
    image::RgbImage::new(2, 1).write_to(&mut png, image::ImageFormat::Png).unwrap();
    let model = parse_model("oak.GLB", &glb(&parts.json(), &square()), &mut |path| {
        asked.push(path.to_owned());
        Ok(png.get_ref().clone())
    })
    .unwrap();
    assert_eq!(asked, ["leaf a.png"]);
    let material = &model.materials[0];
    assert_eq!((material.alpha, material.unlit), (SourceAlpha::Mask(0.5), true));
    assert!(material.double_sided && material.is_leaf);
    assert_eq!((material.perceptual_roughness, material.metallic), (0.25, 0.5));
    assert_eq!(material.base_color, Vec4::new(0.1, 0.2, 0.3, 0.9));
    let texture = material.base_color_texture.as_ref().unwrap();
    assert_eq!(texture.wrap, [SourceWrap::ClampToEdge, SourceWrap::MirroredRepeat]);
    assert!(texture.nearest);
    // Scaled, then a quarter turn counter-clockwise as seen (v down), then moved.
    let uv = texture.uv_transform.transform_point2(Vec2::new(1.0, 0.0));
    assert!(uv.distance(Vec2::new(0.5, -2.0)) < 1e-5, "{uv}");
    assert_eq!(model.warnings, ["material `Leaf`: blended alpha was read as a mask at 0.5"]);
}

#[test]
fn nodes_of_the_default_scene_are_read_and_no_others() {
    let count = |scene: &str, children: &str| {
        let nodes =
            format!(r#""nodes":[{{"mesh":0{children}}},{{"mesh":0,"translation":[5,0,0]}}]"#);
        let json = Parts { primitive: END, ..PLAIN }
            .json()
            .replace(r#""scene":0,"scenes":[{"nodes":[0]}],"#, scene)
            .replace(r#""nodes":[{"mesh":0}]"#, &nodes);
        read(&json, &square()).map(|model| model.meshes.len())
    };
    let both = r#""scene":1,"scenes":[{"nodes":[0]},{"nodes":[0,1]}],"#;
    assert_eq!(count(both, "").unwrap(), 2);
    assert_eq!(count(r#""scenes":[{"nodes":[1]}],"#, "").unwrap(), 1);
    assert_eq!(count("", "").unwrap(), 2);
    assert_eq!(count("", r#","children":[1]"#).unwrap(), 2);
    let nothing = count(r#""scenes":[{"nodes":[]}],"#, "").unwrap_err().to_string();
    assert!(nothing.contains("shows none of its 1 meshes"), "{nothing}");
    let cycle = count(both, r#","children":[1]"#).unwrap_err().to_string();
    assert!(cycle.contains("node 1") && cycle.contains("itself"), "{cycle}");
}

#[test]
fn broken_files_are_refused_with_the_place_of_the_fault() {
    let index = r#"},"mode":4,"indices":1"#;
    let indices = r#",{"bufferView":1,"componentType":5121,"count":3,"type":"SCALAR"}"#;
    let index_view = r#",{"buffer":0,"byteOffset":48,"byteLength":3}"#;
    let indexed =
        Parts { primitive: index, accessors: indices, views: index_view, length: 51, ..PLAIN };
    let plain = Parts { primitive: END, ..PLAIN };
    let mut with_indices = square();
    with_indices.extend([0, 1, 9]);
    let nan: Vec<u8> = square()[..44].iter().copied().chain(f32::NAN.to_le_bytes()).collect();
    let texture = Parts {
        root: r#","materials":[{"pbrMetallicRoughness":{"baseColorTexture":{"index":0}}}],
            "textures":[{"source":0}],"images":[{"name":"bark","uri":"bark.png"}]"#,
        primitive: r#"},"mode":6,"material":0"#,
        ..PLAIN
    };
    let json = plain.json();
    let draco = json.replace(
        r#""scene":0"#,
        r#""extensionsRequired":["KHR_texture_transform","KHR_draco_mesh_compression"],"scene":0"#,
    );
    let cases: [(String, &[u8], &[&str]); 20] = [
        (json.clone(), &square()[..40], &["buffer 0", "48 bytes", "there are 40"]),
        (
            json.replace(r#""byteLength":48}]"#, r#""byteLength":40}]"#),
            &square(),
            &["POSITION of mesh `crown`", "48", "40"],
        ),
        (
            json.replace(r#""count":4"#, r#""count":99999999999999999"#),
            &square(),
            &["POSITION of mesh `crown`"],
        ),
        (
            json.replace(r#""count":4"#, r#""count":4,"byteOffset":18446744073709551615"#),
            &square(),
            &["POSITION of mesh `crown`"],
        ),
        (
            json.replace(r#"{"buffer":0,"#, r#"{"buffer":0,"byteStride":4,"#),
            &square(),
            &["POSITION of mesh `crown`", "4 bytes apart"],
        ),
        (json.replace("VEC3", "VEC2"), &square(), &["POSITION of mesh `crown`", "Vec2"]),
        (
            json.replace(r#""POSITION":0"#, r#""POSITION":7"#),
            &square(),
            &["mesh 0", "accessor 7", "there are 1"],
        ),
        (
            json.replace(r#""mesh":0"#, r#""mesh":3"#),
            &square(),
            &["nodes[0].mesh", "out of bounds"],
        ),
        (json.replace(r#""count":4"#, r#""count":0"#), &square(), &["no triangles"]),
        (indexed.json(), &with_indices, &["crown", "triangle 0", "vertex 9", "there are 4"]),
        (
            indexed
                .json()
                .replace("5121", "5126")
                .replace(r#""byteLength":3}"#, r#""byteLength":4}"#),
            &with_indices,
            &["indices of mesh", "F32"],
        ),
        (json.clone(), &nan, &["crown", "vertex 3", "NaN"]),
        (json.clone(), &[0; 48], &["zero area"]),
        (draco, &square(), &["KHR_draco_mesh_compression", "without mesh compression"]),
        (
            json.replace(r#""attributes""#, r#""mode":1,"attributes""#),
            &square(),
            &["only lines and points"],
        ),
        (
            json.replace(r#""buffers":[{"#, r#""buffers":[{"uri":"oak.bin","#),
            &square(),
            &["refers to `oak.bin`", "not found"],
        ),
        (
            json.replace(r#""buffers":[{"#, r#""buffers":[{"uri":"https://a.b/c","#),
            &square(),
            &["buffer 0", "https://a.b/c"],
        ),
        (texture.json(), &square(), &["image 0 (`bark`)", "file `bark.png`", "not found"]),
        ("{".to_owned(), &square(), &["its JSON", "line 1"]),
        (r#"{"asset":{"version":"2.0"}}"#.to_owned(), &[], &["no mesh"]),
    ];
    for (json, bin, parts) in cases {
        let message = read(&json, bin).unwrap_err().to_string();
        for part in ["oak.glb"].iter().chain(parts) {
            assert!(message.contains(part), "{message} lacks {part}");
        }
    }
    let whole = glb(&json, &square());
    for (bytes, part) in [
        (&whole[..11], "GLB header"),
        (&whole[..whole.len() - 1], "GLB header"),
        (b"glTF\x02\0\0\0\0\0\0\0".as_slice(), "0 bytes in all"),
        (b"glTF\x01\0\0\0\x14\0\0\0aaaaaaaa".as_slice(), "version"),
        (b"".as_slice(), "its JSON"),
        (b"Kaydara FBX Binary".as_slice(), "its JSON"),
    ] {
        let result = parse_model("oak.glb", bytes, &mut |_| Err(io::ErrorKind::NotFound.into()));
        let message = result.unwrap_err().to_string();
        assert!(message.contains(part) && message.contains("oak.glb"), "{message} lacks {part}");
    }
}
