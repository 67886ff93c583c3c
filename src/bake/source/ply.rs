//! Stanford PLY, ascii or binary of either byte order: bytes → one mesh. Linear in the bytes.
//!
//! Polygons become fans. Vertex colours of integers are sRGB, of floats linear. The `ply-rs-bw` crate parses; the counts of
//! the header are checked against the length of the file before it reads a single element.

use super::check::{check, check_mesh};
use super::normals::smooth;
use super::{SourceError, SourceMaterial, SourceMesh, SourceModel};
use crate::math::quantize::srgb8_to_linear;
use bevy::math::{Vec3, Vec4};
use ply_rs_bw::parser::Parser;
use ply_rs_bw::ply::{
    ElementDef, Encoding, Header, Property, PropertyAccess, PropertyType, ScalarType,
};

/// Reads a PLY file.
pub(super) fn parse(bytes: &[u8], file: &str) -> Result<SourceModel, SourceError> {
    let malformed = |place: &str, problem: String| SourceError::Malformed {
        file: file.to_owned(),
        place: place.to_owned(),
        problem,
    };
    let mut rest = bytes;
    let header = Parser::<Skipped>::new()
        .read_header(&mut rest)
        .map_err(|error| malformed("its header", one_line(&error)))?;
    check_header(file, &header, rest.len())?;

    let mut vertices: Vec<Vertex> = Vec::new();
    let mut faces: Vec<Face> = Vec::new();
    for (name, element) in &header.elements {
        let read = match name.as_str() {
            "vertex" => Parser::new()
                .read_payload_for_element(&mut rest, element, &header)
                .map(|read| vertices = read),
            "face" => Parser::new()
                .read_payload_for_element(&mut rest, element, &header)
                .map(|read| faces = read),
            _ => Parser::<Skipped>::new()
                .read_payload_for_element(&mut rest, element, &header)
                .map(drop),
        };
        read.map_err(|error| malformed(&format!("element `{name}`"), one_line(&error)))?;
    }

    let mut model = SourceModel { name: file.to_owned(), ..SourceModel::default() };
    let too_small = faces.iter().filter(|face| face.0.len() < 3).count();
    if too_small > 0 {
        model.warnings.push(format!("{too_small} faces of less than three corners were skipped"));
    }
    let mut mesh = SourceMesh {
        name: "face".to_owned(),
        triangles: faces.iter().flat_map(Face::triangles).collect(),
        ..read_vertices(&vertices, &header.elements["vertex"])
    };
    check_mesh(file, &mesh)?;
    if mesh.normals.is_empty() {
        mesh.normals = smooth(&mesh.positions, &mesh.triangles);
    }
    model.meshes.push(mesh);
    model.materials.push(SourceMaterial::default());
    check(&mut model)?;
    Ok(model)
}

/// The crate's messages run over several lines.
fn one_line(error: &std::io::Error) -> String {
    error.to_string().split_whitespace().collect::<Vec<_>>().join(" ")
}

/// Checks that the header names what makes a mesh, and that `payload` bytes can hold what it counts.
fn check_header(file: &str, header: &Header, payload: usize) -> Result<(), SourceError> {
    let malformed = |problem: String| SourceError::Malformed {
        file: file.to_owned(),
        place: "its header".to_owned(),
        problem,
    };
    let Some(vertex) = header.elements.get("vertex") else {
        return Err(malformed("it has no element `vertex`".to_owned()));
    };
    if let Some(axis) = ["x", "y", "z"].into_iter().find(|&axis| !has(vertex, axis)) {
        return Err(malformed(format!("its vertices have no property `{axis}`")));
    }
    let mut needed = 0u64;
    for (name, element) in &header.elements {
        let size = element.properties.values().map(|p| least_size(header.encoding, &p.data_type));
        let size: u64 = size.sum();
        if size == 0 && element.count > 0 {
            return Err(malformed(format!("its element `{name}` has no properties")));
        }
        needed = needed.saturating_add((element.count as u64).saturating_mul(size));
    }
    // The last line may lack its end.
    let available = payload as u64 + u64::from(header.encoding == Encoding::Ascii);
    if needed > available {
        let (file, place) = (file.to_owned(), "what its header counts".to_owned());
        return Err(SourceError::BufferRange { file, place, needed, available });
    }
    match header.elements.get("face") {
        Some(face) if face.count > 0 => {
            let is_index_list =
                |name| matches!(face.properties.get(name), Some(p) if is_list(&p.data_type));
            if INDEX_NAMES.into_iter().any(is_index_list) {
                Ok(())
            } else {
                Err(malformed("its faces have no list `vertex_indices`".to_owned()))
            }
        }
        _ => Err(SourceError::PointCloud { file: file.to_owned(), vertices: vertex.count }),
    }
}

fn has(element: &ElementDef, property: &str) -> bool {
    element.properties.get(property).is_some_and(|p| !is_list(&p.data_type))
}

fn is_list(data_type: &PropertyType) -> bool {
    matches!(data_type, PropertyType::List(..))
}

/// Fewest bytes a property can take in the file.
fn least_size(encoding: Encoding, data_type: &PropertyType) -> u64 {
    let (PropertyType::Scalar(scalar) | PropertyType::List(scalar, _)) = data_type;
    match (encoding, scalar) {
        // A digit and a space or line end.
        (Encoding::Ascii, _) => 2,
        (_, ScalarType::Char | ScalarType::UChar) => 1,
        (_, ScalarType::Short | ScalarType::UShort) => 2,
        (_, ScalarType::Int | ScalarType::UInt | ScalarType::Float) => 4,
        (_, ScalarType::Double) => 8,
    }
}

/// An element that is read past.
struct Skipped;

impl PropertyAccess for Skipped {
    fn new() -> Self {
        Self
    }
}

/// What a vertex can say.
#[derive(Default)]
struct Vertex {
    position: Vec3,
    normal: Vec3,
    /// Linear.
    color: Vec4,
}

impl PropertyAccess for Vertex {
    fn new() -> Self {
        Self { color: Vec4::ONE, ..Self::default() }
    }

    fn set_property(&mut self, name: &str, property: Property) {
        match name {
            "x" => self.position.x = number(&property),
            "y" => self.position.y = number(&property),
            "z" => self.position.z = number(&property),
            "nx" => self.normal.x = number(&property),
            "ny" => self.normal.y = number(&property),
            "nz" => self.normal.z = number(&property),
            "red" => self.color.x = linear(&property),
            "green" => self.color.y = linear(&property),
            "blue" => self.color.z = linear(&property),
            "alpha" => self.color.w = fraction(&property),
            _ => {}
        }
    }
}

fn number(property: &Property) -> f32 {
    match *property {
        Property::Char(v) => f32::from(v),
        Property::UChar(v) => f32::from(v),
        Property::Short(v) => f32::from(v),
        Property::UShort(v) => f32::from(v),
        Property::Int(v) => v as f32,
        Property::UInt(v) => v as f32,
        Property::Float(v) => v,
        Property::Double(v) => v as f32,
        // Lists are told apart in the header.
        _ => 0.0,
    }
}

/// A colour component as a fraction: integers are shares of their largest value.
fn fraction(property: &Property) -> f32 {
    number(property)
        / match property {
            Property::Char(_) => f32::from(i8::MAX),
            // Many writers put bytes into wider integers.
            Property::UChar(_) | Property::Int(_) | Property::UInt(_) => f32::from(u8::MAX),
            Property::Short(_) => f32::from(i16::MAX),
            Property::UShort(_) => f32::from(u16::MAX),
            _ => 1.0,
        }
}

fn linear(property: &Property) -> f32 {
    match property {
        Property::Float(_) | Property::Double(_) => number(property),
        _ => srgb8_to_linear((fraction(property) * 255.0).round() as u8),
    }
}

fn read_vertices(vertices: &[Vertex], element: &ElementDef) -> SourceMesh {
    let has_all = |names: [&str; 3]| names.into_iter().all(|name| has(element, name));
    let mut mesh = SourceMesh {
        positions: vertices.iter().map(|v| v.position).collect(),
        ..SourceMesh::default()
    };
    if has_all(["nx", "ny", "nz"]) {
        mesh.normals = vertices.iter().map(|v| v.normal).collect();
    }
    if has_all(["red", "green", "blue"]) {
        mesh.colors = vertices.iter().map(|v| v.color).collect();
    }
    mesh
}

/// The names the corners of faces go by.
const INDEX_NAMES: [&str; 2] = ["vertex_indices", "vertex_index"];

/// Corners of a polygon.
struct Face(Vec<u32>);

impl PropertyAccess for Face {
    fn new() -> Self {
        Self(Vec::new())
    }

    fn set_property(&mut self, name: &str, property: Property) {
        if !INDEX_NAMES.contains(&name) {
            return;
        }
        fn convert<T: Copy>(values: &[T]) -> Vec<u32>
        where
            u32: TryFrom<T>,
        {
            // A negative index stays out of range, and is reported as such.
            values.iter().map(|&v| u32::try_from(v).unwrap_or(u32::MAX)).collect()
        }
        self.0 = match property {
            Property::ListInt(v) => convert(&v),
            Property::ListUInt(v) => v,
            Property::ListShort(v) => convert(&v),
            Property::ListUShort(v) => convert(&v),
            Property::ListChar(v) => convert(&v),
            Property::ListUChar(v) => convert(&v),
            Property::ListFloat(v) => v.into_iter().map(|v| v as u32).collect(),
            Property::ListDouble(v) => v.into_iter().map(|v| v as u32).collect(),
            _ => Vec::new(),
        };
    }
}

impl Face {
    fn triangles(&self) -> impl Iterator<Item = [u32; 3]> {
        self.0.windows(2).skip(1).map(|pair| [self.0[0], pair[0], pair[1]])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const QUAD: &str = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\n\
        property float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n\
        element face 2\nproperty list uchar int vertex_index\nend_header\n\
        0 0 0 255 0 188\n1 0 0 255 0 188\n1 1 0 255 0 188\n0 1 0 255 0 188\n4 0 1 2 3\n2 0 1\n";

    fn error_of(text: &str) -> String {
        parse(text.as_bytes(), "rock.ply").unwrap_err().to_string()
    }

    #[test]
    fn an_ascii_quad_with_colours_is_read() {
        let model = parse(QUAD.as_bytes(), "rock.ply").unwrap();
        let mesh = &model.meshes[0];
        assert_eq!(mesh.triangles, [[0, 1, 2], [0, 2, 3]]);
        assert_eq!(mesh.normals, [Vec3::Z; 4]);
        assert!(mesh.colors[0].distance(Vec4::new(1.0, 0.0, 0.5029, 1.0)) < 1e-3);
        assert!(model.warnings[0].contains("1 faces"), "{:?}", model.warnings);
        let crlf = QUAD.replace('\n', "\r\n");
        assert_eq!(parse(crlf.as_bytes(), "rock.ply").unwrap().meshes, model.meshes);
    }

    #[test]
    fn binary_files_of_both_byte_orders_are_read() {
        for (order, is_big) in [("binary_little_endian", false), ("binary_big_endian", true)] {
            let header = format!(
                "ply\nformat {order} 1.0\nelement extra 1\nproperty list uchar short junk\n\
                 element vertex 3\nproperty double x\nproperty float y\nproperty float z\n\
                 property float nx\nproperty float ny\nproperty float nz\n\
                 property float red\nproperty float green\nproperty float blue\n\
                 element face 1\nproperty uchar flag\nproperty list uchar uint vertex_indices\nend_header\n"
            );
            let mut bytes = header.into_bytes();
            let mut put = |little: &[u8]| {
                let mut word = little.to_vec();
                if is_big {
                    word.reverse();
                }
                bytes.extend(word);
            };
            put(&[2]);
            put(&5i16.to_le_bytes());
            put(&6i16.to_le_bytes());
            for i in 0..3u8 {
                put(&f64::from(i).to_le_bytes());
                for value in [f32::from(i * i), 0.0, 0.0, 0.0, -2.0, 0.25, 0.5, 1.0] {
                    put(&value.to_le_bytes());
                }
            }
            put(&[9]);
            put(&[3]);
            for i in 0..3u32 {
                put(&i.to_le_bytes());
            }
            let model = parse(&bytes, "rock.ply").unwrap();
            let mesh = &model.meshes[0];
            assert_eq!(mesh.positions[2], Vec3::new(2.0, 4.0, 0.0));
            assert_eq!(mesh.normals[1], -Vec3::Z);
            assert_eq!(mesh.colors[0], Vec4::new(0.25, 0.5, 1.0, 1.0));
            for end in 0..bytes.len() {
                assert!(parse(&bytes[..end], "rock.ply").is_err(), "{end} bytes were enough");
            }
        }
    }

    #[test]
    fn faults_are_named() {
        let cloud = QUAD.replace("face 2", "face 0");
        let cases = [
            (cloud.as_str(), ["point cloud", "4 vertices"]),
            (&QUAD.replace("vertex 4", "vertex 99999999999999"), ["header", "bytes"]),
            (&QUAD.replace("face 2", "face 18446744073709551615"), ["header", "bytes"]),
            (&QUAD.replace("face 2", "face 3"), ["`face`", "expected 3"]),
            (&QUAD.replace("4 0 1 2 3", "4 0 1 2 7"), ["triangle 1", "vertex 7"]),
            (&QUAD.replace("4 0 1 2 3", "4 0 1 2 -1"), ["triangle 1", "vertex 4294967295"]),
            (&QUAD.replace("1 1 0 255", "1 1e39 0 255"), ["vertex 2", "inf"]),
            (&QUAD.replace("1 1 0 255", "1 oak 0 255"), ["`vertex`", "oak"]),
            (&QUAD.replace("float x", "float a"), ["header", "`x`"]),
            (&QUAD.replace("vertex_index", "corners"), ["header", "vertex_indices"]),
            (&QUAD.replace("element vertex", "element point"), ["header", "`vertex`"]),
            (&QUAD.replace("format ascii 1.0\n", ""), ["header", "format"]),
            ("ply", ["header", "end"]),
            ("", ["header", "end"]),
        ];
        for (text, parts) in cases {
            let message = error_of(text);
            assert!(message.contains("rock.ply"), "{message}");
            for part in parts {
                assert!(message.contains(part), "{message} lacks {part}");
            }
        }
    }
}
