//! Handling of Ctrl-C: the first one stops the work in an orderly way.

use std::sync::atomic::{AtomicBool, Ordering};

/// Set when the user presses Ctrl-C or the program receives a request to terminate.
static REQUESTED: AtomicBool = AtomicBool::new(false);

/// Installs the handler: the first Ctrl-C requests an orderly stop, the second ends the program at once.
pub(crate) fn listen() {
    // Experiments run the tracker many times; the handler of the first run stays installed.
    let _ = ctrlc::set_handler(|| {
        if REQUESTED.swap(true, Ordering::SeqCst) {
            std::process::exit(1);
        }
    });
}

/// Reports whether the user requested a stop.
pub(crate) fn requested() -> bool {
    REQUESTED.load(Ordering::SeqCst)
}
