//! `treeline`: fly over a forest, look at a tree, bake, compare with the truth, measure, ask the doctor.

mod bake;
mod bench;
mod compare;
mod doctor;
mod flip;
mod fly;
mod font;
mod headless;
mod movie;
mod options;
mod plant;
mod scene;
mod sheet;
mod subject;
mod summary;
mod table2;
mod view;

use clap::{Parser, Subcommand};
use std::process::ExitCode;

/// Draws huge vegetation landscapes as points, in Bevy.
#[derive(Parser)]
#[command(version, about, long_about = None)]
struct Args {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Fly over a forest: in a window, or as frames, a contact sheet and statistics.
    Fly(fly::FlyArgs),
    /// Look at a model or a plant of a species, as mesh and as points: in a window, or as a contact sheet.
    View(view::ViewArgs),
    /// Bake models to `.treeline` files and print what it took.
    Bake(bake::BakeArgs),
    /// Measure the error of points against the supersampled mesh, at several distances.
    Compare(compare::CompareArgs),
    /// Measure techniques side by side: frame times, memory, image errors.
    Bench(Box<bench::BenchArgs>),
    /// Say which adapter is used, what it can do, and which splat path that means.
    Doctor(doctor::DoctorArgs),
}

fn main() -> ExitCode {
    let result = match Args::parse().command {
        Command::Fly(args) => fly::run(&args),
        Command::View(args) => view::run(&args),
        Command::Bake(args) => bake::run(&args),
        Command::Compare(args) => compare::run(&args),
        Command::Bench(args) => bench::run(&args),
        Command::Doctor(args) => doctor::run(&args),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("treeline: {error}");
            ExitCode::FAILURE
        }
    }
}
