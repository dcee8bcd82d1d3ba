//! Handling of Ctrl-C: the first one stops the work in an orderly way.

use std::sync::Arc;
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

/// A request to end one piece of work, while the program goes on. Cloning shares it.
#[derive(Debug, Clone, Default)]
pub(crate) struct Stop(Arc<AtomicBool>);

impl Stop {
    /// Ends the work.
    #[cfg(feature = "studio")]
    pub(crate) fn request(&self) {
        self.0.store(true, Ordering::SeqCst);
    }

    /// Reports whether this work should end, or the program.
    pub(crate) fn is_requested(&self) -> bool {
        requested() || self.0.load(Ordering::SeqCst)
    }
}
