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
pub(crate) fn unix_s_at(time_s: f64) -> f64 {
    unix_s() - (now_s() - time_s)
}

/// Returns a time in seconds since the beginning of 1970, UTC, as one of [`now_s`]: the inverse of [`unix_s_at`].
pub(crate) fn now_s_at_unix(unix_s: f64) -> f64 {
    now_s() - (self::unix_s() - unix_s)
}

/// Returns the seconds since the beginning of 1970, UTC, by the clock of this computer.
#[expect(
    clippy::disallowed_methods,
    reason = "estimates that are sent carry the times of capture and sending, and poses that come that of their measurement"
)]
fn unix_s() -> f64 {
    let since = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH);
    // A clock before 1970 is as wrong as one at it.
    since.map_or(0.0, |since| since.as_secs_f64())
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
