//! Cameras of a scene that are known by a rectangle: it is found in their first images.

use anyhow::Result;
use pardalis::Frame;
use pardalis_scene::{CameraConfig, FrameRange, Problem};

use super::{Edge, find};
use crate::output::warn;
use crate::source::{Delivery, Source, SourceConfig};
use crate::user_error::user_error;

/// The frames of a range; what cannot be decoded is left out, with a warning.
///
/// Errors: there is none, or none can be decoded.
pub(crate) fn first_frames(config: &SourceConfig) -> Result<Vec<Frame>> {
    let source = Source::open(config)?;
    let input = source.describe().input.clone();
    let mut frames = Vec::new();
    let mut broken = None;
    for delivery in source {
        match delivery? {
            Delivery::Frame { frame, .. } => frames.push(frame),
            Delivery::Broken(error) => {
                warn(format!("{error:#}; it is left out"));
                broken = Some(error);
            }
        }
    }
    match broken {
        _ if !frames.is_empty() => Ok(frames),
        Some(error) => Err(error),
        None => Err(user_error!(
            "{input}: has no frames; give a folder of images or a video"
        )),
    }
}

/// Finds the rectangle that a camera is known by, where it is, in its first images, and sets its model by it. The corners join the scene's settings.
pub(crate) fn find_in_scene(
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
    let edge = if config.value.inner_edge {
        Edge::Inner
    } else {
        Edge::Outer
    };
    let frames = first_frames(&first).map_err(|error| config.problem(format!("{error:#}")))?;
    let found = find(&frames, edge).map_err(|error| config.problem(format!("{error:#}")))?;
    let known = config.value.camera(found.corners_px);
    let known = known.map_err(|error| config.problem(error.to_string()))?;
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
    camera.camera = known;
    Ok(())
}
