//! An app without a window that draws frame by frame, and pictures of what it draws.

use crate::options::{ToolError, ToolResult};
use bevy::{
    app::{PluginGroup, PluginGroupBuilder},
    camera::RenderTarget,
    log::LogPlugin,
    prelude::*,
    render::{
        RenderApp, RenderPlugin,
        diagnostic::RenderDiagnosticsPlugin,
        pipelined_rendering::PipelinedRenderingPlugin,
        render_asset::RenderAssets,
        render_resource::{
            BufferDescriptor, BufferUsages, Extent3d, MapMode, PollType, TexelCopyBufferInfo,
            TexelCopyBufferLayout, TextureFormat, TextureUsages,
        },
        renderer::{RenderAdapterInfo, RenderDevice, RenderQueue},
        settings::{Backends, RenderCreation, WgpuSettings},
        texture::GpuImage,
    },
    time::TimeUpdateStrategy,
    window::ExitCondition,
    winit::WinitPlugin,
};
use bevy_treeline::{CacheLocation, SplatPath, TreelinePlugin};
use image::RgbaImage;
use std::time::Duration;

/// Bevy's plugins with or without a window.
pub fn bevy_plugins(window: Option<Window>) -> PluginGroupBuilder {
    let windowed = window.is_some();
    // Without DX12 among the backends, Bevy does not validate indirect draws in release builds.
    let backends = std::env::var("WGPU_BACKEND").is_err().then_some(if cfg!(target_os = "linux") {
        Backends::VULKAN
    } else {
        Backends::PRIMARY
    });
    let mut settings = WgpuSettings::default();
    settings.backends = backends.or(settings.backends);
    let plugins = DefaultPlugins
        .set(WindowPlugin {
            primary_window: window,
            exit_condition: if windowed {
                ExitCondition::OnPrimaryClosed
            } else {
                ExitCondition::DontExit
            },
            ..default()
        })
        .set(LogPlugin {
            // `bevy_log` complains that bakes have set up `log` before it; it is the same bridge.
            filter: "warn,bevy_log=off,bevy_treeline=info,wgpu=error,naga=warn,symphonia=error"
                .into(),
            ..default()
        })
        .set(RenderPlugin {
            render_creation: RenderCreation::from(settings),
            // Headless pictures must not depend on how fast shaders compile.
            synchronous_pipeline_compilation: !windowed,
            ..default()
        });
    if windowed {
        plugins
    } else {
        plugins.disable::<WinitPlugin>().disable::<PipelinedRenderingPlugin>()
    }
}

/// An app without a window, ready to update. Trees come from the caller, so the plugin's own cache is off.
pub fn headless_app(splat_path: SplatPath) -> ToolResult<App> {
    headless_app_with(splat_path, |_| Ok(()))
}

/// The same, with plugins of the caller's.
pub fn headless_app_with(
    splat_path: SplatPath,
    build: impl FnOnce(&mut App) -> ToolResult,
) -> ToolResult<App> {
    // Bevy panics without an adapter; ask first.
    bevy_treeline::gpu::headless::headless_device()
        .map_err(|error| ToolError::NoGpu(error.to_string()))?;
    let mut app = App::new();
    app.add_plugins(bevy_plugins(None))
        .add_plugins(RenderDiagnosticsPlugin)
        .add_plugins(TreelinePlugin { splat_path, cache: CacheLocation::Off, ..default() });
    pass_time(&mut app, Duration::ZERO);
    build(&mut app)?;
    app.finish();
    app.cleanup();
    if let Some(info) = app.world().get_resource::<RenderAdapterInfo>() {
        eprintln!("drawing with {} ({:?})", info.name, info.backend);
    }
    Ok(app)
}

/// How much time passes in the world from frame to frame, from now on; at first none. Not that of the clock: water must
/// not look different on a slower machine.
pub fn pass_time(app: &mut App, between_frames: Duration) {
    app.insert_resource(TimeUpdateStrategy::ManualDuration(between_frames));
}

/// Draws a frame and waits until the GPU is done.
pub fn step(app: &mut App) {
    app.update();
    let device = app.world().resource::<RenderDevice>();
    // An error means that the device is lost; the capture that follows says so.
    let _ = device.wgpu_device().poll(PollType::wait_indefinitely());
}

/// A picture to draw into.
pub fn target(app: &mut App, width: u32, height: u32) -> Handle<Image> {
    let mut image = Image::new_target_texture(width, height, TextureFormat::Rgba8UnormSrgb, None);
    image.texture_descriptor.usage |= TextureUsages::COPY_SRC;
    app.world_mut().resource_mut::<Assets<Image>>().add(image)
}

/// Points a camera at a picture.
pub fn render_target(image: &Handle<Image>) -> RenderTarget {
    RenderTarget::from(image.clone())
}

/// The pixels of a target, after [`step`].
pub fn capture(app: &App, target: &Handle<Image>) -> ToolResult<RgbaImage> {
    let lost = |what: &str| ToolError::NoGpu(format!("the picture could not be read back: {what}"));
    let render = app.get_sub_app(RenderApp).ok_or_else(|| lost("there is no renderer"))?.world();
    let images = render.resource::<RenderAssets<GpuImage>>();
    let texture = &images.get(target).ok_or_else(|| lost("it was never drawn"))?.texture;
    let (device, queue) = (render.resource::<RenderDevice>(), render.resource::<RenderQueue>());
    let (width, height) = (texture.width(), texture.height());
    let row = RenderDevice::align_copy_bytes_per_row(width as usize * 4);
    let buffer = device.create_buffer(&BufferDescriptor {
        label: Some("capture"),
        size: row as u64 * u64::from(height),
        usage: BufferUsages::MAP_READ | BufferUsages::COPY_DST,
        mapped_at_creation: false,
    });
    let mut encoder = device.create_command_encoder(&default());
    encoder.copy_texture_to_buffer(
        texture.as_image_copy(),
        TexelCopyBufferInfo {
            buffer: &buffer,
            layout: TexelCopyBufferLayout {
                offset: 0,
                bytes_per_row: Some(row as u32),
                rows_per_image: None,
            },
        },
        Extent3d { width, height, depth_or_array_layers: 1 },
    );
    queue.submit([encoder.finish()]);
    buffer.slice(..).map_async(MapMode::Read, |_| ());
    device
        .wgpu_device()
        .poll(PollType::wait_indefinitely())
        .map_err(|error| lost(&error.to_string()))?;
    let bytes = buffer.slice(..).get_mapped_range();
    let mut pixels = Vec::with_capacity((width * height * 4) as usize);
    for y in 0..height as usize {
        pixels.extend_from_slice(&bytes[y * row..y * row + width as usize * 4]);
    }
    RgbaImage::from_raw(width, height, pixels).ok_or_else(|| lost("its size is wrong"))
}

/// CPU seconds of this process so far, all threads (the driver's too); 0 where the system does not say.
pub fn cpu_seconds() -> f64 {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    // After the command's name, which may hold spaces: fields 14 and 15 of `man 5 proc`, in hundredths of a second.
    let fields: Vec<&str> = stat.rsplit(')').next().unwrap_or("").split_whitespace().collect();
    let ticks = |i: usize| fields.get(i).and_then(|v| v.parse::<f64>().ok()).unwrap_or(0.0);
    (ticks(11) + ticks(12)) / 100.0
}

/// Most memory that this process has held, MiB; 0 where the system does not say.
pub fn peak_memory_mib() -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:")).unwrap_or("");
    line.split_whitespace().next().and_then(|kib| kib.parse::<f64>().ok()).unwrap_or(0.0) / 1024.0
}
