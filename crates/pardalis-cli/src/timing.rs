//! The one place where the program reads a clock: to report how long work took, and to know when the frames of live cameras arrive; never for a
//! result that comes from files.

use std::sync::OnceLock;
use std::time::Instant;

/// Seconds since the first call.
#[expect(
    clippy::disallowed_methods,
    reason = "frames of live cameras arrive when they do"
)]
pub(crate) fn now_s() -> f64 {
    static START: OnceLock<Instant> = OnceLock::new();
    START.get_or_init(Instant::now).elapsed().as_secs_f64()
}

/// Measures how long something takes.
pub(crate) struct Stopwatch(Instant);

impl Stopwatch {
    /// Starts now.
    #[expect(
        clippy::disallowed_methods,
        reason = "durations are reported and decide nothing"
    )]
    pub(crate) fn start() -> Self {
        Self(Instant::now())
    }

    /// Seconds since the start.
    pub(crate) fn elapsed_s(&self) -> f64 {
        self.0.elapsed().as_secs_f64()
    }
}
