//! The clocks of this computer.
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
