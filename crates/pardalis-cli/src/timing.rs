//! Clocks. This is the only module that reads one: to report durations, and to time-stamp the frames of live
//! cameras. Results computed from files never depend on it.

use std::sync::OnceLock;
use std::time::Instant;

/// Returns the seconds since the first call.
#[expect(
    clippy::disallowed_methods,
    reason = "frames of live cameras are time-stamped on arrival"
)]
pub(crate) fn now_s() -> f64 {
    static START: OnceLock<Instant> = OnceLock::new();
    START.get_or_init(Instant::now).elapsed().as_secs_f64()
}

/// Returns a time of [`now_s`] in seconds since the beginning of 1970, UTC, by the clock of this computer.
#[expect(
    clippy::disallowed_methods,
    reason = "estimates that are sent carry the times of capture and sending"
)]
pub(crate) fn unix_s_at(time_s: f64) -> f64 {
    let since = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH);
    // A clock before 1970 is as wrong as one at it.
    let unix_s = since.map_or(0.0, |since| since.as_secs_f64());
    unix_s - (now_s() - time_s)
}

/// A stopwatch for durations.
pub(crate) struct Stopwatch(Instant);

impl Stopwatch {
    /// Starts the stopwatch.
    #[expect(clippy::disallowed_methods, reason = "durations are only reported")]
    pub(crate) fn start() -> Self {
        Self(Instant::now())
    }

    /// Returns the seconds since the start.
    pub(crate) fn elapsed_s(&self) -> f64 {
        self.0.elapsed().as_secs_f64()
    }
}
