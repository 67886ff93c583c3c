//! `treeline fly`: a flight over a forest, in a window or as frames with statistics.

pub mod headless;
mod window;
mod world;

use crate::{
    options::{
        BakeOptions, SplatPathArg, ToolError, ToolResult, bake_with_progress, parse_quality,
        parse_size,
    },
    view::has_display,
};
use bevy_treeline::bake::Baked;
use clap::Args;
use std::path::PathBuf;

#[derive(Args)]
pub struct FlyArgs {
    /// Models to plant (default: the trees in assets/trees).
    #[arg(long = "tree")]
    pub trees: Vec<PathBuf>,
    /// Number of trees.
    #[arg(long, default_value_t = 4000, allow_negative_numbers = true)]
    pub count: usize,
    /// Height that each model is scaled to, metres (0: as modelled).
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true)]
    pub height: f32,
    /// Side of the ground, metres.
    #[arg(long, default_value_t = 1000.0, allow_negative_numbers = true)]
    pub side: f32,
    /// Seed of ground, trees and flight.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// No window: write frames, a contact sheet and statistics.
    #[arg(long)]
    pub headless: bool,
    /// Frames of a headless flight, once around.
    #[arg(long, default_value_t = 48, allow_negative_numbers = true)]
    pub frames: u32,
    /// Picture size, WIDTHxHEIGHT.
    #[arg(long, default_value = "1280x720", value_parser = parse_size)]
    pub size: (u32, u32),
    /// Folder for frames, `sheet.png`, `stats.csv`.
    #[arg(long, default_value = "out/fly")]
    pub out: PathBuf,
    /// q: points per pixel of surface.
    #[arg(long, default_value_t = bevy_treeline::TreelineSettings::default().quality, allow_negative_numbers = true, value_parser = parse_quality)]
    pub quality: f32,
    /// Meshes up to this distance at least, metres.
    #[arg(long, default_value_t = bevy_treeline::TreelineSettings::default().min_mesh_distance, allow_negative_numbers = true)]
    pub mesh_distance: f32,
    /// Part of the way around that a headless flight covers (small values: slow motion).
    #[arg(long, default_value_t = 1.0, allow_negative_numbers = true)]
    pub way: f32,
    /// Where on the way it starts, 0 to 1.
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true)]
    pub start: f32,
    /// No points: to see what the ground and the near meshes cost.
    #[arg(long)]
    pub no_points: bool,
    /// Kernels that draw the points.
    #[arg(long, value_enum, default_value = "auto")]
    pub splat_path: SplatPathArg,
    #[command(flatten)]
    pub bake: BakeOptions,
}

/// The trees of this project, next to the binary's sources or the working folder.
fn default_trees() -> ToolResult<Vec<PathBuf>> {
    let candidates = [
        PathBuf::from("assets/trees"),
        PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("assets/trees"),
    ];
    for folder in &candidates {
        let Ok(entries) = std::fs::read_dir(folder) else { continue };
        let mut trees: Vec<PathBuf> = entries.flatten().map(|e| e.path()).collect();
        trees.retain(|p| p.extension().is_some_and(|e| e == "glb"));
        trees.sort();
        if !trees.is_empty() {
            return Ok(trees);
        }
    }
    Err(ToolError::Message(
        "there are no trees in assets/trees: run this in the project's folder, make them with `cargo run --release \
         --example make_trees`, or name a model with --tree FILE"
            .into(),
    ))
}

pub fn run(args: &FlyArgs) -> ToolResult {
    let check =
        |ok: bool, what: &str| if ok { Ok(()) } else { Err(ToolError::Message(what.to_owned())) };
    check(args.frames > 0, "--frames 0 would write nothing: give 1 or more")?;
    check(args.count > 0, "--count 0 is no forest: give 1 or more")?;
    let side = args.side;
    check(
        side.is_finite() && (50.0..=16_000.0).contains(&side),
        "--side must be 50 to 16000 metres",
    )?;
    check(
        args.height.is_finite() && args.height >= 0.0,
        "--height must be 0 (as modelled) or a height in metres",
    )?;
    let distance = args.mesh_distance;
    check(distance >= 0.0, "--mesh-distance must be 0 or a distance in metres")?;
    check(args.start.is_finite() && args.way.is_finite(), "--start and --way must be numbers")?;
    let files = if args.trees.is_empty() { default_trees()? } else { args.trees.clone() };
    let windowed = !args.headless && has_display();
    if !windowed {
        crate::options::make_folder(&args.out)?;
    }
    let (settings, context) = (args.bake.settings(), args.bake.context()?);
    let baked = files.iter().map(|file| bake_with_progress(file, &settings, &context));
    let baked: Vec<Baked> = baked.collect::<ToolResult<_>>()?;
    drop(context);
    if windowed {
        window::run(args, &baked)
    } else {
        if !args.headless {
            println!("there is no display, so frames are written (the same as --headless)");
        }
        headless::run(args, &baked)
    }
}
