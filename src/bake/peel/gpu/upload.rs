//! Puts a model on the GPU.
//!
//! In: model and triangle table; out: chunks of corners, textures, and what to draw for each direction. O(triangles);
//! 144 bytes a triangle and one image each. Corners are not shared: a corner's number then tells its triangle, which
//! needs no optional feature.

use super::{
    GpuPeelError, GpuPeeler,
    pipelines::GpuPeelDraw,
    triangles::{TriangleTable, corner_positions},
};
use crate::bake::source::{
    SourceAlpha, SourceImage, SourceMaterial, SourceMesh, SourceModel, SourceTexture, SourceWrap,
};
use bevy::math::{Vec2, Vec3, Vec4};
use std::{collections::BTreeMap, ops::Range};

/// Floats of a corner: position, u, normal, v, colour.
const CORNER_FLOATS: usize = 12;
/// Bytes of a triangle.
const TRIANGLE_BYTES: u64 = 3 * CORNER_FLOATS as u64 * 4;
/// Bytes of a chunk of corners at most, so that preparing it takes little memory.
const CHUNK_BYTES: u64 = 64 << 20;

/// A model on the GPU.
#[derive(Debug)]
pub(super) struct PeelScene {
    /// The direction that keeps each triangle, four to a word.
    pub(super) triangle_directions: wgpu::Buffer,
    bind_groups: Vec<wgpu::BindGroup>,
    /// Per chunk, if triangles are partitioned.
    indices: Vec<wgpu::Buffer>,
    /// What to draw: one list for all directions, or one each.
    lists: Vec<Vec<DrawCall>>,
}

/// A material, and whether its texture is used: not by meshes without texture coordinates.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Look {
    material: usize,
    textured: bool,
}

/// A run of triangles of one chunk and look.
#[derive(Clone, Debug)]
struct Span {
    chunk: usize,
    look: Look,
    bind_group: usize,
    /// Triangles of the chunk.
    triangles: Range<u32>,
}

#[derive(Clone, Debug)]
struct DrawCall {
    bind_group: usize,
    chunk: usize,
    /// Vertices, or indices if partitioned.
    vertices: Range<u32>,
}

/// Corners of all meshes in chunks, in model order.
#[derive(Default)]
struct Chunks {
    buffers: Vec<wgpu::Buffer>,
    first_triangles: Vec<u32>,
    spans: Vec<Span>,
}

impl PeelScene {
    /// Uploads everything. wgpu's errors go to the device's error scope.
    ///
    /// # Errors
    /// An image whose size is wrong or above the device's limit.
    pub(super) fn upload(
        peeler: &GpuPeeler,
        model: &SourceModel,
        triangles: &TriangleTable,
        partition: bool,
        direction_count: usize,
    ) -> Result<Self, GpuPeelError> {
        let mut chunks = Chunks::upload(peeler, model, triangles);
        let bind_groups = create_bind_groups(peeler, model, &mut chunks)?;
        let mut words = triangles.directions.clone();
        words.resize(words.len().next_multiple_of(4), 0);
        let triangle_directions =
            peeler.buffer_with("triangle_directions", &words, wgpu::BufferUsages::STORAGE);
        let (lists, indices) = if partition {
            partition_draws(peeler, &chunks, triangles, direction_count)
        } else {
            let list = chunks.spans.iter().map(|span| DrawCall {
                bind_group: span.bind_group,
                chunk: span.chunk,
                vertices: span.triangles.start * 3..span.triangles.end * 3,
            });
            (vec![list.collect()], Vec::new())
        };
        Ok(Self { triangle_directions, bind_groups, indices, lists })
    }

    /// Draws all triangles, or those of `direction` if partitioned, in model order.
    pub(super) fn draw(&self, pass: &mut wgpu::RenderPass<'_>, direction: u8) {
        let list = &self.lists[usize::from(direction).min(self.lists.len() - 1)];
        for call in list {
            pass.set_bind_group(1, &self.bind_groups[call.bind_group], &[]);
            match self.indices.get(call.chunk) {
                None => pass.draw(call.vertices.clone(), 0..1),
                Some(indices) => {
                    pass.set_index_buffer(indices.slice(..), wgpu::IndexFormat::Uint32);
                    pass.draw_indexed(call.vertices.clone(), 0, 0..1);
                }
            }
        }
    }
}

impl Chunks {
    fn upload(peeler: &GpuPeeler, model: &SourceModel, triangles: &TriangleTable) -> Self {
        let limits = peeler.device.limits();
        let bytes =
            limits.max_storage_buffer_binding_size.min(limits.max_buffer_size).min(CHUNK_BYTES);
        let capacity = (bytes / TRIANGLE_BYTES).max(1) as u32;
        let mut chunks = Self::default();
        let mut corners: Vec<f32> = Vec::new();
        let (mut first, mut count) = (0, 0);
        let flush = |chunks: &mut Self, corners: &mut Vec<f32>, first: u32| {
            let data = bytemuck::cast_slice(corners);
            chunks.buffers.push(peeler.buffer_with("corners", data, wgpu::BufferUsages::STORAGE));
            chunks.first_triangles.push(first);
            corners.clear();
            // Hands the staging memory on, or a large model would be held twice.
            peeler.queue.submit([]);
        };
        for mesh in &model.meshes {
            let material = &model.materials[mesh.material];
            let textured = !mesh.uvs.is_empty() && material.base_color_texture.is_some();
            let look = Look { material: mesh.material, textured };
            for triangle in &mesh.triangles {
                if count == capacity {
                    flush(&mut chunks, &mut corners, first);
                    (first, count) = (first + count, 0);
                }
                let has_area = triangles.face_normals[(first + count) as usize] != Vec3::ZERO;
                match corner_positions(mesh, *triangle).filter(|_| has_area) {
                    Some(positions) => {
                        push_triangle(&mut corners, mesh, material, *triangle, positions)
                    }
                    // A point covers nothing and keeps the numbering.
                    None => corners.extend([0.0; 3 * CORNER_FLOATS]),
                }
                chunks.extend_span(look, count);
                count += 1;
            }
        }
        if count > 0 {
            flush(&mut chunks, &mut corners, first);
        }
        chunks
    }

    /// Adds triangle `triangle` of the chunk being filled to the last span, or to a new one.
    fn extend_span(&mut self, look: Look, triangle: u32) {
        let chunk = self.buffers.len();
        match self.spans.last_mut() {
            Some(span) if span.chunk == chunk && span.look == look => span.triangles.end += 1,
            _ => {
                let triangles = triangle..triangle + 1;
                self.spans.push(Span { chunk, look, bind_group: 0, triangles });
            }
        }
    }
}

/// Appends three corners.
fn push_triangle(
    corners: &mut Vec<f32>,
    mesh: &SourceMesh,
    material: &SourceMaterial,
    triangle: [u32; 3],
    positions: [Vec3; 3],
) {
    let uv_transform = material.base_color_texture.as_ref().map(|texture| texture.uv_transform);
    for (position, index) in std::iter::zip(positions, triangle) {
        let index = index as usize;
        let normal = mesh.normals.get(index).copied().unwrap_or(Vec3::ZERO);
        let uv = mesh.uvs.get(index).copied().unwrap_or(Vec2::ZERO);
        let uv = uv_transform.map_or(uv, |transform| (transform * uv.extend(1.0)).truncate());
        let color = mesh.colors.get(index).copied().unwrap_or(Vec4::ONE);
        corners.extend([position.x, position.y, position.z, uv.x]);
        corners.extend([normal.x, normal.y, normal.z, uv.y]);
        corners.extend(color.to_array());
    }
}

/// One bind group per chunk and look that meet, written into the spans.
fn create_bind_groups(
    peeler: &GpuPeeler,
    model: &SourceModel,
    chunks: &mut Chunks,
) -> Result<Vec<wgpu::BindGroup>, GpuPeelError> {
    let mut pairs = BTreeMap::new();
    for span in &mut chunks.spans {
        let next = pairs.len();
        span.bind_group = *pairs.entry((span.chunk, span.look)).or_insert(next);
    }
    let stride = (size_of::<GpuPeelDraw>() as u32)
        .next_multiple_of(peeler.device.limits().min_uniform_buffer_offset_alignment)
        as usize;
    let mut uniforms = vec![0; stride * pairs.len()];
    for (&(chunk, look), &i) in &pairs {
        let material = &model.materials[look.material];
        let alpha_cutoff = match material.alpha {
            SourceAlpha::Opaque => -1.0,
            SourceAlpha::Mask(cutoff) => cutoff,
        };
        let draw = GpuPeelDraw {
            base_color: material.base_color.to_array(),
            alpha_cutoff,
            first_triangle: chunks.first_triangles[chunk],
            pad: [0; 2],
        };
        uniforms[i * stride..][..size_of::<GpuPeelDraw>()]
            .copy_from_slice(bytemuck::bytes_of(&draw));
    }
    let uniforms = peeler.buffer_with("peel_draw", &uniforms, wgpu::BufferUsages::UNIFORM);

    let white = SourceImage { width: 1, height: 1, rgba8: vec![255; 4] };
    let mut images = BTreeMap::new();
    let mut bind_groups: Vec<_> = pairs.iter().map(|(&pair, &i)| (i, pair)).collect();
    bind_groups.sort_unstable();
    let create = |(i, (chunk, look)): (usize, (usize, Look))| {
        let texture =
            model.materials[look.material].base_color_texture.as_ref().filter(|_| look.textured);
        let image_index = texture.map(|texture| texture.image);
        let view = match images.get(&image_index) {
            Some(view) => view,
            None => {
                let image = match image_index {
                    None => &white,
                    Some(index) => checked_image(peeler, model, index)?,
                };
                images.entry(image_index).or_insert(upload_image(peeler, image))
            }
        };
        let sampler = peeler.device.create_sampler(&sampler_descriptor(texture));
        Ok(peeler.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("peel_draw"),
            layout: &peeler.pipelines.draw_layout,
            entries: &[
                wgpu::BindGroupEntry {
                    binding: 0,
                    resource: wgpu::BindingResource::Buffer(wgpu::BufferBinding {
                        buffer: &uniforms,
                        offset: (i * stride) as u64,
                        size: wgpu::BufferSize::new(size_of::<GpuPeelDraw>() as u64),
                    }),
                },
                wgpu::BindGroupEntry {
                    binding: 1,
                    resource: chunks.buffers[chunk].as_entire_binding(),
                },
                wgpu::BindGroupEntry {
                    binding: 2,
                    resource: wgpu::BindingResource::TextureView(view),
                },
                wgpu::BindGroupEntry {
                    binding: 3,
                    resource: wgpu::BindingResource::Sampler(&sampler),
                },
            ],
        }))
    };
    bind_groups.into_iter().map(create).collect()
}

fn checked_image<'a>(
    peeler: &GpuPeeler,
    model: &'a SourceModel,
    index: usize,
) -> Result<&'a SourceImage, GpuPeelError> {
    let error = |what| Err(GpuPeelError::Model { model: model.name.clone(), what });
    let Some(image) = model.images.get(index) else {
        return error(format!(
            "a material uses image {index}, but there are {}",
            model.images.len()
        ));
    };
    let (width, height) = (image.width, image.height);
    let pixels = u64::from(width) * u64::from(height);
    if pixels == 0 || image.rgba8.len() as u64 != pixels * 4 {
        let bytes = image.rgba8.len();
        return error(format!("image {index} is {width}x{height}, but has {bytes} bytes"));
    }
    let limit = peeler.device.limits().max_texture_dimension_2d;
    if width.max(height) > limit {
        return Err(GpuPeelError::Limit {
            adapter: peeler.adapter.clone(),
            limit: "max_texture_dimension_2d",
            have: u64::from(limit),
            need: u64::from(width.max(height)),
        });
    }
    Ok(image)
}

fn upload_image(peeler: &GpuPeeler, image: &SourceImage) -> wgpu::TextureView {
    let size =
        wgpu::Extent3d { width: image.width, height: image.height, depth_or_array_layers: 1 };
    let texture = peeler.device.create_texture(&wgpu::TextureDescriptor {
        label: Some("base_color_texture"),
        size,
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        // Decoded before filtering: texels are mixed in linear light.
        format: wgpu::TextureFormat::Rgba8UnormSrgb,
        usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    });
    let layout = wgpu::TexelCopyBufferLayout {
        offset: 0,
        bytes_per_row: Some(image.width * 4),
        rows_per_image: None,
    };
    peeler.queue.write_texture(texture.as_image_copy(), &image.rgba8, layout, size);
    texture.create_view(&Default::default())
}

fn sampler_descriptor(texture: Option<&SourceTexture>) -> wgpu::SamplerDescriptor<'static> {
    let mode = |wrap| match wrap {
        SourceWrap::Repeat => wgpu::AddressMode::Repeat,
        SourceWrap::MirroredRepeat => wgpu::AddressMode::MirrorRepeat,
        SourceWrap::ClampToEdge => wgpu::AddressMode::ClampToEdge,
    };
    let [u, v] = texture.map_or([SourceWrap::Repeat; 2], |texture| texture.wrap);
    let filter = match texture {
        Some(texture) if !texture.nearest => wgpu::FilterMode::Linear,
        _ => wgpu::FilterMode::Nearest,
    };
    wgpu::SamplerDescriptor {
        label: Some("base_color_sampler"),
        address_mode_u: mode(u),
        address_mode_v: mode(v),
        mag_filter: filter,
        min_filter: filter,
        ..Default::default()
    }
}

/// Per direction, the corners of the triangles it keeps (Bærentzen 2005, §2.1), in model order.
fn partition_draws(
    peeler: &GpuPeeler,
    chunks: &Chunks,
    triangles: &TriangleTable,
    direction_count: usize,
) -> (Vec<Vec<DrawCall>>, Vec<wgpu::Buffer>) {
    let mut indices: Vec<Vec<u32>> = vec![Vec::new(); chunks.buffers.len()];
    let lists = (0..direction_count).map(|direction| {
        let mut list = Vec::new();
        for span in &chunks.spans {
            let indices = &mut indices[span.chunk];
            let start = indices.len() as u32;
            for triangle in span.triangles.clone() {
                let global = chunks.first_triangles[span.chunk] + triangle;
                if usize::from(triangles.directions[global as usize]) == direction {
                    indices.extend([triangle * 3, triangle * 3 + 1, triangle * 3 + 2]);
                }
            }
            let vertices = start..indices.len() as u32;
            if !vertices.is_empty() {
                list.push(DrawCall { bind_group: span.bind_group, chunk: span.chunk, vertices });
            }
        }
        list
    });
    let lists = lists.collect();
    let buffers = indices.iter().map(|indices| {
        peeler.buffer_with("partition", bytemuck::cast_slice(indices), wgpu::BufferUsages::INDEX)
    });
    (lists, buffers.collect())
}

impl GpuPeeler {
    /// A buffer that holds `data`, whose length is a multiple of 4.
    fn buffer_with(&self, label: &str, data: &[u8], usage: wgpu::BufferUsages) -> wgpu::Buffer {
        let buffer = self.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some(label),
            size: data.len() as u64,
            usage: usage | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        self.queue.write_buffer(&buffer, 0, data);
        buffer
    }
}
