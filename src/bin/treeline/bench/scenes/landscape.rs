//! The landscape of `treeline fly`: ground, sky and trees of all species, and a stretch of its flight.
//!
//! One landscape for every number of trees: the same ground, the same places where forest grows, the same way of the camera.
//! More trees stand denser, and those of a smaller number are among those of a larger one. Ground cover is left out: the
//! number of instances is that of all there is.

use super::{BenchScene, Scenery, View};
use crate::{
    bench::args::BenchArgs,
    fly::{
        FlyArgs,
        world::{self, Flight, Plan},
    },
    options::ToolResult,
    scene,
};
use bevy::prelude::*;
use bevy_treeline::species::{SpeciesKind, preset, species_names};
use clap::Parser;

/// Side of the ground, kilometres.
const SIDE_KM: u32 = 16;
/// Metres that the flying camera moves between two frames: 108 km/h at 60 frames a second.
const STEP_M: f32 = 0.5;

/// The options of `fly`, for its defaults.
#[derive(Parser)]
struct Fly {
    #[command(flatten)]
    args: FlyArgs,
}

/// The scene.
pub struct Landscape {
    args: FlyArgs,
    plan: Option<Plan>,
    flight: Flight,
    view: View,
    /// Where on the way the last frame is, 0 to 1.
    at: f32,
    /// Points of all species, one plant each.
    points_baked: u64,
}

/// Names of what grows.
pub fn species(args: &BenchArgs) -> Vec<String> {
    if let Some(tree) = &args.tree {
        return vec![tree.clone()];
    }
    let is_tree = |name: &&str| preset(name).is_ok_and(|s| s.kind == SpeciesKind::Tree);
    species_names().iter().copied().filter(is_tree).map(str::to_owned).collect()
}

/// The options of `fly` that make this landscape.
fn fly_args(args: &BenchArgs, instances: u64) -> FlyArgs {
    let side = format!("{SIDE_KM}km");
    let species = species(args).join(",");
    let what = match &args.tree {
        Some(tree) if !species_names().contains(&tree.as_str()) && !tree.ends_with(".ron") => {
            ["--tree".to_owned(), tree.clone()]
        }
        _ => ["--species".to_owned(), species],
    };
    let fixed = ["fly", "--side", &side, "--variants", "1", "--sky", "gradient"];
    let fly = Fly::parse_from(fixed.into_iter().map(str::to_owned).chain(what));
    FlyArgs {
        trees: Some(instances),
        seed: args.seed,
        size: args.size,
        bake: args.bake.clone(),
        ..fly.args
    }
}

impl Landscape {
    pub fn new(args: &BenchArgs, instances: u64, view: View) -> ToolResult<Self> {
        let fly = fly_args(args, instances);
        let plan = world::prepare_one_landscape(&fly)?;
        Ok(Self {
            flight: plan.flight(),
            points_baked: plan.points_baked(),
            plan: Some(plan),
            args: fly,
            view,
            at: args.at,
        })
    }
}

impl BenchScene for Landscape {
    fn build(&mut self, app: &mut App) {
        if let Some(plan) = self.plan.take() {
            world::build(app, &self.args, plan, true);
        }
    }

    fn set_up(&self, _world: &mut World) -> Scenery {
        Scenery { ground: None, sky: scene::SKY }
    }

    fn camera(&self, world: &mut World, _height: u32) -> Entity {
        world::camera(world, &self.args)
    }

    fn trees(&self) -> Option<&[Transform]> {
        None
    }

    fn points_baked(&self) -> Option<u64> {
        Some(self.points_baked)
    }

    fn place(&self, steps: u32) -> Transform {
        let back = if self.view == View::Flying { steps as f32 * STEP_M } else { 0.0 };
        self.flight.place((self.at - back / self.flight.0.length_m()).rem_euclid(1.0))
    }
}
