//! Materials of ground and sky: textures and a chunk's place in, pipelines out. They read Bevy's lights, exposure, fog and
//! tone mapping, so that they agree with other materials beside them.

use super::super::quadtree::{CHUNK_QUADS, ChunkKey, Quadtree};
use crate::{
    landscape::chunk::TEXTURE_PLACE,
    shaders::{GROUND, GROUND_PREPASS, SKY},
};
use bevy::{
    asset::RenderAssetUsages,
    image::{ImageAddressMode, ImageFilterMode, ImageSampler, ImageSamplerDescriptor},
    mesh::MeshVertexBufferLayoutRef,
    pbr::{MaterialPipeline, MaterialPipelineKey},
    prelude::*,
    render::{
        render_resource::{
            AsBindGroup, Extent3d, RenderPipelineDescriptor, ShaderType,
            SpecializedMeshPipelineError, TextureDimension, TextureFormat,
        },
        storage::ShaderBuffer,
    },
    shader::ShaderRef,
};

/// WGSL: `LandscapeFrame`.
#[derive(Clone, Copy, Debug, Default, ShaderType)]
pub(super) struct LandscapeFrame {
    pub eyes: [Vec4; 4],
    pub morphs: [Vec4; 12],
    pub zenith: Vec4,
    pub horizon: Vec4,
    pub glow: Vec4,
    pub disc: Vec4,
    pub sun_direction: Vec4,
    pub water: Vec4,
}

/// WGSL: `GroundChunk`.
#[derive(Clone, Copy, Debug, ShaderType)]
pub(super) struct GroundChunk {
    first: Vec2,
    quad_m: f32,
    level: u32,
    texture_place: Vec2,
    texture_side: f32,
    morphs: f32,
}

impl GroundChunk {
    pub fn new(tree: &Quadtree, key: ChunkKey, texture_side: u32) -> Self {
        Self {
            first: Vec2::new(key.x as f32, key.z as f32) * CHUNK_QUADS as f32,
            quad_m: tree.quad_m(key.level.into()),
            level: key.level.into(),
            texture_place: Vec2::new(TEXTURE_PLACE[0] / CHUNK_QUADS as f32, TEXTURE_PLACE[1]),
            texture_side: texture_side as f32,
            morphs: if key == tree.root() { 0.0 } else { 1.0 },
        }
    }
}

/// Ground and water of one chunk. Made by the plugin.
#[derive(Asset, AsBindGroup, Clone, Debug, TypePath)]
#[bind_group_data(GroundMaterialKey)]
pub struct GroundMaterial {
    #[storage(0, read_only)]
    pub(super) frame: Handle<ShaderBuffer>,
    #[uniform(1)]
    pub(super) chunk: GroundChunk,
    #[texture(2)]
    #[sampler(3)]
    pub(super) painting: Handle<Image>,
    #[texture(4)]
    #[sampler(5)]
    pub(super) grain: Handle<Image>,
    pub(super) receive_shadows: bool,
}

/// What pipelines of [`GroundMaterial`] differ in.
#[repr(C)]
#[derive(Clone, Copy, Debug, Eq, Hash, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
pub struct GroundMaterialKey {
    receive_shadows: u32,
}

impl From<&GroundMaterial> for GroundMaterialKey {
    fn from(material: &GroundMaterial) -> Self {
        Self { receive_shadows: material.receive_shadows.into() }
    }
}

impl Material for GroundMaterial {
    fn vertex_shader() -> ShaderRef {
        GROUND.into()
    }

    fn fragment_shader() -> ShaderRef {
        GROUND.into()
    }

    fn prepass_vertex_shader() -> ShaderRef {
        GROUND_PREPASS.into()
    }

    fn prepass_fragment_shader() -> ShaderRef {
        GROUND_PREPASS.into()
    }

    fn specialize(
        _pipeline: &MaterialPipeline,
        descriptor: &mut RenderPipelineDescriptor,
        _layout: &MeshVertexBufferLayoutRef,
        key: MaterialPipelineKey<Self>,
    ) -> Result<(), SpecializedMeshPipelineError> {
        if key.bind_group_data.receive_shadows != 0
            && let Some(fragment) = &mut descriptor.fragment
        {
            fragment.shader_defs.push("RECEIVE_SHADOWS".into());
        }
        Ok(())
    }
}

/// The clear sky behind everything. Made by the plugin.
#[derive(Asset, AsBindGroup, Clone, Debug, TypePath)]
pub struct SkyMaterial {
    #[storage(0, read_only)]
    pub(super) frame: Handle<ShaderBuffer>,
}

impl Material for SkyMaterial {
    fn vertex_shader() -> ShaderRef {
        SKY.into()
    }

    fn fragment_shader() -> ShaderRef {
        SKY.into()
    }

    /// Drawn behind the opaque pass, where its depth is still empty: hidden sky costs nothing.
    fn alpha_mode(&self) -> AlphaMode {
        AlphaMode::Blend
    }

    /// Before all that is transparent.
    fn depth_bias(&self) -> f32 {
        -1e12
    }

    fn enable_prepass() -> bool {
        false
    }

    fn enable_shadows() -> bool {
        false
    }

    fn specialize(
        _pipeline: &MaterialPipeline,
        descriptor: &mut RenderPipelineDescriptor,
        _layout: &MeshVertexBufferLayoutRef,
        _key: MaterialPipelineKey<Self>,
    ) -> Result<(), SpecializedMeshPipelineError> {
        descriptor.primitive.cull_mode = None;
        if let Some(depth) = &mut descriptor.depth_stencil {
            depth.bias = default();
        }
        for target in descriptor.fragment.iter_mut().flat_map(|f| f.targets.iter_mut().flatten()) {
            target.blend = None;
        }
        Ok(())
    }
}

/// A square of texels with all their smaller copies.
///
/// Paintings are sRGB and end at their border; grain is linear, repeats, and takes the nearest copy.
pub(super) fn image(bytes: Vec<u8>, side: u32, mips: u32, painting: bool) -> Image {
    let format = if painting { TextureFormat::Rgba8UnormSrgb } else { TextureFormat::Rgba8Unorm };
    let size = Extent3d { width: side, height: side, depth_or_array_layers: 1 };
    let mut image =
        Image::new_uninit(size, TextureDimension::D2, format, RenderAssetUsages::RENDER_WORLD);
    image.data = Some(bytes);
    image.texture_descriptor.mip_level_count = mips;
    let address = if painting { ImageAddressMode::ClampToEdge } else { ImageAddressMode::Repeat };
    image.sampler = ImageSampler::Descriptor(ImageSamplerDescriptor {
        address_mode_u: address,
        address_mode_v: address,
        mag_filter: ImageFilterMode::Linear,
        min_filter: ImageFilterMode::Linear,
        mipmap_filter: if painting { ImageFilterMode::Linear } else { ImageFilterMode::Nearest },
        ..default()
    });
    image
}
