//! Cameras of a scene that are calibrated by a rectangle, which is detected in their first images.

use anyhow::Result;
use pardalis_calibrate::rectangle::{Edge, detect};
use pardalis_images::RgbImage;
use pardalis_scene::{CameraConfig, FrameRange, Problem};

use crate::draw::picture::picture_of;
use crate::output::warn;
use crate::source::{Delivery, Source, SourceConfig};
use crate::user_error::user_error;

/// Edge of a tape, as an argument of the command line.
#[derive(Debug, Clone, Copy, clap::ValueEnum)]
pub(crate) enum EdgeArgument {
    /// The outer one.
    Outer,
    /// The inner one.
    Inner,
}

impl From<EdgeArgument> for Edge {
    fn from(argument: EdgeArgument) -> Self {
        match argument {
            EdgeArgument::Outer => Self::Outer,
            EdgeArgument::Inner => Self::Inner,
        }
    }
}

/// Reads the images of a range. Those that cannot be decoded are omitted with a warning.
///
/// Fails if there are none, or if none can be decoded.
pub(crate) fn first_images(config: &SourceConfig) -> Result<Vec<RgbImage>> {
    let source = Source::open(config)?;
    let input = source.describe().input.clone();
    let mut images = Vec::new();
    let mut broken = None;
    for delivery in source {
        match delivery? {
            Delivery::Frame { frame, .. } => images.push(picture_of(&frame)),
            Delivery::Broken(error) => {
                warn(format!("{error:#}; it is left out"));
                broken = Some(error);
            }
        }
    }
    match broken {
        _ if !images.is_empty() => Ok(images),
        Some(error) => Err(error),
        None => Err(user_error!(
            "{input}: has no frames; give a folder of images or a video"
        )),
    }
}

/// Detects the rectangle of a camera in its first images, for which its source is opened, and sets the camera's model
/// accordingly. Adds the corners to the scene's resolved settings. Does nothing if the camera has no rectangle.
pub(crate) fn find_in_images(
    camera: &mut CameraConfig,
    source: SourceConfig,
    resolved: &mut toml::Table,
) -> Result<(), Problem> {
    let Some(config) = &camera.rectangle else {
        return Ok(());
    };
    let first = SourceConfig {
        frames: FrameRange {
            limit: Some(config.value.frames),
            ..FrameRange::ALL
        },
        ..source
    };
    let images = first_images(&first).map_err(|error| config.problem(format!("{error:#}")))?;
    set_model(camera, &images, resolved)
}

/// Detects the rectangle of a camera like [`find_in_images`] in the first frames of a source, which delivers them
/// nevertheless.
pub(crate) fn find_in_source(
    camera: &mut CameraConfig,
    source: &mut Source,
    resolved: &mut toml::Table,
) -> Result<(), Problem> {
    let Some(config) = &camera.rectangle else {
        return Ok(());
    };
    let frames = source.peek(config.value.frames);
    let images: Vec<RgbImage> = frames.map(picture_of).collect();
    set_model(camera, &images, resolved)
}

fn set_model(
    camera: &mut CameraConfig,
    images: &[RgbImage],
    resolved: &mut toml::Table,
) -> Result<(), Problem> {
    let Some(config) = &camera.rectangle else {
        return Ok(());
    };
    let edge = if config.value.inner_edge {
        Edge::Inner
    } else {
        Edge::Outer
    };
    let found = detect(images, edge).map_err(|error| config.problem(error.to_string()))?;
    let model = config.value.camera(found.corners_px);
    let model = model.map_err(|error| config.problem(error.to_string()))?;
    let corners: toml::Table = [(
        "found_corners_px".to_owned(),
        toml::Value::from(
            found
                .corners_px
                .map(|corner| toml::Value::from(corner.to_vec()))
                .to_vec(),
        ),
    )]
    .into_iter()
    .collect();
    if let Some(toml::Value::Table(settings)) = resolved
        .get_mut("cameras")
        .and_then(|cameras| cameras.get_mut(&camera.name))
    {
        settings.extend(corners);
    }
    camera.camera = model;
    Ok(())
}
