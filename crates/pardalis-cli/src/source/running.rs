//! The ffmpeg of a source: the present one of several, if a live source is opened again.

use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use anyhow::Result;

use super::ffmpeg::Process;
use super::start_thread;
use crate::timing::Stopwatch;

/// How often a [`Watchdog`] looks.
const LOOK: Duration = Duration::from_millis(250);

/// Shared by everything that may have to end the ffmpeg of a source.
pub(super) struct Running {
    state: Mutex<State>,
    stopped: Condvar,
}

struct State {
    process: Arc<Process>,
    /// Whether the process has not delivered a frame yet. Its errors are reasons for another attempt and not of damaged
    /// frames.
    is_attempt: bool,
    /// Errors that earlier processes reported.
    earlier_errors: usize,
    /// Errors of the present process before its first frame: whoever joins a stream misses what its first frames refer to.
    joining_errors: usize,
    reopened: usize,
    clock_jumps: usize,
    /// Frames that were left out, and not counted yet.
    left_out: usize,
    is_stopped: bool,
    /// Runs while a frame is waited for.
    wait: Option<Stopwatch>,
    /// Whether the [`Watchdog`] has ended the present process.
    was_silent: bool,
}

impl State {
    fn error_count(&self) -> usize {
        let present = if self.is_attempt {
            0
        } else {
            self.process.error_count() - self.joining_errors
        };
        self.earlier_errors + present
    }
}

impl Running {
    pub(super) fn new(process: Arc<Process>) -> Self {
        Self {
            state: Mutex::new(State {
                process,
                is_attempt: false,
                earlier_errors: 0,
                joining_errors: 0,
                reopened: 0,
                clock_jumps: 0,
                left_out: 0,
                is_stopped: false,
                wait: None,
                was_silent: false,
            }),
            stopped: Condvar::new(),
        }
    }

    /// Ends ffmpeg for good, so that its pipes close.
    pub(super) fn stop(&self) {
        let mut state = self.state();
        state.is_stopped = true;
        state.process.kill();
        drop(state);
        self.stopped.notify_all();
    }

    /// Replaces ffmpeg by another one, and ends both if the source has been stopped.
    pub(super) fn replace(&self, process: Arc<Process>) {
        let mut state = self.state();
        state.process.kill();
        state.earlier_errors = state.error_count();
        state.is_attempt = true;
        if state.is_stopped {
            process.kill();
        }
        state.process = process;
        state.joining_errors = 0;
        state.wait = None;
        state.was_silent = false;
    }

    /// Waits for this long, or until the source is stopped. Reports whether it is.
    pub(super) fn is_stopped_after(&self, time: Duration) -> bool {
        let state = self.state();
        let waited = self
            .stopped
            .wait_timeout_while(state, time, |state| !state.is_stopped);
        waited.unwrap_or_else(PoisonError::into_inner).0.is_stopped
    }

    /// Notes that a frame is waited for from now on, or that it has come.
    pub(super) fn set_waiting(&self, is_waiting: bool) {
        self.state().wait = is_waiting.then(Stopwatch::start);
    }

    /// Reports whether the present ffmpeg was ended because it delivered no frame.
    pub(super) fn was_silent(&self) -> bool {
        self.state().was_silent
    }

    /// Notes that the source has come back.
    pub(super) fn count_reopened(&self) {
        let mut state = self.state();
        state.reopened += 1;
        state.is_attempt = false;
        state.joining_errors = state.process.error_count();
    }

    /// Notes that a live source has delivered its first frame.
    pub(super) fn joined(&self) {
        let mut state = self.state();
        state.joining_errors = state.process.error_count();
    }

    /// Forgets what was counted, as if the source had only now been opened.
    #[cfg(feature = "studio")]
    pub(super) fn count_anew(&self) {
        let mut state = self.state();
        state.earlier_errors = 0;
        state.joining_errors = state.process.error_count();
        state.reopened = 0;
        state.clock_jumps = 0;
    }

    /// Returns how often the source was opened again.
    pub(super) fn reopened(&self) -> usize {
        self.state().reopened
    }

    /// Notes that the time stamps of the source have jumped, and returns how often they have so far.
    pub(super) fn count_clock_jump(&self) -> usize {
        let mut state = self.state();
        state.clock_jumps += 1;
        state.clock_jumps
    }

    /// Reports whether the source has failed and attempts are made to open it again.
    pub(super) fn is_away(&self) -> bool {
        self.state().is_attempt
    }

    /// Notes that a frame was left out because it came late.
    pub(super) fn count_left_out(&self) {
        self.state().left_out += 1;
    }

    /// Returns the number of frames that were left out since the last call.
    pub(super) fn take_left_out(&self) -> usize {
        std::mem::take(&mut self.state().left_out)
    }

    /// Returns how often the time stamps of the source have jumped.
    pub(super) fn clock_jumps(&self) -> usize {
        self.state().clock_jumps
    }

    /// Returns the number of errors that ffmpeg has reported so far.
    pub(super) fn error_count(&self) -> usize {
        self.state().error_count()
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Ends the present ffmpeg whenever a frame has been waited for too long, until the source is stopped.
pub(super) struct Watchdog(Option<JoinHandle<()>>);

impl Watchdog {
    pub(super) fn start(running: Arc<Running>, limit: Duration) -> Result<Self> {
        let thread = start_thread(move || {
            while !running.is_stopped_after(LOOK) {
                let mut state = running.state();
                let is_silent = |wait: &Stopwatch| wait.elapsed_s() > limit.as_secs_f64();
                if state.wait.take_if(|wait| is_silent(wait)).is_some() {
                    state.was_silent = true;
                    state.process.kill();
                }
            }
        })?;
        Ok(Self(Some(thread)))
    }
}

impl Drop for Watchdog {
    /// Waits for the thread; stop the source before.
    fn drop(&mut self) {
        // It has no reason to panic, and this is no place to pass a panic on.
        let _ = self.0.take().map(JoinHandle::join);
    }
}
