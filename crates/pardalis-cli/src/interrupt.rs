//! Ctrl-C: work stops where it can keep what is finished.

use std::sync::atomic::{AtomicBool, Ordering};

/// Set when the user presses Ctrl-C or the program is asked to end.
static REQUESTED: AtomicBool = AtomicBool::new(false);

/// From now on the first Ctrl-C asks to stop, and the second ends the program at once.
pub(crate) fn listen() {
    // Experiments track many times: the handler of the first time stays.
    let _ = ctrlc::set_handler(|| {
        if REQUESTED.swap(true, Ordering::SeqCst) {
            std::process::exit(1);
        }
    });
}

/// Whether the user asked to stop.
pub(crate) fn requested() -> bool {
    REQUESTED.load(Ordering::SeqCst)
}
