//! Calibrations in recordings: `sensor_msgs/CameraInfo` of ROS 2 and Foxglove's `CameraCalibration`.

use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::path::Path;

use foxglove::Decode as _;
use foxglove::messages::CameraCalibration;
use mcap::{Channel, Message};
use pardalis_camera::CalibratedCamera;
use pardalis_camera::formats::Lens;
use pardalis_scene::calibration;
use serde_json::{Map, Value};

use super::reader::{Messages, summary};
use super::{kind_of, ros2};

/// Reads the camera of the first calibration of each topic, with the name of the topic without its last part.
pub(super) fn read(path: &Path, lens: Option<Lens>) -> Result<Vec<CalibratedCamera>, String> {
    let mut topics: Vec<String> = Vec::new();
    let mut cameras = Vec::new();
    let expected = summary(path).map(|summary| {
        let channels = summary.channels.values();
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
        cameras.extend(camera.map_err(|error| format!("topic {topic}: {error}"))?);
        topics.push(topic.clone());
    }
    if cameras.is_empty() {
        return Err(damage.unwrap_or_else(|| "has no topic with calibrations; allowed: sensor_msgs/msg/CameraInfo of ROS 2 (cdr), CameraCalibration of Foxglove (protobuf, json)"
                .to_owned()));
    }
    Ok(cameras)
}

/// Returns the name of the camera of a topic: `left` of `/left/camera_info`, and `robot_left` of `/robot/left/camera_info`.
pub(super) fn name_of(topic: &str) -> String {
    let topic = topic.trim_matches('/');
    let camera = topic.rsplit_once('/').map_or(topic, |(camera, _)| camera);
    let allowed = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '-';
    camera.replace(|c: char| !allowed(c), "_")
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
            ros2::read::<ros2::CameraInfo>(data).map(|info| Info::of_ros(&info))
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

/// A calibration with the fields of ROS.
pub(super) struct Info {
    size_px: [u32; 2],
    distortion_model: String,
    d: Vec<f64>,
    k: Vec<f64>,
    r: Vec<f64>,
    p: Vec<f64>,
    binning: [u32; 2],
    /// `x_offset`, `y_offset`, height and width of the region of interest.
    region: [u32; 4],
}

impl Info {
    pub(super) fn of_ros(info: &ros2::CameraInfo) -> Self {
        let roi = &info.roi;
        Self {
            size_px: [info.width, info.height],
            distortion_model: info.distortion_model.clone(),
            d: info.d.clone(),
            k: info.k.to_vec(),
            r: info.r.to_vec(),
            p: info.p.to_vec(),
            binning: [info.binning_x, info.binning_y],
            region: [roi.x_offset, roi.y_offset, roi.height, roi.width],
        }
    }

    fn of_foxglove(info: CameraCalibration) -> Self {
        // The same model has another name in ROS.
        let distortion_model = match &*info.distortion_model {
            "kannala_brandt" => "equidistant".to_owned(),
            _ => info.distortion_model,
        };
        Self {
            size_px: [info.width, info.height],
            distortion_model,
            d: info.d,
            k: info.k,
            r: info.r,
            p: info.p,
            binning: [0; 2],
            region: [0; 4],
        }
    }

    /// Returns the text that ROS prints of the message, which is read like any calibration file.
    pub(super) fn text(&self, name: &str) -> String {
        let [width, height] = self.size_px;
        let mut text = format!(
            "camera_name: {name}\nwidth: {width}\nheight: {height}\ndistortion_model: {:?}\n",
            // Older recordings name no model of images without distortion.
            if self.d.is_empty() && self.distortion_model.is_empty() {
                "plumb_bob"
            } else {
                &self.distortion_model
            },
        );
        let d = if self.d.is_empty() {
            &[0.0; 5][..]
        } else {
            &self.d
        };
        for (key, values) in [("d", d), ("k", &self.k), ("r", &self.r), ("p", &self.p)] {
            // Those that are left out are all zero in ROS.
            if !values.is_empty() {
                let _ = writeln!(text, "{key}: {values:?}");
            }
        }
        let [binning_x, binning_y] = self.binning;
        let [x_offset, y_offset, height, width] = self.region;
        let _ = write!(
            text,
            "binning_x: {binning_x}\nbinning_y: {binning_y}\nroi:\n  x_offset: {x_offset}\n  y_offset: {y_offset}\n  height: {height}\n  width: {width}\n"
        );
        text
    }
}
