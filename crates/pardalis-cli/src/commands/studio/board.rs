//! The lens of a camera from a board that somebody holds up to it: views are collected from the newest pictures, and calibrated as `calibrate board` does.

use std::mem::discriminant;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};
use std::thread::JoinHandle;
use std::time::Duration;

use anyhow::{Context as _, Result};
use pardalis::Frame;
use pardalis_calibrate::board::{Board, BoardNotFound, Collection, Corner, NotAdded, detect};
use pardalis_calibrate::covered;
use serde::Deserialize;
use serde_json::{Value, json};

use super::edits::with_lens;
use super::session::Session;
use crate::board::parse_with;
use crate::commands::calibrate::held::{HeldLens, calibrate};
use crate::commands::init::text::{Calibration, CameraText};
use crate::draw::picture::picture_of;
use crate::files::write_file;
use crate::interrupt::Stop;
use crate::user_error::user_error;

/// How often the thread looks for a new picture.
const POLL: Duration = Duration::from_millis(10);

/// The least views for a calibration, and how many views, tilted views and what share of the image make a good one. Hand-set, as in
/// docs/calibration.md.
const LEAST_VIEWS: usize = 3;
const GOOD_VIEWS: usize = 12;
const GOOD_TILTED: usize = 5;
const GOOD_SHARE: f64 = 0.5;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct BoardOf {
    camera: String,
    /// As on the command line, such as `checkerboard:9x6:0.025`.
    board: String,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ModelOf {
    /// The name of a model, or `all`.
    model: String,
}

/// Looks for the board in the pictures of a camera until it is dropped.
pub(super) struct Held {
    shared: Arc<Mutex<Collected>>,
    stop: Stop,
    thread: Option<JoinHandle<()>>,
}

impl Drop for Held {
    fn drop(&mut self) {
        self.stop.request();
    }
}

/// What was seen of a board.
struct Collected {
    camera: String,
    words: String,
    board: Board,
    /// `None` before the first picture.
    collection: Option<Collection>,
    /// The numbers of the frames of its views.
    frames: Vec<usize>,
    /// The newest frame that was searched, with the corners and why it was not added.
    newest: Option<(usize, Vec<Corner>, Option<Reason>)>,
    left_out: Vec<LeftOut>,
    is_looking: bool,
    is_fitting: bool,
    fitted: Option<HeldLens>,
    error: Option<String>,
}

/// Frames that were left out for one reason.
struct LeftOut {
    reason: Reason,
    count: usize,
    last: usize,
}

#[derive(Debug, Clone)]
enum Reason {
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
    /// Looks for the board in a frame.
    fn see(&mut self, number: usize, frame: &Frame, found: Result<Vec<Corner>, BoardNotFound>) {
        let size_px = (frame.width(), frame.height());
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
                let added = collection.offer(frame.time_s(), &corners);
                (corners, added.err().map(Reason::NotAdded))
            }
        };
        match &reason {
            None => self.frames.push(number),
            // Nobody showed anything.
            Some(Reason::NotFound(BoardNotFound::NotInView)) => {}
            Some(reason) => {
                let known = self.left_out.iter_mut();
                let mut alike = known.filter(|known| known.reason.is_like(reason));
                if let Some(known) = alike.next() {
                    (known.reason, known.last) = (reason.clone(), number);
                    known.count += 1;
                } else {
                    self.left_out.push(LeftOut {
                        reason: reason.clone(),
                        count: 1,
                        last: number,
                    });
                }
            }
        }
        self.newest = Some((number, corners, reason));
    }

    fn views(&self) -> &[Vec<Corner>] {
        self.collection.as_ref().map_or(&[], Collection::views)
    }

    /// Returns what the page shows.
    fn about(&self) -> Value {
        let size_px = self.collection.as_ref().map(Collection::size_px);
        let pixels = self.views().iter().flatten().map(|corner| corner.pixel);
        let cells = covered(pixels, size_px.unwrap_or((1, 1)));
        let all = cells.as_flattened();
        let share = all.iter().filter(|cell| **cell).count() as f64 / all.len() as f64;
        let tilted = self.collection.as_ref().map_or(0, Collection::tilted_count);
        let advice = self.advice(&cells, share, tilted);
        let newest = self.newest.as_ref().map(|(number, corners, reason)| {
            let corners_px: Vec<_> = corners.iter().map(|corner| corner.pixel).collect();
            let reason = reason.as_ref().map(Reason::text);
            json!({ "frame": number, "corners_px": corners_px, "reason": reason })
        });
        let left_out = self.left_out.iter().map(|left| {
            json!({ "reason": left.reason.text(), "count": left.count, "last_frame": left.last })
        });
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
            "frames": self.frames,
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
        if share < GOOD_SHARE {
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

fn lock(shared: &Mutex<Collected>) -> MutexGuard<'_, Collected> {
    // A panic of the search leaves what was collected before.
    shared.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Session {
    /// Begins to look for a board in the pictures of a camera.
    pub(super) fn look_for_board(&self, of: &BoardOf) -> Result<()> {
        // Files are named only below the folders of the command line.
        let no_file = |_: &std::path::Path| {
            Err(user_error!(
                "describe the board in words, such as checkerboard:9x6:0.025"
            ))
        };
        let board = parse_with(&of.board, no_file)?;
        let mut inner = self.inner();
        inner.player(&of.camera)?;
        // Views of the same board go on.
        let before = inner.held.take().map(|held| Arc::clone(&held.shared));
        let same = before.filter(|shared| {
            let collected = lock(shared);
            (&*collected.camera, &*collected.words) == (&of.camera, &of.board)
                && collected.error.is_none()
        });
        let shared = same.unwrap_or_else(|| {
            Arc::new(Mutex::new(Collected {
                camera: of.camera.clone(),
                words: of.board.clone(),
                board,
                collection: None,
                frames: Vec::new(),
                newest: None,
                left_out: Vec::new(),
                is_looking: true,
                is_fitting: false,
                fitted: None,
                error: None,
            }))
        });
        lock(&shared).is_looking = true;
        let stop = Stop::default();
        let thread = std::thread::Builder::new()
            .name("board".to_owned())
            .spawn({
                let (session, shared, stop) =
                    (Weak::clone(&self.me), Arc::clone(&shared), stop.clone());
                move || look(&session, &shared, &stop)
            })
            .context("no further thread can be started")?;
        inner.held = Some(Held {
            shared,
            stop,
            thread: Some(thread),
        });
        drop(inner);
        self.tell_board();
        Ok(())
    }

    /// Ends to look for the board; the views remain.
    pub(super) fn leave_board(&self) {
        let held = self.inner().held.as_mut().map(|held| {
            held.stop.request();
            (Arc::clone(&held.shared), held.thread.take())
        });
        let Some((shared, thread)) = held else {
            return;
        };
        if let Some(thread) = thread {
            // A panic has been reported.
            let _ = thread.join();
        }
        lock(&shared).is_looking = false;
        self.tell_board();
    }

    /// Forgets the board and its views.
    pub(super) fn forget_board(&self) {
        self.leave_board();
        self.inner().held = None;
        self.feed.show("board", &Value::Null);
    }

    /// Calibrates the lens from the views so far.
    pub(super) fn fit_board(&self, of: &ModelOf) -> Result<()> {
        let shared = self.collected()?;
        let (name, board, views, size_px) = {
            let mut collected = lock(&shared);
            let Some(collection) = &collected.collection else {
                return Err(user_error!("no view of the board was taken yet"));
            };
            let views = collection.views().iter().cloned().zip(&collected.frames);
            let views: Vec<_> = views
                .map(|(corners, number)| (format!("frame {}", number + 1), corners))
                .collect();
            let size_px = collection.size_px();
            if views.len() < LEAST_VIEWS {
                return Err(user_error!(
                    "{} views of the board are too few; show it in {LEAST_VIEWS} at least, better in {GOOD_VIEWS}",
                    views.len()
                ));
            }
            if collected.is_fitting {
                return Err(user_error!("a calibration goes on; wait for it"));
            }
            collected.is_fitting = true;
            (
                collected.camera.clone(),
                collected.board.clone(),
                views,
                size_px,
            )
        };
        self.tell_board();
        let fitted = calibrate(&name, &board, views, size_px, &of.model);
        let mut collected = lock(&shared);
        collected.is_fitting = false;
        let done = fitted.map(|lens| collected.fitted = Some(lens));
        drop(collected);
        self.tell_board();
        done
    }

    /// Writes the calibration beside the scene, and the lens into the scene.
    pub(super) fn use_board(&self) -> Result<()> {
        let shared = self.collected()?;
        let collected = lock(&shared);
        let lens = collected
            .fitted
            .as_ref()
            .ok_or_else(|| user_error!("the lens is not calibrated yet; calibrate it first"))?;
        let name = collected.camera.clone();
        let (camera, text) = (lens.camera.clone(), lens.text.clone());
        drop(collected);
        let opened = self.inner().opened(&name)?;
        let file = self.lens_file(&name);
        let named = file.file_name().unwrap_or_default().to_string_lossy();
        let calibration = Calibration {
            file: named.clone().into_owned(),
            camera: None,
            lens: None,
        };
        let mut table = String::new();
        CameraText::known(&camera, calibration, &opened, "", None)
            .named(name.clone())
            .text(&mut table);
        // The scene is read with it before it is edited.
        write_file(&file, text.as_bytes())?;
        self.edit(
            &format!("cameras.{name}"),
            format!("{named} for {name}"),
            |state| {
                state.text = with_lens(&state.text, &name, &table)?.into();
                state.files.insert(file.clone(), text.into());
                Ok(())
            },
        )
    }

    /// Returns the file of the lens of a camera: one that was written here, or a new one.
    fn lens_file(&self, name: &str) -> PathBuf {
        let inner = self.inner();
        let (folder, files) = (inner.project.folder(), &inner.project.now().files);
        let numbered = (2..).map(|number| format!("{name}-{number}.lens.toml"));
        let names = std::iter::once(format!("{name}.lens.toml")).chain(numbered);
        let mut paths = names.map(|name| folder.join(name));
        let free = paths.find(|path| files.contains_key(path) || !path.exists());
        free.unwrap_or_else(|| folder.join(format!("{name}.lens.toml")))
    }

    fn collected(&self) -> Result<Arc<Mutex<Collected>>> {
        let inner = self.inner();
        let held = inner.held.as_ref();
        held.map(|held| Arc::clone(&held.shared))
            .ok_or_else(|| user_error!("no board is looked for; begin with it"))
    }

    fn tell_board(&self) {
        if let Ok(shared) = self.collected() {
            let about = lock(&shared).about();
            self.feed.show("board", &about);
        }
    }
}

/// Looks for the board in the newest picture, again and again. The picture does not wait for this.
fn look(session: &Weak<Session>, shared: &Mutex<Collected>, stop: &Stop) {
    let (camera, board) = {
        let collected = lock(shared);
        (collected.camera.clone(), collected.board.clone())
    };
    let mut last = None;
    while !stop.is_requested() && lock(shared).is_looking {
        let Some(session) = session.upgrade() else {
            return;
        };
        let newest = session
            .inner()
            .player(&camera)
            .ok()
            .and_then(super::player::Player::shown);
        let key = |(number, frame): &(usize, Frame)| (*number, frame.time_s().to_bits());
        let Some((number, frame)) = newest.filter(|newest| last != Some(key(newest))) else {
            drop(session);
            std::thread::sleep(POLL);
            continue;
        };
        let found = detect(&board, &picture_of(&frame).to_grey());
        let mut collected = lock(shared);
        collected.see(number, &frame, found);
        last = Some((number, frame.time_s().to_bits()));
        let about = collected.about();
        drop(collected);
        if !stop.is_requested() {
            session.feed.show("board", &about);
        }
    }
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
