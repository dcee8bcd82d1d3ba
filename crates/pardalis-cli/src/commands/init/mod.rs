//! `pardalis init`: a commented scene file to start from.

mod sequence;
mod text;

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::Result;
use clap::ValueEnum;

use crate::fault::fault;
use crate::files::write_file;
use crate::source::{Source, SourceConfig, SourceKind, Timing};
use text::{CameraText, SceneText};

/// Writes a scene file to start from
///
/// Takes a folder of images, a sequence folder (frames/ and camera.json or cameras.json), or a video, and writes a commented scene
/// file. Values that only you know are guessed and marked CHANGE.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  pardalis init images --fps 25 --camera equidistant        a folder of images from a fisheye camera
  pardalis init ride.mp4 --camera pinhole -o ride.toml      a video (needs an installed ffmpeg)
  pardalis init images --fps 25 --camera rig/camera.json    with a known calibration
  pardalis init data/dioptric-jump                          a sequence folder that says all this itself")]
pub(crate) struct Arguments {
    /// A folder of images, a sequence folder, or a video file
    input: PathBuf,
    /// The scene file to write
    #[arg(short, long, value_name = "SCENE.toml", default_value = "scene.toml")]
    output: PathBuf,
    /// The camera: equidistant, pinhole, unified or perspective_mirror (its parameters are then guessed from the image's size), or
    /// a camera.json with a calibration [default: camera.json or cameras.json of a sequence folder, else equidistant]
    #[arg(long, value_name = "MODEL|FILE")]
    camera: Option<String>,
    /// Frames a second of a folder of images without times.csv
    #[arg(long, value_parser = frames_a_second)]
    fps: Option<f64>,
    /// The target's colour model, as `pardalis learn` writes it
    #[arg(long, value_name = "FILE", default_value = "target.colors.toml")]
    colors: String,
    /// The target's name
    #[arg(long, default_value = "ball")]
    target: String,
    /// The ball's radius in metres
    #[arg(long, value_parser = positive_m, default_value_t = 0.11)]
    radius_m: f64,
    /// A pixel near the middle of the target in the first frame
    #[arg(long, value_name = "X,Y", value_parser = pixel)]
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
        return Err(fault!(
            "{}: exists already; give another -o, or --force to replace it",
            output.display()
        ));
    }
    let known = known_cameras(arguments)?;
    let fps = arguments.fps.or(known.as_ref().and_then(|k| k.fps));
    let mut cameras = Vec::new();
    if let Some(known) = &known {
        for camera in &known.cameras {
            let several = known.cameras.len() > 1;
            let input = frames_of(&arguments.input, several.then_some(&*camera.name));
            let opened = open(&input, fps)?;
            let shown = shown_path(&input, output);
            cameras.push(CameraText::known(camera, &opened, &shown, fps)?);
        }
    } else {
        let input = frames_of(&arguments.input, None);
        let opened = open(&input, fps)?;
        let model = model_named(arguments.camera.as_deref().unwrap_or("equidistant"))?;
        cameras.push(CameraText::guessed(
            model,
            &opened,
            &shown_path(&input, output),
            fps,
        ));
    }
    let scene = SceneText {
        cameras,
        target: &arguments.target,
        colors: &arguments.colors,
        radius_m: arguments.radius_m,
        pixel: arguments.pixel,
    };
    let text = scene.text();
    if let Err(problems) = pardalis::config::Scene::parse(&text) {
        let problems: Vec<String> = problems.iter().map(ToString::to_string).collect();
        return Err(fault!(
            "the scene would not be valid: {}",
            problems.join("; ")
        ));
    }
    write_file(output, text.as_bytes())?;
    println!("{}", output.display());
    let to_change = text.lines().filter(|line| line.contains("CHANGE")).count();
    if to_change > 0 {
        println!("  put your values into the lines marked CHANGE ({to_change})");
    }
    println!(
        "next:\n  pardalis learn …            learns {}, if you have none yet",
        arguments.colors
    );
    println!("  pardalis track {}", output.display());
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
        return Err(fault!(
            "{}: there is no such file or folder",
            input.display()
        ));
    }
    if fps.is_some() && (is_video || has_times) {
        let why = if is_video {
            "a video carries its own time stamps"
        } else {
            "times.csv gives the time stamps"
        };
        return Err(fault!("--fps: {why}; leave it out"));
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
        first_frame: 0,
        frame_limit: None,
    };
    let size = Source::open(&config)?.size();
    Ok(Opened {
        size,
        is_video,
        has_times,
    })
}

/// The calibration that a file beside or named gives.
fn known_cameras(arguments: &Arguments) -> Result<Option<sequence::Sequence>> {
    match &arguments.camera {
        Some(name) if Model::from_str(name, false).is_ok() => Ok(None),
        Some(file) => sequence::read(Path::new(file)).map(Some),
        None => {
            let beside = ["camera.json", "cameras.json"].map(|name| arguments.input.join(name));
            beside
                .iter()
                .find(|path| path.is_file())
                .map(|path| sequence::read(path))
                .transpose()
        }
    }
}

fn model_named(name: &str) -> Result<Model> {
    Model::from_str(name, false).map_err(|_| {
        fault!("--camera {name}: is neither a model (equidistant, pinhole, unified, perspective_mirror) nor a file")
    })
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

/// A path as it stands in the scene: relative to the scene's folder where it lies below, absolute elsewhere.
fn shown_path(input: &Path, output: &Path) -> String {
    let parent = output
        .parent()
        .filter(|p| !p.as_os_str().is_empty())
        .unwrap_or(Path::new("."));
    let absolute = |path: &Path| fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
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
