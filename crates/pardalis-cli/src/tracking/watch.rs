//! A run that is shown while it goes on: images with what is drawn over them, the state of each target, and the rows so far.

use std::collections::{BTreeMap, VecDeque};
use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use anyhow::Result;
use pardalis::tracker::Verdict;
use pardalis::{CameraId, Frame, Tracker};
use pardalis_scene::Scene;
use pardalis_studio::{Feed, Lines};
use serde_json::{Map, Value, json};

use super::camera_rows::{moving, numbers_of};
use super::examined::Examined;
use super::marks::Marker;
use super::missed;
use super::pictures::Pictures;
use super::recording::Recording;
use super::rows::{HEADER, write_row};
use super::sender::open_line;
use super::{Instant, Sink};
use crate::draw::overlay::{Mark, Note, Shape};
use crate::report::{self, PageCamera, PageScene};
use crate::timing::now_s;

/// The shortest time between two images of a camera, and between two messages about the state, in seconds. Hand-set: as many as people see.
const INTERVAL_S: f64 = 0.04;
/// The most rows that are kept for pages that open late. Hand-set: more than an hour of one target at 50 frames per second, in less than 100 MB.
const MAX_ROWS: usize = 200_000;
/// The most rows in one answer.
const MAX_ANSWERED: usize = 20_000;
/// The upper limits of the histogram of tracking times, in milliseconds; there is one more bin above.
const HISTOGRAM_MS: [f64; 14] = [
    0.5, 1.0, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0, 25.0, 50.0, 100.0, 200.0, 500.0,
];

/// What shows a run. Cloning shares it.
#[derive(Debug, Clone)]
pub(crate) struct Watch {
    feed: Feed,
    /// The estimates for other programs, see [`open_line`].
    lines: Lines,
    rows: Arc<Mutex<RowsSoFar>>,
    /// Keeps the images.
    recording: Option<Recording>,
    /// Keeps what is examined in recorded images.
    examined: Option<Examined>,
}

/// The last rows, as in `tracks.csv`.
#[derive(Debug, Default)]
struct RowsSoFar {
    rows: VecDeque<String>,
    /// Number of rows before the first that is kept.
    dropped: usize,
    /// Where cameras were that move, each with the number of the next row, the camera's name, and time and pose as in `web/viewer.js`.
    poses: VecDeque<(usize, String, [f64; 8])>,
}

impl Watch {
    /// Shows a run on the pages that watch the feed, and to programs that read the lines.
    pub(crate) fn of(feed: &Feed, lines: &Lines) -> Self {
        Self {
            feed: feed.clone(),
            lines: lines.clone(),
            rows: Arc::default(),
            recording: None,
            examined: None,
        }
    }

    /// Withdraws what an earlier run showed of these cameras: it would look new until something is shown.
    #[cfg(feature = "studio")]
    pub(crate) fn begin<'c>(&self, cameras: impl Iterator<Item = &'c str>) {
        self.feed.withdraw("track");
        for camera in cameras {
            self.feed.withdraw(&format!("run/{camera}"));
        }
    }

    /// Also keeps what is examined in recorded images.
    pub(crate) fn examined(mut self, examined: Examined) -> Self {
        self.examined = Some(examined);
        self
    }

    /// Replaces the rows by those of a text as in `tracks.csv`, which has as many.
    pub(crate) fn replace_rows(&self, text: &str) {
        let rows = text.lines().skip(1);
        let mut so_far = self.so_far();
        let dropped = so_far.dropped;
        so_far.rows = rows.skip(dropped).map(str::to_owned).collect();
    }

    /// Also keeps the images.
    pub(crate) fn recorded(mut self, recording: Option<Recording>) -> Self {
        self.recording = recording;
        self
    }

    /// Returns the rows from this number on, as columns of each target, the number of the row after them, and where cameras were that move.
    pub(crate) fn rows_from(&self, first: usize) -> Value {
        let so_far = self.so_far();
        let skipped = first.saturating_sub(so_far.dropped);
        let rows = so_far.rows.iter().skip(skipped).take(MAX_ANSWERED);
        let next = first.max(so_far.dropped) + rows.len();
        let mut targets: BTreeMap<&str, Map<String, Value>> = BTreeMap::new();
        for row in rows {
            let cells = HEADER.trim_end().split(',').zip(row.trim_end().split(','));
            let (_, name) = cells.clone().nth(2).unwrap_or_default();
            let columns = targets.entry(name).or_default();
            for (column, cell) in cells.filter(|(column, _)| *column != "target") {
                let value = match (column, cell.parse::<f64>()) {
                    ("state", _) => Value::from(cell),
                    (_, Ok(number)) => Value::from(number),
                    _ => Value::Null,
                };
                let values = columns.entry(column).or_insert_with(|| json!([]));
                if let Value::Array(values) = values {
                    values.push(value);
                }
            }
        }
        let mut cameras: BTreeMap<&str, Vec<[f64; 8]>> = BTreeMap::new();
        let skipped = so_far.poses.partition_point(|(row, _, _)| *row < first);
        let poses = so_far.poses.iter().skip(skipped);
        for (_, name, pose) in poses.take_while(|(row, _, _)| *row < next) {
            cameras.entry(name).or_default().push(*pose);
        }
        json!({ "first": first.max(so_far.dropped), "next": next, "targets": targets, "cameras": cameras })
    }

    /// Shows the scene in the file at `scene_path`, and then its run.
    pub(super) fn sink(
        &self,
        scene_path: &Path,
        scene: &Scene,
        tracker: &Tracker,
    ) -> Result<WatchSink> {
        let cameras = tracker.views().iter().map(|view| PageCamera {
            size_px: Some(view.size()),
            path: Vec::new(),
        });
        let cameras: Vec<PageCamera> = cameras.collect();
        let page = PageScene::new(report::title(scene_path), scene, &cameras);
        self.feed.show("scene", &json!(page));
        Ok(WatchSink {
            watch: self.clone(),
            pictures: Pictures::start(&self.feed)?,
            marker: Marker::new(&scene.targets, true, true),
            cameras: scene.cameras.iter().map(|c| c.name.clone()).collect(),
            moving: moving(scene),
            shown_s: vec![f64::NEG_INFINITY; scene.cameras.len()],
            told_s: f64::NEG_INFINITY,
            untold: None,
            histogram: [0; HISTOGRAM_MS.len() + 1],
            text: String::new(),
        })
    }

    fn so_far(&self) -> MutexGuard<'_, RowsSoFar> {
        // Rows are added whole.
        self.rows.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Shows a run.
pub(crate) struct WatchSink {
    watch: Watch,
    pictures: Pictures,
    marker: Marker,
    /// The names of the cameras.
    cameras: Vec<String>,
    /// The indices and names of those that move.
    moving: Vec<(usize, String)>,
    /// When the last image of each camera was shown, in seconds.
    shown_s: Vec<f64>,
    /// When the state was last told, in seconds.
    told_s: f64,
    /// The last state, if it was not told because another was told shortly before.
    untold: Option<Value>,
    /// How often estimates of live cameras were how old, from the capture of their images on; how often tracking took how long without.
    histogram: [u64; HISTOGRAM_MS.len() + 1],
    text: String,
}

impl Sink for WatchSink {
    fn take(&mut self, instant: &Instant) -> Result<()> {
        self.marker.follow(instant);
        let latency_s = instant.captured_s.map(|captured_s| now_s() - captured_s);
        let time_ms = 1e3 * latency_s.unwrap_or(instant.tracking_s);
        self.histogram[HISTOGRAM_MS.partition_point(|limit_ms| *limit_ms < time_ms)] += 1;
        let row_count = self.add_rows(instant);
        if let Some(recording) = &self.watch.recording {
            recording.take(instant);
        }
        if let (Some(examined), None) = (&self.watch.examined, instant.captured_s) {
            for (camera, frame) in instant.frames {
                let notes = self.marker.notes(instant, CameraId::new(*camera))?;
                examined.keep(*camera, frame.time_s(), notes);
            }
        }
        if self.watch.lines.are_read() {
            let line = open_line(instant, &self.marker.targets);
            self.watch.lines.send(line);
        }
        if !self.watch.feed.is_watched() {
            return Ok(());
        }
        let now_s = now_s();
        let state = self.state(instant, row_count);
        if now_s - self.told_s >= INTERVAL_S {
            self.told_s = now_s;
            self.untold = None;
            self.watch.feed.show("track", &state);
        } else {
            self.untold = Some(state);
        }
        for (camera, frame) in instant.frames {
            if now_s - self.shown_s[*camera] >= INTERVAL_S {
                self.shown_s[*camera] = now_s;
                self.show(instant, *camera, frame)?;
            }
        }
        Ok(())
    }
}

impl Drop for WatchSink {
    fn drop(&mut self) {
        if let Some(state) = &self.untold {
            self.watch.feed.show("track", state);
        }
    }
}

impl WatchSink {
    /// Returns the number of rows since the beginning.
    fn add_rows(&mut self, instant: &Instant) -> usize {
        let mut so_far = self.watch.so_far();
        let next = so_far.dropped + so_far.rows.len();
        for (index, name) in &self.moving {
            let pose = instant.tracker.views()[*index].world_from_camera();
            let [x, y, z, qx, qy, qz, qw] = numbers_of(pose);
            let pose = [instant.time_s, x, y, z, qw, qx, qy, qz];
            so_far.poses.push_back((next, name.clone(), pose));
        }
        while so_far.poses.len() > MAX_ROWS {
            so_far.poses.pop_front();
        }
        for tracked in instant.tracked {
            self.text.clear();
            let name = tracked.name(&self.marker.targets);
            let place = (instant.index, instant.time_s);
            write_row(&mut self.text, place, &name, &tracked.estimate);
            so_far.rows.push_back(self.text.clone());
        }
        while so_far.rows.len() > MAX_ROWS {
            so_far.rows.pop_front();
            so_far.dropped += 1;
        }
        so_far.dropped + so_far.rows.len()
    }

    fn state(&self, instant: &Instant, row_count: usize) -> Value {
        let targets = instant.tracked.iter().map(|tracked| {
            let estimate = &tracked.estimate;
            let known = estimate.kinematics.as_ref();
            let sigma_m = known.map(|known| [0, 3, 5].map(|i| known.covariance_m2[i].sqrt()));
            json!({
                "name": tracked.name(&self.marker.targets),
                "state": estimate.state.name(),
                "confidence": estimate.confidence,
                "position_m": known.map(|known| known.position_m),
                "sigma_m": sigma_m,
                "velocity_mps": known.and_then(|known| known.velocity_mps),
            })
        });
        json!({
            "frame": instant.index,
            "time_s": instant.time_s,
            "age_s": instant.captured_s.map(|captured_s| now_s() - captured_s),
            "rows": row_count,
            "recording": self.watch.recording.as_ref().map(Recording::about),
            "targets": targets.collect::<Vec<_>>(),
            "times_ms": { "limits": HISTOGRAM_MS, "counts": self.histogram },
        })
    }

    /// Shows an image and what is drawn over it.
    fn show(&self, instant: &Instant, camera: usize, frame: &Frame) -> Result<()> {
        let id = CameraId::new(camera);
        let marks = self.marker.marks(instant, id)?;
        let notes = self.marker.notes(instant, id)?;
        let is_boxed = self.marker.targets.iter().any(missed::is_boxed);
        let about = json!({
            "index": instant.index,
            "time_s": frame.time_s(),
            "marks": marks.iter().map(written).collect::<Vec<_>>(),
            "notes": notes.iter().map(|note| noted(note, is_boxed)).collect::<Vec<_>>(),
        });
        let topic = format!("run/{}", self.cameras[camera]);
        self.pictures.show(topic, about, frame);
        Ok(())
    }
}

/// Returns a mark for a page: see `drawMarks` of the studio's `picture.js`.
pub(crate) fn written(mark: &Mark) -> Value {
    let shape = match mark.shape {
        Shape::Dots => "dots",
        Shape::Line => "line",
        Shape::Dashes => "dashes",
        Shape::Contour => "contour",
        Shape::WideContour => "wide_contour",
    };
    let points_px: Vec<_> = mark
        .points_px
        .iter()
        .map(|point| point.map(rounded))
        .collect();
    json!({ "shape": shape, "color": mark.color, "points_px": points_px })
}

/// Returns a note for a page, likewise: of a candidate that was ruled out also why, in words.
pub(crate) fn noted(note: &Note, is_boxed: bool) -> Value {
    let verdict = Verdict::ALL.into_iter().find(|one| one.name() == note.text);
    let why = verdict.filter(|verdict| *verdict != Verdict::Target);
    let why = why.map(|verdict| missed::what(verdict, is_boxed));
    json!({ "at_px": rounded(note.at_px), "text": note.text, "color": note.color, "why": why })
}

/// Tenths of pixels are enough to be seen.
fn rounded(pixel: [f64; 2]) -> [f64; 2] {
    pixel.map(|value| (10.0 * value).round() / 10.0)
}
