//! `pardalis calibrate time`: time offsets between the cameras of a scene, from a moving target.

pub(in crate::commands) mod detect;
mod report;

use std::path::{Path, PathBuf};

use anyhow::Result;
use pardalis_calibrate::{MAX_TIME_OFFSET_S, TimedCamera, calibrate_time};
use pardalis_scene::{Scene, TargetConfig, with_camera_settings};

use super::output;
use crate::arguments::parse_duration_s;
use crate::files::write_file;
use crate::output::{Shown, print};
use crate::scene;
use crate::scene_files::read_text;
use crate::user_error::user_error;
use detect::{Until, detect, settings};
use report::Report;

/// Estimates the time offsets between the cameras of a scene from a moving target
///
/// Looks for the target in every image by itself, and finds the offsets under which one path through space
/// explains what all cameras show. The cameras need poses but not a common frame rate. Record 5 to 30 seconds
/// of the target moving back and forth in all directions, visible to two or more cameras at a time.
#[derive(Debug, clap::Args)]
#[command(after_help = "Example:
  pardalis calibrate time scene.toml --corrected corrected.toml
  pardalis track corrected.toml")]
pub(crate) struct Arguments {
    /// The scene; its first camera is the time reference
    #[arg(value_name = "SCENE.toml")]
    scene: PathBuf,
    /// The target to detect, if the scene has several
    #[arg(long, value_name = "NAME")]
    target: Option<String>,
    /// Largest offset to search for in either direction, in seconds
    #[arg(long, value_name = "SECONDS", default_value_t = 0.5, value_parser = parse_offset, allow_negative_numbers = true)]
    max_offset_s: f64,
    /// How long live cameras are watched
    #[arg(long = "duration", value_name = "SECONDS", value_parser = parse_duration_s, allow_negative_numbers = true)]
    duration_s: Option<f64>,
    /// Also writes the scene with the estimated offsets to this file, which must be in the scene's folder and
    /// may be the scene itself
    #[arg(long, value_name = "SCENE.toml")]
    corrected: Option<PathBuf>,
    /// The folder for the results [default: in the current directory, the scene's name with -time]
    #[arg(short, long, value_name = "FOLDER")]
    output: Option<PathBuf>,
}

/// Runs the command.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let path = &arguments.scene;
    if let Some(corrected) = &arguments.corrected {
        check_folder(path, corrected)?;
    }
    let read = scene::read(path)?;
    if let Some(camera) = read.cameras.iter().find(|camera| camera.platform.is_some()) {
        return Err(user_error!(
            "{}: cameras.{}.platform: the camera moves, and temporal calibration needs cameras at rest; `calibrate mount` estimates the offset of the platform's clock",
            path.shown(),
            camera.name
        ));
    }
    let number = target(path, &read, arguments.target.as_deref())?;
    let mut open = scene::open(path, read, None, &[])?;
    let [body] = &open.scene.targets[number].bodies[..] else {
        return Err(user_error!(
            "{}: targets.{}: has several landmarks, but temporal calibration needs a single body; define a target of one body and choose it with --target NAME",
            path.shown(),
            open.scene.targets[number].name
        ));
    };
    let colors = scene::colors(path, body)?;
    let views = open.tracker.views();
    let detector = settings(body, &colors);
    let frames = detect(
        &mut open.sources,
        views,
        (&body.shape, &detector),
        &Until {
            duration_s: arguments.duration_s,
            ..Until::default()
        },
        &|_, _, _| (),
    )?;
    let cameras: Vec<TimedCamera> = open
        .scene
        .cameras
        .iter()
        .zip(views)
        .zip(frames)
        .map(|((camera, view), frames)| TimedCamera {
            name: &camera.name,
            view,
            frames,
        })
        .collect();
    let fits = calibrate_time(&cameras, body.size, arguments.max_offset_s)
        .map_err(|refusal| user_error!("{}: {refusal}", path.shown()))?;
    let report = Report::new(&open.scene, &cameras, &fits);

    let folder = output::folder(arguments.output.as_deref(), path, "time");
    output::make_folder(&folder)?;
    let mut written = Vec::new();
    for (name, text) in [
        ("offsets.csv", report.table()?),
        ("detections.csv", report.detections()?),
        ("report.html", report.page()?),
    ] {
        let file = folder.join(name);
        write_file(&file, text.as_bytes())?;
        written.push(file);
    }
    if let Some(corrected) = &arguments.corrected {
        let text = with_camera_settings(&read_text(path)?, &report.camera_settings());
        let text = text.ok_or_else(|| {
            user_error!(
                "{}: the layout of the file does not allow inserting the offsets; add them by hand:\n{}",
                path.shown(),
                report.settings()
            )
        })?;
        write_file(corrected, text.as_bytes())?;
        written.push(corrected.clone());
    }
    print(&report);
    output::print_written(&written);
    Ok(())
}

/// Requires a file in the scene's folder, because paths in a scene are relative to it.
pub(super) fn check_folder(scene: &Path, corrected: &Path) -> Result<()> {
    let folder = |file: &Path| {
        let folder = file.parent().filter(|folder| *folder != Path::new(""));
        folder.unwrap_or(Path::new(".")).canonicalize().ok()
    };
    if folder(scene) == folder(corrected) {
        return Ok(());
    }
    Err(user_error!(
        "--corrected {}: lies in another folder than {}, but paths in a scene are relative to its folder; give a file beside the scene",
        corrected.shown(),
        scene.shown()
    ))
}

/// Returns the index of the target to detect.
pub(super) fn target(path: &Path, scene: &Scene, wanted: Option<&str>) -> Result<usize> {
    let is_wanted = |target: &TargetConfig| wanted.is_none_or(|name| target.name == name);
    let found = scene.targets.iter().position(is_wanted);
    match found {
        Some(number) if wanted.is_some() || scene.targets.len() == 1 => Ok(number),
        _ => {
            let names: Vec<&str> = scene.targets.iter().map(|t| &*t.name).collect();
            let unknown = wanted.map_or_else(String::new, |name| format!("no target {name}, but "));
            Err(user_error!(
                "{}: has {unknown}the targets {}; choose one with --target NAME",
                path.shown(),
                names.join(", ")
            ))
        }
    }
}

/// Parses the largest offset in seconds.
pub(super) fn parse_offset(text: &str) -> Result<f64, String> {
    text.parse()
        .ok()
        .filter(|offset_s: &f64| *offset_s > 0.0 && *offset_s <= MAX_TIME_OFFSET_S)
        .ok_or_else(|| format!("allowed: above 0 and at most {MAX_TIME_OFFSET_S} seconds"))
}
