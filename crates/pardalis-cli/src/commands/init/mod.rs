//! `pardalis init`: a commented scene file to start from.

mod sequence;
mod text;

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::Result;
use clap::ValueEnum;
use pardalis_camera::CalibratedCamera;
use pardalis_camera::formats::Lens;
use pardalis_scene::{FrameRange, NAMES_ALLOWED, Scene, is_name};

use crate::commands::camera::load::lens;
use crate::files::write_file;
use crate::output::print;
use crate::scene::{read_calibration, read_text};
use crate::source::{Source, SourceConfig, SourceKind, Timing};
use crate::user_error::user_error;
use sequence::Recording;
use text::{Calibration, CameraText, SceneText};

/// Writes a scene file to start from
///
/// Takes a folder of images, a sequence folder (frames/ and camera.json or cameras.json), or a video, and writes a commented scene
/// file. Values that only you know are guessed and marked CHANGE.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  pardalis init images --fps 25 --camera equidistant        a folder of images from a fisheye camera
  pardalis init ride.mp4 --camera pinhole -o ride.toml      a video (needs an installed ffmpeg)
  pardalis init images --fps 25 --camera lens/camera.toml   with a known calibration, ours or another program's
  pardalis init data/dioptric-jump                          a sequence folder that says all this itself")]
pub(crate) struct Arguments {
    /// A folder of images, a sequence folder, or a video file
    input: PathBuf,
    /// The scene file to write
    #[arg(short, long, value_name = "SCENE.toml", default_value = "scene.toml")]
    output: PathBuf,
    /// The camera: equidistant, pinhole, unified or perspective_mirror (its parameters are then guessed from the image's size), or
    /// a calibration file of any format, which the scene then names; of a file of several cameras each has a folder of its name in
    /// the input [default: camera.json or cameras.json of a sequence folder, else equidistant]
    #[arg(long, value_name = "MODEL|FILE")]
    camera: Option<String>,
    /// What the calibration's coefficients mean where the file does not say so itself
    #[arg(long = "as", value_name = "LENS", value_parser = lens(), requires = "camera")]
    lens: Option<Lens>,
    /// Frames a second of a folder of images without times.csv
    #[arg(long, value_parser = frames_a_second, allow_negative_numbers = true)]
    fps: Option<f64>,
    /// The target's colour model, as `pardalis learn` writes it
    #[arg(long, value_name = "FILE", default_value = "target.colors.toml")]
    colors: PathBuf,
    /// The target's name
    #[arg(long, value_parser = target_name, default_value = "ball")]
    target: String,
    /// The ball's radius in metres [default: what camera.json says, else 0.11, marked CHANGE]
    #[arg(long, value_parser = positive_m, allow_negative_numbers = true)]
    radius_m: Option<f64>,
    /// Starts the target by a click, and tracks it by the published contour cue: a pixel near its middle in the first frame,
    /// of the first camera where there are several [default: it is found by itself]
    #[arg(long, value_name = "X,Y", value_parser = pixel, allow_negative_numbers = true)]
    pixel: Option<[f64; 2]>,
    /// Replaces an existing scene file
    #[arg(long)]
    force: bool,
}

/// Camera models that `--camera` names.
#[derive(Debug, Clone, Copy, ValueEnum)]
#[value(rename_all = "snake_case")]
enum Model {
    Equidistant,
    Pinhole,
    Unified,
    PerspectiveMirror,
}

/// Runs the command.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let output = &arguments.output;
    if output.exists() && !arguments.force {
        return Err(user_error!(
            "{}: exists already; give another -o, or --force to replace it",
            output.display()
        ));
    }
    let mut cameras = Vec::new();
    let mut radius_m = arguments.radius_m;
    match knowledge(arguments)? {
        Knowledge::Calibration {
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
                        "{}: there is no such folder, but {} has {} cameras, and each needs one of its name; take one camera out with \
                         pardalis camera convert --camera NAME",
                        input.display(),
                        file.display(),
                        known.len()
                    ));
                }
                let opened = open(&input, arguments.fps)?;
                check_size(&file, camera, opened.size)?;
                let shown = shown_path(&input, output);
                let fps = arguments.fps.or(recording.fps);
                let calibration = Calibration {
                    file: shown_path(&file, output),
                    lens: arguments.lens,
                };
                cameras.push(CameraText::known(camera, calibration, &opened, &shown, fps));
            }
        }
        Knowledge::Model(model) => {
            let input = frames_of(&arguments.input, None);
            let opened = open(&input, arguments.fps)?;
            let shown = shown_path(&input, output);
            cameras.push(CameraText::guessed(model, &opened, &shown, arguments.fps));
        }
    }
    let scene = SceneText {
        cameras,
        target: &arguments.target,
        colors: shown_path(&arguments.colors, output),
        radius_m,
        pixel: arguments.pixel,
    };
    scene.check_pixel()?;
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
    print(output.display());
    let to_change = text.lines().filter(|line| line.contains("CHANGE")).count();
    if to_change > 0 {
        print(format!(
            "  put your values into the lines marked CHANGE ({to_change})"
        ));
    }
    print("next:");
    if !arguments.colors.exists() {
        print(format!(
            "  pardalis learn … -o {}    (how: pardalis learn --help)",
            arguments.colors.display()
        ));
    }
    print(format!("  pardalis track {}", output.display()));
    Ok(())
}

/// What a frame source looks like from outside.
pub(super) struct Opened {
    size: (usize, usize),
    is_video: bool,
    has_times: bool,
}

/// Opens the input once, so that what is wrong with it shows now.
fn open(input: &Path, fps: Option<f64>) -> Result<Opened> {
    let is_video = !input.is_dir();
    let has_times = input.join("times.csv").is_file();
    if !input.exists() {
        return Err(user_error!(
            "{}: there is no such file or folder",
            input.display()
        ));
    }
    if is_video && is_image(input) {
        return Err(user_error!(
            "{}: is a single image; give the folder that holds it, or a video",
            input.display()
        ));
    }
    if fps.is_some() && (is_video || has_times) {
        let why = if is_video {
            "a video carries its own time stamps"
        } else {
            "times.csv gives the time stamps"
        };
        return Err(user_error!("--fps: {why}; leave it out"));
    }
    let kind = if is_video {
        SourceKind::Video {
            input: input.display().to_string(),
            input_options: Vec::new(),
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
        is_video,
        has_times,
    })
}

/// What is known of the cameras.
enum Knowledge {
    /// What a file says of them.
    Calibration {
        file: PathBuf,
        cameras: Vec<CalibratedCamera>,
    },
    /// The model alone.
    Model(Model),
}

/// As `--camera` says; without it, the calibration beside the frames, else an equidistant camera.
fn knowledge(arguments: &Arguments) -> Result<Knowledge> {
    let file = if let Some(name) = &arguments.camera {
        if let Ok(model) = Model::from_str(name, false) {
            return match arguments.lens {
                None => Ok(Knowledge::Model(model)),
                Some(_) => Err(user_error!(
                    "--as: is for calibration files; leave it out beside --camera {name}"
                )),
            };
        }
        PathBuf::from(name)
    } else {
        let beside = ["camera.json", "cameras.json"].map(|name| arguments.input.join(name));
        match beside.into_iter().find(|path| path.is_file()) {
            Some(path) => path,
            None => return Ok(Knowledge::Model(Model::Equidistant)),
        }
    };
    if !file.exists() {
        return Err(user_error!(
            "--camera {}: is neither a model (equidistant, pinhole, unified, perspective_mirror) nor a file",
            file.display()
        ));
    }
    let cameras = read_calibration(Path::new(""), &file.to_string_lossy(), arguments.lens)
        .map_err(|message| user_error!("{message}"))?;
    Ok(Knowledge::Calibration { file, cameras })
}

/// Errors: the calibration is for images of another size.
fn check_size(file: &Path, camera: &CalibratedCamera, found: (usize, usize)) -> Result<()> {
    match camera.size_px {
        Some(stated) if stated != found => Err(user_error!(
            "{}: camera {}: the calibration is for {} x {} pixels, the images are {} x {}",
            file.display(),
            camera.name,
            stated.0,
            stated.1,
            found.0,
            found.1
        )),
        _ => Ok(()),
    }
}

/// Whether the name is that of a still image, which ffmpeg would take for a video of one frame.
fn is_image(path: &Path) -> bool {
    let ending = path.extension().unwrap_or_default().to_ascii_lowercase();
    ["jpg", "jpeg", "png"].iter().any(|image| ending == *image)
}

/// Where the images of an input are: in it, or in its folder `frames`, with one for each of several cameras.
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

/// A path as it stands in the scene, which need not exist: relative to the scene's folder where it lies below, absolute elsewhere.
fn shown_path(input: &Path, output: &Path) -> String {
    let parent = output
        .parent()
        .filter(|p| !p.as_os_str().is_empty())
        .unwrap_or(Path::new("."));
    let absolute = |path: &Path| {
        fs::canonicalize(path)
            .or_else(|_| std::path::absolute(path))
            .unwrap_or_else(|_| path.to_owned())
    };
    let (input, parent) = (absolute(input), absolute(parent));
    let shown = input.strip_prefix(&parent).unwrap_or(&input);
    if shown.as_os_str().is_empty() {
        ".".to_owned()
    } else {
        shown.display().to_string()
    }
}

fn frames_a_second(text: &str) -> Result<f64, String> {
    let fps: f64 = text.parse().map_err(|_| "is no number".to_owned())?;
    if fps > 0.0 && fps <= 1e6 {
        Ok(fps)
    } else {
        Err("allowed: above 0 and at most 1e6".to_owned())
    }
}

/// A name as scenes allow it.
fn target_name(text: &str) -> Result<String, String> {
    if is_name(text) {
        Ok(text.to_owned())
    } else {
        Err(format!("allowed: {NAMES_ALLOWED}"))
    }
}

fn positive_m(text: &str) -> Result<f64, String> {
    let length: f64 = text.parse().map_err(|_| "is no number".to_owned())?;
    if length > 0.0 && length <= 1000.0 {
        Ok(length)
    } else {
        Err("allowed: above 0 and at most 1000".to_owned())
    }
}

fn pixel(text: &str) -> Result<[f64; 2], String> {
    let (x, y) = text.split_once(',').ok_or("give two numbers, X,Y")?;
    let number = |part: &str| part.trim().parse().ok().filter(|v: &f64| v.is_finite());
    match (number(x), number(y)) {
        (Some(x), Some(y)) => Ok([x, y]),
        _ => Err("give two numbers, X,Y".to_owned()),
    }
}
