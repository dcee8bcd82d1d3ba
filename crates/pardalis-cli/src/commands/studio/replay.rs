//! The outlines of a finished run, to be drawn over the images of its recordings again.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

use anyhow::Result;
use pardalis::shape::Stance;
use pardalis::tracker::TrackState;
use pardalis::view::View;
use pardalis_camera::Pose;
use pardalis_scene::TargetConfig;
use serde_json::{Value, json};

use crate::draw::overlay::{Mark, Shape};
use crate::tables::{Series, TrackRow, read_tracks};
use crate::tracking::radius::EstimatedRadius;
use crate::tracking::{CONTOUR_POINTS, Examined, Run, mark_written, missed, note_written};

/// Times that differ by less than this, in seconds, are the same.
const SAME_TIME_S: f64 = 1e-6;

/// The row of a frame set is at most this much later than an image in it, in seconds. Hand-set: the interval of a slow camera.
const MAX_LATER_S: f64 = 0.1;

/// The colours of the outlines of the run and of another one.
const COLORS: [[u8; 3]; 2] = [[255; 3], [255, 138, 76]];

/// The run that is replayed, if there is one. Cloning shares it.
#[derive(Debug, Clone, Default)]
pub(super) struct Replayed(Arc<Mutex<Option<Arc<Replay>>>>);

impl Replayed {
    pub(super) fn set(&self, replay: Option<Arc<Replay>>) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = replay;
    }

    /// Returns what is drawn over the image of a camera at a time, what was examined in it, and the targets then, as in a run; nothing without a run.
    pub(super) fn at(&self, camera: &str, time_s: f64) -> [Value; 3] {
        let replay = self
            .0
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .clone();
        let at = |replay: Arc<Replay>| {
            [
                replay.marks(camera, time_s),
                replay.notes(camera, time_s),
                replay.targets(time_s),
            ]
        };
        replay.map_or([Value::Null, Value::Null, Value::Null], at)
    }
}

/// A finished run, with another one over it if two are compared.
pub(super) struct Replay {
    cameras: Vec<String>,
    views: Vec<View>,
    /// The poses of cameras that move, by times in seconds.
    poses: Vec<Vec<(f64, Pose)>>,
    targets: Vec<TargetConfig>,
    run: Outlined,
    examined: Examined,
    other: Mutex<Outlined>,
}

/// What is drawn of a run.
#[derive(Default)]
pub(super) struct Outlined {
    pub(super) tracks: Vec<Series<TrackRow>>,
    /// The diameters of targets in metres, by their names. Without one, a target is as large as its shape.
    pub(super) diameters_m: BTreeMap<String, f64>,
}

impl std::fmt::Debug for Replay {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Replay").finish_non_exhaustive()
    }
}

impl Replay {
    /// Takes over a run with its rows and what was examined in its images.
    pub(super) fn of(run: Run, rows: &Path, examined: Examined) -> Result<Self> {
        let targets = run.open.scene.targets.clone();
        let mut diameters_m = BTreeMap::new();
        for (number, target) in targets.iter().enumerate() {
            let radii = EstimatedRadius::of(&run.open.scene, &run.open.tracker, number)?;
            let estimated = radii.first().map(|radius| 2.0 * radius.estimate.radius_m);
            diameters_m.extend(estimated.map(|diameter_m| (target.name.clone(), diameter_m)));
        }
        let cameras = run.open.scene.cameras.iter();
        let cameras: Vec<String> = cameras.map(|camera| camera.name.clone()).collect();
        let views = run.open.tracker.views();
        let poses = (0..cameras.len()).map(|number| run.series.poses(number).to_vec());
        Ok(Self {
            poses: poses.collect(),
            cameras,
            targets,
            run: Outlined {
                tracks: read_tracks(rows)?,
                diameters_m,
            },
            examined,
            other: Mutex::default(),
            views: views
                .iter()
                .map(|view| view.clone().at_its_frame())
                .collect(),
        })
    }

    /// Also draws the outlines of another run.
    pub(super) fn set_other(&self, other: Outlined) {
        *self.other.lock().unwrap_or_else(PoisonError::into_inner) = other;
    }

    fn marks(&self, camera: &str, time_s: f64) -> Value {
        let Some(number) = self.cameras.iter().position(|name| name == camera) else {
            return Value::Null;
        };
        let view = &self.views[number];
        let poses = &self.poses[number];
        let after = poses.partition_point(|(at_s, _)| *at_s < time_s - SAME_TIME_S);
        let moved = poses.get(after).map(|(_, pose)| pose.inverse());
        let camera_from_world = moved.unwrap_or(*view.camera_from_world());
        let other = self.other.lock().unwrap_or_else(PoisonError::into_inner);
        let seen = (view, &camera_from_world);
        let outlined = |(run, color): (&Outlined, [u8; 3])| {
            let outlines = run.tracks.iter().filter_map(|track| {
                let points_px = self.outline(run, track, time_s, seen)?;
                let shape = Shape::Contour;
                Some(mark_written(&Mark {
                    shape,
                    points_px,
                    color,
                }))
            });
            outlines.collect::<Vec<_>>()
        };
        let runs = [(&*other, COLORS[1]), (&self.run, COLORS[0])];
        runs.into_iter().flat_map(outlined).collect()
    }

    fn notes(&self, camera: &str, time_s: f64) -> Value {
        let number = self.cameras.iter().position(|name| name == camera);
        let notes = number.map(|number| self.examined.at(number, time_s));
        let is_boxed = self.targets.iter().any(missed::is_boxed);
        let written = |note| note_written(note, is_boxed);
        notes.iter().flatten().map(written).collect()
    }

    /// Returns the state of each target at the end.
    pub(super) fn last(&self) -> Value {
        let ends_s = self.run.tracks.iter();
        let ends_s = ends_s.filter_map(|track| Some(track.rows.last()?.0));
        self.targets(ends_s.fold(f64::NEG_INFINITY, f64::max))
    }

    /// Returns the state of each target at a time: see [`Watch`](crate::tracking::Watch).
    fn targets(&self, time_s: f64) -> Value {
        let targets = self.run.tracks.iter().filter_map(|track| {
            let (at_s, row) = row_at(&track.rows, time_s)?;
            let number = track.rows.partition_point(|(before_s, _)| before_s < at_s);
            let estimate = row.estimate.as_ref();
            let covariance_m2 = estimate.and_then(|estimate| estimate.covariance_m2);
            Some(json!({
                "name": track.name,
                "row": number,
                "state": row.state.map(TrackState::name),
                "confidence": row.confidence,
                "position_m": estimate.map(|estimate| estimate.position_m),
                "sigma_m": covariance_m2.map(|m2| [0, 3, 5].map(|i| m2[i].sqrt())),
            }))
        });
        targets.collect()
    }

    /// Returns the outline of a target at a time; none of landmarks, of which rows say too little.
    fn outline(
        &self,
        run: &Outlined,
        track: &Series<TrackRow>,
        time_s: f64,
        (view, camera_from_world): (&View, &Pose),
    ) -> Option<Vec<Option<[f64; 2]>>> {
        let (at_s, row) = row_at(&track.rows, time_s)?;
        let later_s = at_s - time_s;
        let estimate = row.estimate?;
        let target = self.target(&track.name)?;
        let [body] = &*target.bodies else {
            return None;
        };
        let velocity_mps = estimate.velocity_mps.unwrap_or_default();
        let position_m =
            [0, 1, 2].map(|axis| estimate.position_m[axis] - later_s * velocity_mps[axis]);
        let position_m = view.shown_position_m(position_m, velocity_mps);
        let diameter_m = run.diameters_m.get(&target.name);
        let stance = Stance {
            scale: diameter_m.map_or(1.0, |diameter_m| diameter_m / body.shape.diameter_m()),
            yaw_rad: estimate.heading_rad.unwrap_or(0.0),
        };
        let points_px = body.shape.outline_px(
            view.camera(),
            camera_from_world,
            position_m,
            stance,
            CONTOUR_POINTS,
        );
        Some(points_px)
    }

    /// Returns the target of this name, or the crowd with a member of this name.
    fn target(&self, name: &str) -> Option<&TargetConfig> {
        let is_of = |target: &&TargetConfig| {
            let number = name.strip_prefix(&target.name);
            let number = number.and_then(|rest| rest.strip_prefix('-'));
            let is_member = number.is_some_and(|number| number.parse::<u32>().is_ok());
            target.name == name || (target.crowd.is_some() && is_member)
        };
        self.targets.iter().find(is_of)
    }
}

/// Returns the row of the frame set that has an image of this time, with its own time in seconds.
fn row_at(rows: &[(f64, TrackRow)], time_s: f64) -> Option<&(f64, TrackRow)> {
    let row = rows.get(rows.partition_point(|row| row.0 < time_s - SAME_TIME_S))?;
    (row.0 - time_s < MAX_LATER_S).then_some(row)
}
