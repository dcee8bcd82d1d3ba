//! Scenes of MCAP recordings: a camera for each topic with images, calibrated where the recording says so.

use std::path::Path;

use anyhow::Result;
use pardalis_camera::formats::Lens;
use pardalis_scene::{FrameRange, is_rectified};

use super::text::{Calibration, CameraText};
use super::{
    Arguments, Fov, Input, KnownCameras, Model, Opened, check_size, known_cameras, shown_path,
};
use crate::mcap;
use crate::output::warn;
use crate::source::{Source, SourceConfig, SourceKind};
use crate::user_error::user_error;

/// Describes the cameras of a recording.
pub(super) fn cameras(arguments: &Arguments) -> Result<Vec<CameraText>> {
    let (file, output) = (&arguments.input, &arguments.output);
    if arguments.fps.is_some() {
        return Err(user_error!(
            "--fps: a recording carries its own time stamps; leave it out"
        ));
    }
    let (known, is_recorded) = known(arguments)?;
    // What is wrong with a calibration has been said of the raw images.
    let rectified = mcap::calibrations(file, Some(Lens::Rectified));
    let (rectified, _) = rectified.unwrap_or_default();
    let mut cameras: Vec<CameraText> = Vec::new();
    let mut left_out: Vec<String> = Vec::new();
    let topics = mcap::image_topics(file).map_err(|message| user_error!("{message}"))?;
    for (name, topic) in &topics {
        let opened = match open(file, topic) {
            Ok(opened) => opened,
            // Such as a topic of depths.
            Err(error) => {
                left_out.push(format!("{error:#}"));
                continue;
            }
        };
        let is_of_rectified = is_recorded && is_rectified(topic);
        let shown = shown_path(file, output);
        let calibrated = match &known {
            KnownCameras::Calibration { .. } if is_of_rectified => {
                rectified.iter().find(|c| c.name == *name)
            }
            // A given calibration is of all; a recorded one may be of another camera.
            KnownCameras::Calibration { cameras, .. }
                if cameras.len() == 1 && (!is_recorded || topics.len() == 1) =>
            {
                cameras.first()
            }
            KnownCameras::Calibration { cameras, .. } => cameras.iter().find(|c| c.name == *name),
            KnownCameras::Model(..) => None,
        };
        let text = match (&known, calibrated) {
            (KnownCameras::Calibration { file, .. }, Some(camera)) => {
                check_size(file, camera, opened.size)?;
                let of_rectified = is_of_rectified.then_some(Lens::Rectified);
                let calibration = Calibration {
                    file: shown_path(file, output),
                    // So that the camera may get another name.
                    camera: Some(camera.name.clone()),
                    lens: of_rectified.or(arguments.lens),
                };
                CameraText::known(camera, calibration, &opened, &shown, None)
            }
            (KnownCameras::Calibration { .. }, None) => {
                warn(format!(
                    "{topic}: has no calibration; the scene has a guess of this camera"
                ));
                CameraText::guessed(Model::Pinhole, &Fov::Unknown, &opened, &shown, None)
            }
            (KnownCameras::Model(model, fov), _) => {
                CameraText::guessed(*model, fov, &opened, &shown, None)
            }
        };
        cameras.push(text.named(name.clone()));
    }
    match left_out.first() {
        Some(error) if cameras.is_empty() => Err(user_error!("{error}")),
        _ => {
            let left_out = left_out.iter().map(|error| format!("left out: {error}"));
            left_out.for_each(warn);
            Ok(cameras)
        }
    }
}

/// Returns what is known about the cameras, and whether the recording itself says so.
fn known(arguments: &Arguments) -> Result<(KnownCameras, bool)> {
    let file = &arguments.input;
    let is_given = arguments.camera.is_some() || arguments.fov_deg.is_some();
    let known = known_cameras(arguments)?;
    if is_given || matches!(known, KnownCameras::Calibration { .. }) {
        return Ok((known, false));
    }
    match mcap::calibrations(file, None) {
        Ok((cameras, problems)) => {
            problems.iter().for_each(warn);
            let file = file.clone();
            Ok((KnownCameras::Calibration { file, cameras }, true))
        }
        Err(error) => {
            warn(format!("{error}; the scene has a guess"));
            let guess = KnownCameras::Model(Model::Pinhole, Fov::Unknown);
            Ok((guess, false))
        }
    }
}

fn open(file: &Path, topic: &str) -> Result<Opened> {
    let config = SourceConfig {
        kind: SourceKind::Mcap {
            file: file.to_owned(),
            topic: Some(topic.to_owned()),
        },
        time_offset_s: 0.0,
        frames: FrameRange::ALL,
    };
    Ok(Opened {
        size: Source::open(&config)?.size(),
        input: Input::Mcap {
            topic: topic.to_owned(),
        },
    })
}
