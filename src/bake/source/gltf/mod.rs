//! glTF 2.0: a `.gltf` or `.glb` → every triangle of its scene, in model space. Linear in the bytes decoded.
//!
//! `buffers` finds the bytes and decodes accessors, `material` reads materials and their images; here the scene is walked.
//! The `gltf` crate parses and validates the JSON, but trusts lengths and offsets, and a few indices: those are checked
//! before it is asked for them.

use super::check::{check, check_mesh};
use super::{Files, SourceError, SourceMesh, SourceModel, normals};
use bevy::math::{Mat3, Mat4, Quat, Vec2, Vec3, Vec4};
use buffers::Buffers;
use gltf::json::Root;
use gltf::mesh::Mode;
use gltf::{Document, Semantic, scene::Transform};
use std::borrow::Cow;
use std::collections::BTreeMap;

mod buffers;
mod material;
#[cfg(test)]
mod tests;

/// Required extensions that this reader honours, or that change nothing it reads.
const KNOWN_EXTENSIONS: [&str; 14] = [
    "KHR_lights_punctual",
    "KHR_materials_anisotropy",
    "KHR_materials_clearcoat",
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_iridescence",
    "KHR_materials_sheen",
    "KHR_materials_specular",
    "KHR_materials_transmission",
    "KHR_materials_unlit",
    "KHR_materials_variants",
    "KHR_materials_volume",
    "KHR_mesh_quantization",
    "KHR_texture_transform",
];

/// Vertices a model may have after instancing: a small file can ask for any number.
const MAX_VERTICES: usize = 1 << 26;

/// Reads a `.glb` or `.gltf`, told apart by its first bytes.
pub(super) fn parse(bytes: &[u8], files: &mut Files) -> Result<SourceModel, SourceError> {
    let file = files.file;
    let (json, bin) = split(file, bytes)?;
    let document = read_document(file, &json)?;
    let buffers = Buffers::read(&document, bin, files)?;
    let mut model = SourceModel { name: file.to_owned(), ..SourceModel::default() };
    let mut reader = SceneReader { file, buffers: &buffers, model: &mut model, vertices: 0 };
    let instances = reader.visible_meshes(&document)?;
    if instances.is_empty() {
        let problem = match document.meshes().len() {
            0 => "it has no meshes".to_owned(),
            n => format!("its scene shows none of its {n} meshes"),
        };
        return Err(SourceError::NoMesh { file: file.to_owned(), problem });
    }
    // By the index in the file (none: the default material), which stays the order in the model.
    let mut uses = BTreeMap::new();
    for instance in instances {
        for primitive in instance.mesh.primitives() {
            let Some(mesh) =
                reader.read_primitive(&instance.mesh, &primitive, instance.transform)?
            else {
                continue;
            };
            let key = primitive.material().index().unwrap_or(usize::MAX);
            let (_, users) = uses.entry(key).or_insert_with(|| (primitive.material(), Vec::new()));
            users.push(reader.model.meshes.len());
            reader.model.meshes.push(mesh);
        }
    }
    if model.meshes.is_empty() {
        let problem = "its scene has only lines and points".to_owned();
        return Err(SourceError::NoMesh { file: file.to_owned(), problem });
    }
    let mut images = material::Images::default();
    for (material, meshes) in uses.into_values() {
        let material = images.read_material(&material, &buffers, files, &mut model)?;
        for mesh in meshes {
            model.meshes[mesh].material = model.materials.len();
        }
        model.materials.push(material);
    }
    check(&mut model)?;
    Ok(model)
}

/// A [`SourceError::Malformed`].
fn malformed(file: &str, place: impl Into<String>, problem: impl Into<String>) -> SourceError {
    SourceError::Malformed { file: file.to_owned(), place: place.into(), problem: problem.into() }
}

/// JSON text and BIN chunk.
type Chunks<'a> = (Cow<'a, [u8]>, Option<Cow<'a, [u8]>>);

/// Splits a GLB; anything else is taken for JSON.
fn split<'a>(file: &str, bytes: &'a [u8]) -> Result<Chunks<'a>, SourceError> {
    if !bytes.starts_with(b"glTF") {
        return Ok((bytes.into(), None));
    }
    // Before the crate subtracts the header from this length.
    let length = bytes.get(8..12).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]));
    let (needed, available) = (u64::from(length.unwrap_or(12)), bytes.len() as u64);
    if length.is_none() || needed > available {
        let (file, place) = (file.to_owned(), "its GLB header".to_owned());
        return Err(SourceError::BufferRange { file, place, needed, available });
    }
    if needed < 20 {
        return Err(malformed(file, "its GLB header", format!("it says {needed} bytes in all")));
    }
    let glb = gltf::Glb::from_slice(bytes)
        .map_err(|e| malformed(file, "its GLB chunks", e.to_string()))?;
    Ok((glb.json, glb.bin))
}

/// Parses and validates the JSON.
fn read_document(file: &str, json: &[u8]) -> Result<Document, SourceError> {
    let mut root =
        Root::from_slice(json).map_err(|e| malformed(file, "its JSON", e.to_string()))?;
    refuse_unknown_extensions(file, &root)?;
    // The crate's own list is shorter than ours.
    root.extensions_required.clear();
    // Its validation looks positions up without asking whether they exist.
    let count = root.accessors.len();
    for (m, mesh) in root.meshes.iter().enumerate() {
        for (p, primitive) in mesh.primitives.iter().enumerate() {
            if let Some(accessor) =
                primitive.attributes.values().map(|a| a.value()).find(|&a| a >= count)
            {
                let place = format!("primitive {p} of mesh {m}");
                let problem = format!("it uses accessor {accessor}, but there are {count}");
                return Err(malformed(file, place, problem));
            }
        }
    }
    Document::from_json(root).map_err(|error| match error {
        gltf::Error::Validation(faults) => {
            let (path, fault) = &faults[0];
            let more = faults.len() - 1;
            let more = if more > 0 { format!(" ({more} more faults)") } else { String::new() };
            malformed(file, format!("JSON `{path}`"), format!("{fault}{more}").to_lowercase())
        }
        other => malformed(file, "its JSON", other.to_string()),
    })
}

fn refuse_unknown_extensions(file: &str, root: &Root) -> Result<(), SourceError> {
    let required = root.extensions_required.iter().map(String::as_str);
    let unknown: Vec<_> = required.filter(|e| !KNOWN_EXTENSIONS.contains(e)).collect();
    let has = |part: &str| unknown.iter().any(|e| e.contains(part));
    let advice = if unknown.is_empty() {
        return Ok(());
    } else if has("draco") || has("meshopt") {
        "export it without mesh compression"
    } else if has("texture") {
        "export it with PNG or JPEG textures"
    } else {
        "export it without them"
    };
    let (file, extensions) = (file.to_owned(), unknown.join(", "));
    Err(SourceError::UnsupportedExtension { file, extensions, advice })
}

/// A mesh at a node.
struct Instance<'a> {
    mesh: gltf::Mesh<'a>,
    transform: Mat4,
}

struct SceneReader<'a> {
    file: &'a str,
    buffers: &'a Buffers<'a>,
    model: &'a mut SourceModel,
    /// Vertices read so far.
    vertices: usize,
}

impl SceneReader<'_> {
    /// The meshes of the default scene (else the first, else of all nodes), depth first in the order of the file.
    fn visible_meshes<'d>(&self, document: &'d Document) -> Result<Vec<Instance<'d>>, SourceError> {
        let scene = document.default_scene().or_else(|| document.scenes().next());
        let roots: Vec<_> = match scene {
            Some(scene) => scene.nodes().collect(),
            None => {
                let mut is_child = vec![false; document.nodes().len()];
                document
                    .nodes()
                    .flat_map(|n| n.children())
                    .for_each(|n| is_child[n.index()] = true);
                document.nodes().filter(|n| !is_child[n.index()]).collect()
            }
        };
        let mut instances = Vec::new();
        let mut visited = vec![false; document.nodes().len()];
        // A stack instead of recursion: files may nest as deep as they like.
        let mut stack: Vec<_> = roots.into_iter().rev().map(|n| (n, Mat4::IDENTITY)).collect();
        while let Some((node, parent)) = stack.pop() {
            if std::mem::replace(&mut visited[node.index()], true) {
                let place = format!("node {}", node.index());
                return Err(malformed(
                    self.file,
                    place,
                    "it hangs below two nodes, or below itself",
                ));
            }
            let transform = parent * node_matrix(&node);
            if let Some(mesh) = node.mesh() {
                instances.push(Instance { mesh, transform });
            }
            let children: Vec<_> = node.children().map(|child| (child, transform)).collect();
            stack.extend(children.into_iter().rev());
        }
        Ok(instances)
    }

    /// One primitive with its node's transform applied; none if it has no triangles. The material is set later.
    fn read_primitive(
        &mut self,
        mesh: &gltf::Mesh,
        primitive: &gltf::Primitive,
        transform: Mat4,
    ) -> Result<Option<SourceMesh>, SourceError> {
        let mut name = mesh.name().map_or_else(|| format!("#{}", mesh.index()), str::to_owned);
        if mesh.primitives().len() > 1 {
            name = format!("{name}[{}]", primitive.index());
        }
        if !matches!(primitive.mode(), Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan) {
            let mode = primitive.mode();
            self.model.warnings.push(format!("mesh `{name}`: {mode:?} were skipped"));
            return Ok(None);
        }
        let mut out = SourceMesh { name, ..SourceMesh::default() };
        self.read_attributes(primitive, &mut out)?;
        let corners = match primitive.indices() {
            Some(accessor) => {
                self.buffers.indices(&accessor, &format!("indices of mesh `{}`", out.name))?
            }
            None => (0..out.positions.len() as u32).collect(),
        };
        if primitive.mode() == Mode::Triangles && !corners.len().is_multiple_of(3) {
            let name = &out.name;
            self.model.warnings.push(format!("mesh `{name}`: its last triangle is incomplete"));
        }
        out.triangles = triangles_of(primitive.mode(), &corners);
        check_mesh(self.file, &out)?;
        self.vertices += out.positions.len().max(out.triangles.len());
        if self.vertices > MAX_VERTICES {
            let (file, count) = (self.file.to_owned(), self.vertices);
            let (what, limit) = ("vertices in all its nodes", MAX_VERTICES);
            return Err(SourceError::TooMany { file, what, count, limit });
        }
        apply_transform(&mut out, transform);
        if out.normals.is_empty() {
            normals::flatten(&mut out);
        }
        Ok(Some(out))
    }

    fn read_attributes(
        &mut self,
        primitive: &gltf::Primitive,
        out: &mut SourceMesh,
    ) -> Result<(), SourceError> {
        let place = |what: &str| format!("{what} of mesh `{}`", out.name);
        let Some(positions) = primitive.get(&Semantic::Positions) else {
            return Err(malformed(self.file, place("attributes"), "there is no POSITION"));
        };
        let positions = self.buffers.vectors::<3>(&positions, &place("POSITION"), false)?;
        let mut normals = Vec::new();
        if let Some(accessor) = primitive.get(&Semantic::Normals) {
            normals = self.buffers.vectors::<3>(&accessor, &place("NORMAL"), false)?;
        }
        let mut colors = Vec::new();
        if let Some(accessor) = primitive.get(&Semantic::Colors(0)) {
            colors = self.buffers.vectors::<4>(&accessor, &place("COLOR_0"), true)?;
        }
        let mut uvs = Vec::new();
        if let Some(set) = material::texcoord_set(&primitive.material()) {
            let semantic = Semantic::TexCoords(set);
            match primitive.get(&semantic) {
                Some(accessor) => {
                    let place = place(&format!("TEXCOORD_{set}"));
                    uvs = self.buffers.vectors::<2>(&accessor, &place, false)?;
                }
                None => self.model.warnings.push(format!(
                    "mesh `{}`: it has a texture, but no TEXCOORD_{set} to place it by",
                    out.name
                )),
            }
        }
        out.positions = positions.into_iter().map(Vec3::from_array).collect();
        out.normals = normals.into_iter().map(Vec3::from_array).collect();
        out.colors = colors.into_iter().map(Vec4::from_array).collect();
        out.uvs = uvs.into_iter().map(Vec2::from_array).collect();
        Ok(())
    }
}

/// A node's own transform.
fn node_matrix(node: &gltf::Node) -> Mat4 {
    match node.transform() {
        Transform::Matrix { matrix } => Mat4::from_cols_array_2d(&matrix),
        Transform::Decomposed { translation, rotation, scale } => {
            // Exporters round, and a quaternion of another length would scale the model.
            let rotation = Quat::from_array(rotation);
            let rotation = if rotation.length_squared() > 0.0 && rotation.is_finite() {
                rotation.normalize()
            } else {
                Quat::IDENTITY
            };
            Mat4::from_translation(translation.into())
                * Mat4::from_quat(rotation)
                * Mat4::from_scale(scale.into())
        }
    }
}

/// Moves a mesh to model space. Mirroring transforms turn the winding, so that front sides stay front sides.
fn apply_transform(mesh: &mut SourceMesh, transform: Mat4) {
    for position in &mut mesh.positions {
        *position = transform.transform_point3(*position);
    }
    let linear = Mat3::from_mat4(transform);
    let largest = linear.to_cols_array().iter().fold(0.0f32, |a, b| a.max(b.abs()));
    let m = linear * if largest > 0.0 { largest.recip() } else { 1.0 };
    // Cofactors: the inverse transpose times the determinant. Unlike it they exist where a scale is zero.
    let cofactors = Mat3::from_cols(
        m.y_axis.cross(m.z_axis),
        m.z_axis.cross(m.x_axis),
        m.x_axis.cross(m.y_axis),
    );
    let is_mirrored = m.determinant() < 0.0;
    let normal_matrix = if is_mirrored { -cofactors } else { cofactors };
    for normal in &mut mesh.normals {
        *normal = normal_matrix * *normal;
    }
    if is_mirrored {
        for triangle in &mut mesh.triangles {
            triangle.swap(1, 2);
        }
    }
}

/// Triangles of a list, strip or fan (glTF 2.0 §3.7.2.1); none for other modes.
fn triangles_of(mode: Mode, corners: &[u32]) -> Vec<[u32; 3]> {
    match mode {
        Mode::Triangles => corners.chunks_exact(3).map(|c| [c[0], c[1], c[2]]).collect(),
        // Every second triangle of a strip is wound the other way.
        Mode::TriangleStrip => corners
            .windows(3)
            .enumerate()
            .map(|(i, c)| if i % 2 == 0 { [c[0], c[1], c[2]] } else { [c[0], c[2], c[1]] })
            .collect(),
        Mode::TriangleFan => corners.windows(2).skip(1).map(|c| [c[0], c[1], corners[0]]).collect(),
        _ => Vec::new(),
    }
}
