//! `pardalis calibrate`: intrinsics, poses, rigs, planes, mounts on robots and time offsets of cameras.

mod board;
mod board_checks;
mod board_rig;
mod board_rig_report;
mod fit;
#[cfg(feature = "studio")]
pub(super) mod held;
pub(super) mod images;
mod model;
mod mount;
pub(crate) mod observations;
mod output;
mod page;
mod plane;
mod points;
pub(crate) mod pose;
mod print;
mod report;
pub(super) mod rig;
pub(super) mod time;
mod trial;

use anyhow::Result;

/// Calibrates cameras: intrinsics, poses and rigs from boards, known points or a ball, the ground plane, mounts on robots, and time offsets
#[derive(Debug, clap::Args)]
#[command(arg_required_else_help = true)]
#[command(after_help = "Examples, in the order of use:
  pardalis calibrate print --board checkerboard:9x6:0.025 -o board.svg
  pardalis calibrate board images --board checkerboard:9x6:0.025 --model all -o lens
  pardalis calibrate pose points.csv --camera lens/camera.toml -o pose
  pardalis calibrate points points.csv --model all --size 640x480   lens and pose without a board
  pardalis calibrate plane images --size 2.0x1.5 -o floor       a floor from a rectangle on it, with an unknown camera
  pardalis calibrate mount scene.toml --target ball        a camera on a robot, from a ball at rest
  pardalis calibrate rig scene.toml --corrected corrected.toml    several cameras, from a ball waved through the room
  pardalis calibrate time scene.toml --corrected corrected.toml   several cameras with unsynchronised clocks")]
pub(crate) struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, clap::Subcommand)]
enum Command {
    Points(points::Arguments),
    Board(board::Arguments),
    Pose(pose::Arguments),
    Mount(mount::Arguments),
    Plane(plane::Arguments),
    Print(print::Arguments),
    Rig(rig::Arguments),
    Time(time::Arguments),
}

/// Runs the command.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    match &arguments.command {
        Command::Points(arguments) => points::run(arguments),
        Command::Board(arguments) => board::run(arguments),
        Command::Pose(arguments) => pose::run(arguments),
        Command::Mount(arguments) => mount::run(arguments),
        Command::Plane(arguments) => plane::run(arguments),
        Command::Print(arguments) => print::run(arguments),
        Command::Rig(arguments) => rig::run(arguments),
        Command::Time(arguments) => time::run(arguments),
    }
}
