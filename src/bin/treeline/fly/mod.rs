//! `treeline fly`: a flight over a landscape, in a window or as frames with statistics.

mod camera;
mod graph;
pub mod headless;
mod panel;
mod roster;
mod shipped;
mod window;
pub mod world;

use crate::{
    options::{
        BakeOptions, SplatPathArg, ToolError, ToolResult, parse_count, parse_metres, parse_quality,
        parse_size,
    },
    view::has_display,
};
use clap::{Args, ValueEnum};
use std::path::PathBuf;

/// What draws the sky.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum SkyArg {
    /// Bevy's atmosphere where the adapter can, else a gradient.
    #[default]
    Auto,
    /// A clear-sky gradient.
    Gradient,
    /// Bevy's atmosphere (never on software drivers: they crash in it).
    Atmosphere,
}

#[derive(Args, Clone)]
pub struct FlyArgs {
    /// Trees of the whole landscape, 1000 to 10M (default: as many as grow there).
    #[arg(long, value_parser = parse_count, allow_negative_numbers = true)]
    pub trees: Option<u64>,
    /// Trees per hectare of closed forest instead of a total.
    #[arg(long, conflicts_with = "trees", allow_negative_numbers = true)]
    pub density: Option<f32>,
    /// Species that grow, by name or species file (.ron), with commas (default: all; `--species list` names them).
    #[arg(long, value_delimiter = ',')]
    pub species: Vec<String>,
    /// Seeds per species: how many different trees of each.
    #[arg(long, default_value_t = 2, value_parser = clap::value_parser!(u32).range(1..=8), allow_negative_numbers = true)]
    pub variants: u32,
    /// A model to plant instead of the species; may be repeated.
    #[arg(long = "tree", conflicts_with = "species")]
    pub models: Vec<PathBuf>,
    /// Height that each model of --tree is scaled to, metres (0: as modelled).
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true)]
    pub height: f32,
    /// Side of the landscape, 1km to 64km.
    #[arg(long, default_value = "8km", value_parser = parse_metres, allow_negative_numbers = true)]
    pub side: f32,
    /// A real landscape: a 16-bit grey PNG with a JSON of the same name beside it.
    #[arg(long)]
    pub dem: Option<PathBuf>,
    /// Seed of ground, trees and flight.
    #[arg(long, default_value_t = 1, allow_negative_numbers = true)]
    pub seed: u64,
    /// Time of day, hours (0 to 24).
    #[arg(long, default_value_t = 10.5, allow_negative_numbers = true)]
    pub hour: f32,
    /// Season: 0 is summer, 1 the height of autumn.
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true)]
    pub season: f32,
    /// Distance at which haze leaves 5 % of the contrast.
    #[arg(long, default_value = "24km", value_parser = parse_metres, allow_negative_numbers = true)]
    pub visibility: f32,
    /// What draws the sky.
    #[arg(long, value_enum, default_value = "auto")]
    pub sky: SkyArg,
    /// No window: write frames, a contact sheet, statistics and a film.
    #[arg(long)]
    pub headless: bool,
    /// Frames of a headless flight, once around.
    #[arg(long, default_value_t = 48, allow_negative_numbers = true)]
    pub frames: u32,
    /// Picture size, WIDTHxHEIGHT.
    #[arg(long, default_value = "1280x720", value_parser = parse_size)]
    pub size: (u32, u32),
    /// Folder for frames, `sheet.png`, `stats.csv` and the film.
    #[arg(long, default_value = "out/fly")]
    pub out: PathBuf,
    /// Write a summary of a headless flight to this file.
    #[arg(long)]
    pub json: Option<PathBuf>,
    /// q: points per pixel of surface.
    #[arg(long, default_value_t = 1.0, allow_negative_numbers = true, value_parser = parse_quality)]
    pub quality: f32,
    /// Points a frame that q is lowered for, such as 500k or 2M (q is not raised above --quality).
    #[arg(long, value_parser = parse_count, conflicts_with = "budget_ms", allow_negative_numbers = true)]
    pub budget_points: Option<u64>,
    /// GPU milliseconds of the trees' passes that q is lowered for, where the adapter measures time.
    #[arg(long, allow_negative_numbers = true)]
    pub budget_ms: Option<f32>,
    /// Meshes up to this distance at least, metres.
    #[arg(long, default_value_t = bevy_treeline::TreelineSettings::default().min_mesh_distance, allow_negative_numbers = true)]
    pub mesh_distance: f32,
    /// Trees that are meshes at one time, at most.
    #[arg(long, default_value_t = bevy_treeline::NearMeshes::default().max_trees)]
    pub near_meshes: usize,
    /// Trees are planted up to this distance.
    #[arg(long, default_value = "9km", value_parser = parse_metres, allow_negative_numbers = true)]
    pub tree_distance: f32,
    /// Memory for trees and chunks, MiB.
    #[arg(long, default_value_t = 2048, value_parser = clap::value_parser!(u32).range(64..=262_144), allow_negative_numbers = true)]
    pub memory: u32,
    /// Part of the way around that a headless flight covers (small values: slow motion).
    #[arg(long, default_value_t = 1.0, allow_negative_numbers = true)]
    pub way: f32,
    /// Where on the way it starts, 0 to 1.
    #[arg(long, default_value_t = 0.0, allow_negative_numbers = true)]
    pub start: f32,
    /// Near trees cast and receive Bevy's shadow maps too (the ground has tree shadows without them).
    #[arg(long)]
    pub shadow_maps: bool,
    /// No forest: to see what everything else costs.
    #[arg(long, visible_alias = "no-points")]
    pub no_forest: bool,
    /// Measure how much each frame differs from the one before (FLIP), into stats.csv.
    #[arg(long)]
    pub flip: bool,
    /// Kernels that draw the points.
    #[arg(long, value_enum, default_value = "auto")]
    pub splat_path: SplatPathArg,
    #[command(flatten)]
    pub bake: BakeOptions,
}

fn check(ok: bool, what: &str) -> ToolResult {
    if ok { Ok(()) } else { Err(ToolError::Message(what.to_owned())) }
}

fn check_args(args: &FlyArgs) -> ToolResult {
    check(args.frames > 0, "--frames 0 would write nothing: give 1 or more")?;
    check(
        args.trees != Some(0),
        "--trees 0 is no forest: give 1000 or more, or --no-forest for the bare ground",
    )?;
    check(
        args.trees.is_none_or(|n| (1..=10_000_000).contains(&n)),
        "--trees must be at most 10M (10,000,000)",
    )?;
    check(
        args.density.is_none_or(|d| d > 0.0 && d.is_finite()),
        "--density must be a positive number of trees per hectare, such as 400",
    )?;
    check((1_000.0..=64_000.0).contains(&args.side), "--side must be 1km to 64km")?;
    check(
        args.height.is_finite() && args.height >= 0.0,
        "--height must be 0 (as modelled) or a height in metres",
    )?;
    check((0.0..=24.0).contains(&args.hour), "--hour must be 0 to 24, such as 17.5")?;
    check((0.0..=1.0).contains(&args.season), "--season must be 0 (summer) to 1 (autumn)")?;
    check(args.visibility >= 100.0, "--visibility must be at least 100 metres")?;
    check(args.tree_distance >= 100.0, "--tree-distance must be at least 100 metres")?;
    check(
        args.budget_points.is_none_or(|n| (1..=u64::from(u32::MAX)).contains(&n)),
        "--budget-points must be 1 to 4294M",
    )?;
    check(
        args.budget_ms.is_none_or(|ms| ms > 0.0 && ms.is_finite()),
        "--budget-ms must be a positive number of milliseconds, such as 4",
    )?;
    check(args.mesh_distance >= 0.0, "--mesh-distance must be 0 or a distance in metres")?;
    check(args.start.is_finite() && args.way.is_finite(), "--start and --way must be numbers")
}

pub fn run(args: &FlyArgs) -> ToolResult {
    check_args(args)?;
    if args.species.iter().any(|name| name == "list") {
        println!("{}", bevy_treeline::species::species_names().join("\n"));
        return Ok(());
    }
    let windowed = !args.headless && has_display();
    if windowed {
        return window::run(args);
    }
    // What is misspelt leaves no empty folder.
    roster::chosen(args)?;
    crate::options::make_folder(&args.out)?;
    if !args.headless {
        println!("there is no display, so frames are written (the same as --headless)");
    }
    headless::run(args)
}
