//! Tracks against circles that somebody drew in images, in place of positions.

use std::collections::{BTreeMap, HashMap, HashSet};
use std::fmt;
use std::path::{Path, PathBuf};

use anyhow::Result;
use pardalis::shape::Stance;
use pardalis::tracker::TrackState;
use pardalis_camera::Pose;
use pardalis_evaluate::{
    Circle, CircleEvaluation, CircleSample, Distribution, ProjectedOutline, Sighting,
    evaluate_circles,
};
use pardalis_scene::{CameraConfig, Scene, TargetConfig};
use serde::Serialize;
use serde_json::Value;

use super::Options;
use super::pairing::mapped;
use crate::numbers::{counted, fixed};
use crate::output::Shown;
use crate::report::{CameraPoses, poses_of};
use crate::results::{beside, folder_of, read_summary, scene_of};
use crate::sight::Sight;
use crate::tables::{Table, TrackRow, times_of, tracks_of};
use crate::tracking::{CAMERAS, SUMMARY};
use crate::user_error::user_error;

/// A circle is in the image whose time differs by less than this share of the time between two. Hand-set: enough for times that were rounded to milliseconds.
const TOLERANCE: f64 = 0.1;

/// The most frames that are listed.
const LISTED: usize = 12;

/// The image that somebody judged.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(untagged)]
pub(crate) enum Image {
    /// The number of the frame in the tracks.
    Frame(usize),
    /// Its time in seconds.
    Time(f64),
}

/// The circles around one object in the images of one camera.
#[derive(Debug, PartialEq)]
pub(crate) struct Circles {
    pub(crate) object: String,
    /// `None` if the table has no cameras.
    pub(crate) camera: Option<String>,
    /// The judged images, without a circle where the object is not in view.
    pub(crate) images: Vec<(Image, Option<Circle>)>,
}

/// The name of the object of a table without a column of objects.
const NAMELESS: &str = "object";

/// Reports whether a table has circles in place of positions.
pub(super) fn has_circles(table: &Table) -> bool {
    // With names misspelt, they are those that are missing.
    let has = |name: &str| table.optional_column(name).is_some();
    let has_position = ["x_m", "y_m", "z_m"].into_iter().any(has);
    let of_circles = ["u_px", "v_px", "radius_px", "u", "v", "radius", "r"];
    !has_position && of_circles.into_iter().filter(|name| has(name)).count() > 1
}

/// Returns the circles in a table with the columns `time_s` or `frame`, `u_px`, `v_px` and `radius_px`; `object`, `camera` and `visible_fraction` are optional. Images whose
/// `visible_fraction` is empty were not judged.
pub(crate) fn circles_of(table: &Table) -> Result<Vec<Circles>> {
    let frame = table.optional_column("frame");
    let time = table.optional_column("time_s");
    if frame.is_none() && time.is_none() {
        return Err(user_error!(
            "{}: circles need the column frame or time_s, which says in which image each is",
            table.path().shown()
        ));
    }
    let circle = table.columns(["u_px", "v_px", "radius_px"]);
    let circle = circle.map_err(|error| {
        user_error!("{error}; circles need frame or time_s, u_px, v_px and radius_px")
    })?;
    let [object, camera, visible] =
        ["object", "camera", "visible_fraction"].map(|name| table.optional_column(name));
    let mut all: Vec<Circles> = Vec::new();
    // The line of each image, by the number of its series and the bits of its frame or time.
    let mut lines = HashMap::new();
    for row in table.rows() {
        // Times stay right if the scene leaves out frames.
        let image = match (time, frame) {
            (Some(time), _) => Image::Time(row.numbers([time])?[0]),
            (None, Some(frame)) => Image::Frame(row.count(frame)?),
            (None, None) => continue,
        };
        let of = |column: Option<_>| column.map(|column| row.text(column)).transpose();
        let name = of(object)?.unwrap_or(NAMELESS);
        let camera = of(camera)?;
        let visible_fraction = row.fraction(visible)?;
        let found = row.all_or_none(Some(circle))?;
        if let Some([_, _, radius_px]) = found
            && !(radius_px > 0.0)
        {
            return Err(user_error!(
                "{}: radius_px is {radius_px}; allowed: above 0, or an empty circle where the object is not in view",
                row.place()
            ));
        }
        let is_same = |one: &Circles| one.object == name && one.camera.as_deref() == camera;
        let series = all.iter().position(is_same).unwrap_or_else(|| {
            all.push(Circles {
                object: name.to_owned(),
                camera: camera.map(str::to_owned),
                images: Vec::new(),
            });
            all.len() - 1
        });
        let bits = match image {
            Image::Frame(frame) => frame as u64,
            // Without minus zero.
            Image::Time(time_s) => (time_s + 0.0).to_bits(),
        };
        if let Some(line) = lines.insert((series, bits), row.line) {
            return Err(user_error!(
                "{}: {name} already has a circle in this image in line {line}; allowed: one row an object, image and camera",
                row.place()
            ));
        }
        if visible.is_some() && visible_fraction.is_none() {
            continue;
        }
        let circle = found.filter(|_| visible_fraction != Some(0.0));
        let circle = circle.map(|[u_px, v_px, radius_px]| Circle {
            center_px: [u_px, v_px],
            radius_px,
            visible_fraction,
        });
        all[series].images.push((image, circle));
    }
    Ok(all)
}

/// The results.
#[derive(Debug, Serialize)]
pub(crate) struct CircleReport {
    /// The tracks.csv that was read.
    tracks: PathBuf,
    /// The table of circles.
    circles: PathBuf,
    /// The scene that has the cameras and the sizes.
    scene: PathBuf,
    visible_over: f64,
    from_s: Option<f64>,
    to_s: Option<f64>,
    targets: Vec<TargetCircles>,
    /// Objects without a target.
    objects_without_target: Vec<String>,
}

/// A target compared with the circles of one camera.
#[derive(Debug, Serialize)]
struct TargetCircles {
    target: String,
    object: String,
    camera: String,
    /// Rows of circles in images of which the tracks have no rows.
    circles_without_rows: usize,
    #[serde(flatten)]
    figures: CircleEvaluation,
    /// The images in which it is tracked on something else.
    elsewhere_in: Vec<Image>,
    /// Those in which the object is visible and the target not tracked at all.
    missed_in: Vec<Image>,
}

/// Evaluates the tracks of a file against a table of circles.
pub(super) fn score(tracks: &Path, table: &Table, options: &Options) -> Result<CircleReport> {
    refuse_positions(options, table.path())?;
    let rows = Rows::read(tracks)?;
    let all = circles_of(table)?;
    let (scene, path, poses) = scene_beside(tracks)?;
    let objects: Vec<&str> = all.iter().map(|one| &*one.object).collect();
    let targets: Vec<&str> = scene.targets.iter().map(|target| &*target.name).collect();
    mapped(&options.map, (&path, &targets), (table.path(), &objects))?;
    let mut report = CircleReport {
        tracks: tracks.to_owned(),
        circles: table.path().to_owned(),
        scene: path,
        visible_over: options.visible_over,
        from_s: options.from_s,
        to_s: options.to_s,
        targets: Vec::new(),
        objects_without_target: Vec::new(),
    };
    for circles in &all {
        let Some(target) = target_of(&circles.object, &objects, &scene, &options.map) else {
            if !report.objects_without_target.contains(&circles.object) {
                report.objects_without_target.push(circles.object.clone());
            }
            continue;
        };
        check_target(target)?;
        let camera = camera_of(circles, &scene, table.path())?;
        let path = poses.get(&camera.name);
        if camera.platform.is_some() && path.is_none() {
            return Err(user_error!(
                "{}: does not say where {} was, which is on a platform; keep this file beside the tracks",
                beside(tracks, CAMERAS).shown(),
                camera.name
            ));
        }
        let sees = Seen {
            target,
            camera,
            path: path.map(|path| &**path),
        };
        let compared = sees.compare(circles, &rows, options);
        report.targets.push(compared.map_err(|image| {
            user_error!(
                "{}: two circles of {} belong to the row of {}; allowed: one an image",
                table.path().shown(),
                circles.object,
                list(&[image])
            )
        })?);
    }
    check_judged(&report, (&objects, &targets))?;
    Ok(report)
}

/// Rejects circles of which none counts.
fn check_judged(report: &CircleReport, (objects, targets): (&[&str], &[&str])) -> Result<()> {
    let (circles, tracks) = (report.circles.shown(), report.tracks.shown());
    if report.targets.is_empty() {
        return Err(user_error!(
            "{circles}: none of its objects ({}) is a target ({}); name them alike, or pair them with --map TARGET=OBJECT",
            objects.join(", "),
            targets.join(", ")
        ));
    }
    if report
        .targets
        .iter()
        .any(|target| target.figures.frames > 0)
    {
        return Ok(());
    }
    if report
        .targets
        .iter()
        .any(|target| target.circles_without_rows > 0)
    {
        return Err(user_error!(
            "{circles}: none of its circles is in an image of which {tracks} has a row; frames and times are those of its columns frame and time_s"
        ));
    }
    Err(user_error!(
        "{circles}: none of its images was judged, or lies between --from and --to; visible_fraction is empty in images that were not judged"
    ))
}

/// Rejects options that need positions.
fn refuse_positions(options: &Options, circles: &Path) -> Result<()> {
    let given = [
        ("--align", options.align),
        ("--interpolate", options.interpolate),
        ("--around", options.around.is_some()),
        ("--lost-beyond-m", options.lost_beyond_m.is_some()),
        ("--diameter-m", options.diameter_m.is_some()),
        ("--seen-by", options.seen_by.is_some()),
        ("--crowd", !options.crowd.is_empty()),
    ];
    match given.into_iter().find(|(_, is_given)| *is_given) {
        Some((name, _)) => Err(user_error!(
            "{name}: {} has circles in images, and no positions; leave {name} out",
            circles.shown()
        )),
        None => Ok(()),
    }
}

/// Returns the scene of results, its file, and where cameras were that move.
fn scene_beside(tracks: &Path) -> Result<(Scene, PathBuf, CameraPoses)> {
    let needed = "circles are compared with what the cameras of the scene show";
    let summary = read_summary(tracks)?.ok_or_else(|| {
        user_error!(
            "{}: there is none, but {needed}; keep it beside the tracks",
            beside(tracks, SUMMARY).shown()
        )
    })?;
    let (scene, path) = scene_of(&summary, &folder_of(tracks))
        .map_err(|problem| user_error!("{}: {problem}, but {needed}", tracks.shown()))?;
    if let Some(key) = changed_since(&scene, &summary) {
        return Err(user_error!(
            "{}: {key} has changed since {} was made, and {needed}; track again, or give the scene its earlier value",
            path.shown(),
            tracks.shown()
        ));
    }
    let poses = beside(tracks, CAMERAS);
    let poses = if poses.exists() {
        poses_of(&Table::read(&poses)?)?
    } else {
        CameraPoses::new()
    };
    Ok((scene, path, poses))
}

/// Returns a key of the scene that matters here and differs from that of the summary.
fn changed_since(scene: &Scene, summary: &Value) -> Option<String> {
    let now = serde_json::to_value(&scene.resolved).ok()?;
    let then = &summary["settings"];
    let of_cameras = scene.cameras.iter().flat_map(|camera| {
        ["model", "world_from_camera"].map(|key| ["cameras", &camera.name, key])
    });
    let of_targets = scene
        .targets
        .iter()
        .map(|target| ["targets", &target.name, "shape"]);
    let mut keys = of_cameras.chain(of_targets);
    let value = |all: &Value, [table, name, key]: [&str; 3]| all[table][name][key].clone();
    let changed = keys.find(|&key| value(&now, key) != value(then, key));
    changed.map(|key| key.join("."))
}

/// Returns the target that is compared with an object: as mapped, of the same name, or the only one if there is only one object.
fn target_of<'s>(
    object: &str,
    objects: &[&str],
    scene: &'s Scene,
    map: &[(String, String)],
) -> Option<&'s TargetConfig> {
    let named = |name: &str| scene.targets.iter().find(|target| target.name == name);
    if let Some((target, _)) = map.iter().find(|(_, of)| of == object) {
        return named(target);
    }
    let is_alone = objects.iter().all(|other| *other == object);
    let only = match &scene.targets[..] {
        [target] if is_alone => Some(target),
        _ => None,
    };
    let is_mapped = |target: &&TargetConfig| map.iter().any(|(name, _)| *name == target.name);
    named(object).or(only).filter(|target| !is_mapped(target))
}

/// Returns the camera whose images the circles are in.
fn camera_of<'s>(circles: &Circles, scene: &'s Scene, path: &Path) -> Result<&'s CameraConfig> {
    let cameras = &scene.cameras;
    let names: Vec<&str> = cameras.iter().map(|camera| &*camera.name).collect();
    match (&circles.camera, &cameras[..]) {
        (None, [camera]) => Ok(camera),
        (None, _) => Err(user_error!(
            "{}: the scene has several cameras ({}); add a column camera",
            path.shown(),
            names.join(", ")
        )),
        (Some(name), _) => cameras
            .iter()
            .find(|camera| camera.name == *name)
            .ok_or_else(|| {
                user_error!(
                    "{}: the scene has no camera {name}; it has {}",
                    path.shown(),
                    names.join(", ")
                )
            }),
    }
}

/// The rows of the tracks by time.
struct Rows {
    /// The times of the frames, in seconds.
    frames: BTreeMap<usize, f64>,
    /// All times in ascending order.
    times_s: Vec<f64>,
    /// Times that differ by less are the same.
    tolerance_s: f64,
    /// The rows of each target by the bits of their times.
    targets: HashMap<String, HashMap<u64, TrackRow>>,
}

impl Rows {
    fn read(path: &Path) -> Result<Self> {
        let table = Table::read(path)?;
        let (time, mut frames) = (table.column("time_s")?, BTreeMap::new());
        if let Some(frame) = table.optional_column("frame") {
            for row in table.rows() {
                frames.insert(row.count(frame)?, row.numbers([time])?[0]);
            }
        }
        let tracks = tracks_of(&table)?;
        let times_s = times_of(&tracks);
        let mut steps_s: Vec<f64> = times_s.windows(2).map(|pair| pair[1] - pair[0]).collect();
        steps_s.sort_by(f64::total_cmp);
        let by_time = |rows: &[(f64, TrackRow)]| {
            rows.iter()
                .map(|(time_s, row)| (time_s.to_bits(), *row))
                .collect()
        };
        let targets = tracks
            .iter()
            .map(|track| (track.name.clone(), by_time(&track.rows)));
        Ok(Self {
            frames,
            tolerance_s: steps_s
                .get(steps_s.len() / 2)
                .map_or(0.0, |step_s| TOLERANCE * step_s),
            targets: targets.collect(),
            times_s,
        })
    }

    /// Returns the time in the tracks of an image; `None` if they have none of it.
    fn time_s(&self, image: Image) -> Option<f64> {
        match image {
            Image::Frame(frame) => self.frames.get(&frame).copied(),
            Image::Time(time_s) => {
                let after = self.times_s.partition_point(|known_s| *known_s < time_s);
                let near = self.times_s[after.saturating_sub(1)..].iter().take(2);
                let off_s = |known_s: &f64| (known_s - time_s).abs();
                let nearest = near.min_by(|a, b| off_s(a).total_cmp(&off_s(b)));
                nearest
                    .copied()
                    .filter(|known_s| off_s(known_s) <= self.tolerance_s)
            }
        }
    }
}

/// Rejects a target that circles cannot be compared with.
fn check_target(target: &TargetConfig) -> Result<()> {
    let what = if target.crowd.is_some() {
        "is a crowd (count = \"any\")"
    } else if target.bodies.len() > 1 {
        "has several landmarks"
    } else {
        return Ok(());
    };
    Err(user_error!(
        "targets.{} {what}: circles are compared with targets of one body only; leave its circles out",
        target.name
    ))
}

/// A target in the images of a camera.
struct Seen<'s> {
    target: &'s TargetConfig,
    camera: &'s CameraConfig,
    /// Where the camera was, by times in seconds, if it moves.
    path: Option<&'s [(f64, Pose)]>,
}

impl Seen<'_> {
    /// Compares the target with circles. Returns the second image of two of which the tracks have only one row as an error.
    fn compare(
        &self,
        circles: &Circles,
        rows: &Rows,
        options: &Options,
    ) -> Result<TargetCircles, Image> {
        let rows_of_target = rows.targets.get(&self.target.name);
        let (mut samples, mut images, mut circles_without_rows) = (Vec::new(), Vec::new(), 0);
        let mut taken = HashSet::new();
        for &(image, circle) in &circles.images {
            let Some(time_s) = rows.time_s(image) else {
                circles_without_rows += 1;
                continue;
            };
            if !taken.insert(time_s.to_bits()) {
                return Err(image);
            }
            let from_s = options.from_s.unwrap_or(f64::NEG_INFINITY);
            if !(from_s..=options.to_s.unwrap_or(f64::INFINITY)).contains(&time_s) {
                continue;
            }
            let row = rows_of_target.and_then(|rows| rows.get(&time_s.to_bits()));
            let outline = row.and_then(|row| self.outline(row, time_s));
            images.push(image);
            samples.push(CircleSample { circle, outline });
        }
        let listed = |is_listed: &dyn Fn(&CircleSample) -> bool| {
            let all = images.iter().zip(&samples);
            let listed = all.filter(|(_, sample)| is_listed(sample));
            listed.map(|(image, _)| *image).collect()
        };
        let is_missed = |sample: &CircleSample| {
            sample.is_visible(options.visible_over) && sample.sighting() == Sighting::None
        };
        Ok(TargetCircles {
            target: self.target.name.clone(),
            object: circles.object.clone(),
            camera: self.camera.name.clone(),
            circles_without_rows,
            figures: evaluate_circles(&samples, options.visible_over),
            elsewhere_in: listed(&|sample| sample.sighting() == Sighting::Elsewhere),
            missed_in: listed(&is_missed),
        })
    }

    /// Returns what the camera shows of a target that is tracked.
    fn outline(&self, row: &TrackRow, time_s: f64) -> Option<ProjectedOutline> {
        let is_tracked = row.state.is_none_or(|state| state == TrackState::Tracking);
        let estimate = row.estimate.filter(|_| is_tracked)?;
        let shape = &self.target.bodies[0].shape;
        let scale = row
            .radius_m
            .map_or(1.0, |radius_m| 2.0 * radius_m / shape.diameter_m());
        let stance = Stance {
            yaw_rad: estimate.heading_rad.unwrap_or(0.0),
            ..Stance::scaled(scale)
        };
        let pose = self.pose(time_s)?.inverse();
        let sight = Sight::by(
            (&self.camera.camera, &pose),
            shape,
            estimate.position_m,
            stance,
        );
        Some(ProjectedOutline {
            center_px: sight
                .as_ref()
                .map_or([f64::INFINITY; 2], |sight| sight.outline_center_px),
            radius_px: sight.map_or(0.0, |sight| sight.radius_px),
            confidence: row.confidence,
        })
    }

    /// Returns the pose of the camera in the world; `None` if it was not known.
    fn pose(&self, time_s: f64) -> Option<Pose> {
        let Some(path) = self.path else {
            return Some(self.camera.world_from_camera);
        };
        let at = path.binary_search_by(|(at_s, _)| at_s.total_cmp(&time_s));
        at.ok().map(|at| path[at].1)
    }
}

impl CircleReport {
    /// Returns the results as JSON with unit-suffixed keys, without a final line feed.
    pub(super) fn to_json(&self) -> Result<String> {
        Ok(serde_json::to_string_pretty(self)?)
    }
}

impl fmt::Display for CircleReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "tracks   {}", self.tracks.shown())?;
        writeln!(f, "circles  {}", self.circles.shown())?;
        writeln!(f, "scene    {}", self.scene.shown())?;
        writeln!(
            f,
            "visible  more than {} of the object in view; on the object: tracked within one radius of it; on something else: beyond 1.5 radii, or while it is not in view",
            self.visible_over
        )?;
        for target in &self.targets {
            writeln!(f)?;
            target.fmt(f)?;
        }
        if !self.objects_without_target.is_empty() {
            let names = self.objects_without_target.join(", ");
            writeln!(f, "\nobjects without a target: {names}")?;
        }
        Ok(())
    }
}

impl fmt::Display for TargetCircles {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let figures = &self.figures;
        writeln!(
            f,
            "target {} against {} in the images of {}: {} judged, {} with the object visible",
            self.target,
            if self.object == NAMELESS {
                "the object".to_owned()
            } else {
                format!("object {}", self.object)
            },
            self.camera,
            counted(figures.frames as u64, "image"),
            figures.visible_frames
        )?;
        if self.circles_without_rows > 0 {
            let images = counted(self.circles_without_rows as u64, "image");
            writeln!(f, "  not counted: {images} of which the tracks have no row")?;
        }
        let mut line = |label: &str, value: String, note: &str| {
            let line = format!("  {label:<44} {value:>9}  {note}");
            writeln!(f, "{}", line.trim_end())
        };
        let none = || "-".to_owned();
        let percent = |share: Option<f64>| {
            share.map_or_else(none, |share| format!("{} %", fixed(100.0 * share, 1)))
        };
        let of = |count: usize, of: usize, what: &str| format!("{count} of {of} {what}");
        let (seen, all) = (figures.visible_frames, figures.frames);
        line(
            "on the object",
            percent(figures.on_object_share),
            &of(figures.on_object_frames, seen, "visible"),
        )?;
        line(
            "on something else",
            percent(figures.elsewhere_share),
            &of(figures.elsewhere_frames, all, "judged"),
        )?;
        let shown = |values: &Option<Distribution>, of: fn(&Distribution) -> f64, digits| {
            values
                .as_ref()
                .map_or_else(none, |values| fixed(of(values), digits))
        };
        let (radii, px) = (&figures.center_error_radii, &figures.center_error_px);
        let share = |values: &Option<Distribution>, of: fn(&Distribution) -> f64| {
            percent(values.as_ref().map(of))
        };
        line(
            "distance of the centres, median, of the radius",
            share(radii, |d| d.median),
            "",
        )?;
        line("    95 % are below", share(radii, |d| d.p95), "")?;
        line("    median, px", shown(px, |d| d.median, 2), "")?;
        line(
            "radius relative to the circle's, median",
            share(&figures.radius_ratio, |d| d.median),
            "",
        )?;
        let confidence = |value: Option<f64>| value.map_or_else(none, |value| fixed(value, 2));
        line(
            "confidence on the object, mean",
            confidence(figures.confidence_on_object),
            "",
        )?;
        line(
            "    on something else",
            confidence(figures.confidence_elsewhere),
            "",
        )?;
        for (label, images) in [
            ("on something else in", &self.elsewhere_in),
            ("visible, not tracked in", &self.missed_in),
        ] {
            if !images.is_empty() {
                writeln!(f, "  {label} {}", list(images))?;
            }
        }
        Ok(())
    }
}

/// Names images.
fn list(images: &[Image]) -> String {
    let name = |image: &Image| match image {
        Image::Frame(frame) => frame.to_string(),
        Image::Time(time_s) => format!("{time_s} s"),
    };
    let names: Vec<String> = images.iter().take(LISTED).map(name).collect();
    let what = match images.first() {
        Some(Image::Frame(_)) if images.len() == 1 => "frame ",
        Some(Image::Frame(_)) => "frames ",
        _ => "",
    };
    let more = images.len().saturating_sub(LISTED);
    let more = if more > 0 {
        format!(" and {more} more")
    } else {
        String::new()
    };
    format!("{what}{}{more}", names.join(", "))
}
