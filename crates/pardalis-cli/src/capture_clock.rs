//! The clocks of live cameras, as far as the arrivals of their frames tell them.

/// How long a camera's fastest frame counts, in seconds: clocks of cameras drift by milliseconds an hour.
const WINDOW_S: f64 = 60.0;

/// The clock of a live camera on that of the program.
///
/// How long an image takes from the camera to the program is not known, but it varies. Capture times are those of a camera whose fastest image of the last
/// minute took no time.
#[derive(Debug, Clone, Default)]
pub(crate) struct CaptureClock {
    /// The shortest time from a time stamp to the arrival of its frame in the present window, in seconds, and when the window began.
    present: Option<(f64, f64)>,
    /// That of the window before.
    before_s: Option<f64>,
}

impl CaptureClock {
    /// Takes the time stamp of a frame and its arrival on the clock of the program, in seconds.
    pub(crate) fn take(&mut self, time_s: f64, arrival_s: f64) {
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
    pub(crate) fn captured_s(&self, time_s: f64) -> Option<f64> {
        Some(time_s + self.least_delay_s()?)
    }

    /// Returns the time stamp of a frame that arrives at this time on the clock of the program as quickly as the fastest, in seconds; `None` before the
    /// first frame.
    pub(crate) fn stamp_s(&self, arrival_s: f64) -> Option<f64> {
        Some(arrival_s - self.least_delay_s()?)
    }

    /// Returns the shortest time from a time stamp to the arrival of its frame, in seconds; `None` before the first frame.
    pub(crate) fn least_delay_s(&self) -> Option<f64> {
        let (least_s, _) = self.present?;
        Some(self.before_s.map_or(least_s, |s| least_s.min(s)))
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
        assert!((clock.stamp_s(6.0).unwrap() - 101.0).abs() < 1e-9);
        // The camera's clock has lost 50 ms: the fastest frame of long ago is forgotten.
        for number in 1..=3 {
            let since_s = 70.0 * f64::from(number);
            clock.take(100.0 + since_s, 5.05 + since_s);
        }
        assert!((clock.captured_s(310.0).unwrap() - 215.05).abs() < 1e-9);
    }
}
