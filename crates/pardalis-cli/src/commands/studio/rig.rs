//! The poses of all cameras from a ball that is waved, as `calibrate rig` finds them.

use std::sync::{Arc, Mutex, Weak};

use anyhow::{Context as _, Result};
use pardalis::Frame;
use pardalis_calibrate::{BallRigSettings, Detection};
use serde::Deserialize;
use serde_json::json;

use super::pose::KnownPoints;
use super::project::State;
use super::session::Session;
use super::waved::{OfCamera, Seen, Waved, lock};
use crate::board::parse_words;
use crate::commands::calibrate::rig::{CalibratedRig, Known, Task};
use crate::commands::calibrate::time::detect::Until;
use crate::draw::picture::{jpeg_of, picture_of};
use crate::interrupt::Stop;
use crate::source::{OpenCameras, Source, SourceConfig};
use crate::timing::now_s;
use crate::user_error::user_error;

/// The shortest time between two pictures of a live camera, in seconds: detecting the ball comes first.
const INTERVAL_S: f64 = 0.15;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RigOf {
    target: String,
    /// How long live cameras are watched, in seconds.
    duration_s: f64,
    /// Points in the room that cameras see; none if something else says where the room is.
    points: Vec<KnownPoints>,
    /// A board at rest in view, as on the command line.
    board: Option<String>,
    refine_focal: bool,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RigStop {
    /// Whether nothing is calibrated from what was seen so far.
    is_cancelled: bool,
}

impl Session {
    /// Begins to look for the ball in all cameras.
    pub(super) fn wave(&self, of: RigOf) -> Result<()> {
        if !(of.duration_s > 0.0 && of.duration_s <= 3600.0) {
            return Err(user_error!("duration_s: allowed: above 0 and at most 3600"));
        }
        let known = match &of.board {
            Some(board) => Known::Board(parse_words(board)?),
            None if of.points.is_empty() => Known::Scene,
            None => {
                let points = of.points.iter();
                let points = points.map(|of| (of.camera().to_owned(), of.correspondences()));
                Known::Points(points.collect())
            }
        };
        let mut inner = self.inner();
        let is_running = inner.running.as_ref();
        if is_running.is_some_and(super::running::Running::goes_on) {
            return Err(user_error!("a run goes on; stop it first"));
        }
        if inner.waved.as_ref().is_some_and(Waved::goes_on) {
            return Err(user_error!(
                "the cameras are being calibrated; stop that first"
            ));
        }
        let cameras: Vec<OfCamera> = inner
            .players
            .iter()
            .map(|(name, player)| OfCamera {
                name: name.clone(),
                is_live: player.is_live(),
                frame_count: player.frame_count(),
                frames: 0,
                found: 0,
                shown_s: 0.0,
            })
            .collect();
        let duration_s = cameras
            .iter()
            .any(|camera| camera.is_live)
            .then_some(of.duration_s);
        let shared = Arc::new(Mutex::new(Seen {
            text: Arc::clone(&inner.project.now().text),
            cameras,
            began_s: now_s(),
            duration_s,
            goes_on: true,
            is_cancelled: false,
            done: None,
        }));
        let stop = Stop::default();
        // Live cameras can be open only once, and some senders serve one connection.
        let live = inner.players.extract_if(.., |_, player| player.is_live());
        let open = live.filter_map(|(_, player)| player.into_source());
        let open = open.collect();
        let work = Work {
            session: Weak::clone(&self.me),
            shared: Arc::clone(&shared),
            target: of.target,
            known,
            refine_focal: of.refine_focal,
            open,
            until: Until {
                duration_s,
                stop: stop.clone(),
            },
        };
        std::thread::Builder::new()
            .name("rig".to_owned())
            .spawn(move || work.run())
            .context("no further thread can be started")?;
        // Frames may be long in coming.
        let about = lock(&shared).about();
        inner.waved = Some(Waved { shared, stop });
        self.feed.show("rig", &about);
        Ok(())
    }

    /// Ends the search for the ball. The rig is calibrated from what was seen, unless that is not wanted.
    pub(super) fn stop_waving(&self, of: &RigStop) {
        if let Some(waved) = &self.inner().waved {
            lock(&waved.shared).is_cancelled = of.is_cancelled;
            waved.stop.request();
        }
    }

    /// Writes the poses and offsets into the scene.
    pub(super) fn use_rig(&self) -> Result<()> {
        let inner = self.inner();
        let waved = inner.waved.as_ref();
        let shared = waved.map(|waved| Arc::clone(&waved.shared));
        let path = inner.project.path().to_owned();
        let is_same = waved.is_some_and(|waved| waved.is_of(&inner.project.now().text));
        drop(inner);
        let missing = || user_error!("the cameras are not calibrated yet; wave the ball first");
        let shared = shared.ok_or_else(missing)?;
        let seen = lock(&shared);
        let Some(Ok(rig)) = &seen.done else {
            return Err(missing());
        };
        if !is_same {
            return Err(user_error!(
                "the scene was edited since; undo that, or calibrate the cameras again"
            ));
        }
        let stem = path.file_stem().unwrap_or_default().to_string_lossy();
        let file = path.with_file_name(format!("{stem}.rig.toml"));
        let named = file.file_name().unwrap_or_default().to_string_lossy();
        let text = rig.corrected(&path, &seen.text, &named).ok_or_else(|| {
            user_error!(
                "the layout of the scene does not allow inserting poses; give each camera a table [cameras.NAME] of its own"
            )
        })?;
        let rig_text = rig.rig_text();
        drop(seen);
        let needs_file = text.contains(&*named);
        let what = "poses from the ball".to_owned();
        let change = |state: &mut State| {
            state.text = text.into();
            Ok(())
        };
        if !needs_file {
            return self.edit("cameras", what, change);
        }
        let is_own = self.inner().project.now().files.contains_key(&file);
        if file.exists() && !is_own {
            return Err(user_error!(
                "{named}: exists already; rename it to keep it, and try again"
            ));
        }
        self.edit_with_file("cameras", what, (file, rig_text), change)
    }
}

/// What the thread does.
struct Work {
    session: Weak<Session>,
    shared: Arc<Mutex<Seen>>,
    target: String,
    known: Known,
    refine_focal: bool,
    /// The live cameras.
    open: Vec<(SourceConfig, Source)>,
    until: Until,
}

impl Work {
    fn run(self) {
        let Some(session) = self.session.upgrade() else {
            return;
        };
        let path = session.inner().project.path().to_owned();
        drop(session);
        let text = Arc::clone(&lock(&self.shared).text);
        let mut settings = BallRigSettings::default();
        settings.refine_focal = self.refine_focal;
        let task = Task {
            path: &path,
            text: &text,
            target: Some(&self.target),
            known: self.known,
            settings,
            until: self.until,
        };
        let (weak, shared) = (&self.session, &self.shared);
        let mut live = OpenCameras {
            open: self.open,
            ..OpenCameras::default()
        };
        let done = CalibratedRig::of(&task, &mut live, &|name, frame, detections| {
            see(weak, shared, name, frame, detections);
        });
        let mut seen = lock(shared);
        seen.goes_on = false;
        if !seen.is_cancelled {
            seen.done = Some(done.map_err(|error| format!("{error:#}")));
        }
        let about = seen.about();
        drop(seen);
        if let Some(session) = weak.upgrade() {
            session.feed.show("rig", &about);
            session.inner().open = live.open;
            session.follow();
            session.tell();
        }
    }
}

/// Counts what a camera shows, and shows the picture of a live one.
fn see(
    session: &Weak<Session>,
    shared: &Mutex<Seen>,
    name: &str,
    frame: &Frame,
    detections: &[Detection],
) {
    let mut seen = lock(shared);
    let now = now_s();
    let Some(camera) = seen.cameras.iter_mut().find(|one| one.name == name) else {
        return;
    };
    camera.frames += 1;
    camera.found += usize::from(!detections.is_empty());
    if now - camera.shown_s < INTERVAL_S {
        return;
    }
    camera.shown_s = now;
    let (number, is_live) = (camera.frames - 1, camera.is_live);
    let about = seen.about();
    drop(seen);
    let Some(session) = session.upgrade() else {
        return;
    };
    session.feed.show("rig", &about);
    if is_live
        && session.feed.is_watched()
        && let Ok(jpeg) = jpeg_of(&picture_of(frame))
    {
        let circles = detections
            .iter()
            .map(|one| json!({ "at_px": one.pixel, "radius_px": one.radius_px }));
        let about = json!({ "index": number, "time_s": frame.time_s(), "balls": circles.collect::<Vec<_>>() });
        session
            .feed
            .show_image(&format!("image/{name}"), &about, &jpeg);
    }
}
