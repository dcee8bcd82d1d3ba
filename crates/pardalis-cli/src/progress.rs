//! How far a command is, and a way to stop it.

use anyhow::Result;
use indicatif::{ProgressBar, ProgressStyle};

use crate::interrupt;

/// A bar on a terminal, nothing elsewhere.
pub(crate) struct Progress(ProgressBar);

impl Progress {
    /// Of something that is done to so many images, where their number is known.
    pub(crate) fn new(doing: &'static str, images: Option<usize>) -> Self {
        interrupt::listen();
        let (bar, template) = match images {
            Some(count) => (
                ProgressBar::new(count as u64),
                "{msg} {bar:32} {pos}/{len} images, {eta} left",
            ),
            None => (ProgressBar::no_length(), "{msg} {spinner} {pos} images"),
        };
        let bar = bar.with_message(doing);
        Self(match ProgressStyle::with_template(template) {
            Ok(style) => bar.with_style(style),
            Err(_) => bar,
        })
    }

    /// Another image is done; fails where the user asked to stop.
    pub(crate) fn step(&self) -> Result<()> {
        self.0.inc(1);
        if interrupt::requested() {
            return Err(anyhow::anyhow!("stopped; nothing was written"));
        }
        Ok(())
    }

    /// Does something, warn say, while the bar is out of the way.
    pub(crate) fn aside(&self, act: impl FnOnce()) {
        self.0.suspend(act);
    }
}
