//! What was examined in the images of recordings, for whoever looks at these again.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use crate::draw::overlay::Note;

/// The most notes that are kept. Hand-set: those of an hour of a few candidates in each image, in less than 50 MB.
const MAX_NOTES: usize = 500_000;
/// Times that differ by less than this, in seconds, are the same.
const SAME_TIME_S: f64 = 1e-6;

/// What was examined in each image, and what became of it. Cloning shares it.
#[derive(Debug, Clone, Default)]
pub(crate) struct Examined(Arc<Mutex<Kept>>);

#[derive(Debug, Default)]
struct Kept {
    /// By the index of the camera, in order of the times of its images in seconds.
    cameras: BTreeMap<usize, Vec<(f64, Vec<Note>)>>,
    count: usize,
}

impl Examined {
    /// Keeps what was examined in an image, which is later than those before, unless that is too much.
    pub(super) fn keep(&self, camera: usize, time_s: f64, notes: Vec<Note>) {
        let mut kept = self.kept();
        if notes.is_empty() || kept.count + notes.len() > MAX_NOTES {
            return;
        }
        kept.count += notes.len();
        kept.cameras
            .entry(camera)
            .or_default()
            .push((time_s, notes));
    }

    /// Returns what was examined in the image of a camera at a time.
    pub(crate) fn at(&self, camera: usize, time_s: f64) -> Vec<Note> {
        let kept = self.kept();
        let Some(images) = kept.cameras.get(&camera) else {
            return Vec::new();
        };
        let number = images.partition_point(|(at_s, _)| *at_s < time_s - SAME_TIME_S);
        let image = images.get(number);
        let image = image.filter(|(at_s, _)| *at_s <= time_s + SAME_TIME_S);
        image.map_or_else(Vec::new, |(_, notes)| notes.clone())
    }

    fn kept(&self) -> MutexGuard<'_, Kept> {
        // Notes are added whole.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn notes_are_those_of_the_image_at_the_time() {
        let note = |text: &str| Note {
            at_px: [1.0, 2.0],
            text: text.to_owned().into(),
            color: [0; 3],
        };
        let examined = Examined::default();
        examined.keep(1, 0.0, vec![note("a")]);
        examined.keep(1, 0.04, Vec::new());
        examined.keep(1, 0.08, vec![note("b"), note("c")]);
        let at = |camera, time_s| {
            let notes = examined.at(camera, time_s).into_iter();
            notes.map(|note| note.text.into_owned()).collect::<Vec<_>>()
        };
        assert_eq!(at(1, 0.0), ["a"]);
        assert_eq!(at(1, 0.08 + 1e-9), ["b", "c"]);
        assert!(at(1, 0.04).is_empty() && at(1, 0.12).is_empty() && at(0, 0.0).is_empty());
    }
}
