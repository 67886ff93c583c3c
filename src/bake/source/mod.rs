//! Source models: any triangle mesh with base colours, read from a file or from entities of a running game.
//!
//! Out: [`SourceModel`], plain data with every node transform applied. Polygon soups are fine.

use bevy::math::{Mat3, Vec2, Vec3, Vec4};

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
    /// BLAKE3 of every byte read, external buffers and images included; all zero if not from a file.
    pub content_hash: [u8; 32],
}
