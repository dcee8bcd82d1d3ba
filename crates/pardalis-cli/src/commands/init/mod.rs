//! `pardalis init`: writes a commented scene file as a starting point.

mod mcap;
pub(crate) mod sequence;
pub(crate) mod text;

use std::fs;
use std::path::{Component, Path, PathBuf};

use anyhow::Result;
use clap::ValueEnum;
use pardalis_camera::CalibratedCamera;
use pardalis_camera::formats::Lens;
use pardalis_scene::{FrameRange, NAMES_ALLOWED, Scene, VideoInput, is_name};

use crate::commands::camera::load::lens;
use crate::files::write_file;
use crate::focal_length::{exif_fov_deg, parse_fov_deg};
use crate::output::{Shown, in_line, print, warn};
use crate::scene_files::{read_calibration, read_text};
use crate::shell_word::shell_word;
use crate::source::decode::media_kind;
use crate::source::{Source, SourceConfig, SourceKind, Timing};
use crate::user_error::user_error;
use sequence::Recording;
use text::{Calibration, CameraText, SceneText};

/// Writes a commented scene file as a starting point
///
/// The input is a folder of images, a sequence folder (frames/ and camera.json or cameras.json), a video, a single image, or an MCAP recording.
/// Values that cannot be derived from it are guessed and marked CHANGE; `track` warns while they remain. For a live camera,
/// record a clip, and put the device in its place in the scene (docs/cameras-live.md).
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  pardalis init images --fps 25 --camera equidistant        a folder of images from a fisheye camera
  pardalis init images --fps 25 --camera pinhole            images from a webcam or a phone
  pardalis init ride.mp4 --fov 65 -o ride.toml              a video; the angle of view is 65 degrees (needs ffmpeg)
  pardalis init ride.mp4 --camera photo.jpg                 a focal length from the EXIF data of a photo by this camera
  pardalis init ride.mcap                                   every camera of a recording, with its calibration
  pardalis init photo.jpg -o photo.toml                     a single image, for pardalis locate
  pardalis init images --fps 25 --camera lens/camera.toml   with a calibration by this or another program
  pardalis init data/dioptric-jump                          a sequence folder, which contains all this")]
pub(crate) struct Arguments {
    /// A folder of images, a sequence folder, a video file, an image, or an MCAP recording
    input: PathBuf,
    /// The scene file to write
    #[arg(short, long, value_name = "SCENE.toml", default_value = "scene.toml")]
    output: PathBuf,
    /// The camera: a model (equidistant, pinhole, unified or perspective_mirror, with parameters guessed from
    /// the image size), or a calibration file of any format, which the scene then refers to; if the file has
    /// several cameras, the input must have a folder named after each; or a JPEG image by the same camera, for
    /// a pinhole camera with the focal length in its EXIF data [default: camera.json or cameras.json
    /// of a sequence folder, else pinhole]
    #[arg(long, value_name = "MODEL|FILE")]
    camera: Option<String>,
    /// The angle of view across the longer side of the image; selects a pinhole camera. docs/calibration.md says how to
    /// measure it with a tape measure [default for pinhole: from the EXIF data of the images, else 60, marked CHANGE]
    #[arg(long = "fov", value_name = "DEGREES", value_parser = parse_fov_deg, allow_negative_numbers = true)]
    fov_deg: Option<f64>,
    /// The lens model of the calibration's coefficients, if the file does not state it
    #[arg(long = "as", value_name = "LENS", value_parser = lens(), requires = "camera")]
    lens: Option<Lens>,
    /// Frames per second of a folder of images without times.csv
    #[arg(long, value_parser = frames_per_second, allow_negative_numbers = true)]
    fps: Option<f64>,
    /// The target's colour model, as written by `pardalis learn` [default: the target's name with .colors.toml]
    #[arg(long, value_name = "FILE")]
    colors: Option<PathBuf>,
    /// The target's name
    #[arg(long, value_parser = target_name, default_value = "ball")]
    target: String,
    /// The ball's radius in metres [default: from camera.json, else 0.11, marked CHANGE]
    #[arg(long, value_parser = positive_m, allow_negative_numbers = true)]
    radius_m: Option<f64>,
    /// Starts the target from a pixel near its centre in the first frame (of the first camera, if there are
    /// several) and tracks it with the published contour cue [default: the target is detected automatically]
    #[arg(long, value_name = "X,Y", value_parser = pixel, allow_hyphen_values = true)]
    pixel: Option<[f64; 2]>,
    /// Replaces an existing scene file
    #[arg(long)]
    force: bool,
}

/// Larger and smaller balls, in metres, are probably given in another unit.
const LIKELY_RADIUS_M: std::ops::RangeInclusive<f64> = 0.002..=2.0;
/// Wider images, in degrees, are hardly those of a pinhole camera.
const WIDEST_PINHOLE_DEG: f64 = 120.0;

impl Arguments {
    /// Returns the arguments for an input and a scene file, and otherwise the defaults.
    #[cfg(feature = "studio")]
    pub(crate) fn of(input: PathBuf, output: PathBuf, fps: Option<f64>) -> Self {
        Self {
            input,
            output,
            camera: None,
            fov_deg: None,
            lens: None,
            fps,
            colors: None,
            target: String::new(),
            radius_m: None,
            pixel: None,
            force: false,
        }
    }

    /// Returns warnings of values that are possible but probably mistaken.
    fn unlikely(&self) -> Vec<String> {
        let mut warnings = Vec::new();
        if let Some(radius_m) = self.radius_m
            && !LIKELY_RADIUS_M.contains(&radius_m)
        {
            warnings.push(format!(
                "--radius-m: a ball with a radius of {radius_m} m? --radius-m is in metres: 0.035 for 35 mm"
            ));
        }
        if let Some(fov_deg) = self.fov_deg
            && fov_deg > WIDEST_PINHOLE_DEG
        {
            warnings.push(format!(
                "--fov: {fov_deg} degrees are hardly those of a pinhole camera; for a fisheye lens use --camera equidistant"
            ));
        }
        warnings
    }
}

/// Camera models that `--camera` accepts by name.
#[derive(Debug, Clone, Copy, ValueEnum)]
#[value(rename_all = "snake_case")]
pub(crate) enum Model {
    Equidistant,
    Pinhole,
    Unified,
    PerspectiveMirror,
}

/// Runs the command.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let output = &arguments.output;
    let default_colors = || PathBuf::from(format!("{}.colors.toml", arguments.target));
    let colors = arguments.colors.clone().unwrap_or_else(default_colors);
    let is_single = is_single_image(&arguments.input);
    if colors.is_dir() {
        return Err(user_error!(
            "--colors: {} is a folder; give the file that `pardalis learn` wrote",
            colors.shown()
        ));
    }
    let (cameras, radius_m) = cameras(arguments)?;
    let scene = SceneText {
        cameras,
        target: &arguments.target,
        colors: shown_path(&colors, output),
        radius_m,
        pixel: arguments.pixel,
    };
    scene.check_pixel()?;
    // After the input, which no other name of the scene mends.
    if output.exists() && !arguments.force {
        return Err(user_error!(
            "{}: already exists; choose another file with -o, or replace it with --force",
            output.shown()
        ));
    }
    let text = scene.text();
    let folder = output.parent().unwrap_or(Path::new(""));
    let checked = Scene::parse(&text, &|file, lens| read_calibration(folder, file, lens));
    if let Err(problems) = checked {
        let problems: Vec<String> = problems.iter().map(ToString::to_string).collect();
        return Err(user_error!(
            "the scene would not be valid: {}",
            problems.join("; ")
        ));
    }
    write_file(output, text.as_bytes())?;
    arguments.unlikely().into_iter().for_each(warn);
    print(output.shown());
    let to_change = text::guesses(&text).len();
    if to_change > 0 {
        print(format!(
            "  replace the guesses in the lines marked CHANGE ({to_change})"
        ));
    }
    print("next:");
    if !colors.exists() {
        print(format!(
            "  pardalis learn … -o {}    (how: pardalis learn --help)",
            shell_word(&colors)
        ));
    }
    print(format!("  pardalis check {}", shell_word(output)));
    let command = if is_single { "locate" } else { "track" };
    print(format!("  pardalis {command} {}", shell_word(output)));
    Ok(())
}

/// Returns the tables of the cameras of the input, and the radius of the ball in metres if it is known.
pub(crate) fn cameras(arguments: &Arguments) -> Result<(Vec<CameraText>, Option<f64>)> {
    let output = &arguments.output;
    let mut cameras = Vec::new();
    let mut radius_m = arguments.radius_m;
    match known_cameras(arguments)? {
        _ if media_kind(&arguments.input) == Some("recording") => {
            cameras = mcap::cameras(arguments)?;
        }
        KnownCameras::Calibration {
            file,
            cameras: known,
        } => {
            let recording = Recording::of(&read_text(&file)?);
            radius_m = radius_m.or(recording.ball_radius_m);
            for camera in &known {
                let of_several = (known.len() > 1).then_some(&*camera.name);
                let input = frames_of(&arguments.input, of_several);
                if of_several.is_some() && !input.exists() {
                    return Err(user_error!(
                        "{}: no such folder; {} has {} cameras, and each needs a folder of its name; extract one camera with \
                         pardalis camera convert --camera NAME",
                        input.shown(),
                        file.shown(),
                        known.len()
                    ));
                }
                let opened = open(&input, arguments.fps)?;
                check_size(&file, camera, opened.size)?;
                let shown = shown_path(&input, output);
                let fps = arguments.fps.or(recording.fps);
                let calibration = Calibration {
                    file: shown_path(&file, output),
                    camera: None,
                    lens: arguments.lens,
                };
                cameras.push(CameraText::known(camera, calibration, &opened, &shown, fps));
            }
        }
        KnownCameras::Model(model, mut fov) => {
            let input = frames_of(&arguments.input, None);
            let opened = open(&input, arguments.fps)?;
            if matches!((model, &fov), (Model::Pinhole, Fov::Unknown))
                && !matches!(opened.input, Input::Video)
            {
                fov = fov_of_images(&input)?;
            }
            let shown = shown_path(&input, output);
            let fps = arguments.fps;
            cameras.push(CameraText::guessed(model, &fov, &opened, &shown, fps));
        }
    }
    Ok((cameras, radius_m))
}

/// Properties of a frame source.
pub(crate) struct Opened {
    pub(crate) size: (usize, usize),
    pub(crate) input: Input,
}

/// Where frames come from.
pub(crate) enum Input {
    Video,
    SingleImage,
    /// A folder of images, with or without their times.
    Images {
        has_times: bool,
    },
    /// A topic of an MCAP recording.
    Mcap {
        topic: String,
    },
}

/// Opens the input once, so that errors show now.
fn open(input: &Path, fps: Option<f64>) -> Result<Opened> {
    let is_single = is_single_image(input);
    let is_video = !input.is_dir() && !is_single;
    let has_times = input.join("times.csv").is_file();
    let name = input.shown();
    if name == "-" || name.contains("://") {
        let source = if name == "-" { "pipe:0" } else { &name };
        return Err(user_error!(
            "{name}: init needs recorded images; record a clip, for example with `ffmpeg -i {source} -t 20 -c copy clip.mkv`, run \
             pardalis init clip.mkv, and then give video = \"{name}\" in the scene, with input.format = \"mpjpeg\" if it is a camera that sends \
             single JPEG images (docs/cameras-live.md); or use the studio (docs/studio.md)"
        ));
    }
    if !input.exists() {
        return Err(user_error!(
            "{name}: no such file or folder; check the name"
        ));
    }
    if fps.is_some() && (is_video || is_single || has_times) {
        let why = if is_video {
            "a video carries its own time stamps"
        } else if is_single {
            "a single image has no frame rate"
        } else {
            "times.csv gives the time stamps"
        };
        return Err(user_error!("--fps: {why}; leave it out"));
    }
    let kind = if is_video {
        SourceKind::Video {
            video: VideoInput::of_path(&input.to_string_lossy()),
            encoding: None,
        }
    } else {
        let timing = if has_times {
            Timing::TimesFile
        } else {
            Timing::Fps(fps.unwrap_or(text::GUESSED_FPS))
        };
        SourceKind::Images {
            folder: input.to_owned(),
            timing,
        }
    };
    let config = SourceConfig {
        kind,
        time_offset_s: 0.0,
        frames: FrameRange::ALL,
    };
    let size = Source::open(&config)?.size();
    Ok(Opened {
        size,
        input: match (is_video, is_single) {
            (true, _) => Input::Video,
            (_, true) => Input::SingleImage,
            _ => Input::Images { has_times },
        },
    })
}

/// What is known about the cameras.
enum KnownCameras {
    /// Calibrated cameras of a file.
    Calibration {
        file: PathBuf,
        cameras: Vec<CalibratedCamera>,
    },
    /// Only the model of a single camera, and perhaps the angle of a pinhole camera.
    Model(Model, Fov),
}

/// The angle of view of a pinhole camera across the longer side of its images, in degrees.
pub(crate) enum Fov {
    /// Given on the command line.
    Given(f64),
    /// From the EXIF data of the image of this name.
    Exif(f64, String),
    Unknown,
}

/// Interprets `--camera` and `--fov`; without them, uses the calibration next to the frames, or else a pinhole camera, as webcams and phones are.
fn known_cameras(arguments: &Arguments) -> Result<KnownCameras> {
    let name = arguments.camera.as_deref();
    let model = name.and_then(|name| Model::from_str(name, false).ok());
    let image = name.map(Path::new).filter(|path| is_image(path));
    if let (Some(_), Some(name)) = (arguments.lens, name)
        && (model.is_some() || image.is_some())
    {
        return Err(user_error!(
            "--as: applies to calibration files only; remove it with --camera {name}"
        ));
    }
    if let Some(fov_deg) = arguments.fov_deg {
        return match (name, model) {
            (None, _) | (_, Some(Model::Pinhole)) => {
                Ok(KnownCameras::Model(Model::Pinhole, Fov::Given(fov_deg)))
            }
            (Some(name), _) => Err(user_error!(
                "--fov: applies to a pinhole camera of which nothing else is known; remove it with --camera {name}"
            )),
        };
    }
    if let Some(model) = model {
        return Ok(KnownCameras::Model(model, Fov::Unknown));
    }
    if let Some(image) = image {
        return match exif_fov_deg(image)? {
            Some(fov_deg) => {
                let fov = Fov::Exif(fov_deg, file_name(image));
                Ok(KnownCameras::Model(Model::Pinhole, fov))
            }
            None => Err(user_error!(
                "--camera {}: its EXIF data state no focal length; give the angle of view with --fov DEGREES, or --camera pinhole for a \
                 typical one",
                image.shown()
            )),
        };
    }
    let file = if let Some(name) = name {
        PathBuf::from(name)
    } else {
        let beside = ["camera.json", "cameras.json"].map(|name| arguments.input.join(name));
        match beside.into_iter().find(|path| path.is_file()) {
            Some(path) => path,
            None => return Ok(KnownCameras::Model(Model::Pinhole, Fov::Unknown)),
        }
    };
    if !file.exists() {
        return Err(user_error!(
            "--camera {}: there is no such file, and it is no model; give a calibration file, or one of the models pinhole, equidistant (fisheye lenses), \
             unified and perspective_mirror",
            file.shown()
        ));
    }
    let cameras = read_calibration(Path::new(""), &file.to_string_lossy(), arguments.lens)
        .map_err(|message| user_error!("{message}"))?;
    Ok(KnownCameras::Calibration { file, cameras })
}

/// Returns the angle of view that the first image of a folder, or a single image, states, if it does.
fn fov_of_images(folder: &Path) -> Result<Fov> {
    if folder.is_file() {
        // A broken image was reported when it was opened.
        let stated = exif_fov_deg(folder).ok().flatten();
        return Ok(stated.map_or(Fov::Unknown, |fov_deg| {
            Fov::Exif(fov_deg, file_name(folder))
        }));
    }
    let unreadable = |error| user_error!("{}: cannot be read: {error}", folder.shown());
    let entries = fs::read_dir(folder).map_err(unreadable)?;
    let paths = entries.map(|entry| Ok(entry?.path()));
    let paths = paths.collect::<std::io::Result<Vec<PathBuf>>>();
    let is_shown = |path: &PathBuf| is_image(path) && !file_name(path).starts_with('.');
    let first = paths
        .map_err(unreadable)?
        .into_iter()
        .filter(is_shown)
        .min();
    // A broken image is reported when it is tracked.
    let stated = first.and_then(|first| Some((exif_fov_deg(&first).ok()??, file_name(&first))));
    Ok(stated.map_or(Fov::Unknown, |(fov_deg, name)| Fov::Exif(fov_deg, name)))
}

/// Returns the name of a file without its folder.
fn file_name(path: &Path) -> String {
    let name = path.file_name().unwrap_or_default();
    in_line(&name.to_string_lossy())
}

/// Errors: the calibration is for images of another size.
pub(crate) fn check_size(
    file: &Path,
    camera: &CalibratedCamera,
    found: (usize, usize),
) -> Result<()> {
    match camera.size_px {
        Some(stated) if stated != found => Err(user_error!(
            "{}: {}: the calibration is for {} x {} pixels, the images are {} x {}",
            file.shown(),
            // The name of those in files that have none.
            if camera.name == "camera" {
                "its camera".to_owned()
            } else {
                format!("camera {}", camera.name)
            },
            stated.0,
            stated.1,
            found.0,
            found.1
        )),
        _ => Ok(()),
    }
}

/// Reports whether the input is one image.
fn is_single_image(input: &Path) -> bool {
    input.is_file() && is_image(input)
}

/// Reports whether the name is that of a still image, which ffmpeg would open as a video of one frame.
fn is_image(path: &Path) -> bool {
    let ending = path.extension().unwrap_or_default().to_ascii_lowercase();
    ["jpg", "jpeg", "png"].iter().any(|image| ending == *image)
}

/// Returns the folder of images: the input itself or its folder `frames`, and within it the folder of the
/// camera if there are several.
fn frames_of(input: &Path, camera: Option<&str>) -> PathBuf {
    let frames = input.join("frames");
    let base = if frames.is_dir() {
        frames
    } else {
        input.to_owned()
    };
    match camera {
        Some(name) => base.join(name),
        None => base,
    }
}

/// Returns a path as written in the scene `output`, which need not exist: relative to the scene's folder, so that both can be moved
/// together; absolute only if they have no root in common, such as on two drives of Windows.
pub(crate) fn shown_path(input: &Path, output: &Path) -> String {
    let parent = output
        .parent()
        .filter(|p| !p.as_os_str().is_empty())
        .unwrap_or(Path::new("."));
    let (input, parent) = (canonical(input), canonical(parent));
    let common: PathBuf = input
        .components()
        .zip(parent.components())
        .take_while(|(a, b)| a == b)
        .map(|(component, _)| component)
        .collect();
    let shown = match (input.strip_prefix(&common), parent.strip_prefix(&common)) {
        (Ok(below), Ok(up)) if common.has_root() => {
            let ups = up.components().map(|_| Component::ParentDir);
            ups.chain(below.components()).collect()
        }
        _ => input,
    };
    if shown.as_os_str().is_empty() {
        ".".to_owned()
    } else {
        shown.to_string_lossy().into_owned()
    }
}

/// Returns the absolute path without links. Of a file that is still to be written, only its folder need exist.
fn canonical(path: &Path) -> PathBuf {
    let in_folder = || {
        let folder = path
            .parent()
            .filter(|folder| !folder.as_os_str().is_empty());
        let folder = fs::canonicalize(folder.unwrap_or(Path::new(".")))?;
        Ok(folder.join(path.file_name().unwrap_or_default()))
    };
    fs::canonicalize(path)
        .or_else(|_| in_folder())
        .or_else(|_: std::io::Error| std::path::absolute(path))
        .unwrap_or_else(|_| path.to_owned())
}

fn frames_per_second(text: &str) -> Result<f64, String> {
    let fps: f64 = text.parse().map_err(|_| "is not a number".to_owned())?;
    if fps > 0.0 && fps <= 1e6 {
        Ok(fps)
    } else {
        Err("allowed: above 0 and at most 1e6".to_owned())
    }
}

/// Checks a name against the rules of scenes.
fn target_name(text: &str) -> Result<String, String> {
    if is_name(text) {
        Ok(text.to_owned())
    } else {
        Err(format!("allowed: {NAMES_ALLOWED}"))
    }
}

fn positive_m(text: &str) -> Result<f64, String> {
    let length: f64 = text.parse().map_err(|_| "is not a number".to_owned())?;
    if length > 0.0 && length <= 1000.0 {
        Ok(length)
    } else {
        Err("allowed: above 0 and at most 1000".to_owned())
    }
}

fn pixel(text: &str) -> Result<[f64; 2], String> {
    let allowed = "allowed: two numbers, X,Y without a space, inside the image, such as 412,96";
    let (x, y) = text.split_once(',').ok_or(allowed)?;
    let number = |part: &str| part.trim().parse().ok().filter(|v: &f64| v.is_finite());
    match (number(x), number(y)) {
        (Some(x), Some(y)) => Ok([x, y]),
        _ => Err(allowed.to_owned()),
    }
}
