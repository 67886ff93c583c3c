//! Source models: any triangle mesh with base colours, read from a file or from entities of a running game.
//!
//! In: a `.glb`, `.gltf`, `.obj` or `.ply` file and what it refers to. Out: [`SourceModel`], plain data with every node
//! transform applied. Polygon soups are fine. Cost: linear in the bytes read.
//!
//! One reader a format (`gltf`, `obj`, `ply`), each ends in [`check()`]; `images` decodes textures, `normals` makes missing
//! normals, `leaf` tells foliage from wood, `measure` gives areas and bounds; `plain` takes grown plants.

use bevy::math::{Mat3, Vec2, Vec3, Vec4};
use std::io;
use std::path::Path;

mod check;
mod error;
mod gltf;
pub mod images;
pub mod leaf;
mod measure;
mod mtl;
pub mod normals;
mod obj;
mod plain;
mod ply;
mod uri;

#[cfg(test)]
mod data_tests;

pub use check::check;
pub use error::SourceError;
pub use plain::model_of_plain_tree;

/// Extensions of the files that can be read, in lower case.
pub const EXTENSIONS: [&str; 4] = ["glb", "gltf", "obj", "ply"];

/// How a material uses alpha.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SourceAlpha {
    /// Alpha is ignored.
    Opaque,
    /// Fragments with alpha below the cut-off are holes. Blended materials are read as `Mask(0.5)`, with a warning.
    Mask(f32),
}

/// Texture coordinate wrapping on one axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SourceWrap {
    /// Tiles.
    Repeat,
    /// Tiles, every second one mirrored.
    MirroredRepeat,
    /// Clamps to the edge texel.
    ClampToEdge,
}

/// A use of an image as a base colour texture.
#[derive(Clone, Debug, PartialEq)]
pub struct SourceTexture {
    /// Index into [`SourceModel::images`].
    pub image: usize,
    /// Wrapping along u and v.
    pub wrap: [SourceWrap; 2],
    /// Nearest texel instead of bilinear.
    pub nearest: bool,
    /// Applied to texture coordinates (KHR_texture_transform); identity if absent.
    pub uv_transform: Mat3,
}

/// An image decoded to 8-bit sRGB with straight alpha.
#[derive(Clone, Debug, PartialEq)]
pub struct SourceImage {
    /// Pixels, ≥ 1.
    pub width: u32,
    /// Pixels, ≥ 1.
    pub height: u32,
    /// `width * height * 4` bytes, rows from the top.
    pub rgba8: Vec<u8>,
}

/// What a surface looks like: the part of PBR that points keep.
#[derive(Clone, Debug, PartialEq)]
pub struct SourceMaterial {
    /// Name in the file, for messages.
    pub name: String,
    /// Linear base colour factor.
    pub base_color: Vec4,
    /// Multiplied with the factor.
    pub base_color_texture: Option<SourceTexture>,
    /// Opaque or masked.
    pub alpha: SourceAlpha,
    /// Seen from both sides when drawn. Peeling never culls faces, whatever this says.
    pub double_sided: bool,
    /// Drawn without light.
    pub unlit: bool,
    /// 0 to 1.
    pub perceptual_roughness: f32,
    /// 0 to 1.
    pub metallic: f32,
    /// Foliage (masked, two-sided or named so), not wood.
    pub is_leaf: bool,
    /// Normals light both sides as they are, as those of leaves that are bent to the outside of the crown; else they are
    /// turned to the side that is seen. glTF has no such thing.
    pub keeps_normals: bool,
}

impl Default for SourceMaterial {
    fn default() -> Self {
        Self {
            name: String::new(),
            base_color: Vec4::ONE,
            base_color_texture: None,
            alpha: SourceAlpha::Opaque,
            double_sided: false,
            unlit: false,
            perceptual_roughness: 1.0,
            metallic: 0.0,
            is_leaf: false,
            keeps_normals: false,
        }
    }
}

/// Triangles of one material.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SourceMesh {
    /// Name in the file, for messages.
    pub name: String,
    /// Model space (node transforms applied).
    pub positions: Vec<Vec3>,
    /// Unit, one a vertex (generated where the file has none).
    pub normals: Vec<Vec3>,
    /// Texture coordinates, one a vertex, or empty.
    pub uvs: Vec<Vec2>,
    /// Linear vertex colours, one a vertex, or empty.
    pub colors: Vec<Vec4>,
    /// Triangles; every index is below `positions.len()`.
    pub triangles: Vec<[u32; 3]>,
    /// Index into [`SourceModel::materials`].
    pub material: usize,
}

/// A whole model.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SourceModel {
    /// File name or entity name, for messages.
    pub name: String,
    /// One per primitive of every node.
    pub meshes: Vec<SourceMesh>,
    /// At least one if there are meshes.
    pub materials: Vec<SourceMaterial>,
    /// Decoded textures.
    pub images: Vec<SourceImage>,
    /// What was read differently from how the file says it (blended materials, skipped lines and points).
    pub warnings: Vec<String>,
    /// BLAKE3 of every byte read, external buffers and images included, or of a grown plant's vertices; all zero if from
    /// neither.
    pub content_hash: [u8; 32],
}

/// The bytes of one model: what its file refers to is read through this, so that all of it is hashed, in order.
struct Files<'a> {
    /// The model's file, for messages.
    file: &'a str,
    hasher: blake3::Hasher,
    read: &'a mut dyn FnMut(&str) -> io::Result<Vec<u8>>,
}

impl Files<'_> {
    /// Reads a file by its path relative to the model.
    fn fetch(&mut self, reference: &str) -> io::Result<Vec<u8>> {
        let bytes = (self.read)(reference)?;
        self.hasher.update(&bytes);
        Ok(bytes)
    }

    /// [`Files::fetch`] for a file without which the model cannot be read.
    fn require(&mut self, reference: &str) -> Result<Vec<u8>, SourceError> {
        self.fetch(reference).map_err(|source| SourceError::ReadReferenced {
            file: self.file.to_owned(),
            reference: reference.to_owned(),
            source,
        })
    }
}

/// Reads a model and the files it refers to, which are looked for relative to its folder.
///
/// # Errors
/// Any [`SourceError`]: unreadable or malformed files, unknown formats, models without triangles.
pub fn load_model(path: &Path) -> Result<SourceModel, SourceError> {
    let name = path.display().to_string();
    // Before its extension is looked at: a folder has none, and converting it is no good advice.
    if path.is_dir() {
        let source = io::ErrorKind::IsADirectory.into();
        return Err(SourceError::Read { file: name, source });
    }
    // Before reading: no need to load a video to learn that it is no model.
    kind_of(&name)?;
    let bytes =
        std::fs::read(path).map_err(|source| SourceError::Read { file: name.clone(), source })?;
    let folder = path.parent().unwrap_or(Path::new(""));
    let mut model =
        parse_model(&name, &bytes, &mut |reference| std::fs::read(folder.join(reference)))?;
    if let Some(file_name) = path.file_name() {
        model.name = file_name.to_string_lossy().into_owned();
    }
    Ok(model)
}

/// Reads a model from `bytes`; `name` says its format by its extension, and names it in messages. `read` is asked for
/// the files it refers to (buffers, textures, material libraries), by their decoded paths relative to the model.
///
/// # Errors
/// As [`load_model`].
pub fn parse_model(
    name: &str,
    bytes: &[u8],
    read: &mut dyn FnMut(&str) -> io::Result<Vec<u8>>,
) -> Result<SourceModel, SourceError> {
    let kind = kind_of(name)?;
    let mut hasher = blake3::Hasher::new();
    hasher.update(bytes);
    let mut files = Files { file: name, hasher, read };
    let mut model = match kind {
        "obj" => obj::parse(bytes, &mut files)?,
        "ply" => ply::parse(bytes, name)?,
        _ => gltf::parse(bytes, &mut files)?,
    };
    model.content_hash = *files.hasher.finalize().as_bytes();
    Ok(model)
}

/// The entry of [`EXTENSIONS`] that `name` ends in.
fn kind_of(name: &str) -> Result<&'static str, SourceError> {
    let extension = Path::new(name).extension().unwrap_or_default().to_string_lossy();
    EXTENSIONS
        .into_iter()
        .find(|known| extension.eq_ignore_ascii_case(known))
        .ok_or_else(|| SourceError::UnknownKind { file: name.to_owned() })
}
