//! `pardalis camera`: shows cameras and converts their files.

mod convert;
mod grid;
pub(super) mod load;
pub(super) mod optics;
mod show;

use anyhow::Result;
use clap::Subcommand;

/// Shows calibrated cameras and converts their files
///
/// Reads Pardalis calibrations and scenes, OpenCV YAML and XML, ROS camera_info, Kalibr camchains,
/// OCamCalib's calib_results.txt, Basalt JSON and the camera.json of sequence folders. The format is detected
/// from the content.
#[derive(Debug, clap::Args)]
#[command(arg_required_else_help = true)]
pub(crate) struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    Show(show::Arguments),
    Convert(convert::Arguments),
}

/// Runs the command.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    match &arguments.command {
        Command::Show(arguments) => show::run(arguments),
        Command::Convert(arguments) => convert::run(arguments),
    }
}
