//! How old estimates of live cameras are when they leave the program.

use hdrhistogram::Histogram;
use serde::Serialize;

use crate::timing::now_s;

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
