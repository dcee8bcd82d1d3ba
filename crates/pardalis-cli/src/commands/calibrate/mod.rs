//! `pardalis calibrate`: cameras from known points or from images of a board, the plane that one sees, and their clocks.

mod board;
mod time;
mod fit;
mod images;
mod model;
mod observations;
mod output;
mod page;
mod plane;
mod points;
mod pose;
mod print;
mod report;
mod rig;
mod rig_report;
mod trial;

use anyhow::Result;

pub(super) use model::parse_size;

/// Calibrates cameras from known points or from images of a board, or finds a camera's pose, its plane, or the time between clocks
#[derive(Debug, clap::Args)]
#[command(arg_required_else_help = true)]
#[command(after_help = "Examples, in the order of use:
  pardalis calibrate print --board checkerboard:9x6:0.025 -o board.svg
  pardalis calibrate board images --board checkerboard:9x6:0.025 --model all -o lens
  pardalis calibrate pose points.csv --camera lens/camera.toml -o pose
  pardalis calibrate points points.csv --model all --size 640x480   lens and pose without a board
  pardalis calibrate plane images --size 2.0x1.5 -o floor       a floor by a rectangle on it, the camera unknown
  pardalis calibrate clocks scene.toml --corrected corrected.toml   several cameras that run on their own clocks")]
pub(crate) struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, clap::Subcommand)]
enum Command {
    Points(points::Arguments),
    Board(board::Arguments),
    Pose(pose::Arguments),
    Plane(plane::Arguments),
    Print(print::Arguments),
    Time(time::Arguments),
}

/// Runs the command.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    match &arguments.command {
        Command::Points(arguments) => points::run(arguments),
        Command::Board(arguments) => board::run(arguments),
        Command::Pose(arguments) => pose::run(arguments),
        Command::Plane(arguments) => plane::run(arguments),
        Command::Print(arguments) => print::run(arguments),
        Command::Time(arguments) => time::run(arguments),
    }
}
