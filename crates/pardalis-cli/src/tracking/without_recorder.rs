//! In place of `recorder.rs` in programs that are built without MCAP: nothing can be written.

use std::path::Path;

use anyhow::Result;
use pardalis_scene::Scene;

use super::{Instant, Sink};
use crate::mcap::MISSING;
use crate::user_error::user_error;

pub(super) fn check_path(_: &Path, _: &Scene, _: &Path) -> Result<()> {
    Err(user_error!("--mcap: {MISSING}"))
}

/// No recording.
pub(crate) enum Recorder {}

impl Recorder {
    pub(super) fn create(_: &Path, _: &Scene) -> Result<Self> {
        Err(user_error!("--mcap: {MISSING}"))
    }

    pub(super) fn finish(self) -> Result<()> {
        match self {}
    }
}

impl Sink for Recorder {
    fn take(&mut self, _: &Instant) -> Result<()> {
        match *self {}
    }
}
