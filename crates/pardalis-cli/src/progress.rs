//! Progress bars, and the check for interruption.

use anyhow::Result;
use indicatif::{ProgressBar, ProgressStyle};

use crate::interrupt;

/// A progress bar, shown only on a terminal.
pub(crate) struct Progress(ProgressBar);

impl Progress {
    /// Creates a bar for an operation on images; `images` is their number, if known.
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

    /// Advances the bar by one image. Fails if the user interrupted the program.
    pub(crate) fn step(&self) -> Result<()> {
        self.0.inc(1);
        if interrupt::requested() {
            return Err(anyhow::anyhow!("stopped; nothing was written"));
        }
        Ok(())
    }

    /// Runs an action, such as a warning, while the bar is hidden.
    pub(crate) fn aside(&self, act: impl FnOnce()) {
        self.0.suspend(act);
    }
}
