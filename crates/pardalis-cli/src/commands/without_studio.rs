//! In place of `studio/` in programs that are built without it.

use std::path::PathBuf;

use anyhow::Result;

use crate::user_error::user_error;

/// Sets up and tracks a scene in a browser; needs a program that was built with the feature studio
///
/// This program was built without it: build it with `cargo build --release --features studio`, or install the Python package, which has it.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    #[arg(hide = true)]
    inputs: Vec<PathBuf>,
}

/// Says that the command is missing.
pub(crate) fn run(_: &Arguments) -> Result<()> {
    Err(user_error!(
        "studio: this program was built without it; build it with `cargo build --release --features studio`, or install the Python \
         package, which has it"
    ))
}
