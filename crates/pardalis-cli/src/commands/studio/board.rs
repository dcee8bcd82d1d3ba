//! The lens of a camera from a board that somebody holds up to it: views are collected from the newest pictures, and calibrated as `calibrate board` does.

use std::path::PathBuf;
use std::sync::{Arc, Mutex, Weak};
use std::time::Duration;

use anyhow::{Context as _, Result};
use pardalis::Frame;
use pardalis_calibrate::board::detect;
use serde::Deserialize;
use serde_json::Value;

use super::collected::{Collected, GOOD_VIEWS, Held, LEAST_VIEWS, lock};
use super::edits::with_lens;
use super::session::Session;
use crate::board::parse_words;
use crate::commands::calibrate::held::calibrate;
use crate::commands::calibrate::images::files;
use crate::commands::init::text::{Calibration, CameraText};
use crate::draw::picture::picture_of;
use crate::interrupt::Stop;
use crate::output::{Shown as _, in_line};
use crate::source::decode::{decode_mask, image_size};
use crate::user_error::user_error;

/// How often the thread looks for a new picture.
const POLL: Duration = Duration::from_millis(10);

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct BoardOf {
    camera: String,
    /// As on the command line, such as `checkerboard:9x6:0.025`.
    board: String,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct BoardIn {
    camera: String,
    /// As on the command line, such as `checkerboard:9x6:0.025`.
    board: String,
    /// A folder of pictures that the camera took.
    folder: String,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ModelOf {
    /// The name of a model, or `all`.
    model: String,
}

impl Session {
    /// Begins to look for a board in the pictures of a camera.
    pub(super) fn look_for_board(&self, of: &BoardOf) -> Result<()> {
        let board = parse_words(&of.board)?;
        let mut inner = self.inner();
        inner.player(&of.camera)?;
        // Views of the same board go on.
        let before = inner.held.take().map(|held| Arc::clone(&held.shared));
        let same = before.filter(|shared| {
            let collected = lock(shared);
            (&*collected.camera, &*collected.words) == (&of.camera, &of.board)
                && !collected.is_of_folder
                && collected.error.is_none()
        });
        drop(inner);
        let shared = same.unwrap_or_else(|| {
            let collected = Collected::new(&of.camera, &of.board, board, false);
            Arc::new(Mutex::new(collected))
        });
        lock(&shared).is_looking = true;
        self.hold(shared, look)
    }

    /// Looks for a board in all pictures of a folder, and takes each in which it is.
    pub(super) fn look_in_folder(&self, of: &BoardIn) -> Result<()> {
        let board = parse_words(&of.board)?;
        let files = files(&self.places.allowed(&of.folder)?)?;
        let wanted_px = self.inner().opened(&of.camera)?.size;
        let size_px = image_size(&files[0])?;
        if size_px != wanted_px {
            return Err(user_error!(
                "{}: has {} x {} pixels, and the images of {} have {} x {}; take the pictures with the camera's present settings",
                files[0].shown(),
                size_px.0,
                size_px.1,
                of.camera,
                wanted_px.0,
                wanted_px.1
            ));
        }
        let collected = Collected::new(&of.camera, &of.board, board, true);
        self.hold(
            Arc::new(Mutex::new(collected)),
            move |session, shared, stop| {
                look_in(&files, session, shared, stop);
            },
        )
    }

    /// Looks for a board on a thread of its own, in place of any that was looked for before.
    fn hold(
        &self,
        shared: Arc<Mutex<Collected>>,
        look: impl FnOnce(&Weak<Self>, &Mutex<Collected>, &Stop) + Send + 'static,
    ) -> Result<()> {
        let stop = Stop::default();
        let thread = std::thread::Builder::new()
            .name("board".to_owned())
            .spawn({
                let (session, shared, stop) =
                    (Weak::clone(&self.me), Arc::clone(&shared), stop.clone());
                move || look(&session, &shared, &stop)
            })
            .context("no further thread can be started")?;
        self.inner().held = Some(Held {
            shared,
            stop,
            thread: Some(thread),
        });
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
            let views = collection.views().iter().cloned();
            let views: Vec<_> = collected.names.iter().cloned().zip(views).collect();
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
        let what = format!("{named} for {name}");
        self.edit_with_file(
            &format!("cameras.{name}"),
            what,
            (file.clone(), text),
            |state| {
                state.text = with_lens(&state.text, &name, &table)?.into();
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
        let size_px = (frame.width(), frame.height());
        let name = format!("frame {number}");
        collected.see(name, size_px, Some(frame.time_s()), found);
        last = Some((number, frame.time_s().to_bits()));
        let about = collected.about();
        drop(collected);
        if !stop.is_requested() {
            session.feed.show("board", &about);
        }
    }
}

/// Looks for the board in pictures of the camera, one after another.
fn look_in(files: &[PathBuf], session: &Weak<Session>, shared: &Mutex<Collected>, stop: &Stop) {
    let board = lock(shared).board.clone();
    for file in files {
        let picture = decode_mask(file);
        let found = picture.map(|picture| (detect(&board, &picture), picture.size_px()));
        let Some(session) = session.upgrade().filter(|_| !stop.is_requested()) else {
            return;
        };
        let mut collected = lock(shared);
        let name = file.file_name().unwrap_or_default().to_string_lossy();
        match found {
            Ok((found, size_px)) => collected.see(in_line(&name), size_px, None, found),
            Err(error) => {
                collected.error = Some(format!("{error:#}"));
                collected.is_looking = false;
            }
        }
        let about = collected.about();
        let goes_on = collected.is_looking;
        drop(collected);
        session.feed.show("board", &about);
        if !goes_on {
            return;
        }
    }
    let mut collected = lock(shared);
    collected.is_looking = false;
    let about = collected.about();
    drop(collected);
    if let Some(session) = session.upgrade().filter(|_| !stop.is_requested()) {
        session.feed.show("board", &about);
    }
}
