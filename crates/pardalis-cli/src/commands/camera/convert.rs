//! `pardalis camera convert`: a calibration in another program's format.

use std::path::PathBuf;

use anyhow::Result;
use pardalis::interchange::{self, Format};

use super::load::Selection;
use crate::fault::fault;
use crate::files::write_file;
use crate::say::say;

/// Writes cameras in another format
///
/// Parameters keep every digit. What a format cannot hold is refused by name, so nothing is lost unsaid.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  pardalis camera convert calib.yml --to kalibr -o camchain.yaml
  pardalis camera convert four_numbers.yml --as fisheye --to pardalis -o lens.toml
  pardalis camera convert rig.toml --camera cam1 --to ros -o cam1.yaml")]
pub(super) struct Arguments {
    #[command(flatten)]
    selection: Selection,
    /// The format to write: pardalis, opencv-yaml, opencv-xml, ros, kalibr, ocamcalib or basalt
    #[arg(long, value_name = "FORMAT", value_parser = format)]
    to: Format,
    /// The file to write
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
}

fn format(word: &str) -> Result<Format, String> {
    Format::ALL
        .into_iter()
        .find(|format| format.name() == word)
        .ok_or_else(|| format!("allowed: {}", Format::ALL.map(Format::name).join(", ")))
}

/// Runs the command.
pub(super) fn run(arguments: &Arguments) -> Result<()> {
    let cameras = arguments.selection.cameras()?;
    let text = interchange::write(arguments.to, &cameras)
        .map_err(|error| fault!("{}: {error}", arguments.selection.file.display()))?;
    write_file(&arguments.output, text.as_bytes())?;
    for camera in &cameras {
        say(format!("{}: {}", camera.name, camera.camera.kind()));
    }
    say(format!("  {}", arguments.output.display()));
    Ok(())
}
