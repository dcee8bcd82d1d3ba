//! Calibrations in recordings: `sensor_msgs/CameraInfo` of ROS 2 and Foxglove's `CameraCalibration`.

use std::collections::BTreeSet;
use std::path::Path;

use foxglove::Decode as _;
use foxglove::messages::CameraCalibration;
use mcap::{Channel, Message};
use pardalis_camera::CalibratedCamera;
use pardalis_camera::formats::Lens;
use pardalis_scene::calibration;
use serde_json::{Map, Value};

use super::camera_info::Info;
use super::reader::{Messages, summary};
use super::{kind_of, ros2};

/// Reads the camera of the first calibration of each topic, with the name of the topic without its last part. Also returns what is wrong with
/// calibrations that cannot be used.
pub(super) fn read(
    path: &Path,
    lens: Option<Lens>,
) -> Result<(Vec<CalibratedCamera>, Vec<String>), String> {
    let mut topics: Vec<String> = Vec::new();
    let (mut cameras, mut problems) = (Vec::new(), Vec::new());
    let expected = summary(path).map(|summary| {
        let channels = summary.channels.iter();
        let topics = channels.filter(|channel| is_calibration(channel));
        topics
            .map(|channel| &channel.topic)
            .collect::<BTreeSet<_>>()
            .len()
    });
    let mut damage = None;
    for message in Messages::open(path)? {
        if Some(topics.len()) == expected {
            break;
        }
        let message = match message {
            Ok(message) => message,
            // What precedes it is sound.
            Err(error) => {
                damage = Some(error);
                break;
            }
        };
        let topic = &message.channel.topic;
        if topics.contains(topic) {
            continue;
        }
        let Some(info) = info_in(&message) else {
            continue;
        };
        let camera = info.and_then(|info| {
            let text = info.text(&name_of(topic));
            calibration::read(&text, lens).map_err(|error| error.to_string())
        });
        match camera {
            Ok(camera) => cameras.extend(camera),
            // Such as that of a camera which nobody has calibrated.
            Err(error) => problems.push(format!("topic {topic}: {error}")),
        }
        topics.push(topic.clone());
    }
    if cameras.is_empty() {
        return Err(problems.into_iter().next().or(damage).unwrap_or_else(|| "has no topic with calibrations; allowed: sensor_msgs/msg/CameraInfo of ROS 2 (cdr), CameraCalibration of Foxglove (protobuf, json)"
                .to_owned()));
    }
    Ok((cameras, problems))
}

/// Returns the name of the camera of a topic: `left` of `/left/camera_info`, and `robot-left` of `/robot/left/camera_info`. In ROS, no topic has a hyphen,
/// so that `/robot_left/camera_info` has another name.
pub(super) fn name_of(topic: &str) -> String {
    let topic = topic.trim_matches('/');
    let camera = topic.rsplit_once('/').map_or(topic, |(camera, _)| camera);
    let allowed = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '-';
    camera.replace('/', "-").replace(|c: char| !allowed(c), "_")
}

/// Reports whether the messages of a channel are calibrations.
fn is_calibration(channel: &Channel) -> bool {
    let (_, schema) = kind_of(channel);
    schema.ends_with("/CameraInfo") || schema == "foxglove.CameraCalibration"
}

/// The calibration in a message; `None` of other messages.
fn info_in(message: &Message) -> Option<Result<Info, String>> {
    let data = &message.data;
    let damaged = |error: &dyn std::fmt::Display| format!("the message is damaged: {error}");
    Some(match kind_of(&message.channel) {
        ("cdr", "sensor_msgs/msg/CameraInfo" | "sensor_msgs/CameraInfo") => {
            ros2::read::<ros2::CameraInfo>(data).map(|info| info.info())
        }
        ("protobuf", "foxglove.CameraCalibration") => {
            let read = CameraCalibration::decode(&data[..]);
            read.map(Info::of_foxglove).map_err(|error| damaged(&error))
        }
        ("json", "foxglove.CameraCalibration") => {
            let read = serde_json::from_slice(data).and_then(|mut fields: Map<String, Value>| {
                // Foxglove's schema has capitals here, its Rust library has none.
                for (name, key) in [("D", "d"), ("K", "k"), ("R", "r"), ("P", "p")] {
                    if let Some(value) = fields.remove(name) {
                        fields.insert(key.to_owned(), value);
                    }
                }
                serde_json::from_value(Value::Object(fields))
            });
            read.map(Info::of_foxglove).map_err(|error| damaged(&error))
        }
        _ => return None,
    })
}
