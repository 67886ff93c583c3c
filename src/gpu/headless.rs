//! A GPU device without a window and without Bevy, for bakes on the command line and for tests.

use bevy::tasks::block_on;

/// Why there is no device.
#[derive(Debug, thiserror::Error)]
pub enum HeadlessError {
    /// No driver, or none for the backends asked for.
    #[error(
        "no GPU adapter for {backends:?} ({reason}); install a Vulkan driver for the GPU, or Mesa's software driver \
         (package mesa-vulkan-drivers), and check WGPU_BACKEND if it is set"
    )]
    NoAdapter {
        /// Backends that were tried.
        backends: wgpu::Backends,
        /// What wgpu said.
        reason: wgpu::RequestAdapterError,
    },
    /// The adapter is there but cannot be opened.
    #[error("cannot open the GPU {adapter}: {reason}; it may be in use or its driver too old")]
    NoDevice {
        /// Adapter name.
        adapter: String,
        /// What wgpu said.
        reason: wgpu::RequestDeviceError,
    },
}

/// Opens the fastest adapter with all its limits and no optional features.
///
/// Tries the backends named by the environment variable `WGPU_BACKEND` (`vulkan`, `metal`, `dx12`, `gl`, separated by
/// commas), or all. Blocks for some milliseconds; works on any thread.
///
/// # Errors
/// No adapter, or one that cannot be opened.
pub fn headless_device() -> Result<(wgpu::Adapter, wgpu::Device, wgpu::Queue), HeadlessError> {
    let backends = wgpu::Backends::from_env().unwrap_or(wgpu::Backends::all());
    let descriptor = wgpu::InstanceDescriptor {
        backends,
        ..wgpu::InstanceDescriptor::new_without_display_handle()
    };
    let instance = wgpu::Instance::new(descriptor);
    let options = wgpu::RequestAdapterOptions {
        power_preference: wgpu::PowerPreference::HighPerformance,
        ..Default::default()
    };
    let adapter = block_on(instance.request_adapter(&options))
        .map_err(|reason| HeadlessError::NoAdapter { backends, reason })?;
    let descriptor = wgpu::DeviceDescriptor {
        label: Some("treeline_headless"),
        required_limits: adapter.limits(),
        memory_hints: wgpu::MemoryHints::MemoryUsage,
        ..Default::default()
    };
    match block_on(adapter.request_device(&descriptor)) {
        Ok((device, queue)) => Ok((adapter, device, queue)),
        Err(reason) => Err(HeadlessError::NoDevice { adapter: adapter.get_info().name, reason }),
    }
}
