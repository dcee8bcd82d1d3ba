//! `pardalis evaluate`: compares tracks with the truth.

mod align;
mod between;
mod circles;
mod confidence;
mod crowds;
mod frames;
mod pairing;
mod report;

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::{Path, PathBuf};

use anyhow::Result;
use pardalis_evaluate::{self, Identities, Sample, Settings, TrueState};
use serde::Deserialize as _;
use serde_json::Value;

use crate::files::write_file;
use crate::output::{Shown, print, warn};
use crate::scene_files::read_text;
use crate::tables::{self, Series, Table, TrackRow};
use crate::user_error::user_error;
pub(crate) use align::Aligned;
#[cfg(any(test, feature = "fuzz"))]
pub(crate) use circles::circles_of;
use confidence::Confidence;
use frames::Frames;
use pairing::Pair;
pub(crate) use report::{CrowdReport, Point, Report, TargetReport};

/// Evaluates tracks against the truth
///
/// The truth is positions in metres, or circles that were drawn around the object in some images: a table with the columns frame,u_px,v_px,radius_px, for recordings whose
/// positions nobody measured. Circles are compared with what the cameras of the scene show of the target.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  pardalis evaluate ball-tracks truth.csv              errors in metres, coverage, lost frames
  pardalis evaluate ball-tracks circles.csv            how often it is on the ball
  pardalis evaluate run7 truth.csv --json -            all figures as JSON")]
pub(crate) struct Arguments {
    /// tracks.csv, or the folder that holds it
    tracks: PathBuf,
    /// truth.csv, or the folder that holds it; or a table of circles
    truth: PathBuf,
    #[command(flatten)]
    options: Options,
    /// Writes the results as JSON to this file, or with - to standard output instead of the table
    #[arg(long, value_name = "FILE|-")]
    json: Option<PathBuf>,
}

/// Options that affect the results.
#[derive(Debug, Clone, clap::Args)]
pub(crate) struct Options {
    /// Pairs a target with an object of the truth; may be repeated [default: the object of the same name, else the
    /// one that the target follows best; objects named occluder… only by name]
    #[arg(long, value_name = "TARGET=OBJECT", value_parser = name_pair)]
    pub(crate) map: Vec<(String, String)>,
    /// Evaluates the targets NAME-1, NAME-2, ... together, as the members of a crowd; may be repeated [default: the crowds in the
    /// summary.json next to the tracks]
    #[arg(long, value_name = "NAME")]
    pub(crate) crowd: Vec<String>,
    /// The origin of distance, elevation and azimuth in the world, in metres [default: the first camera in the
    /// summary.json next to the tracks, else the world's origin]
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true)]
    pub(crate) around: Option<[f64; 3]>,
    /// An object counts as visible if more than this share of it is visible
    #[arg(long, value_name = "SHARE", value_parser = share, default_value_t = Settings::VISIBLE_OVER)]
    pub(crate) visible_over: f64,
    /// An estimate farther than this from the truth counts as lost [default: three diameters of the largest target, from the
    /// summary.json next to the tracks, else 0.66]
    #[arg(long, value_name = "METRES", value_parser = length)]
    pub(crate) lost_beyond_m: Option<f64>,
    /// The diameter of targets: a confidence or state is right if the object is within this distance [default: the
    /// targets' own diameters, from the summary.json next to the tracks]
    #[arg(long, value_name = "METRES", value_parser = length)]
    pub(crate) diameter_m: Option<f64>,
    /// Evaluates only the frames from this time on
    #[arg(long = "from", value_name = "SECONDS", value_parser = finite, allow_hyphen_values = true)]
    pub(crate) from_s: Option<f64>,
    /// Evaluates only the frames up to this time
    #[arg(long = "to", value_name = "SECONDS", value_parser = finite, allow_hyphen_values = true)]
    pub(crate) to_s: Option<f64>,
    /// Evaluates only the frames in which exactly this number of cameras (of those with an image at that time) see
    /// more than half of the object
    #[arg(long, value_name = "CAMERAS")]
    pub(crate) seen_by: Option<usize>,
    /// Evaluates every row of the tracks, with the truth interpolated to its time (by a cubic if the truth includes
    /// velocities, otherwise linearly)
    #[arg(long)]
    pub(crate) interpolate: bool,
    /// Moves and turns the tracks as one rigid body to where they fit the truth best, before they are evaluated: for tracks in a world frame of their own
    ///
    /// Estimates that count as lost then do not take part. Targets need the names of their objects, or --map.
    #[arg(long)]
    pub(crate) align: bool,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            map: Vec::new(),
            crowd: Vec::new(),
            around: None,
            visible_over: Settings::VISIBLE_OVER,
            lost_beyond_m: None,
            diameter_m: None,
            from_s: None,
            to_s: None,
            seen_by: None,
            interpolate: false,
            align: false,
        }
    }
}

/// Runs the command.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    // If it cannot be read, that is reported where it is needed.
    let truth = Table::read(&file_in(&arguments.truth, "truth.csv"));
    if let Ok(truth) = truth
        && circles::has_circles(&truth)
    {
        let tracks = file_in(&arguments.tracks, "tracks.csv");
        let report = circles::score(&tracks, &truth, &arguments.options)?;
        return show(arguments, &report.to_json()?, &report.to_string());
    }
    let report = score_files(&arguments.tracks, &arguments.truth, &arguments.options)?;
    let rows = |count: fn(&TargetReport) -> usize| report.targets.iter().map(count).sum::<usize>();
    if !arguments.options.interpolate && 2 * rows(|t| t.rows_without_truth) > rows(|t| t.rows) {
        warn(
            "most rows lie between the times of the truth and are not evaluated; add --interpolate to evaluate them",
        );
    }
    let is_lost = |target: &TargetReport| {
        let visible = &target.scores.visible;
        visible.estimates > 0 && 10 * target.scores.lost_frames > 9 * visible.frames
    };
    if !arguments.options.align && !report.targets.is_empty() && report.targets.iter().all(is_lost)
    {
        warn(
            "almost all estimates are lost; if the tracks have a world frame of their own, add --align to move them onto the truth",
        );
    }
    show(arguments, &report.to_json()?, &report.to_string())
}

/// Prints or writes a report, given as JSON and as text.
fn show(arguments: &Arguments, json: &str, text: &str) -> Result<()> {
    if arguments.json.as_deref() == Some(Path::new("-")) {
        print(json);
        return Ok(());
    }
    if let Some(path) = &arguments.json {
        write_file(path, format!("{json}\n").as_bytes())?;
    }
    print(text.trim_end());
    Ok(())
}

/// Evaluates the tracks of a file against the truth of another; folders stand for the tracks.csv and truth.csv in them.
pub(crate) fn score_files(tracks: &Path, truth: &Path, options: &Options) -> Result<Report> {
    let tracks_path = file_in(tracks, "tracks.csv");
    let truth_path = file_in(truth, "truth.csv");
    let mut tracks = tables::read_tracks(&tracks_path)?;
    let mut objects = tables::read_truth(&truth_path)?;
    if options.interpolate {
        objects = between::at_times_of(&tracks, &objects);
    }
    let summary_path = tracks_path.with_file_name("summary.json");
    let summary = RunSummary::read(&summary_path)?;
    let mut around = around(options, &summary, &summary_path)?;
    let mut settings = Settings::default();
    settings.around_m = around.position_m;
    settings.visible_over = options.visible_over;
    let lost_beyond_m = options.lost_beyond_m.or(summary.lost_beyond_m());
    let lost_beyond_m = lost_beyond_m.unwrap_or(Settings::LOST_BEYOND_M);
    settings.lost_beyond_m = lost_beyond_m;

    let frames = Frames::of(&objects);
    let aligned = if options.align {
        let placed = Placed::of(&tracks, &objects, &frames);
        let paths = (&*tracks_path, &*truth_path);
        let aligned = Aligned::of(&placed, paths, options, lost_beyond_m)?;
        aligned.move_tracks(&mut tracks);
        // Given points are in the world of the truth.
        if options.around.is_none() {
            around.position_m = aligned.place(around.position_m);
            settings.around_m = around.position_m;
        }
        Some(aligned)
    } else {
        None
    };
    let placed = Placed::of(&tracks, &objects, &frames);
    if placed.track_rows.iter().flatten().all(Option::is_none) {
        let (tracks, truth) = ((&*tracks_path, &*tracks), (&*truth_path, &*objects));
        return Err(other_clock(tracks, truth, frames.tolerance_s));
    }
    let crowds = crowds::find(&summary, options, &placed, &tracks_path)?;
    let in_crowd = |track: usize| crowds.iter().any(|crowd| crowd.tracks.contains(&track));
    let of_crowd = |object: usize| crowds.iter().any(|crowd| crowd.objects.contains(&object));
    let single_tracks = (0..tracks.len()).filter(|&track| !in_crowd(track));
    let single_objects = (0..objects.len()).filter(|&object| !of_crowd(object));
    let single = [single_tracks.collect(), single_objects.collect::<Vec<_>>()];
    let pairs = if single[0].is_empty() && !crowds.is_empty() {
        Vec::new()
    } else {
        pairs(
            &placed,
            single,
            (&tracks_path, &truth_path),
            options,
            lost_beyond_m,
        )?
    };

    let window = window(options, &frames).ok_or_else(|| {
        user_error!(
            "no frame of {} (times {}) lies between --from and --to; change them",
            truth_path.shown(),
            time_range(&objects)
        )
    })?;
    let rules = Rules {
        options,
        summary: &summary,
        settings,
        window,
        frames_in_a_second: frames.in_a_second,
    };

    let identities = identities(&placed, &pairs, &rules);
    let targets = pairs
        .iter()
        .map(|pair| target_report(&placed, pair, &rules));
    let mut targets: Vec<TargetReport> = targets.collect();
    let mut crowd_reports = Vec::new();
    for crowd in &crowds {
        let report = crowd.evaluate(&placed, &rules);
        targets.extend(crowd.object_reports(&report, &placed, &rules));
        crowd_reports.push(report);
    }
    check_seen(&targets, options.seen_by, &truth_path)?;
    Ok(Report {
        tracks: tracks_path,
        truth: truth_path,
        aligned,
        around,
        visible_over: options.visible_over,
        lost_beyond_m,
        from_s: options.from_s,
        to_s: options.to_s,
        seen_by: options.seen_by,
        time_tolerance_s: frames.tolerance_s,
        targets,
        crowds: crowd_reports,
        identities,
        targets_without_object: names_without(&tracks, |i| {
            in_crowd(i) || pairs.iter().any(|p| p.target == i)
        }),
        objects_without_target: names_without(&objects, |i| {
            of_crowd(i) || pairs.iter().any(|p| p.object == i)
        }),
    })
}

/// Positions by frame, in metres.
type Positions = Vec<Option<[f64; 3]>>;

/// The tracks and the objects of the truth, by frame.
struct Placed<'a> {
    tracks: &'a [Series<TrackRow>],
    objects: &'a [Series<TrueState>],
    track_rows: Vec<Vec<Option<&'a TrackRow>>>,
    object_rows: Vec<Vec<Option<&'a TrueState>>>,
    track_paths: Vec<Positions>,
    object_paths: Vec<Positions>,
}

impl<'a> Placed<'a> {
    fn of(
        tracks: &'a [Series<TrackRow>],
        objects: &'a [Series<TrueState>],
        frames: &Frames,
    ) -> Self {
        let track_rows: Vec<_> = tracks.iter().map(|t| frames.place(t)).collect();
        let object_rows: Vec<_> = objects.iter().map(|o| frames.place(o)).collect();
        Self {
            tracks,
            objects,
            track_paths: track_rows.iter().map(|rows| estimated_path(rows)).collect(),
            object_paths: object_rows.iter().map(|rows| true_path(rows)).collect(),
            track_rows,
            object_rows,
        }
    }
}

/// How tracks are evaluated.
struct Rules<'a> {
    options: &'a Options,
    summary: &'a RunSummary,
    settings: Settings,
    /// The frames that are.
    window: Range<usize>,
    frames_in_a_second: usize,
}

impl Rules<'_> {
    /// The diameter of a target, in metres.
    fn diameter_m(&self, target: &str) -> Option<f64> {
        let of_run = self.summary.targets.get(target);
        self.options
            .diameter_m
            .or(of_run.and_then(|t| t.diameter_m))
    }
}

/// Pairs those of these tracks with those of these objects.
fn pairs(
    placed: &Placed,
    [tracks, objects]: [Vec<usize>; 2],
    (tracks_path, truth_path): (&Path, &Path),
    options: &Options,
    lost_beyond_m: f64,
) -> Result<Vec<Pair>> {
    let mut pairs = pairing::pair(
        (
            tracks_path,
            &of(&names(placed.tracks), &tracks),
            &of(&placed.track_paths, &tracks),
        ),
        (
            truth_path,
            &of(&names(placed.objects), &objects),
            &of(&placed.object_paths, &objects),
        ),
        &options.map,
        lost_beyond_m,
    )?;
    for pair in &mut pairs {
        (pair.target, pair.object) = (tracks[pair.target], objects[pair.object]);
    }
    Ok(pairs)
}

/// Reports which target follows which object; `None` with fewer than two targets.
fn identities(placed: &Placed, pairs: &[Pair], rules: &Rules) -> Option<Identities> {
    let window = || rules.window.clone();
    let of_tracks = pairs
        .iter()
        .map(|p| &placed.track_paths[p.target][window()]);
    let of_objects = pairs
        .iter()
        .map(|p| &placed.object_paths[p.object][window()]);
    let (of_tracks, of_objects) = (
        of_tracks.collect::<Vec<_>>(),
        of_objects.collect::<Vec<_>>(),
    );
    let lost_beyond_m = rules.settings.lost_beyond_m;
    (pairs.len() > 1).then(|| pardalis_evaluate::identities(&of_tracks, &of_objects, lost_beyond_m))
}

/// Evaluates a target against its object.
fn target_report(placed: &Placed, pair: &Pair, rules: &Rules) -> TargetReport {
    let Rules {
        options, window, ..
    } = rules;
    let objects = placed.objects;
    let rows = || {
        let of_object = placed.object_rows[pair.object].iter().copied();
        placed.track_rows[pair.target]
            .iter()
            .copied()
            .zip(of_object)
    };
    let with_truth = rows().filter(|(r, t)| r.is_some() && t.is_some()).count();
    let window_rows = || rows().skip(window.start).take(window.len());
    let samples = samples(window_rows(), options);
    let track = &placed.tracks[pair.target];
    let diameter_m = rules.diameter_m(&track.name);
    let others: Vec<_> = (0..objects.len())
        .filter(|&o| o != pair.object && !objects[o].name.starts_with(pairing::OCCLUDER))
        .map(|o| &placed.object_paths[o][window.clone()])
        .collect();
    TargetReport {
        target: track.name.clone(),
        object: objects[pair.object].name.clone(),
        matched_by: pair.matched_by,
        rows: track.rows.len(),
        rows_without_truth: track.rows.len() - with_truth,
        changed_target: pardalis_evaluate::ends_on_another(
            &placed.track_paths[pair.target][window.clone()],
            &placed.object_paths[pair.object][window.clone()],
            &others,
        ),
        scores: pardalis_evaluate::evaluate(&samples, &rules.settings),
        states: diameter_m.and_then(|diameter_m| pardalis_evaluate::states(&samples, diameter_m)),
        samples,
        confidence: Confidence::of(window_rows(), options, diameter_m),
    }
}

/// Rejects a number of cameras that never see the targets together.
fn check_seen(targets: &[TargetReport], seen_by: Option<usize>, truth: &Path) -> Result<()> {
    match seen_by {
        Some(cameras) if targets.iter().all(|target| target.samples.is_empty()) => {
            Err(user_error!(
                "in no frame of {} do exactly {cameras} cameras see more than half of a tracked object; give another number of cameras",
                truth.shown()
            ))
        }
        _ => Ok(()),
    }
}

/// Reports whether the frame is to be evaluated according to the number of cameras that see the object.
fn has_required_cameras(truth: Option<&TrueState>, options: &Options) -> bool {
    let cameras = options.seen_by;
    cameras.is_none_or(|cameras| truth.and_then(|t| t.seeing_cameras) == Some(cameras))
}

/// Returns the evaluated frames, from rows of a track and of the truth.
fn samples<'a>(
    rows: impl Iterator<Item = (Option<&'a TrackRow>, Option<&'a TrueState>)>,
    options: &Options,
) -> Vec<Sample> {
    rows.filter(|(_, truth)| has_required_cameras(*truth, options))
        .filter_map(|(row, truth)| {
            Some(Sample {
                state: row.and_then(|row| row.state),
                estimate: row.and_then(|row| row.estimate),
                truth: *truth?,
            })
        })
        .collect()
}

/// Returns the origin of distance, elevation and azimuth.
fn around(options: &Options, summary: &RunSummary, summary_path: &Path) -> Result<Point> {
    match options.around {
        Some(position_m) => Ok(Point {
            position_m,
            source: "--around".to_owned(),
        }),
        None => summary.first_camera(summary_path),
    }
}

/// Returns the evaluated frames; `None` if there are none.
fn window(options: &Options, frames: &Frames) -> Option<Range<usize>> {
    let from_s = options.from_s.unwrap_or(f64::NEG_INFINITY);
    let window = frames.between(from_s, options.to_s.unwrap_or(f64::INFINITY));
    (!window.is_empty()).then_some(window)
}

/// Returns the error that no row of the tracks is at a time of the truth.
fn other_clock<T, O>(
    (tracks_path, tracks): (&Path, &[Series<T>]),
    (truth_path, objects): (&Path, &[Series<O>]),
    tolerance_s: f64,
) -> anyhow::Error {
    user_error!(
        "no row of {} (times {}) has a row of {} (times {}) within {tolerance_s} s; both must use the same clock",
        tracks_path.shown(),
        time_range(tracks),
        truth_path.shown(),
        time_range(objects)
    )
}

/// Returns the file of that name in a folder, or the path itself if it is a file.
fn file_in(path: &Path, name: &str) -> PathBuf {
    if path.is_dir() {
        path.join(name)
    } else {
        path.to_owned()
    }
}

/// Returns those of these numbers.
fn of<T: Clone>(all: &[T], numbers: &[usize]) -> Vec<T> {
    numbers.iter().map(|&number| all[number].clone()).collect()
}

/// Returns the names in the order of the file.
fn names<T>(series: &[Series<T>]) -> Vec<&str> {
    series.iter().map(|s| s.name.as_str()).collect()
}

/// Returns the names whose index is not used.
fn names_without<T>(series: &[Series<T>], is_used: impl Fn(usize) -> bool) -> Vec<String> {
    let unused = (0..series.len()).filter(|&i| !is_used(i));
    unused.map(|i| series[i].name.clone()).collect()
}

/// Returns first and last time, for error messages.
fn time_range<T>(series: &[Series<T>]) -> String {
    let times = || series.iter().flat_map(|s| s.rows.iter().map(|row| row.0));
    let first_s = times().fold(f64::INFINITY, f64::min);
    let last_s = times().fold(f64::NEG_INFINITY, f64::max);
    format!("{first_s} to {last_s} s")
}

/// Returns the estimated positions by frame.
fn estimated_path(rows: &[Option<&TrackRow>]) -> Vec<Option<[f64; 3]>> {
    let estimates = rows.iter().map(|row| (*row)?.estimate);
    estimates.map(|e| Some(e?.position_m)).collect()
}

/// Returns the true positions by frame.
fn true_path(rows: &[Option<&TrueState>]) -> Vec<Option<[f64; 3]>> {
    rows.iter().map(|row| Some((*row)?.position_m)).collect()
}

/// What to do about a summary.json that cannot be read.
const SUMMARY_REMEDY: &str = "give another file, or remove it and give --around X,Y,Z";

/// The relevant part of summary.json.
#[derive(Default, serde::Deserialize)]
pub(crate) struct RunSummary {
    #[serde(default)]
    cameras: BTreeMap<String, Value>,
    #[serde(default)]
    targets: BTreeMap<String, TargetSummary>,
}

/// The part of it about a target.
#[derive(serde::Deserialize)]
struct TargetSummary {
    /// `None` if the program that wrote it omitted it.
    diameter_m: Option<f64>,
    /// Only of crowds.
    members: Option<Value>,
}

impl RunSummary {
    /// Reads the file; a missing file yields an empty summary.
    fn read(path: &Path) -> Result<Self> {
        if !path.exists() {
            return Ok(Self::default());
        }
        let text = read_text(path).map_err(|error| error.context(SUMMARY_REMEDY))?;
        Self::parse(path, &text)
    }

    /// Parses the file's text. Errors name `path`.
    pub(crate) fn parse(path: &Path, text: &str) -> Result<Self> {
        serde_json::from_str(text)
            .map_err(|error| user_error!("{}: {error}; {SUMMARY_REMEDY}", path.shown()))
    }

    /// Returns three diameters of the largest target, if the diameter of one is known.
    fn lost_beyond_m(&self) -> Option<f64> {
        let diameters_m = self.targets.values().filter_map(|target| target.diameter_m);
        diameters_m
            .reduce(f64::max)
            .map(|diameter_m| 3.0 * diameter_m)
    }

    /// Returns the position of the first camera that has one, or the world's origin.
    pub(crate) fn first_camera(&self, path: &Path) -> Result<Point> {
        let mut cameras = self.cameras.iter();
        let Some((name, position)) =
            cameras.find_map(|(name, camera)| Some((name, camera.get("position_m")?)))
        else {
            return Ok(Point {
                position_m: [0.0; 3],
                source: "the world's origin".to_owned(),
            });
        };
        let position_m = <[f64; 3]>::deserialize(position).map_err(|_| {
            user_error!(
                "{}: cameras.{name}.position_m is {position}; allowed: an array of three numbers; or give --around X,Y,Z",
                path.shown()
            )
        })?;
        Ok(Point {
            position_m,
            source: format!("camera {name} of {}", path.shown()),
        })
    }
}

/// Parses `TARGET=OBJECT`.
fn name_pair(text: &str) -> Result<(String, String), String> {
    match text.split_once('=') {
        Some((target, object)) if !target.is_empty() && !object.is_empty() => {
            Ok((target.to_owned(), object.to_owned()))
        }
        _ => Err("allowed: TARGET=OBJECT, such as ball=ball1".to_owned()),
    }
}

/// Parses `X,Y,Z`.
fn point(text: &str) -> Result<[f64; 3], String> {
    let numbers: Option<Vec<f64>> = text.split(',').map(|c| finite(c).ok()).collect();
    numbers
        .and_then(|n| n.try_into().ok())
        .ok_or_else(|| "allowed: three numbers in metres, such as 0,0,0.9".to_owned())
}

/// Parses a share below 1.
fn share(text: &str) -> Result<f64, String> {
    let number = finite(text)?;
    if (0.0..1.0).contains(&number) {
        Ok(number)
    } else {
        Err("allowed: 0 up to, but not including, 1".to_owned())
    }
}

/// Parses a positive length.
fn length(text: &str) -> Result<f64, String> {
    let number = finite(text)?;
    if number > 0.0 {
        Ok(number)
    } else {
        Err("allowed: more than 0".to_owned())
    }
}

/// Parses a finite number.
fn finite(text: &str) -> Result<f64, String> {
    let number = text.trim().parse().ok();
    number
        .filter(|n: &f64| n.is_finite())
        .ok_or_else(|| "allowed: a finite number".to_owned())
}
