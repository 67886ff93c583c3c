//! What can be wrong with a source model. Every message names the file, the place in it, and a way out.

use super::EXTENSIONS;

/// Why a model could not be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SourceError {
    /// The model's own file cannot be read.
    #[error("cannot read the model `{file}`: {source}; check the path and its permissions")]
    Read {
        /// Model file.
        file: String,
        /// What the system said.
        source: std::io::Error,
    },
    /// A file that the model refers to cannot be read.
    #[error(
        "`{file}` refers to `{reference}`, which cannot be read: {source}; put it beside the model, or save the model with everything embedded (.glb)"
    )]
    ReadReferenced {
        /// Model file.
        file: String,
        /// Path in it.
        reference: String,
        /// What the system said.
        source: std::io::Error,
    },
    /// The file's extension is none of those that can be read.
    #[error("`{file}` is of an unknown kind; models are read from .{} files: convert it to one of these", EXTENSIONS.join(", ."))]
    UnknownKind {
        /// Model file.
        file: String,
    },
    /// The file does not follow its format.
    #[error("`{file}` is malformed at {place}: {problem}; export it again")]
    Malformed {
        /// Model file.
        file: String,
        /// Line, header or object.
        place: String,
        /// What is wrong there.
        problem: String,
    },
    /// Something lies outside the bytes it should be in.
    #[error(
        "`{file}` is cut short or malformed: {place} needs {needed} bytes, but there are {available}; copy or export it again"
    )]
    BufferRange {
        /// Model file.
        file: String,
        /// Which buffer, view or accessor.
        place: String,
        /// Bytes it reaches to.
        needed: u64,
        /// Bytes there are.
        available: u64,
    },
    /// The file needs glTF extensions that this reader does not know.
    #[error(
        "`{file}` cannot be read without the glTF extensions {extensions}, which are not supported; {advice}"
    )]
    UnsupportedExtension {
        /// Model file.
        file: String,
        /// Names, separated by commas.
        extensions: String,
        /// How to save the model without them.
        advice: &'static str,
    },
    /// A texture is missing, broken or too large.
    #[error(
        "image {image} of `{file}`, from {place}, cannot be used: {problem}; save it as a PNG or JPEG of at most {} pixels a side",
        super::images::MAX_SIDE
    )]
    Image {
        /// Model file.
        file: String,
        /// Name or number.
        image: String,
        /// File, buffer view or data URI it comes from.
        place: String,
        /// What is wrong with it.
        problem: String,
    },
    /// There are no triangles.
    #[error(
        "`{file}` has no mesh to bake: {problem}; export it with triangles in its default scene"
    )]
    NoMesh {
        /// Model file.
        file: String,
        /// What there is instead.
        problem: String,
    },
    /// There are points, but no faces.
    #[error(
        "`{file}` is a point cloud ({vertices} vertices and no faces), and only triangle meshes can be baked: reconstruct its surface first"
    )]
    PointCloud {
        /// Model file.
        file: String,
        /// Points.
        vertices: usize,
    },
    /// A triangle refers to a vertex that does not exist.
    #[error(
        "mesh `{mesh}` of `{file}` is malformed: triangle {triangle} uses vertex {index}, but there are {vertices} (the first is 0); export it again"
    )]
    IndexOutOfRange {
        /// Model file.
        file: String,
        /// Mesh name.
        mesh: String,
        /// Triangle number.
        triangle: usize,
        /// Vertex number.
        index: u32,
        /// Vertices of the mesh.
        vertices: usize,
    },
    /// A position is not a number, or infinite.
    #[error(
        "mesh `{mesh}` of `{file}` is malformed: vertex {vertex} lies at {position}; repair the mesh or its node transforms"
    )]
    NonFinitePosition {
        /// Model file.
        file: String,
        /// Mesh name.
        mesh: String,
        /// Vertex number.
        vertex: usize,
        /// Where it is said to be.
        position: bevy::math::Vec3,
    },
    /// An attribute does not have one value a vertex.
    #[error(
        "mesh `{mesh}` of `{file}` is malformed: {found} {attribute} for {vertices} vertices; export it again"
    )]
    AttributeLength {
        /// Model file.
        file: String,
        /// Mesh name.
        mesh: String,
        /// Normals, texture coordinates or colours.
        attribute: &'static str,
        /// Values there are.
        found: usize,
        /// Vertices of the mesh.
        vertices: usize,
    },
    /// Something refers to a material or an image that does not exist.
    #[error(
        "{place} of `{file}` is malformed: it uses {what} {index}, but there are {count} (the first is 0); export it again"
    )]
    Reference {
        /// Model file.
        file: String,
        /// Mesh or material.
        place: String,
        /// Material or image.
        what: &'static str,
        /// Its number.
        index: usize,
        /// How many there are.
        count: usize,
    },
    /// All triangles together have no area.
    #[error(
        "`{file}` has no surface: all of its {triangles} triangles have zero area; check its scale and node transforms"
    )]
    ZeroArea {
        /// Model file.
        file: String,
        /// Triangles, all degenerate.
        triangles: usize,
    },
    /// The model is too large or too small for single precision.
    #[error("`{file}` is {extent:e} units large; its largest side must be 1e-9 to 1e9: scale it")]
    Extent {
        /// Model file.
        file: String,
        /// Largest side of its box.
        extent: f32,
    },
    /// More materials or vertices than a bake can number.
    #[error("`{file}` has {count} {what}, at most {limit} can be baked: merge or simplify it")]
    TooMany {
        /// Model file.
        file: String,
        /// Materials or vertices.
        what: &'static str,
        /// How many.
        count: usize,
        /// How many may be.
        limit: usize,
    },
}
