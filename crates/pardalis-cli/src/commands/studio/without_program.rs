//! In place of `program.rs` in programs that are built without the studio.

use std::path::Path;

use anyhow::Result;

use super::{Arguments, WatchOptions};
use crate::tracking::Watch;
use crate::user_error::user_error;

/// What is missing, and what to do.
const MISSING: &str = "this program was built without the studio; build it with `cargo build --release --features studio`, or install the Python package, which has it";

/// Says that the command is missing.
pub(crate) fn run(_: &Arguments) -> Result<()> {
    Err(user_error!("studio: {MISSING}"))
}

/// No page.
pub(crate) struct Watching {
    pub(crate) watch: Watch,
}

impl Watching {
    /// Says that the page is missing, if it is asked for.
    pub(crate) fn start(options: &WatchOptions, _: &Path) -> Result<Option<Self>> {
        if options.watch {
            return Err(user_error!("--watch: {MISSING}"));
        }
        Ok(None)
    }

    pub(crate) fn finish(self) {
        match self.watch {}
    }
}
