//! Source models from a running game: any entity tree with `Mesh3d` and `MeshMaterial3d<StandardMaterial>`.

use super::source::{
    self, SourceAlpha, SourceError, SourceImage, SourceMaterial, SourceMesh, SourceModel,
    SourceTexture, SourceWrap,
};
use bevy::{
    image::{ImageAddressMode, ImageFilterMode, ImageSampler},
    math::{Affine3A, Mat3},
    mesh::{Indices, PrimitiveTopology, VertexAttributeValues},
    platform::collections::HashMap,
    prelude::*,
};

/// Why entities could not be read as a model.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum EntityModelError {
    /// The entity is gone.
    #[error("entity {0} does not exist, so there is nothing to bake")]
    NoEntity(Entity),
    /// A mesh is not, or no longer, in the main world.
    #[error(
        "the mesh of entity {entity} cannot be read: {why}. Load it with `RenderAssetUsages::default()` (or MAIN_WORLD), \
         and bake after it has loaded"
    )]
    Mesh {
        /// Entity with the mesh.
        entity: Entity,
        /// What is wrong.
        why: String,
    },
    /// A texture is not, or no longer, in the main world, or in a format that has no 8-bit form.
    #[error(
        "the base colour texture of entity {entity} cannot be read: {why}. Load it with `RenderAssetUsages::default()` \
         (or MAIN_WORLD), in an uncompressed format"
    )]
    Texture {
        /// Entity with the material.
        entity: Entity,
        /// What is wrong.
        why: String,
    },
    /// The whole is not a usable model.
    #[error(transparent)]
    Model(#[from] SourceError),
}

/// Reads the entity `root` and everything below it, in the space of `root`. Materials and meshes are read as they are
/// now; skinned meshes in their bind pose.
///
/// # Errors
/// See [`EntityModelError`].
pub fn model_of_entities(world: &World, root: Entity) -> Result<SourceModel, EntityModelError> {
    let root_ref = world.get_entity(root).map_err(|_| EntityModelError::NoEntity(root))?;
    let name = root_ref.get::<Name>().map_or_else(|| format!("entity {root}"), |n| n.to_string());
    let mut reader =
        EntityReader { world, model: SourceModel { name, ..default() }, materials: default() };
    let mut pending = vec![(root, Affine3A::IDENTITY)];
    while let Some((entity, root_from_entity)) = pending.pop() {
        reader.read(entity, &root_from_entity)?;
        let children = world.get::<Children>(entity).into_iter().flatten();
        for child in children.copied().collect::<Vec<_>>().into_iter().rev() {
            let local =
                world.get::<Transform>(child).map_or(Affine3A::IDENTITY, Transform::compute_affine);
            pending.push((child, root_from_entity * local));
        }
    }
    source::check(&mut reader.model)?;
    Ok(reader.model)
}

struct EntityReader<'w> {
    world: &'w World,
    model: SourceModel,
    materials: HashMap<AssetId<StandardMaterial>, usize>,
}

impl EntityReader<'_> {
    fn read(
        &mut self,
        entity: Entity,
        root_from_entity: &Affine3A,
    ) -> Result<(), EntityModelError> {
        let (Some(mesh), Some(material)) = (
            self.world.get::<Mesh3d>(entity),
            self.world.get::<MeshMaterial3d<StandardMaterial>>(entity),
        ) else {
            return Ok(());
        };
        let no_mesh = |why: &str| EntityModelError::Mesh { entity, why: why.into() };
        let meshes = self.world.get_resource::<Assets<Mesh>>();
        let mesh =
            meshes.and_then(|m| m.get(&mesh.0)).ok_or_else(|| no_mesh("it is not loaded"))?;
        if mesh.primitive_topology() != PrimitiveTopology::TriangleList {
            self.model.warnings.push(format!("entity {entity}: only triangle lists are read"));
            return Ok(());
        }
        let attribute =
            |id| mesh.try_attribute_option(id).map_err(|error| no_mesh(&error.to_string()));
        let Some(VertexAttributeValues::Float32x3(positions)) =
            attribute(Mesh::ATTRIBUTE_POSITION)?
        else {
            return Err(no_mesh("it has no positions"));
        };
        let normals = match attribute(Mesh::ATTRIBUTE_NORMAL)? {
            Some(VertexAttributeValues::Float32x3(normals)) => normals.clone(),
            _ => vec![[0.0; 3]; positions.len()],
        };
        let uvs = match attribute(Mesh::ATTRIBUTE_UV_0)? {
            Some(VertexAttributeValues::Float32x2(uvs)) => {
                uvs.iter().map(|v| Vec2::from_array(*v)).collect()
            }
            _ => vec![],
        };
        let colors = match attribute(Mesh::ATTRIBUTE_COLOR)? {
            Some(VertexAttributeValues::Float32x4(colors)) => {
                colors.iter().map(|v| Vec4::from_array(*v)).collect()
            }
            _ => vec![],
        };
        let indices: Vec<u32> =
            match mesh.try_indices_option().map_err(|error| no_mesh(&error.to_string()))? {
                Some(Indices::U16(indices)) => indices.iter().map(|i| u32::from(*i)).collect(),
                Some(Indices::U32(indices)) => indices.clone(),
                None => (0..positions.len() as u32).collect(),
            };
        let normal_from_entity = Mat3::from(root_from_entity.matrix3).inverse().transpose();
        let mirrored = root_from_entity.matrix3.determinant() < 0.0;
        let triangles = indices
            .chunks_exact(3)
            .map(|t| if mirrored { [t[0], t[2], t[1]] } else { [t[0], t[1], t[2]] });
        let material = self.material(entity, &material.0)?;
        self.model.meshes.push(SourceMesh {
            name: self
                .world
                .get::<Name>(entity)
                .map_or_else(|| format!("entity {entity}"), Name::to_string),
            positions: positions
                .iter()
                .map(|p| root_from_entity.transform_point3(Vec3::from_array(*p)))
                .collect(),
            normals: normals.iter().map(|n| normal_from_entity * Vec3::from_array(*n)).collect(),
            uvs,
            colors,
            triangles: triangles.collect(),
            material,
        });
        Ok(())
    }

    fn material(
        &mut self,
        entity: Entity,
        handle: &Handle<StandardMaterial>,
    ) -> Result<usize, EntityModelError> {
        if let Some(index) = self.materials.get(&handle.id()) {
            return Ok(*index);
        }
        let fallback = StandardMaterial::default();
        let materials = self.world.get_resource::<Assets<StandardMaterial>>();
        let material = materials.and_then(|m| m.get(handle)).unwrap_or(&fallback);
        let texture = material
            .base_color_texture
            .as_ref()
            .map(|t| self.texture(entity, t, material))
            .transpose()?;
        let base = material.base_color.to_linear();
        let alpha = match material.alpha_mode {
            AlphaMode::Opaque => SourceAlpha::Opaque,
            AlphaMode::Mask(cut_off) => SourceAlpha::Mask(cut_off),
            other => {
                let warning =
                    format!("entity {entity}: {other:?} is read as a mask with cut-off 0.5");
                self.model.warnings.push(warning);
                SourceAlpha::Mask(0.5)
            }
        };
        self.model.materials.push(SourceMaterial {
            name: format!("entity {entity}"),
            base_color: Vec4::new(base.red, base.green, base.blue, base.alpha),
            base_color_texture: texture,
            alpha,
            double_sided: material.double_sided || material.cull_mode.is_none(),
            unlit: material.unlit,
            perceptual_roughness: material.perceptual_roughness,
            metallic: material.metallic,
            keeps_normals: false,
            is_leaf: material.double_sided || matches!(alpha, SourceAlpha::Mask(_)),
        });
        let index = self.model.materials.len() - 1;
        self.materials.insert(handle.id(), index);
        Ok(index)
    }

    fn texture(
        &mut self,
        entity: Entity,
        handle: &Handle<Image>,
        material: &StandardMaterial,
    ) -> Result<SourceTexture, EntityModelError> {
        let no_texture = |why: String| EntityModelError::Texture { entity, why };
        let images = self.world.get_resource::<Assets<Image>>();
        let image = images
            .and_then(|i| i.get(handle))
            .ok_or_else(|| no_texture("it is not loaded".into()))?;
        let pixels = image
            .clone()
            .try_into_dynamic()
            .map_err(|error| no_texture(error.to_string()))?
            .into_rgba8();
        let (width, height) = pixels.dimensions();
        self.model.images.push(SourceImage { width, height, rgba8: pixels.into_raw() });
        let sampler = match &image.sampler {
            ImageSampler::Default => default(),
            ImageSampler::Descriptor(descriptor) => descriptor.clone(),
        };
        let wrap = |mode| match mode {
            ImageAddressMode::Repeat => SourceWrap::Repeat,
            ImageAddressMode::MirrorRepeat => SourceWrap::MirroredRepeat,
            _ => SourceWrap::ClampToEdge,
        };
        Ok(SourceTexture {
            image: self.model.images.len() - 1,
            wrap: [wrap(sampler.address_mode_u), wrap(sampler.address_mode_v)],
            nearest: matches!(sampler.mag_filter, ImageFilterMode::Nearest),
            uv_transform: material.uv_transform.into(),
        })
    }
}
