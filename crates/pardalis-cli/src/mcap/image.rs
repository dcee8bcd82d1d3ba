//! The images of a topic.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::Result;
use foxglove::Decode;
use foxglove::messages::{CompressedImage, RawImage, Timestamp};
use mcap::{Channel, Message};
use pardalis::PixelFormat;
use pardalis_scene::FrameRange;
use serde::de::DeserializeOwned;

use super::pixels::{Pixels, compressed, raw};
use super::reader::{Messages, channels, summary};
use super::{kind_of, ros2};
use crate::output::Shown;
use crate::user_error::user_error;

/// What a message of a channel is.
#[derive(Clone, Copy)]
enum Kind {
    Ros2Raw,
    Ros2Compressed,
    Raw(Encoding),
    Compressed(Encoding),
}

/// How Foxglove's messages are written.
#[derive(Clone, Copy)]
enum Encoding {
    Protobuf,
    Json,
}

impl Encoding {
    fn read<T: Decode + DeserializeOwned>(self, data: &[u8]) -> Result<T, String> {
        let damaged = |error: &dyn std::fmt::Display| format!("the message is damaged: {error}");
        match self {
            Self::Protobuf => T::decode(data).map_err(|error| damaged(&error)),
            Self::Json => serde_json::from_slice(data).map_err(|error| damaged(&error)),
        }
    }
}

/// The kinds of messages that are images, for messages.
const KINDS: &str = "sensor_msgs/msg/Image and CompressedImage of ROS 2 (cdr), RawImage and CompressedImage of Foxglove (protobuf, json)";

impl Kind {
    /// Returns what the messages of a channel are; `None` if they are no images.
    fn of(channel: &Channel) -> Option<Self> {
        Some(match kind_of(channel) {
            ("cdr", "sensor_msgs/msg/Image" | "sensor_msgs/Image") => Self::Ros2Raw,
            ("cdr", "sensor_msgs/msg/CompressedImage" | "sensor_msgs/CompressedImage") => {
                Self::Ros2Compressed
            }
            ("protobuf", "foxglove.RawImage") => Self::Raw(Encoding::Protobuf),
            ("json", "foxglove.RawImage") => Self::Raw(Encoding::Json),
            ("protobuf", "foxglove.CompressedImage") => Self::Compressed(Encoding::Protobuf),
            ("json", "foxglove.CompressedImage") => Self::Compressed(Encoding::Json),
            _ => return None,
        })
    }

    /// Reads a message. Returns the image with its time in seconds, if it states one.
    fn read(self, data: &[u8]) -> Result<(Pixels, Option<f64>), String> {
        match self {
            Self::Ros2Raw => {
                let image: ros2::Image = ros2::read(data)?;
                Ok((image.pixels()?, image.stamp().seconds()))
            }
            Self::Ros2Compressed => {
                let image: ros2::CompressedImage = ros2::read(data)?;
                Ok((image.pixels()?, image.stamp().seconds()))
            }
            Self::Raw(encoding) => {
                let image: RawImage = encoding.read(data)?;
                let size_px = (image.width, image.height);
                let pixels = raw(size_px, image.step, &image.encoding, &image.data)?;
                Ok((pixels, image.timestamp.and_then(seconds)))
            }
            Self::Compressed(encoding) => {
                let image: CompressedImage = encoding.read(data)?;
                Ok((compressed(&image.data)?, image.timestamp.and_then(seconds)))
            }
        }
    }
}

/// Seconds; `None` if the time was left at zero.
fn seconds(time: Timestamp) -> Option<f64> {
    let is_set = time.sec() != 0 || time.nsec() != 0;
    is_set.then(|| f64::from(time.sec()) + 1e-9 * f64::from(time.nsec()))
}

/// An image with its times in seconds.
pub(crate) struct TimedImage {
    /// In the format that all have.
    pub(crate) bytes: Vec<u8>,
    /// When it was taken.
    pub(crate) time_s: f64,
    /// When it was recorded.
    pub(crate) arrival_s: f64,
}

/// The next image, or an image that cannot be used with the reason; others may follow.
pub(crate) type NextImage = Result<TimedImage, anyhow::Error>;

/// The images of a topic that are still to be read.
pub(crate) struct Images {
    path: PathBuf,
    topic: String,
    range: FrameRange,
    messages: Messages,
    /// Width and height of all images in pixels, and their format.
    size_px: (usize, usize),
    format: PixelFormat,
    /// The next message, and how many precede it.
    next: Option<Message<'static>>,
    number: usize,
    taken: usize,
    /// Whether an error ended the recording.
    has_ended: bool,
    /// The number of images, if the recording states it.
    count: Option<usize>,
    /// When the first was taken, and when the recording ends on the same clock, in seconds.
    span_s: Option<(f64, f64)>,
}

impl Images {
    /// Opens the images of a topic, or of the only topic with images. The first that can be used determines the size of all.
    pub(crate) fn open(path: &Path, topic: Option<&str>, range: FrameRange) -> Result<Self> {
        let in_file = |message: String| user_error!("{}: {message}", path.shown());
        let summary = summary(path);
        let channels = channels(path, summary.as_ref()).map_err(in_file)?;
        let topic = find(&channels, topic).map_err(in_file)?;
        let mut images = Self {
            path: path.to_owned(),
            topic,
            range,
            messages: Messages::open(path).map_err(in_file)?,
            size_px: (0, 0),
            format: PixelFormat::Rgb8,
            next: None,
            number: 0,
            taken: 0,
            has_ended: false,
            count: None,
            span_s: None,
        };
        let statistics = summary.and_then(|summary| summary.statistics);
        let count = statistics.as_ref().and_then(|statistics| {
            let counts = &statistics.channel_message_counts;
            let here = channels
                .iter()
                .filter(|channel| channel.topic == images.topic);
            let count: u64 = here.filter_map(|channel| counts.get(&channel.id)).sum();
            usize::try_from(count).ok()
        });
        let mut why = None;
        let ((pixels, first_s), log_time) = loop {
            let Some(message) = images.next_message()? else {
                let why = why.unwrap_or_else(|| "has no messages".to_owned());
                return Err(user_error!("{}: {why}", images.name()));
            };
            match read(&message) {
                Ok(first) => {
                    let log_time = message.log_time;
                    images.next = Some(message);
                    break (first, log_time);
                }
                Err(error) => why.get_or_insert(error),
            };
        };
        (images.size_px, images.format) = (pixels.size_px, pixels.format);
        images.count = count.map(|count| range.count_of(count));
        // The clock of the recording may be another than that of the images.
        let rest_s = |end_ns: u64| 1e-9 * end_ns.saturating_sub(log_time) as f64;
        images.span_s = statistics.map(|s| (first_s, first_s + rest_s(s.message_end_time)));
        // Those before it are broken, and told of when their turn comes.
        if images.number > 1 {
            images.messages = Messages::open(path).map_err(in_file)?;
            images.next = None;
        }
        images.number = 0;
        Ok(images)
    }

    /// Returns the width and height of all images in pixels, and their format.
    pub(crate) fn format(&self) -> ((usize, usize), PixelFormat) {
        (self.size_px, self.format)
    }

    /// Returns the number of images, if the recording states it.
    pub(crate) fn frame_count(&self) -> Option<usize> {
        self.count
    }

    /// Returns the times of the first image and of the end of the recording in seconds, if it states the latter.
    pub(crate) fn span_s(&self) -> Option<(f64, f64)> {
        self.span_s
    }

    /// Returns the recording and the topic, for messages.
    pub(crate) fn name(&self) -> String {
        format!("{}, topic {}", self.path.shown(), self.topic)
    }

    /// Returns the next message of the topic.
    fn next_message(&mut self) -> Result<Option<Message<'static>>> {
        if let Some(message) = self.next.take() {
            self.number += 1;
            return Ok(Some(message));
        }
        while let Some(message) = self.messages.next() {
            let message = message.map_err(|error| user_error!("{}: {error}", self.path.shown()))?;
            if message.channel.topic == self.topic {
                self.number += 1;
                return Ok(Some(message));
            }
        }
        Ok(None)
    }

    /// Returns the image in a message.
    fn image_in(&self, message: &Message) -> NextImage {
        let in_message = |error: String| {
            let recorded_s = 1e-9 * message.log_time as f64;
            user_error!("{}, recorded at {recorded_s} s: {error}", self.name())
        };
        let (pixels, time_s) = read(message).map_err(in_message)?;
        if (pixels.size_px, pixels.format) != self.format() {
            let ((width, height), (now_width, now_height)) = (self.size_px, pixels.size_px);
            return Err(in_message(format!(
                "is {now_width} x {now_height} pixels ({:?}) where the first image is {width} x {height} ({:?}); all images must be alike",
                pixels.format, self.format
            )));
        }
        Ok(TimedImage {
            bytes: pixels.bytes,
            time_s,
            arrival_s: 1e-9 * message.log_time as f64,
        })
    }
}

impl Iterator for Images {
    /// An error ends the recording.
    type Item = Result<NextImage>;

    fn next(&mut self) -> Option<Self::Item> {
        while !self.has_ended && self.range.limit.is_none_or(|limit| self.taken < limit) {
            match self.next_message() {
                Ok(Some(message)) => {
                    if self.range.takes(self.number - 1) {
                        self.taken += 1;
                        return Some(Ok(self.image_in(&message)));
                    }
                }
                Ok(None) => return None,
                Err(error) => {
                    self.has_ended = true;
                    return Some(Err(error));
                }
            }
        }
        None
    }
}

/// Reads the image in a message, with the time when it was taken in seconds, or else recorded.
fn read(message: &Message) -> Result<(Pixels, f64), String> {
    let kind = Kind::of(&message.channel).ok_or("is no image")?;
    let (pixels, time_s) = kind.read(&message.data)?;
    Ok((pixels, time_s.unwrap_or(1e-9 * message.log_time as f64)))
}

/// Returns the topics with images of a recording, of which there is at least one.
pub(super) fn topics(path: &Path) -> Result<Vec<String>, String> {
    let channels = channels(path, summary(path).as_ref())?;
    match &topics_of(&channels)[..] {
        // The error says what there is.
        [] => find(&channels, None).map(|topic| vec![topic]),
        topics => Ok(topics.iter().map(|&topic| topic.to_owned()).collect()),
    }
}

/// Returns the topics with images in alphabetical order.
fn topics_of<'c>(channels: &'c [Arc<Channel<'static>>]) -> Vec<&'c str> {
    let is_image = |channel: &&Arc<Channel>| Kind::of(channel).is_some();
    let topics: BTreeSet<&str> = channels
        .iter()
        .filter(is_image)
        .map(|c| &*c.topic)
        .collect();
    topics.into_iter().collect()
}

/// Finds a topic with images, or the only one.
fn find(channels: &[Arc<Channel<'static>>], topic: Option<&str>) -> Result<String, String> {
    let with_images = topics_of(channels);
    let kinds = |channels: &[&Arc<Channel>]| {
        let kinds = channels.iter().map(|channel| {
            let (encoding, schema) = kind_of(channel);
            format!("{}: {schema} ({encoding})", channel.topic)
        });
        kinds.collect::<Vec<_>>().join(", ")
    };
    match (topic, &with_images[..]) {
        (Some(topic), _) if with_images.contains(&topic) => Ok(topic.to_owned()),
        (None, [only]) => Ok((*only).to_owned()),
        (None, []) => Err(format!(
            "has no topic with images; allowed: {KINDS}; its topics are {}",
            kinds(&channels.iter().collect::<Vec<_>>())
        )),
        (None, several) => Err(format!(
            "has several topics with images; give topic, one of {}",
            several.join(", ")
        )),
        (Some(topic), _) => {
            let here: Vec<_> = channels.iter().filter(|c| c.topic == topic).collect();
            let what = match &here[..] {
                [] => format!("has no topic {topic}"),
                here => format!("has no images in {}; allowed: {KINDS}", kinds(here)),
            };
            let with_images = match &with_images[..] {
                [] => "none".to_owned(),
                topics => topics.join(", "),
            };
            Err(format!("{what}; topics with images: {with_images}"))
        }
    }
}
