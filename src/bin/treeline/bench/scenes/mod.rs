//! What is drawn: light, ground, where trees stand and where the camera is. One file a scene.

pub mod baseline;
pub mod single;

use super::{BenchArgs, plan::Configuration};
use crate::bench::tree::Tree;
use bevy::prelude::*;
use clap::ValueEnum;

/// `--scene`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, ValueEnum)]
pub enum SceneArg {
    /// The protocol for comparison with stock Bevy: a square of 10 m trees on a plain.
    Baseline,
    /// One tree before a plain background, at several distances (--distances).
    Single,
}

impl SceneArg {
    /// As on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Baseline => "baseline",
            Self::Single => "single",
        }
    }
}

/// How the camera looks at a scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum View {
    Still,
    /// It moves from frame to frame, by the frame's number alone.
    Flying,
    /// Still, this far from a single tree, in units of the model.
    Distance(f32),
}

/// What a scene has put into the world besides trees.
pub struct Scenery {
    /// Hidden to see what trees alone cover.
    pub ground: Option<Entity>,
    /// Behind everything.
    pub sky: Color,
}

/// A scene that techniques can be measured in.
pub trait BenchScene {
    /// Adds light, ground and sky.
    fn set_up(&self, world: &mut World) -> Scenery;

    /// Places of the model in the world.
    fn trees(&self) -> &[Transform];

    /// Where the camera is this many frames before the last one.
    fn place(&self, steps: u32) -> Transform;

    /// Its vertical field of view for a picture of this height, radians.
    fn field_of_view(&self, _height: u32) -> f32 {
        std::f32::consts::FRAC_PI_4
    }

    /// First row of the part of the picture that the columns `.._below` are about.
    fn first_row_below(&self, _height: u32) -> Option<u32> {
        None
    }
}

/// The scene of a configuration.
pub fn scene(args: &BenchArgs, configuration: &Configuration, tree: &Tree) -> Box<dyn BenchScene> {
    let bounds = tree.model.bounds();
    match (args.scene, configuration.view) {
        (_, View::Distance(distance)) => Box::new(single::Single::new(&bounds, distance)),
        (_, view) => Box::new(baseline::Baseline::new(
            configuration.instances,
            args.seed,
            bounds.extent().y,
            bounds.min.y,
            view,
        )),
    }
}
