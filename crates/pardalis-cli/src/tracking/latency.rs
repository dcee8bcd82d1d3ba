//! How old estimates of live cameras are when they leave the program.

use hdrhistogram::Histogram;
use serde::Serialize;

use crate::timing::now_s;

/// For so long a camera's fastest frame counts, in seconds: clocks of cameras drift by milliseconds an hour.
const WINDOW_S: f64 = 60.0;

/// The clock of a live camera on that of the program.
///
/// How long an image takes from the camera to the program is not known, but it varies. Capture times are those of a camera whose fastest image of the last
/// minute took no time.
#[derive(Debug, Clone, Default)]
pub(super) struct CaptureClock {
    /// The shortest time from a time stamp to the arrival of its frame in the present window, in seconds, and when the window began.
    present: Option<(f64, f64)>,
    /// That of the window before.
    before_s: Option<f64>,
}

impl CaptureClock {
    /// Takes the time stamp of a frame and its arrival on the clock of the program, in seconds.
    pub(super) fn take(&mut self, time_s: f64, arrival_s: f64) {
        let delay_s = arrival_s - time_s;
        match &mut self.present {
            Some((least_s, begin_s)) if arrival_s - *begin_s < WINDOW_S => {
                *least_s = least_s.min(delay_s);
            }
            present => {
                self.before_s = present.map(|(least_s, _)| least_s);
                *present = Some((delay_s, arrival_s));
            }
        }
    }

    /// Returns when a frame with this time stamp was captured, on the clock of the program, in seconds; `None` before the first frame.
    pub(super) fn captured_s(&self, time_s: f64) -> Option<f64> {
        let (least_s, _) = self.present?;
        Some(time_s + self.before_s.map_or(least_s, |s| least_s.min(s)))
    }
}

/// The times from the capture of images to their estimates.
#[derive(Debug, Clone)]
pub(super) struct Latencies(Histogram<u64>);

/// The latency of a run's estimates, in seconds, within 1 %.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub(crate) struct Latency {
    pub(crate) median_s: f64,
    pub(crate) p99_s: f64,
    pub(crate) max_s: f64,
}

impl Latencies {
    pub(super) fn new() -> Self {
        // Two digits, in microseconds up to an hour.
        let histogram = Histogram::new_with_max(3_600_000_000, 2);
        Self(histogram.expect("constant bounds, which are valid"))
    }

    /// Takes an image set that was captured at this time on the clock of the program, in seconds, and whose estimates have just left.
    pub(super) fn take(&mut self, captured_s: f64) {
        let micros = 1e6 * (now_s() - captured_s).max(0.0);
        self.0.saturating_record(micros as u64);
    }

    /// Returns their quantiles; `None` without any.
    pub(super) fn summary(&self) -> Option<Latency> {
        let quantile_s = |quantile| 1e-6 * self.0.value_at_quantile(quantile) as f64;
        (!self.0.is_empty()).then(|| Latency {
            median_s: quantile_s(0.5),
            p99_s: quantile_s(0.99),
            max_s: 1e-6 * self.0.max() as f64,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn capture_follows_the_fastest_frame_of_the_last_minute() {
        let mut clock = CaptureClock::default();
        assert_eq!(clock.captured_s(7.0), None);
        // Stamps of another clock; frames take 20, 0 and 30 ms longer than the fastest.
        for (time_s, arrival_s) in [(100.0, 5.02), (100.1, 5.1), (100.2, 5.23)] {
            clock.take(time_s, arrival_s);
        }
        assert!((clock.captured_s(100.2).unwrap() - 5.2).abs() < 1e-9);
        // The camera's clock has lost 50 ms: the fastest frame of long ago is forgotten.
        for number in 1..=3 {
            let since_s = 70.0 * f64::from(number);
            clock.take(100.0 + since_s, 5.05 + since_s);
        }
        assert!((clock.captured_s(310.0).unwrap() - 215.05).abs() < 1e-9);
    }

    #[test]
    fn quantiles_are_those_of_what_was_taken() {
        let mut latencies = Latencies::new();
        assert_eq!(latencies.summary(), None);
        let now_s = now_s();
        for _ in 0..98 {
            latencies.take(now_s - 0.5);
        }
        latencies.take(now_s - 2.0);
        latencies.take(now_s - 9.0);
        let found = latencies.summary().unwrap();
        // The clock goes on meanwhile.
        assert!((0.49..0.6).contains(&found.median_s), "{found:?}");
        assert!((1.95..2.2).contains(&found.p99_s), "{found:?}");
        assert!((8.9..9.3).contains(&found.max_s), "{found:?}");
        // Captured in the future, by a clock that was set.
        latencies.take(now_s + 50.0);
        assert!(latencies.summary().unwrap().median_s > 0.4);
    }
}
