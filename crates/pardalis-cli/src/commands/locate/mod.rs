//! `pardalis locate`: locates targets in single images, without dynamics.

mod starts;

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use anyhow::Result;
use pardalis::shape::Stance;
use pardalis::tracker::{PASSES_SIGMA_M, TrackState, Verdict, check_passes};
use pardalis::{Estimate, TargetId, Tracker};
use pardalis_scene::{FrameRange, Scene, TargetConfig};

use crate::arguments::Threads;
use crate::interrupt::Stop;
use crate::numbers::fixed;
use crate::output::{Shown, print};
use crate::scene;
use crate::sight::Sight;
use crate::source::decode::media_kind;
use crate::tracking::{
    self, Annotate, FrameSet, Limit, Options, Output, Previous, Run, Tracked, missed,
};
use crate::user_error::user_error;
use starts::Starts;
pub(crate) use starts::StartsFrom;
pub(crate) use starts::parse_pixel;

/// Locates the targets of a scene in single images
///
/// Each image is processed independently: no time passes between images, and nothing moves. In each pass,
/// particles are drawn around the start, weighted and resampled, with decreasing spread, around the mean of
/// the previous pass; the mean of the last pass is the result. If the start is a pixel, its ray is searched
/// first, down to the ground. Writes into a folder: tracks.csv (one row per image and target, without
/// velocities) and summary.json.
///
/// Targets that are detected need no start, and a start does not guide their detection: if one is given, the line about
/// the image says if the target was found farther from it than its diameter. If it was not found, the line says what ruled out the thing at that place.
///
/// For each image it prints the position with its standard deviations and the confidence, or why a target was not found
/// (docs/not-found.md).
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  pardalis locate ball.toml                          the scene's images, each from the scene's start
  pardalis locate ball.toml a.jpg b.jpg --at 412,96  these images, the ball near that pixel
  pardalis locate ball.toml --starts data/catadioptric-static/truth.csv
  pardalis locate ball.toml --clicks clicks.csv --annotate -o located")]
pub(crate) struct Arguments {
    /// The scene file with the camera, target and start
    #[arg(value_name = "SCENE.toml")]
    scene: PathBuf,
    /// Images to use instead of the scene's, for scenes with one camera
    #[arg(value_name = "IMAGE")]
    images: Vec<PathBuf>,
    #[command(flatten)]
    starts: StartOptions,
    /// Standard deviation in each pass of the particles' positions around the start, in metres
    #[arg(long, value_name = "SIGMA,...", value_delimiter = ',', default_values_t = PASSES_SIGMA_M)]
    passes_m: Vec<f64>,
    /// The folder for the results, or - to print only the rows on standard output [default: the scene's name
    /// with -located]
    #[arg(short, long, value_name = "FOLDER|-")]
    output: Option<PathBuf>,
    /// Overrides the scene's seed
    #[arg(long)]
    seed: Option<u32>,
    #[command(flatten)]
    threads: Threads,
    /// Also writes every image with contours and particles drawn on it
    #[arg(long)]
    annotate: bool,
}

/// Where the targets are searched for, instead of at the scene's start.
#[derive(Debug, clap::Args)]
struct StartOptions {
    /// A pixel near the centre of the target, the same in all images
    #[arg(long, value_name = "U,V", value_parser = parse_pixel, allow_hyphen_values = true, conflicts_with_all = ["starts", "clicks"])]
    at: Option<[f64; 2]>,
    /// A table with a rough position for each image: columns frame,x_m,y_m,z_m, as in truth.csv
    ///
    /// Frames are indices, from 0, of the images in the scene's folder or on the command line.
    #[arg(long, value_name = "FILE.csv", conflicts_with = "clicks")]
    starts: Option<PathBuf>,
    /// A table with a pixel near the centre of the target for each image: columns frame,u_px,v_px, and camera
    /// if there are several
    #[arg(long, value_name = "FILE.csv")]
    clicks: Option<PathBuf>,
    /// The object whose rows to use if the table's column `object` has several names [default: the target's
    /// name]
    #[arg(long, value_name = "NAME")]
    object: Option<String>,
}

impl StartOptions {
    fn from(&self) -> Result<StartsFrom> {
        let object = self.object.clone();
        let from = match (&self.at, &self.starts, &self.clicks) {
            (Some(pixel), ..) => StartsFrom::Pixel(*pixel),
            (_, Some(file), _) => return Ok(StartsFrom::Positions(file.clone(), object)),
            (.., Some(file)) => return Ok(StartsFrom::Clicks(file.clone(), object)),
            _ => StartsFrom::Scene,
        };
        match object {
            None => Ok(from),
            Some(name) => Err(user_error!(
                "--object {name}: selects the rows of a table; give --starts or --clicks as well"
            )),
        }
    }
}

/// What to locate, and where to start.
#[derive(Debug, Clone)]
pub(crate) struct Settings {
    /// Images to use instead of the scene's; empty for the scene's own.
    pub(crate) stills: Vec<PathBuf>,
    /// Where the targets are searched for.
    pub(crate) starts: StartsFrom,
    /// Standard deviation around the start in each pass, in metres.
    pub(crate) passes_m: Vec<f64>,
}

/// Runs the command.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let output = match &arguments.output {
        Some(path) if path.as_os_str() == "-" => Output::Stdout,
        Some(folder) => Output::Folder(folder.clone()),
        None => {
            let stem = arguments.scene.file_stem().unwrap_or_default();
            Output::Folder(PathBuf::from(format!("{}-located", stem.to_string_lossy())))
        }
    };
    let to_stdout = output == Output::Stdout;
    let options = Options {
        output,
        seed: arguments.seed,
        threads: arguments.threads,
        annotate: if arguments.annotate {
            Annotate::Frame
        } else {
            Annotate::No
        },
        explain: false,
        particles: None,
        mcap: None,
        send: Vec::new(),
        smooth: false,
        plots: false,
        report: false,
        progress: true,
        previous: Previous::Keep,
        limit: Limit::default(),
        stop: Stop::default(),
        watch: None,
    };
    let settings = Settings {
        stills: arguments.images.clone(),
        starts: arguments.starts.from()?,
        passes_m: arguments.passes_m.clone(),
    };
    let is_video = |path: &&PathBuf| media_kind(path) == Some("video");
    if let Some(video) = arguments.images.iter().find(is_video) {
        let name = video.shown();
        return Err(user_error!(
            "{name}: is a video, not an image; leave it out if the scene names it, or write its frames to images: ffmpeg -i {name} %06d.png"
        ));
    }
    let scene = scene::read(&arguments.scene)?;
    let (run, report) = locate(&arguments.scene, scene, &options, &settings)?;
    if !to_stdout {
        print(report.trim_end());
        for file in &run.files {
            print(format!("  {}", file.shown()));
        }
    }
    Ok(())
}

/// Locates the targets of a scene, read from the file at `scene_path`, in every image independently. Writes
/// results as [`tracking::run`] does, and returns a printable line about each image as well.
pub(crate) fn locate(
    scene_path: &Path,
    mut scene: Scene,
    options: &Options,
    settings: &Settings,
) -> Result<(Run, String)> {
    check_passes(&settings.passes_m).map_err(|error| user_error!("--passes-m: {error}"))?;
    let starts = Starts::read(&settings.starts, &scene, scene_path)?;
    scene
        .resolved
        .insert("locate".to_owned(), settings.written().into());
    let targets = scene.targets.clone();
    // The tables of starts index all images of the folder.
    let range = if settings.stills.is_empty() {
        scene.cameras[0].frames
    } else {
        FrameRange::ALL
    };
    let mut open = scene::open(scene_path, scene, options.seed, &settings.stills)?;
    let detections = std::mem::take(&mut open.detections);
    // Before results of an earlier run are touched.
    for frame in starts.frames(&open, range, !settings.stills.is_empty()) {
        starts.check(&open.tracker, frame)?;
    }
    let mut report = String::new();
    let mut step = |tracker: &mut Tracker, set: &FrameSet| {
        let frame = range.first + range.step * set.index;
        let starts_here = starts.of_frame(tracker, frame)?;
        let located = set
            .whole(&detections)
            .and_then(|set| tracker.locate(&set, &starts_here, &settings.passes_m));
        let estimates =
            located.map_err(|error| user_error!("{}: {error}", starts.source_of_frame(frame)))?;
        let mut tracked = Vec::new();
        for (number, (target, estimate)) in targets.iter().zip(&estimates).enumerate() {
            if target.crowd.is_some() && estimate.state == TrackState::Tracking {
                tracked.extend(members(tracker, number, set.time_s)?);
            } else {
                tracked.push(Tracked::target(number, estimate));
            }
        }
        for located in &tracked {
            let (number, estimate) = (located.target, &located.estimate);
            let (target, name) = (&targets[number], located.name(&targets));
            let id = TargetId::new(number);
            let click = starts.click(number, frame);
            let reason = match click {
                Some(click) => missed::reason_at(tracker, (id, missed::is_boxed(target)), click)?,
                None => missed::reasons(tracker, id)?.first().copied(),
            };
            let far = estimate.kinematics.and_then(|found| {
                starts.far_from(tracker, (number, target), frame, found.position_m)
            });
            let reason = (reason, click.is_some(), missed::is_boxed(target));
            let line = line(estimate, reason, seen(tracker, target, estimate));
            let far = far.map(|far| format!("; {far}")).unwrap_or_default();
            let _ = writeln!(report, "frame {}: {} {line}{far}", set.index, name);
        }
        Ok(tracked)
    };
    let run = tracking::run_steps(scene_path, open, options, &mut step)?;
    Ok((run, report))
}

/// Returns the members of a crowd that were located, without velocities.
fn members(tracker: &Tracker, number: usize, time_s: f64) -> Result<impl Iterator<Item = Tracked>> {
    let members = tracker.members_at(TargetId::new(number), time_s)?;
    Ok(members.map(move |member| {
        let mut tracked = Tracked::member(number, &member);
        if let Some(known) = &mut tracked.estimate.kinematics {
            known.velocity_mps = None;
        }
        tracked
    }))
}

/// Returns how the only camera shows a target of a single body that was found.
fn seen(tracker: &Tracker, target: &TargetConfig, estimate: &Estimate) -> Option<Sight> {
    let ([view], [body]) = (tracker.views(), &target.bodies[..]) else {
        return None;
    };
    let position_m = estimate.kinematics?.position_m;
    let stance = Stance {
        yaw_rad: estimate.heading_rad.unwrap_or(0.0),
        ..Stance::default()
    };
    Sight::of(view, &body.shape, position_m, stance)
}

/// Says where a target is in one image, or what ruled out a candidate if there is one: that at the click, or that which came nearest to being the target.
fn line(
    estimate: &Estimate,
    (reason, is_at_click, is_boxed): (Option<Verdict>, bool, bool),
    seen: Option<Sight>,
) -> String {
    match (&estimate.kinematics, reason) {
        (Some(found), _) => {
            let [x, y, z] = found.position_m.map(|c| fixed(c, 3));
            let sigma_mm = [0, 3, 5].map(|i| 1e3 * found.covariance_m2[i].sqrt());
            let mut line = format!(
                "at {x}, {y}, {z} m ± {:.0}, {:.0}, {:.0} mm, confidence {:.2}",
                sigma_mm[0], sigma_mm[1], sigma_mm[2], estimate.confidence
            );
            if let Some(seen) = seen {
                let ([u, v], radius) = (seen.pixel.map(|c| fixed(c, 0)), fixed(seen.radius_px, 0));
                let distance = fixed(seen.distance_m, 2);
                let _ = write!(
                    line,
                    "; seen at {u}, {v} px, radius {radius} px, {distance} m from the camera"
                );
            }
            line
        }
        (None, Some(Verdict::NoColors)) if is_at_click => {
            "not found: nothing at the click has its colours (no-colors)".to_owned()
        }
        (None, Some(reason)) => {
            let at_click = if is_at_click { "at the click, " } else { "" };
            format!(
                "not found: {at_click}{} ({})",
                missed::what(reason, is_boxed),
                reason.name()
            )
        }
        (None, None) if is_boxed => "not found: no box in the image".to_owned(),
        (None, None) => {
            let state = estimate.state.name();
            format!("not visible around the start ({state})")
        }
    }
}

impl Settings {
    /// Formats the settings for the summary.
    fn written(&self) -> toml::Table {
        let (from, what) = self.starts.written();
        let passes: Vec<toml::Value> = self.passes_m.iter().map(|&m| m.into()).collect();
        [("passes_m", toml::Value::Array(passes)), (from, what)]
            .into_iter()
            .map(|(key, value)| (key.to_owned(), value))
            .collect()
    }
}
