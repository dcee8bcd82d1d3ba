//! The `pardalis` program, as a library for its `main.rs`, for the Python package and for fuzzing. It has no stable interface:
//! programs use the crate `pardalis`.

mod arguments;
mod board;
mod capture_clock;
mod commands;
mod detections;
mod draw;
mod files;
mod focal_length;
mod folder;
#[cfg(any(test, feature = "fuzz"))]
mod fuzzed_file;
#[cfg(any(test, feature = "fuzz"))]
pub mod fuzzing;
mod interrupt;
#[cfg_attr(not(feature = "mcap"), path = "without_mcap.rs")]
mod mcap;
mod measurements;
mod named_files;
mod numbers;
mod output;
#[cfg(feature = "package")]
mod package;
mod platforms;
mod program_file;
mod progress;
mod recordings;
mod rectangle;
mod report;
mod results;
mod rig;
mod scene;
mod scene_files;
mod scene_tracker;
mod shell_word;
mod sight;
mod source;
mod tables;
mod timing;
mod track_start;
mod tracking;
mod units;
mod user_error;

use std::ffi::OsString;
use std::path::PathBuf;

use clap::{Parser, Subcommand};

pub use scene_tracker::{scene_without_inputs, tracker_of_scene};

#[cfg(feature = "mcap")]
pub use mcap::ros2;

/// Tracks coloured objects in 3D from images, videos and cameras.
#[derive(Parser)]
#[command(name = "pardalis", version, about, arg_required_else_help = true)]
#[command(after_help = "Start with:
  pardalis demo                                   tracks a bundled sequence
  pardalis learn --image a.jpg --rect 10,20,30,40 -o ball.colors.toml
  pardalis init images --fps 25 --camera pinhole --colors ball.colors.toml
  pardalis check scene.toml                       problems of the scene, and its first frames
  pardalis track scene.toml --annotate            tracks, plots and annotated frames
  pardalis view scene-tracks                      shows a track in 3D in the browser
  pardalis locate scene.toml --at 460,88          single images, independently
  pardalis rectify scene.toml                     maps of the ground, seen from above

In a browser:
  pardalis studio ride.mp4                        all of this, step by step

Without cameras:
  pardalis simulate data/worlds/ring.toml -o ring   images of a synthetic world, with ground truth

Cameras:
  pardalis devices                                   cameras of this computer, as lines of a scene
  pardalis camera show calib.yml                     properties of a calibration in any format
  pardalis init images --fps 25 --camera calib.yml   a scene that uses it
  pardalis calibrate board images --board checkerboard:9x6:0.025 --model all
  pardalis calibrate pose points.csv --camera calib.yml
  pardalis calibrate plane images --size 2.0x1.5     a floor from a rectangle on it, with an unknown camera

Exit codes: 0 success; 2 invalid input or usage; 1 any other error.")]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

/// The commands, each in its own module under `commands/`.
#[derive(Subcommand)]
enum Command {
    Calibrate(commands::calibrate::Arguments),
    Demo(commands::demo::Arguments),
    Devices(commands::devices::Arguments),
    Studio(commands::studio::Arguments),
    Init(commands::init::Arguments),
    Learn(commands::learn::Arguments),
    Camera(commands::camera::Arguments),
    Check(commands::check::Arguments),
    Track(commands::track::Arguments),
    Locate(commands::locate::Arguments),
    Rectify(commands::rectify::Arguments),
    Evaluate(commands::evaluate::Arguments),
    Likelihood(commands::likelihood::Arguments),
    Measure(commands::measure::Arguments),
    Simulate(commands::simulate::Arguments),
    View(commands::view::Arguments),
}

/// Runs the command of a command line, whose first argument is the name of the program, and returns the exit code.
///
/// `file` is the executable or library that contains the program. The bundled data are looked for in the folders above it, and results of earlier versions are
/// recognised by its size and time.
pub fn run(arguments: impl IntoIterator<Item = OsString>, file: Option<PathBuf>) -> u8 {
    if let Some(file) = file {
        program_file::set(file);
    }
    #[cfg(feature = "package")]
    return user_error::exit_code_of(&package::write(
        <Arguments as clap::CommandFactory>::command(),
        arguments,
    ));
    #[cfg(not(feature = "package"))]
    run_command(arguments)
}

/// Runs the command of a command line.
#[cfg_attr(feature = "package", expect(dead_code))]
fn run_command(arguments: impl IntoIterator<Item = OsString>) -> u8 {
    let arguments = match Arguments::try_parse_from(arguments) {
        Ok(arguments) => arguments,
        Err(message) => return user_error::exit_code_of_usage(&message),
    };
    let outcome = match arguments.command {
        Command::Calibrate(arguments) => commands::calibrate::run(&arguments),
        Command::Demo(arguments) => commands::demo::run(&arguments),
        Command::Devices(arguments) => commands::devices::run(&arguments),
        Command::Studio(arguments) => commands::studio::run(&arguments),
        Command::Init(arguments) => commands::init::run(&arguments),
        Command::Learn(arguments) => commands::learn::run(&arguments),
        Command::Camera(arguments) => commands::camera::run(&arguments),
        Command::Check(arguments) => commands::check::run(&arguments),
        Command::Track(arguments) => commands::track::run(&arguments),
        Command::Locate(arguments) => commands::locate::run(&arguments),
        Command::Rectify(arguments) => commands::rectify::run(&arguments),
        Command::Evaluate(arguments) => commands::evaluate::run(&arguments),
        Command::Likelihood(arguments) => commands::likelihood::run(&arguments),
        Command::Measure(arguments) => commands::measure::run(&arguments),
        Command::Simulate(arguments) => commands::simulate::run(&arguments),
        Command::View(arguments) => commands::view::run(&arguments),
    };
    user_error::exit_code_of(&outcome.and_then(|()| output::finish()))
}
