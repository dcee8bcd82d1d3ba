//! Command-line options and parsers that several commands share.

use anyhow::{Context as _, Result};
use rayon::{ThreadPool, ThreadPoolBuilder};

/// How many threads a command uses.
#[derive(Debug, Clone, Copy, Default, clap::Args)]
pub(crate) struct Threads {
    /// Number of threads; results do not depend on it [default: one per core]
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
}

impl Threads {
    /// A single thread.
    pub(crate) const ONE: Self = Self { threads: Some(1) };

    /// Starts the threads.
    pub(crate) fn start(self) -> Result<ThreadPool> {
        ThreadPoolBuilder::new()
            .num_threads(self.threads.map_or(0, usize::from))
            .build()
            .context("the threads cannot be started")
    }
}

/// Parses `WIDTHxHEIGHT` in pixels.
pub(crate) fn parse_size(text: &str) -> Result<(usize, usize), String> {
    let sides = text
        .split_once('x')
        .and_then(|(width, height)| Some((width.parse().ok()?, height.parse().ok()?)));
    let allowed = 1..=pardalis_core::error::MAX_IMAGE_SIDE_PX;
    sides
        .filter(|(width, height)| allowed.contains(width) && allowed.contains(height))
        .ok_or_else(|| {
            format!(
                "allowed: width and height in pixels up to {}, such as 640x480",
                allowed.end()
            )
        })
}

/// Parses a duration in seconds.
pub(crate) fn parse_duration_s(text: &str) -> Result<f64, String> {
    let duration_s = text.parse().ok();
    let is_valid = |&duration_s: &f64| duration_s > 0.0 && duration_s.is_finite();
    duration_s
        .filter(is_valid)
        .ok_or_else(|| "allowed: a number of seconds above 0".to_owned())
}
