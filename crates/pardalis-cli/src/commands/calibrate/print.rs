//! `pardalis calibrate print`: a calibration board to print.

use std::path::PathBuf;

use anyhow::Result;

use crate::board::parse_board;
use crate::files::write_file;
use crate::output::{Shown, print};

/// Writes a calibration board in true size as an SVG document
///
/// Print it at 100 % (not "fit to page"), glue it to a flat surface, and measure a square: printers stretch.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  pardalis calibrate print --board checkerboard:9x6:0.025 -o board.svg
  pardalis calibrate print --board charuco:5x7:0.04:0.03:DICT_4X4_50 -o board.svg

A page of A4 has 210 x 297 mm. How boards are written: pardalis calibrate board --help.")]
pub(crate) struct Arguments {
    /// The board, as for `calibrate board`
    #[arg(long, value_name = "BOARD")]
    board: String,
    /// The file to write
    #[arg(short, long, value_name = "FILE.svg")]
    output: PathBuf,
}

/// Runs the command.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let board = parse_board(&arguments.board)?;
    write_file(&arguments.output, board.to_svg().as_bytes())?;
    print(arguments.output.shown());
    Ok(())
}
