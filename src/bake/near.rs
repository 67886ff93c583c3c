//! A source model as Bevy meshes and materials: what is drawn near the camera.

use super::cards::cut_cards;
use super::lighting::LightVolume;
use super::source::{
    SourceAlpha, SourceImage, SourceMaterial, SourceMesh, SourceModel, SourceWrap,
};
use crate::{
    asset::{NEAR_LIGHTING_PASS, NearMesh, NearMeshPiece, light_factor},
    math::bounding::Aabb,
};
use bevy::{
    asset::RenderAssetUsages,
    image::{ImageAddressMode, ImageFilterMode, ImageSampler, ImageSamplerDescriptor},
    mesh::{Indices, PrimitiveTopology},
    prelude::*,
    render::render_resource::{Extent3d, Face, TextureDimension, TextureFormat},
};
use rayon::prelude::*;

/// One part of a near mesh before it has handles.
#[derive(Clone, Debug)]
pub struct NearMeshSource {
    /// All triangles of one material, relative to the centre of the model's box.
    pub mesh: Mesh,
    /// Without its texture.
    pub material: StandardMaterial,
    /// Base colour texture.
    pub texture: Option<Image>,
    /// Centre of the part's box.
    pub center: Vec3,
    /// Half the extent of the part's box.
    pub half_extents: Vec3,
}

/// What is drawn of a model near the camera. Looks like [`model_mesh_sources`] and costs less: leaf cards are cut to the outlines of their leaves, and
/// materials have the lighting pass of near meshes.
///
/// Parameters and order are those of [`model_mesh_sources`].
pub fn near_mesh_sources(model: &SourceModel, ambient_visibility: bool) -> Vec<NearMeshSource> {
    let refine = |mesh: &SourceMesh| cut_to_leaves(model, mesh).unwrap_or_else(|| mesh.clone());
    let meshes: Vec<SourceMesh> = model.meshes.par_iter().map(refine).collect();
    let mut parts = gather(model, &meshes, ambient_visibility);
    for part in &mut parts {
        part.material.deferred_lighting_pass_id = NEAR_LIGHTING_PASS;
    }
    parts
}

/// The model's triangles gathered by material, in the order of materials: what a loader of models would give.
///
/// With `ambient_visibility`, vertex colours hold how much light reaches them, from the same [`LightVolume`] as that of
/// points, so that a tree does not change its brightness as it becomes points; the volume is made here, which takes
/// some 50 ms. Pass [`TreeData::is_shaded`](crate::asset::TreeData::is_shaded) of the points.
pub fn model_mesh_sources(model: &SourceModel, ambient_visibility: bool) -> Vec<NearMeshSource> {
    gather(model, &model.meshes, ambient_visibility)
}

/// The mesh without the empty parts of its leaf cards, if it has cards.
fn cut_to_leaves(model: &SourceModel, mesh: &SourceMesh) -> Option<SourceMesh> {
    let material = model.materials.get(mesh.material)?;
    let SourceAlpha::Mask(cut_off) = material.alpha else { return None };
    let texture = material.base_color_texture.as_ref()?;
    let image = model.images.get(texture.image)?;
    cut_cards(mesh, texture, image, cut_off / material.base_color.w.max(1e-3))
}

/// The triangles of `meshes` by material. The light is that of the model.
fn gather(
    model: &SourceModel,
    meshes: &[SourceMesh],
    ambient_visibility: bool,
) -> Vec<NearMeshSource> {
    let middle = model.bounds().center();
    let light = ambient_visibility.then(|| LightVolume::of_model(model, &|_| ()));
    let parts = model.materials.iter().enumerate().filter_map(|(index, material)| {
        let meshes: Vec<_> =
            meshes.iter().filter(|m| m.material == index && !m.triangles.is_empty()).collect();
        meshes.first()?;
        let textured =
            material.base_color_texture.is_some() && meshes.iter().any(|m| !m.uvs.is_empty());
        // Without light there is none to lose.
        let light = light.as_ref().filter(|_| !material.unlit);
        let colored = light.is_some() || meshes.iter().any(|m| !m.colors.is_empty());
        let (mut positions, mut normals, mut uvs, mut colors, mut indices) =
            (vec![], vec![], vec![], vec![], Vec::<u32>::new());
        for mesh in &meshes {
            let base = positions.len() as u32;
            let count = mesh.positions.len();
            positions.extend(mesh.positions.iter().map(|p| (*p - middle).to_array()));
            normals.extend(mesh.normals.iter().map(Vec3::to_array));
            if textured {
                let zero = Vec2::ZERO;
                uvs.extend((0..count).map(|i| mesh.uvs.get(i).unwrap_or(&zero).to_array()));
            }
            if colored {
                colors.extend(vertex_colors(mesh, material, light));
            }
            indices.extend(mesh.triangles.iter().flatten().map(|i| base + i));
        }
        let bounds = Aabb::of(positions.iter().map(|p| Vec3::from_array(*p)));
        // Only the renderer needs the vertices: bounds are given, and nobody picks a tree leaf by leaf.
        let mut out = Mesh::new(PrimitiveTopology::TriangleList, RenderAssetUsages::RENDER_WORLD)
            .with_inserted_attribute(Mesh::ATTRIBUTE_POSITION, positions)
            .with_inserted_attribute(Mesh::ATTRIBUTE_NORMAL, normals)
            .with_inserted_indices(Indices::U32(indices));
        if textured {
            out.insert_attribute(Mesh::ATTRIBUTE_UV_0, uvs);
        }
        if colored {
            out.insert_attribute(Mesh::ATTRIBUTE_COLOR, colors);
        }
        Some(NearMeshSource {
            mesh: out,
            material: standard_material(material),
            texture: textured.then(|| texture(model, material)).flatten(),
            center: bounds.center(),
            half_extents: bounds.extent() * 0.5,
        })
    });
    parts.collect()
}

/// Vertex colours of a mesh, darkened where light does not reach.
fn vertex_colors(
    mesh: &SourceMesh,
    material: &SourceMaterial,
    light: Option<&LightVolume>,
) -> Vec<[f32; 4]> {
    let color = |i: usize| {
        let own = mesh.colors.get(i).copied().unwrap_or(Vec4::ONE);
        let Some(light) = light else { return own.to_array() };
        let normal = mesh.normals.get(i).copied().unwrap_or(Vec3::Y);
        let visibility = light.visibility(mesh.positions[i], normal, material.double_sided);
        (own.truncate() * light_factor(visibility)).extend(own.w).to_array()
    };
    (0..mesh.positions.len()).into_par_iter().map(color).collect()
}

fn standard_material(material: &SourceMaterial) -> StandardMaterial {
    let c = material.base_color;
    let uv = material.base_color_texture.as_ref().map(|t| t.uv_transform);
    StandardMaterial {
        base_color: LinearRgba::new(c.x, c.y, c.z, c.w).into(),
        perceptual_roughness: material.perceptual_roughness,
        metallic: material.metallic,
        // Leaves that are bent as one would else shine as one; the same number is in shaders/resolve/resolve.wgsl.
        reflectance: if material.keeps_normals { 0.25 } else { 0.5 },
        // What Bevy calls so turns the normals of back faces.
        double_sided: material.double_sided && !material.keeps_normals,
        cull_mode: (!material.double_sided).then_some(Face::Back),
        unlit: material.unlit,
        alpha_mode: match material.alpha {
            SourceAlpha::Opaque => AlphaMode::Opaque,
            SourceAlpha::Mask(cut_off) => AlphaMode::Mask(cut_off),
        },
        uv_transform: uv.map_or(default(), bevy::math::Affine2::from_mat3),
        ..default()
    }
}

fn texture(model: &SourceModel, material: &SourceMaterial) -> Option<Image> {
    let texture = material.base_color_texture.as_ref()?;
    let SourceImage { width, height, rgba8 } = model.images.get(texture.image)?;
    let size = Extent3d { width: *width, height: *height, depth_or_array_layers: 1 };
    let mut image = Image::new(
        size,
        TextureDimension::D2,
        rgba8.clone(),
        TextureFormat::Rgba8UnormSrgb,
        RenderAssetUsages::RENDER_WORLD,
    );
    let address = |wrap| match wrap {
        SourceWrap::Repeat => ImageAddressMode::Repeat,
        SourceWrap::MirroredRepeat => ImageAddressMode::MirrorRepeat,
        SourceWrap::ClampToEdge => ImageAddressMode::ClampToEdge,
    };
    let filter = if texture.nearest { ImageFilterMode::Nearest } else { ImageFilterMode::Linear };
    image.sampler = ImageSampler::Descriptor(ImageSamplerDescriptor {
        address_mode_u: address(texture.wrap[0]),
        address_mode_v: address(texture.wrap[1]),
        mag_filter: filter,
        min_filter: filter,
        ..ImageSamplerDescriptor::linear()
    });
    Some(image)
}

/// Gives the parts handles, by whatever means the caller has.
pub(super) fn near_mesh(
    sources: Vec<NearMeshSource>,
    mut add_image: impl FnMut(usize, Image) -> Handle<Image>,
    mut add: impl FnMut(usize, Mesh, StandardMaterial) -> (Handle<Mesh>, Handle<StandardMaterial>),
) -> NearMesh {
    let parts = sources.into_iter().enumerate().map(|(i, source)| {
        let mut material = source.material;
        material.base_color_texture = source.texture.map(|image| add_image(i, image));
        let (mesh, material) = add(i, source.mesh, material);
        NearMeshPiece { mesh, material, center: source.center, half_extents: source.half_extents }
    });
    NearMesh { parts: parts.collect() }
}
