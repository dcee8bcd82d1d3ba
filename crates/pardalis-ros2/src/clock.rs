//! The clocks of this computer, and stamps of others.
#![allow(clippy::disallowed_methods)] // the node is live: what it waits for and reports depends on the time

use std::time::{Instant, SystemTime, UNIX_EPOCH};

use crate::messages::Time;

/// Returns the time to measure how long something takes.
pub(crate) fn instant() -> Instant {
    Instant::now()
}

/// Returns the time since 1970.
pub(crate) fn now() -> Time {
    let since = SystemTime::now().duration_since(UNIX_EPOCH);
    let since = since.unwrap_or_default();
    Time {
        sec: since.as_secs() as i32,
        nanosec: since.subsec_nanos(),
    }
}

/// The stamps of a topic, one after the other.
#[derive(Debug, Default)]
pub(crate) struct Stamps {
    was_zero: bool,
}

impl Stamps {
    /// Returns when the next message was stamped, or when it came if it does not say so. A stamp of zero says nothing if the one before was zero, too; a
    /// single one is that of a simulated clock, which begins there.
    pub(crate) fn time_of(&mut self, stamp: Time) -> Time {
        let is_zero = stamp == Time::ZERO;
        let was_zero = std::mem::replace(&mut self.was_zero, is_zero);
        if is_zero && was_zero { now() } else { stamp }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_simulated_clock_begins_at_zero_and_a_stamp_that_stays_there_says_nothing() {
        let at = |nanosec| Time { sec: 0, nanosec };
        let mut simulated = Stamps::default();
        for nanosec in [0, 40_000_000, 80_000_000] {
            assert_eq!(simulated.time_of(at(nanosec)), at(nanosec));
        }
        // It was set back.
        assert_eq!(simulated.time_of(Time::ZERO), Time::ZERO);
        let mut unset = Stamps::default();
        unset.time_of(Time::ZERO);
        assert!(unset.time_of(Time::ZERO).sec > 1_000_000_000);
        assert!(unset.time_of(Time::ZERO).sec > 1_000_000_000);
    }
}
