//! Live cameras that are open already: opening them again would take seconds, and some senders serve one connection.

use anyhow::Result;

use super::{Source, SourceConfig};
use crate::interrupt::Stop;

/// Live cameras that are open already when a scene is opened, and what ends the wait for others.
#[derive(Default)]
pub(crate) struct OpenCameras {
    /// Ends the wait for a camera.
    pub(crate) stop: Stop,
    /// Those that are open already, with their settings. They are taken.
    pub(crate) open: Vec<(SourceConfig, Source)>,
}

impl OpenCameras {
    /// Returns the source with these settings, which is opened unless it is open already.
    pub(crate) fn take(&mut self, config: &SourceConfig) -> Result<Source> {
        let is_open = |(open, _): &(SourceConfig, Source)| open.is_same(config);
        match self.open.iter().position(is_open) {
            Some(number) => Ok(self.open.swap_remove(number).1),
            None => Source::open_until(config, &self.stop),
        }
    }
}
