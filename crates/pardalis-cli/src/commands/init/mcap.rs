//! Scenes of MCAP recordings: a camera for each topic with images, calibrated where the recording says so.

use std::path::Path;

use anyhow::Result;
use pardalis_scene::FrameRange;

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
    let is_given = arguments.camera.is_some() || arguments.fov_deg.is_some();
    let known = match known_cameras(arguments)? {
        KnownCameras::Model(model, fov) if is_given => KnownCameras::Model(model, fov),
        KnownCameras::Model(..) => match mcap::calibrations(file, None) {
            Ok((cameras, problems)) => {
                problems.iter().for_each(warn);
                KnownCameras::Calibration {
                    file: file.clone(),
                    cameras,
                }
            }
            Err(error) => {
                warn(format!("{error}; the scene has a guess"));
                KnownCameras::Model(Model::Pinhole, Fov::Unknown)
            }
        },
        known @ KnownCameras::Calibration { .. } => known,
    };
    let mut cameras: Vec<CameraText> = Vec::new();
    let mut left_out: Vec<String> = Vec::new();
    for (name, topic) in mcap::image_topics(file).map_err(|message| user_error!("{message}"))? {
        let opened = match open(file, &topic) {
            Ok(opened) => opened,
            // Such as a topic of depths.
            Err(error) => {
                left_out.push(format!("{error:#}"));
                continue;
            }
        };
        if topic.contains("/image_rect") {
            warn(format!(
                "{topic}: its images are rectified, and recorded calibrations are of the raw ones: give model.pinhole with the values of P, and no distortion"
            ));
        }
        let shown = shown_path(file, output);
        let calibrated = match &known {
            KnownCameras::Calibration { cameras, .. } if cameras.len() == 1 => cameras.first(),
            KnownCameras::Calibration { cameras, .. } => cameras.iter().find(|c| c.name == name),
            KnownCameras::Model(..) => None,
        };
        let text = match (&known, calibrated) {
            (KnownCameras::Calibration { file, .. }, Some(camera)) => {
                check_size(file, camera, opened.size)?;
                let calibration = Calibration {
                    file: shown_path(file, output),
                    // So that the camera may get another name.
                    camera: Some(camera.name.clone()),
                    lens: arguments.lens,
                };
                CameraText::known(camera, calibration, &opened, &shown, None)
            }
            (KnownCameras::Calibration { .. }, None) => {
                CameraText::guessed(Model::Pinhole, &Fov::Unknown, &opened, &shown, None)
            }
            (KnownCameras::Model(model, fov), _) => {
                CameraText::guessed(*model, fov, &opened, &shown, None)
            }
        };
        cameras.push(text.named(name));
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
