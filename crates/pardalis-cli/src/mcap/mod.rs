//! MCAP recordings of robots: their images and the calibrations of their cameras, in messages of ROS 2 and Foxglove.

mod calibration;
mod camera_info;
mod image;
mod pixels;
mod reader;
pub mod ros2;
#[cfg(test)]
mod tests;

use std::path::Path;

use pardalis_camera::CalibratedCamera;
use pardalis_camera::formats::Lens;

use crate::output::Shown;

pub(crate) use image::Images;
pub(crate) use reader::is_cut_off;

/// Encoding of messages and name of their schema.
fn kind_of<'a>(channel: &'a mcap::Channel) -> (&'a str, &'a str) {
    let schema = channel.schema.as_ref();
    let name = schema.map_or("", |schema| &*schema.name);
    (&*channel.message_encoding, name)
}

/// Returns the topics with images, each after the name of its camera: `left` for `/left/image_raw`. Of the topics of one camera, the first is taken.
///
/// Errors: messages that name the file.
pub(crate) fn image_topics(path: &Path) -> Result<Vec<(String, String)>, String> {
    let topics = image::topics(path).map_err(|message| format!("{}: {message}", path.shown()))?;
    let mut cameras: Vec<(String, String)> = Vec::new();
    for topic in topics {
        let name = calibration::name_of(topic.trim_end_matches("/compressed"));
        if cameras.iter().all(|(other, _)| *other != name) {
            cameras.push((name, topic));
        }
    }
    Ok(cameras)
}

/// Reads the cameras of the calibrations in a recording, each with the name of its topic, without the last part. Also returns what is wrong with
/// calibrations that cannot be used, while there are others.
///
/// Errors: messages that name the file.
pub(crate) fn calibrations(
    path: &Path,
    lens: Option<Lens>,
) -> Result<(Vec<CalibratedCamera>, Vec<String>), String> {
    let in_file = |message: String| format!("{}: {message}", path.shown());
    let (cameras, problems) = calibration::read(path, lens).map_err(in_file)?;
    Ok((cameras, problems.into_iter().map(in_file).collect()))
}
