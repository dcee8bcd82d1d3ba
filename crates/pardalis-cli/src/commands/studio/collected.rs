//! The views of a board that somebody holds up to a camera.

use std::mem::discriminant;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;

use pardalis_calibrate::board::{Board, BoardNotFound, Collection, Corner, NotAdded};
use pardalis_calibrate::covered;
use serde_json::{Value, json};

use crate::commands::calibrate::held::HeldLens;
use crate::interrupt::Stop;

/// The least views for a calibration, and how many views, tilted views and what share of the image make a good one. Hand-set, as in
/// docs/calibration.md.
pub(super) const LEAST_VIEWS: usize = 3;
pub(super) const GOOD_VIEWS: usize = 12;
const GOOD_TILTED: usize = 5;
const GOOD_SHARE: f64 = 0.5;
/// With this many views, what is not covered yet probably cannot be: the image of a fisheye may be a circle.
const MANY_VIEWS: usize = 20;

/// Looks for the board in the pictures of a camera until it is dropped.
pub(super) struct Held {
    pub(super) shared: Arc<Mutex<Collected>>,
    pub(super) stop: Stop,
    pub(super) thread: Option<JoinHandle<()>>,
}

impl Drop for Held {
    fn drop(&mut self) {
        self.stop.request();
    }
}

/// What was seen of a board.
pub(super) struct Collected {
    pub(super) camera: String,
    pub(super) words: String,
    pub(super) board: Board,
    /// Whether the pictures are files in a folder, and not what the camera shows.
    pub(super) is_of_folder: bool,
    /// `None` before the first picture.
    pub(super) collection: Option<Collection>,
    /// The names of the pictures of its views.
    pub(super) names: Vec<String>,
    /// The newest picture that was searched by its name, with the corners and why it was not added.
    pub(super) newest: Option<(String, Vec<Corner>, Option<Reason>)>,
    pub(super) left_out: Vec<LeftOut>,
    pub(super) is_looking: bool,
    pub(super) is_fitting: bool,
    pub(super) fitted: Option<HeldLens>,
    pub(super) error: Option<String>,
}

/// Pictures that were left out for one reason.
pub(super) struct LeftOut {
    reason: Reason,
    count: usize,
    last: String,
}

#[derive(Debug, Clone)]
pub(super) enum Reason {
    NotFound(BoardNotFound),
    NotAdded(NotAdded),
}

impl Reason {
    fn is_like(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::NotFound(a), Self::NotFound(b)) => discriminant(a) == discriminant(b),
            (Self::NotAdded(a), Self::NotAdded(b)) => a == b,
            _ => false,
        }
    }

    fn text(&self) -> String {
        match self {
            Self::NotFound(reason) => reason.to_string(),
            Self::NotAdded(reason) => reason.to_string(),
        }
    }
}

impl Collected {
    /// Begins to look for the board that these words describe.
    pub(super) fn new(camera: &str, words: &str, board: Board, is_of_folder: bool) -> Self {
        Self {
            camera: camera.to_owned(),
            words: words.to_owned(),
            board,
            is_of_folder,
            collection: None,
            names: Vec::new(),
            newest: None,
            left_out: Vec::new(),
            is_looking: true,
            is_fitting: false,
            fitted: None,
            error: None,
        }
    }

    /// Takes what was found in a picture of this size, or in a frame at a time in seconds.
    pub(super) fn see(
        &mut self,
        name: String,
        size_px: (usize, usize),
        time_s: Option<f64>,
        found: Result<Vec<Corner>, BoardNotFound>,
    ) {
        let collection = self
            .collection
            .get_or_insert_with(|| Collection::new(size_px));
        if collection.size_px() != size_px {
            self.error = Some("the pictures have another size now; begin again".to_owned());
            self.is_looking = false;
            return;
        }
        let (corners, reason) = match found {
            Err(reason) => (Vec::new(), Some(Reason::NotFound(reason))),
            Ok(corners) => {
                let added = if let Some(time_s) = time_s {
                    collection.offer(time_s, &corners)
                } else {
                    collection.add(&corners);
                    Ok(())
                };
                (corners, added.err().map(Reason::NotAdded))
            }
        };
        match &reason {
            None => self.names.push(name.clone()),
            // Nobody showed anything.
            Some(Reason::NotFound(BoardNotFound::NotInView)) if time_s.is_some() => {}
            Some(reason) => {
                let known = self.left_out.iter_mut();
                let mut alike = known.filter(|known| known.reason.is_like(reason));
                if let Some(known) = alike.next() {
                    (known.reason, known.last) = (reason.clone(), name.clone());
                    known.count += 1;
                } else {
                    self.left_out.push(LeftOut {
                        reason: reason.clone(),
                        count: 1,
                        last: name.clone(),
                    });
                }
            }
        }
        self.newest = Some((name, corners, reason));
    }

    pub(super) fn views(&self) -> &[Vec<Corner>] {
        self.collection.as_ref().map_or(&[], Collection::views)
    }

    /// Returns what the page shows.
    pub(super) fn about(&self) -> Value {
        let size_px = self.collection.as_ref().map(Collection::size_px);
        let pixels = self.views().iter().flatten().map(|corner| corner.pixel);
        let cells = covered(pixels, size_px.unwrap_or((1, 1)));
        let all = cells.as_flattened();
        let share = all.iter().filter(|cell| **cell).count() as f64 / all.len() as f64;
        let tilted = self.collection.as_ref().map_or(0, Collection::tilted_count);
        let advice = self.advice(&cells, share, tilted);
        let newest = self.newest.as_ref().map(|(name, corners, reason)| {
            let corners_px: Vec<_> = corners.iter().map(|corner| corner.pixel).collect();
            let reason = reason.as_ref().map(Reason::text);
            json!({ "name": name, "corners_px": corners_px, "reason": reason })
        });
        let left_out = self.left_out.iter().map(
            |left| json!({ "reason": left.reason.text(), "count": left.count, "last": left.last }),
        );
        let fitted = self.fitted.as_ref().map(|lens| {
            json!({
                "model": lens.camera.camera.kind(),
                "rms_px": lens.rms_px,
                "held_out_rms_px": lens.held_out_rms_px,
                "notes": lens.notes,
                "warnings": lens.warnings,
                "report": lens.report,
            })
        });
        json!({
            "camera": self.camera,
            "board": self.words,
            "is_looking": self.is_looking,
            "is_fitting": self.is_fitting,
            "newest": newest,
            "names": self.names,
            "is_of_folder": self.is_of_folder,
            "cells": cells,
            "share": share,
            "tilted": tilted,
            "can_fit": self.views().len() >= LEAST_VIEWS,
            "is_enough": advice.is_none(),
            "advice": advice,
            "left_out": left_out.collect::<Vec<_>>(),
            "fitted": fitted,
            "error": self.error,
        })
    }

    /// Returns what would help most; `None` if there are enough views.
    fn advice(&self, cells: &[[bool; 10]; 10], share: f64, tilted: usize) -> Option<String> {
        if self.views().is_empty() {
            let what = "Hold the board still, so that the camera sees all of it, large and sharp.";
            return Some(what.to_owned());
        }
        if share < GOOD_SHARE && self.views().len() < MANY_VIEWS {
            return Some(format!("Move it to the {} of the image.", emptiest(cells)));
        }
        if tilted < GOOD_TILTED {
            return Some(
                "Tilt it by 30 degrees or more: to the left, to the right, up and down.".to_owned(),
            );
        }
        (self.views().len() < GOOD_VIEWS)
            .then(|| "Show it from other sides and distances.".to_owned())
    }
}

/// Returns the name of the ninth of an image in which the fewest cells are covered.
fn emptiest(cells: &[[bool; 10]; 10]) -> &'static str {
    const NAMES: [[&str; 3]; 3] = [
        ["top left", "top", "top right"],
        ["left", "middle", "right"],
        ["bottom left", "bottom", "bottom right"],
    ];
    const BOUNDS: [std::ops::Range<usize>; 3] = [0..3, 3..7, 7..10];
    let share = |&(row, column): &(usize, usize)| {
        let rows = &cells[BOUNDS[row].clone()];
        let ninth = rows.iter().map(|row| &row[BOUNDS[column].clone()]);
        let (mut covered, mut all) = (0, 0);
        for cell in ninth.flatten() {
            covered += usize::from(*cell);
            all += 1;
        }
        1000 * covered / all
    };
    let ninths = (0..9).map(|ninth| (ninth / 3, ninth % 3));
    // The first of equal ones, so that the advice does not jump.
    let least = ninths.min_by_key(share);
    least.map_or("middle", |(row, column)| NAMES[row][column])
}

pub(super) fn lock(shared: &Mutex<Collected>) -> MutexGuard<'_, Collected> {
    // A panic of the search leaves what was collected before.
    shared.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn advice_names_the_part_of_the_image_that_is_empty() {
        let mut cells = [[true; 10]; 10];
        cells[9] = [false; 10];
        cells[8][9] = false;
        assert_eq!(emptiest(&cells), "bottom right");
        // A ninth may have fewer cells than another.
        cells[4] = [false; 10];
        cells[5] = [false; 10];
        assert_eq!(emptiest(&cells), "left");
    }
}
