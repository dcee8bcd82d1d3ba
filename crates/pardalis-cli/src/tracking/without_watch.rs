//! In place of `watch.rs` in programs that are built without the studio: nothing is shown.

use std::path::Path;

use anyhow::Result;
use pardalis::Tracker;
use pardalis_scene::Scene;

use super::{Instant, Sink};

/// Nothing that shows a run.
#[derive(Debug, Clone)]
pub(crate) enum Watch {}

impl Watch {
    pub(super) fn sink(&self, _: &Path, _: &Scene, _: &Tracker) -> Result<WatchSink> {
        match *self {}
    }
}

/// No run that is shown.
pub(crate) enum WatchSink {}

impl Sink for WatchSink {
    fn take(&mut self, _: &Instant) -> Result<()> {
        match *self {}
    }
}
