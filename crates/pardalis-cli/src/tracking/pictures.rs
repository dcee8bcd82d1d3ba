//! Pictures of a run for its page, encoded on a thread of their own.

use std::collections::BTreeMap;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;

use anyhow::{Context as _, Result};
use pardalis::Frame;
use pardalis_studio::Feed;
use serde_json::Value;

use crate::draw::picture::{jpeg_of, picture_of};

/// Encodes the latest picture of each topic and shows it. Tracking does not wait; a picture that comes meanwhile replaces the one before it.
pub(super) struct Pictures {
    slots: Arc<Slots>,
    thread: Option<JoinHandle<()>>,
}

#[derive(Default)]
struct Slots {
    state: Mutex<State>,
    changed: Condvar,
}

#[derive(Default)]
struct State {
    /// For each topic, the frame that is shown next, with its description.
    next: BTreeMap<String, (Value, Frame)>,
    is_over: bool,
}

impl Slots {
    fn state(&self) -> MutexGuard<'_, State> {
        // A slot is whole or empty.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Waits for pictures; none at the end.
    fn next(&self) -> BTreeMap<String, (Value, Frame)> {
        let is_waiting = |state: &mut State| state.next.is_empty() && !state.is_over;
        let state = self.changed.wait_while(self.state(), is_waiting);
        let mut state = state.unwrap_or_else(PoisonError::into_inner);
        std::mem::take(&mut state.next)
    }
}

impl Pictures {
    pub(super) fn start(feed: &Feed) -> Result<Self> {
        let slots = Arc::new(Slots::default());
        let (feed, shared) = (feed.clone(), Arc::clone(&slots));
        let show = move || {
            loop {
                let pictures = shared.next();
                if pictures.is_empty() {
                    break;
                }
                for (topic, (about, frame)) in pictures {
                    // Frames have sizes that JPEG can have, or the tracker would have refused them.
                    if let Ok(jpeg) = jpeg_of(&picture_of(&frame)) {
                        feed.show_image(&topic, &about, &jpeg);
                    }
                }
            }
        };
        let thread = std::thread::Builder::new().name("pictures".to_owned());
        let thread = thread.spawn(show);
        Ok(Self {
            slots,
            thread: Some(thread.context("no further thread can be started")?),
        })
    }

    /// Shows a frame, in place of the last one of its topic.
    pub(super) fn show(&self, topic: String, about: Value, frame: &Frame) {
        self.slots
            .state()
            .next
            .insert(topic, (about, frame.clone()));
        self.slots.changed.notify_one();
    }
}

impl Drop for Pictures {
    /// Shows the last pictures and ends.
    fn drop(&mut self) {
        self.slots.state().is_over = true;
        self.slots.changed.notify_one();
        if let Some(thread) = self.thread.take() {
            // A panic has been reported.
            let _ = thread.join();
        }
    }
}
