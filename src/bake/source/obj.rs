//! Wavefront OBJ: text (and its material libraries and textures) → meshes by group and material. Linear in the text.
//!
//! Polygons become fans, as all loaders do: concave ones should be triangulated by the exporter. Vertex colours after a
//! position are sRGB, as Blender and MeshLab write them. Smoothing groups are ignored; missing normals are smooth.

use super::check::check;
use super::mtl::read_materials;
use super::normals::smooth;
use super::{Files, SourceError, SourceMesh, SourceModel};
use crate::math::quantize::srgb8_to_linear;
use bevy::math::{Vec2, Vec3, Vec4};
use std::collections::HashMap;

/// Numbers of a corner's position, texture coordinate and normal, from 0; [`NONE`] where it has none.
type Corner = [u32; 3];
const NONE: u32 = u32::MAX;
const KINDS: [&str; 3] = ["vertex", "texture coordinate", "normal"];

struct Triangle {
    corners: [Corner; 3],
    /// Line number, for messages.
    line: usize,
    mesh: usize,
}

/// What the lines have said so far.
#[derive(Default)]
struct Obj {
    positions: Vec<Vec3>,
    /// Linear; one a position from the first that has one on.
    colors: Vec<Vec4>,
    uvs: Vec<Vec2>,
    normals: Vec<Vec3>,
    triangles: Vec<Triangle>,
    libraries: Vec<String>,
    /// Material names in the order of their first use.
    materials: Vec<String>,
    material_numbers: HashMap<String, usize>,
    /// Group name and material of each mesh.
    meshes: Vec<(String, usize)>,
    mesh_numbers: HashMap<(String, usize), usize>,
    group: String,
    material: Option<usize>,
    lines_and_points: usize,
}

/// Reads an OBJ file.
pub(super) fn parse(bytes: &[u8], files: &mut Files) -> Result<SourceModel, SourceError> {
    let text = String::from_utf8_lossy(bytes);
    let mut obj = Obj::default();
    let mut continued = String::new();
    for (i, line) in text.lines().enumerate() {
        // A backslash at the end joins the next line on.
        if let Some(head) = line.trim_end().strip_suffix('\\') {
            continued.push_str(head);
            continued.push(' ');
            continue;
        }
        let joined = std::mem::take(&mut continued);
        let whole = if joined.is_empty() { line.into() } else { joined + line };
        obj.read_line(i + 1, &whole).map_err(|problem| SourceError::Malformed {
            file: files.file.to_owned(),
            place: format!("line {}", i + 1),
            problem,
        })?;
    }
    obj.check_corners(files.file)?;
    if obj.triangles.is_empty() {
        let problem = match obj.lines_and_points {
            0 => format!("it has {} vertices, but no faces", obj.positions.len()),
            n => format!("it has only {n} lines and points"),
        };
        return Err(SourceError::NoMesh { file: files.file.to_owned(), problem });
    }
    let mut model = SourceModel { name: files.file.to_owned(), ..SourceModel::default() };
    if obj.lines_and_points > 0 {
        model.warnings.push(format!("{} lines and points were skipped", obj.lines_and_points));
    }
    read_materials(&obj.libraries, &obj.materials, files, &mut model)?;
    model.meshes = obj.into_meshes();
    check(&mut model)?;
    Ok(model)
}

impl Obj {
    fn read_line(&mut self, number: usize, line: &str) -> Result<(), String> {
        let line = line.trim();
        let (keyword, name) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
        let name = name.trim();
        // Names may hold a #, after numbers it starts a comment.
        let rest = name.split('#').next().unwrap_or_default();
        match keyword {
            "v" => {
                let values = read_numbers(rest, 3)?;
                self.positions.push(Vec3::from_slice(&values));
                // 3: a position, 4: and a weight (for curves), 6 or 7: and a colour.
                if values.len() >= 6 {
                    let rgb = Vec3::from_slice(&values[values.len() - 3..]);
                    let linear = rgb.to_array().map(|c| srgb8_to_linear((c * 255.0).round() as u8));
                    self.colors.resize(self.positions.len() - 1, Vec4::ONE);
                    self.colors.push(Vec3::from_array(linear).extend(1.0));
                }
            }
            "vt" => {
                let values = read_numbers(rest, 1)?;
                let v = values.get(1).copied().unwrap_or_default();
                // Rows of images run from the top.
                self.uvs.push(Vec2::new(values[0], 1.0 - v));
            }
            "vn" => self.normals.push(Vec3::from_slice(&read_numbers(rest, 3)?)),
            "f" => self.read_face(number, rest)?,
            "l" | "p" => self.lines_and_points += 1,
            "o" | "g" => self.group = name.to_owned(),
            "usemtl" => self.material = Some(self.material_number(name)),
            "mtllib" => self.libraries.push(name.replace('\\', "/")),
            _ => {}
        }
        Ok(())
    }

    fn material_number(&mut self, name: &str) -> usize {
        *self.material_numbers.entry(name.to_owned()).or_insert_with_key(|name| {
            self.materials.push(name.clone());
            self.materials.len() - 1
        })
    }

    fn read_face(&mut self, line: usize, rest: &str) -> Result<(), String> {
        let counts = [self.positions.len(), self.uvs.len(), self.normals.len()];
        let corners = rest
            .split_whitespace()
            .map(|word| read_corner(word, counts))
            .collect::<Result<Vec<Corner>, _>>()?;
        if corners.len() < 3 {
            self.lines_and_points += 1;
            return Ok(());
        }
        let material = match self.material {
            Some(material) => material,
            None => self.material_number(""),
        };
        let key = (self.group.clone(), material);
        let mesh = *self.mesh_numbers.entry(key).or_insert_with_key(|key| {
            self.meshes.push(key.clone());
            self.meshes.len() - 1
        });
        for pair in corners[1..].windows(2) {
            let corners = [corners[0], pair[0], pair[1]];
            self.triangles.push(Triangle { corners, line, mesh });
        }
        Ok(())
    }

    /// Checks what corners refer to: only at the end, as faces may come before their vertices.
    fn check_corners(&self, file: &str) -> Result<(), SourceError> {
        let counts = [self.positions.len(), self.uvs.len(), self.normals.len()];
        for triangle in &self.triangles {
            for corner in triangle.corners {
                for ((index, count), kind) in corner.into_iter().zip(counts).zip(KINDS) {
                    if index != NONE && index as usize >= count {
                        return Err(SourceError::Malformed {
                            file: file.to_owned(),
                            place: format!("line {}", triangle.line),
                            problem: format!(
                                "it uses {kind} {}, but there are {count}",
                                u64::from(index) + 1
                            ),
                        });
                    }
                }
            }
        }
        Ok(())
    }

    /// Splits the triangles into meshes with one index a vertex.
    fn into_meshes(self) -> Vec<SourceMesh> {
        // Over all groups and before seams split vertices, so that no seam shows.
        let is_normal_missing =
            self.triangles.iter().any(|t| t.corners.iter().any(|corner| corner[2] == NONE));
        let generated = if is_normal_missing {
            let positions = |t: &Triangle| t.corners.map(|corner| corner[0]);
            smooth(&self.positions, &self.triangles.iter().map(positions).collect::<Vec<_>>())
        } else {
            Vec::new()
        };
        let mut has_uvs = vec![false; self.meshes.len()];
        for triangle in &self.triangles {
            has_uvs[triangle.mesh] |= triangle.corners.iter().any(|corner| corner[1] != NONE);
        }
        let mut meshes: Vec<_> = self
            .meshes
            .into_iter()
            .map(|(name, material)| SourceMesh { name, material, ..SourceMesh::default() })
            .collect();
        let mut numbers: Vec<HashMap<Corner, u32>> = vec![HashMap::new(); meshes.len()];
        for triangle in &self.triangles {
            let mesh = &mut meshes[triangle.mesh];
            let indices = triangle.corners.map(|corner| {
                *numbers[triangle.mesh].entry(corner).or_insert_with(|| {
                    let [position, uv, normal] = corner.map(|i| i as usize);
                    mesh.positions.push(self.positions[position]);
                    let normal = self.normals.get(normal);
                    mesh.normals.push(normal.copied().unwrap_or_else(|| generated[position]));
                    if has_uvs[triangle.mesh] {
                        mesh.uvs.push(self.uvs.get(uv).copied().unwrap_or_default());
                    }
                    if !self.colors.is_empty() {
                        mesh.colors.push(self.colors.get(position).copied().unwrap_or(Vec4::ONE));
                    }
                    mesh.positions.len() as u32 - 1
                })
            });
            mesh.triangles.push(indices);
        }
        meshes
    }
}

/// All numbers of a line, at least `count`.
fn read_numbers(text: &str, count: usize) -> Result<Vec<f32>, String> {
    let values = text
        .split_whitespace()
        .map(|word| word.parse().map_err(|_| format!("`{word}` is not a number")))
        .collect::<Result<Vec<f32>, _>>()?;
    if values.len() < count {
        return Err(format!("it has {} numbers instead of {count}", values.len()));
    }
    Ok(values)
}

/// `7`, `7/2`, `7//3`, `7/2/3`, from 1, or from the last one backwards if negative.
fn read_corner(word: &str, counts: [usize; 3]) -> Result<Corner, String> {
    let mut corner = [NONE; 3];
    let parts: Vec<_> = word.split('/').collect();
    if parts.len() > 3 || parts[0].is_empty() {
        return Err(format!("`{word}` is not a corner of a face"));
    }
    for (i, part) in parts.into_iter().enumerate().filter(|(_, part)| !part.is_empty()) {
        let number: i64 =
            part.parse().map_err(|_| format!("`{word}` is not a corner of a face"))?;
        let index = if number < 0 { counts[i] as i64 + number } else { number - 1 };
        // NONE itself is no index; so many would not fit in memory anyway.
        corner[i] = u32::try_from(index).ok().filter(|&index| index != NONE).ok_or_else(|| {
            format!("`{word}` uses {} {number}, but there are {} so far", KINDS[i], counts[i])
        })?;
    }
    Ok(corner)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bake::source::{SourceAlpha, parse_model};
    use std::io;

    const TREE: &str = "# a tree\nmtllib tree.mtl\no trunk\nv 0 0 0 1 0 0\nv 1 0 0 1 0 0\nv 1 1 0 1 0 0\n\
        v 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvn 0 0 2\nusemtl bark#1\nf 1//1 2//1 3//1 4//1\n\
        usemtl leaves\nf -4/1 -3/2 \\\n -2/3 # half\nl 1 2\nusemtl bark#1\nf 1 4 3\n";

    fn read(text: &str, others: &[(&str, Vec<u8>)]) -> Result<SourceModel, SourceError> {
        parse_model("tree.obj", text.as_bytes(), &mut |path| {
            let found = others.iter().find(|(name, _)| *name == path);
            found.map(|(_, bytes)| bytes.clone()).ok_or_else(|| io::ErrorKind::NotFound.into())
        })
    }

    fn leaf_png(alpha: u8) -> Vec<u8> {
        let mut bytes = io::Cursor::new(Vec::new());
        let image = image::RgbaImage::from_pixel(2, 2, image::Rgba([0, 99, 0, alpha]));
        image.write_to(&mut bytes, image::ImageFormat::Png).unwrap();
        bytes.into_inner()
    }

    #[test]
    fn groups_materials_and_textures_are_read() {
        let library =
            b"newmtl bark#1\nKd 0.5 0.4 0.3\nnewmtl leaves\nmap_Kd C:\\tex\\leaf.png\n".to_vec();
        let others = [("tree.mtl", library), ("leaf.png", leaf_png(9))];
        let model = read(TREE, &others).unwrap();
        assert_eq!(model.meshes.len(), 2, "alternating materials do not split meshes");
        let [bark, leaves] = &model.meshes[..] else { panic!("two meshes") };
        assert_eq!((bark.triangles.len(), leaves.triangles.len()), (3, 1));
        assert_eq!(bark.name, "trunk");
        assert!(bark.uvs.is_empty());
        assert_eq!(bark.normals[0], Vec3::Z);
        assert_eq!(leaves.uvs, [Vec2::Y, Vec2::ONE, Vec2::X]);
        assert_eq!(leaves.colors[0], Vec4::new(1.0, 0.0, 0.0, 1.0));
        assert_eq!(bark.colors[3], Vec4::ONE);
        assert_eq!(model.materials[bark.material].base_color, Vec4::new(0.5, 0.4, 0.3, 1.0));
        assert!(!model.materials[bark.material].is_leaf);
        let material = &model.materials[leaves.material];
        assert_eq!((material.alpha, material.is_leaf), (SourceAlpha::Mask(0.5), true));
        assert_eq!(model.warnings, ["1 lines and points were skipped"]);

        // Other bytes in a file it refers to make another model.
        let mut others = others;
        others[1].1 = leaf_png(8);
        assert_ne!(read(TREE, &others).unwrap().content_hash, model.content_hash);
    }

    #[test]
    fn a_missing_library_is_a_warning_and_a_missing_texture_an_error() {
        let model = read(TREE, &[]).unwrap();
        assert!(model.warnings[1].contains("tree.mtl"), "{:?}", model.warnings);
        assert_eq!(model.materials[1].name, "leaves");
        assert!(model.materials[1].is_leaf && !model.materials[0].is_leaf);
        let library = b"newmtl leaves\nmap_Kd leaf.png\n".to_vec();
        let message = read(TREE, &[("tree.mtl", library)]).unwrap_err().to_string();
        assert!(message.contains("tree.obj") && message.contains("leaf.png"), "{message}");
    }

    #[test]
    fn missing_normals_are_smooth_across_groups() {
        let text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\ng a\nf 1 2 3\ng b\nf 1 3 4\n";
        let model = read(text, &[]).unwrap();
        assert_eq!(model.meshes[0].normals[0], model.meshes[1].normals[0]);
        assert!(model.meshes[0].normals[0].distance(Vec3::new(0.5, 0.0, 0.5).normalize()) < 1e-6);
    }

    #[test]
    fn faults_are_named_with_their_line() {
        for (text, part) in [
            ("v 0 0\n", "line 1: it has 2 numbers instead of 3"),
            ("v 0 0 0\nv 0 0 x\n", "line 2: `x` is not a number"),
            ("v 0 0 0\nf 1 2 3\n", "line 2: it uses vertex 2, but there are 1"),
            ("v 0 0 0\nf 1 1 -2\n", "line 2: `-2` uses vertex -2, but there are 1 so far"),
            ("v 0 0 0\nf 0 1 1\n", "line 2: `0` uses vertex 0"),
            ("v 0 0 0\nf 1/1 1/1 1/1\n", "line 2: it uses texture coordinate 1, but there are 0"),
            ("v 0 0 0\nf 1/2/3/4 1 1\n", "line 2: `1/2/3/4` is not a corner"),
            ("v 0 0 0\nf -9223372036854775808 1 1\n", "line 2"),
            ("v 0 0 0\nl 1 1\n", "only 1 lines and points"),
            ("v 0 0 0\n", "1 vertices, but no faces"),
            ("", "no faces"),
            ("v 0 0 0\nv nan 0 0\nv 0 1 0\nf 1 2 3", "NaN"),
            ("v 0 0 0\nv 1 0 0\nf 1 2 2", "zero area"),
        ] {
            let message = read(text, &[]).unwrap_err().to_string();
            assert!(message.contains("tree.obj"), "{message}");
            assert!(message.contains(part), "{message} lacks {part}");
        }
    }
}
