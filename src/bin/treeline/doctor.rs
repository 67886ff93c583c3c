//! `treeline doctor`: what this machine offers, and what that means.

use crate::{
    headless::headless_app,
    options::{SplatPathArg, ToolError, ToolResult},
};
use bevy::{
    prelude::*,
    render::{
        RenderApp,
        renderer::{RenderAdapterInfo, RenderDevice},
        settings::WgpuFeatures,
    },
};
use bevy_treeline::render::{SplatSupport, pipeline_states};
use clap::Args;

#[derive(Args)]
pub struct DoctorArgs {
    /// Splat path to ask for.
    #[arg(long, value_enum, default_value = "auto")]
    splat_path: SplatPathArg,
}

pub fn run(args: &DoctorArgs) -> ToolResult {
    let mut app = headless_app(args.splat_path.into())?;
    let world = app.world();
    let (info, device) = (world.resource::<RenderAdapterInfo>(), world.resource::<RenderDevice>());
    println!("adapter   {} ({:?})", info.name, info.device_type);
    println!("driver    {} {}", info.driver, info.driver_info);
    println!("backend   {:?}", info.backend);

    println!("features");
    let features = device.features();
    let wanted = [
        ("SHADER_INT64", WgpuFeatures::SHADER_INT64, "64-bit splats"),
        ("SHADER_INT64_ATOMIC_MIN_MAX", WgpuFeatures::SHADER_INT64_ATOMIC_MIN_MAX, "64-bit splats"),
        ("TIMESTAMP_QUERY", WgpuFeatures::TIMESTAMP_QUERY, "GPU time of passes"),
        (
            "INDIRECT_FIRST_INSTANCE",
            WgpuFeatures::INDIRECT_FIRST_INSTANCE,
            "Bevy's GPU-driven meshes",
        ),
        (
            "TEXTURE_INT64_ATOMIC",
            WgpuFeatures::TEXTURE_INT64_ATOMIC,
            "Bevy's meshlets, for comparison only",
        ),
    ];
    for (name, feature, what) in wanted {
        println!("  {} {name:<28} {what}", if features.contains(feature) { "yes" } else { "no " });
    }
    println!("limits");
    let limits = device.limits();
    let mib = |bytes: u64| format!("{} MiB", bytes >> 20);
    let surfels = limits.max_storage_buffer_binding_size / 8;
    let trees = limits.max_storage_buffer_binding_size / 32;
    println!(
        "  storage buffers per stage   {} (8 are needed)",
        limits.max_storage_buffers_per_shader_stage
    );
    println!(
        "  storage binding             {} ({} M surfels, {} M trees)",
        mib(limits.max_storage_buffer_binding_size),
        surfels / 1_000_000,
        trees / 1_000_000
    );
    println!("  buffer                      {}", mib(limits.max_buffer_size));
    println!(
        "  texture side                {} (larger LDIs are tiled)",
        limits.max_texture_dimension_2d
    );

    let support = SplatSupport::of(args.splat_path.into(), features, &limits);
    match &support {
        SplatSupport::U64 => println!("splats    one pass of 64-bit atomics: the device has them"),
        SplatSupport::U32 { reason } => {
            println!("splats    two passes of 32-bit atomics: {reason}")
        }
        SplatSupport::Off { reason } => println!("splats    off: {reason}"),
    }
    println!("{}", bevy_treeline::landscape::SkySupport::of(info));
    let software = info.device_type == wgpu::DeviceType::Cpu;
    println!(
        "peeling   {}",
        if software {
            "CPU twin (this GPU is a software driver; --peel gpu takes it all the same)"
        } else {
            "GPU"
        }
    );

    // A camera with a tree brings every pipeline to life.
    let (ready, problems) = exercise(&mut app)?;
    println!("pipelines {ready} ready");
    for problem in &problems {
        println!("  {problem}");
    }
    match support {
        SplatSupport::Off { reason } => {
            Err(ToolError::Message(format!("trees cannot be drawn as points: {reason}")))
        }
        _ if !problems.is_empty() => Err(ToolError::Message(format!(
            "{} pipelines did not compile, see above",
            problems.len()
        ))),
        _ => Ok(()),
    }
}

/// Draws a few frames of an empty forest, and says what became of the pipelines.
fn exercise(app: &mut App) -> ToolResult<(usize, Vec<String>)> {
    let image = crate::headless::target(app, 64, 64);
    let world = app.world_mut();
    world.spawn((crate::scene::plain_camera(), crate::headless::render_target(&image)));
    world.spawn(bevy_treeline::Forest::new([]).with([bevy_treeline::TreeInstance::default()]));
    for _ in 0..6 {
        crate::headless::step(app);
    }
    let render = app
        .get_sub_app(RenderApp)
        .ok_or_else(|| ToolError::NoGpu("there is no renderer".into()))?;
    Ok(pipeline_states(render.world()))
}
