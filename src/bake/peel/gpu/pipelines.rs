//! Layouts and pipelines of `shaders/bake/peel.wgsl`, and the Rust mirrors of its uniforms.

use bytemuck::{Pod, Zeroable};
use std::sync::OnceLock;

/// Pixels per workgroup of the compaction: `BLOCK` in the shader.
pub(super) const BLOCK: u32 = 256;
/// Share of the depth range left free at both ends: `DEPTH_MARGIN` in the shader.
pub(super) const DEPTH_MARGIN: f32 = 1.0 / 1024.0;
/// Mark of a normal without direction: `NO_NORMAL` in the shader.
pub(super) const NO_NORMAL: u32 = u32::MAX;
/// Counters that share the counting of left-over fragments.
pub(super) const LEFT_OVER_COUNTERS: u64 = 256;
/// Format of a layer: triangle + 1, normal, albedo, depth bits.
pub(super) const LAYER_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba32Uint;
/// Format of the two depth textures.
pub(super) const DEPTH_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;

/// `PeelView` of the shader: one tile of one LDI.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct GpuPeelView {
    pub(super) right: [f32; 3],
    pub(super) pixel: f32,
    pub(super) up: [f32; 3],
    pub(super) depth: f32,
    pub(super) forward: [f32; 3],
    pub(super) direction: u32,
    pub(super) origin: [f32; 3],
    pub(super) tile_width: u32,
    pub(super) tile_origin: [f32; 2],
    pub(super) clip_origin: [f32; 2],
    pub(super) clip_size: [f32; 2],
    pub(super) tile_height: u32,
    pub(super) pad: u32,
}

/// `PeelDraw` of the shader: one material of one chunk of triangles.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct GpuPeelDraw {
    pub(super) base_color: [f32; 4],
    pub(super) alpha_cutoff: f32,
    pub(super) first_triangle: u32,
    pub(super) pad: [u32; 2],
}

/// Everything compiled once per device.
#[derive(Debug)]
pub(super) struct PeelPipelines {
    pub(super) view_layout: wgpu::BindGroupLayout,
    pub(super) draw_layout: wgpu::BindGroupLayout,
    pub(super) compact_layout: wgpu::BindGroupLayout,
    pub(super) peel: wgpu::RenderPipeline,
    pub(super) count_blocks: wgpu::ComputePipeline,
    pub(super) scan_blocks: wgpu::ComputePipeline,
    pub(super) write_records: wgpu::ComputePipeline,
    shader: wgpu::ShaderModule,
    left_over: OnceLock<LeftOverPipeline>,
}

/// Counts what lies behind the last layer.
#[derive(Debug)]
pub(super) struct LeftOverPipeline {
    pub(super) layout: wgpu::BindGroupLayout,
    pub(super) pipeline: wgpu::RenderPipeline,
}

impl PeelPipelines {
    /// Compiles all but the left-over count. Errors go to the device's error scope.
    pub(super) fn new(device: &wgpu::Device) -> Self {
        use wgpu::ShaderStages as Stages;
        let shader = device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some("peel"),
            source: wgpu::ShaderSource::Wgsl(crate::shaders::source(crate::shaders::PEEL).into()),
        });
        let layout = |label, entries: &[wgpu::BindGroupLayoutEntry]| {
            device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
                label: Some(label),
                entries,
            })
        };
        let view_layout = layout(
            "peel_view",
            &[
                uniform(0, Stages::VERTEX_FRAGMENT | Stages::COMPUTE),
                texture(1, Stages::FRAGMENT, wgpu::TextureSampleType::Depth),
            ],
        );
        let draw_layout = layout(
            "peel_draw",
            &[
                uniform(0, Stages::VERTEX_FRAGMENT),
                storage(1, Stages::VERTEX_FRAGMENT, true),
                texture(2, Stages::FRAGMENT, wgpu::TextureSampleType::Float { filterable: true }),
                entry(
                    3,
                    Stages::FRAGMENT,
                    wgpu::BindingType::Sampler(wgpu::SamplerBindingType::Filtering),
                ),
            ],
        );
        let compact_layout = layout(
            "peel_compact",
            &[
                texture(0, Stages::COMPUTE, wgpu::TextureSampleType::Uint),
                storage(1, Stages::COMPUTE, true),
                storage(2, Stages::COMPUTE, false),
                storage(3, Stages::COMPUTE, false),
                storage(4, Stages::COMPUTE, false),
            ],
        );
        let peel = render_pipeline(
            device,
            &shader,
            "peel_fragment",
            &[Some(&view_layout), Some(&draw_layout)],
            &[Some(LAYER_FORMAT.into())],
            wgpu::CompareFunction::Less,
        );
        let compute_layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some("peel_compact"),
            bind_group_layouts: &[Some(&view_layout), None, None, Some(&compact_layout)],
            immediate_size: 0,
        });
        let compute = |entry_point| {
            device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                label: Some(entry_point),
                layout: Some(&compute_layout),
                module: &shader,
                entry_point: Some(entry_point),
                compilation_options: Default::default(),
                cache: None,
            })
        };
        Self {
            peel,
            count_blocks: compute("count_blocks"),
            scan_blocks: compute("scan_blocks"),
            write_records: compute("write_records"),
            view_layout,
            draw_layout,
            compact_layout,
            shader,
            left_over: OnceLock::new(),
        }
    }

    /// The left-over count, compiled on first use: it alone writes to storage from a fragment shader.
    pub(super) fn left_over(&self, device: &wgpu::Device) -> &LeftOverPipeline {
        self.left_over.get_or_init(|| {
            let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
                label: Some("count_left_over"),
                entries: &[storage(0, wgpu::ShaderStages::FRAGMENT, false)],
            });
            let pipeline = render_pipeline(
                device,
                &self.shader,
                "count_left_over",
                &[Some(&self.view_layout), Some(&self.draw_layout), Some(&layout)],
                &[],
                wgpu::CompareFunction::Always,
            );
            LeftOverPipeline { layout, pipeline }
        })
    }
}

fn render_pipeline(
    device: &wgpu::Device,
    shader: &wgpu::ShaderModule,
    fragment: &'static str,
    bind_group_layouts: &[Option<&wgpu::BindGroupLayout>],
    targets: &[Option<wgpu::ColorTargetState>],
    depth_compare: wgpu::CompareFunction,
) -> wgpu::RenderPipeline {
    let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: Some(fragment),
        bind_group_layouts,
        immediate_size: 0,
    });
    device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some(fragment),
        layout: Some(&layout),
        vertex: wgpu::VertexState {
            module: shader,
            entry_point: Some("peel_vertex"),
            compilation_options: Default::default(),
            buffers: &[],
        },
        // No culling: a layer is whatever surface is there, seen from either side.
        primitive: wgpu::PrimitiveState::default(),
        depth_stencil: Some(wgpu::DepthStencilState {
            format: DEPTH_FORMAT,
            depth_write_enabled: Some(depth_compare == wgpu::CompareFunction::Less),
            depth_compare: Some(depth_compare),
            stencil: Default::default(),
            bias: Default::default(),
        }),
        multisample: Default::default(),
        fragment: Some(wgpu::FragmentState {
            module: shader,
            entry_point: Some(fragment),
            compilation_options: Default::default(),
            targets,
        }),
        multiview_mask: None,
        cache: None,
    })
}

fn entry(
    binding: u32,
    visibility: wgpu::ShaderStages,
    ty: wgpu::BindingType,
) -> wgpu::BindGroupLayoutEntry {
    wgpu::BindGroupLayoutEntry { binding, visibility, ty, count: None }
}

fn buffer(
    binding: u32,
    stages: wgpu::ShaderStages,
    ty: wgpu::BufferBindingType,
) -> wgpu::BindGroupLayoutEntry {
    entry(
        binding,
        stages,
        wgpu::BindingType::Buffer { ty, has_dynamic_offset: false, min_binding_size: None },
    )
}

fn uniform(binding: u32, stages: wgpu::ShaderStages) -> wgpu::BindGroupLayoutEntry {
    buffer(binding, stages, wgpu::BufferBindingType::Uniform)
}

fn storage(
    binding: u32,
    stages: wgpu::ShaderStages,
    read_only: bool,
) -> wgpu::BindGroupLayoutEntry {
    buffer(binding, stages, wgpu::BufferBindingType::Storage { read_only })
}

fn texture(
    binding: u32,
    stages: wgpu::ShaderStages,
    sample_type: wgpu::TextureSampleType,
) -> wgpu::BindGroupLayoutEntry {
    let view_dimension = wgpu::TextureViewDimension::D2;
    entry(
        binding,
        stages,
        wgpu::BindingType::Texture { sample_type, view_dimension, multisampled: false },
    )
}
