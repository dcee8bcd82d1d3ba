//! What is decoded ahead, on its way from the thread that decodes to its source.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, Sender, SyncSender, channel, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};

use super::{Decoded, Delivery};

/// A place in the queue, which is empty if its frame has been dropped since.
#[derive(Clone)]
pub(super) struct Slot(Arc<Mutex<Option<Decoded>>>);

impl Slot {
    fn of(decoded: Decoded) -> Self {
        Self(Arc::new(Mutex::new(Some(decoded))))
    }

    /// Takes what is in it.
    pub(super) fn take(&self) -> Option<Decoded> {
        // It is whole or empty.
        let mut slot = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        slot.take()
    }

    fn is_empty(&self) -> bool {
        let slot = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        slot.is_none()
    }
}

/// The end of the queue at which it is filled.
pub(super) enum Ahead {
    /// Waits while the queue is full.
    Waiting(SyncSender<Slot>),
    /// Drops the oldest frames in place of waiting.
    Dropping {
        /// Empty places take no memory to speak of.
        sender: Sender<Slot>,
        /// Those that may not have been taken yet, the oldest first.
        frames: VecDeque<Slot>,
        /// The most frames that wait.
        most: usize,
        /// Number of dropped frames that have not been counted.
        overtaken: Arc<AtomicUsize>,
    },
}

impl Ahead {
    /// Creates a queue in which this many frames may wait. If `overtaken` is given, the oldest are dropped then and counted there.
    pub(super) fn new(most: usize, overtaken: Option<Arc<AtomicUsize>>) -> (Self, Receiver<Slot>) {
        if let Some(overtaken) = overtaken {
            let (sender, receiver) = channel();
            let frames = VecDeque::new();
            let ahead = Self::Dropping {
                sender,
                frames,
                most,
                overtaken,
            };
            return (ahead, receiver);
        }
        let (sender, receiver) = sync_channel(most);
        (Self::Waiting(sender), receiver)
    }

    /// Puts something at the end of the queue. Reports whether there is still somebody who takes it.
    pub(super) fn send(&mut self, mut decoded: Decoded) -> bool {
        match self {
            Self::Waiting(sender) => sender.send(Slot::of(decoded)).is_ok(),
            Self::Dropping {
                sender,
                frames,
                most,
                overtaken,
            } => {
                let is_frame = matches!(decoded.0, Ok(Delivery::Frame { .. }));
                frames.retain(|slot| !slot.is_empty());
                while is_frame && frames.len() >= *most {
                    let dropped = frames.pop_front().and_then(|slot| slot.take());
                    if let Some((_, decode_s)) = dropped {
                        decoded.1 += decode_s;
                        overtaken.fetch_add(1, Ordering::Relaxed);
                    }
                }
                let slot = Slot::of(decoded);
                if is_frame {
                    frames.push_back(slot.clone());
                }
                sender.send(slot).is_ok()
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use pardalis::color::YuvEncoding;
    use pardalis::{Frame, PixelFormat};

    use super::*;

    fn frame(time_s: f64) -> Decoded {
        let encoding = YuvEncoding::default();
        let frame = Frame::new(PixelFormat::Rgb8, encoding, 2, 2, vec![0; 12], time_s);
        let delivery = Delivery::Frame {
            frame: frame.unwrap(),
            arrival_s: time_s,
        };
        (Ok(delivery), 1.0)
    }

    fn taken(receiver: &Receiver<Slot>) -> Vec<String> {
        let slots = receiver.try_iter();
        let decoded = slots.filter_map(|slot| slot.take());
        let name = |(delivery, _)| match delivery {
            Ok(Delivery::Frame { frame, .. }) => frame.time_s().to_string(),
            Ok(Delivery::Broken(error)) | Err(error) => error.to_string(),
        };
        decoded.map(name).collect()
    }

    #[test]
    fn only_frames_are_dropped_and_the_newest_stay() {
        let overtaken = Arc::new(AtomicUsize::new(0));
        let (mut ahead, receiver) = Ahead::new(2, Some(Arc::clone(&overtaken)));
        for time_s in [0.0, 1.0, 2.0] {
            assert!(ahead.send(frame(time_s)));
        }
        let broken = Ok(Delivery::Broken(anyhow::anyhow!("broken")));
        assert!(ahead.send((broken, 0.0)));
        assert!(ahead.send(frame(3.0)));
        assert_eq!(taken(&receiver), ["2", "broken", "3"]);
        assert_eq!(overtaken.swap(0, Ordering::Relaxed), 2);
        // What was taken makes room.
        for time_s in [4.0, 5.0] {
            assert!(ahead.send(frame(time_s)));
        }
        assert_eq!(taken(&receiver), ["4", "5"]);
        assert_eq!(overtaken.load(Ordering::Relaxed), 0);
        drop(receiver);
        assert!(!ahead.send(frame(6.0)));
    }

    #[test]
    fn the_time_of_decoding_what_was_dropped_is_kept() {
        let (mut ahead, receiver) = Ahead::new(1, Some(Arc::default()));
        for time_s in [0.0, 1.0, 2.0] {
            ahead.send(frame(time_s));
        }
        let decode_s: f64 = receiver
            .try_iter()
            .filter_map(|slot| Some(slot.take()?.1))
            .sum();
        assert_eq!(decode_s, 3.0);
    }
}
