//! What the node subscribes to.

use anyhow::Result;
use pardalis::Frame;
use pardalis::color::YuvEncoding;
use pardalis::tracker::ImageBox;
use pardalis_cli::ros2::{CameraInfo, CompressedImage, Image};
use ros2_client::{MessageTypeName, Name, Node, QosProfile, Subscription};
use rustdds::mio1::event::Source;
use rustdds::mio1::{Interest, Registry, Token};

use crate::discovery::{COMPRESSED_IMAGE, DETECTIONS, IMAGE, Kind};
use crate::messages::{BoundingBox2D, Detection2D, Detection2DArray, Odometry, Time};

/// A subscription to the images of a camera, or to what a detector found in them.
pub(crate) enum Messages {
    Raw(Subscription<Image>),
    Compressed(Subscription<CompressedImage>),
    Boxes(Subscription<Detection2DArray>),
}

/// An image that has not been decoded, or what a detector found in one.
pub(crate) enum Received {
    Raw(Image),
    Compressed(CompressedImage),
    Boxes(Detection2DArray),
}

/// What is in a message.
pub(crate) enum Content {
    Frame(Frame),
    Boxes(Vec<ClassBox>),
}

/// A box that a detector found.
pub(crate) struct ClassBox {
    pub(crate) class: String,
    pub(crate) image_box: ImageBox,
}

/// Splits a topic into its namespace and its name.
pub(crate) fn name_of(topic: &str) -> Result<Name> {
    let topic = format!("/{}", topic.trim_start_matches('/'));
    let (namespace, name) = topic.rsplit_once('/').unwrap_or(("", &topic));
    let namespace = if namespace.is_empty() { "/" } else { namespace };
    Ok(Name::new(namespace, name)?)
}

/// Subscribes to a topic of a type of `sensor_msgs` or another package.
pub(crate) fn subscribe<M: 'static>(
    node: &mut Node,
    topic: &str,
    (package, message): Kind,
    qos: &QosProfile,
) -> Result<Subscription<M>> {
    let topic = node.create_topic(
        &name_of(topic)?,
        MessageTypeName::new(package, message),
        qos,
    )?;
    Ok(node.create_subscription(&topic, None)?)
}

impl Messages {
    /// Subscribes to a topic of images, which are compressed if its name says so.
    pub(crate) fn images(node: &mut Node, topic: &str, qos: &QosProfile) -> Result<Self> {
        if topic.ends_with("/compressed") {
            let images = subscribe(node, topic, COMPRESSED_IMAGE, qos)?;
            return Ok(Self::Compressed(images));
        }
        Ok(Self::Raw(subscribe(node, topic, IMAGE, qos)?))
    }

    /// Subscribes to what a detector finds in the images of a camera.
    pub(crate) fn boxes(node: &mut Node, topic: &str, qos: &QosProfile) -> Result<Self> {
        Ok(Self::Boxes(subscribe(node, topic, DETECTIONS, qos)?))
    }

    /// Returns what the messages are.
    pub(crate) fn kind(&self) -> Kind {
        match self {
            Self::Raw(_) => IMAGE,
            Self::Compressed(_) => COMPRESSED_IMAGE,
            Self::Boxes(_) => DETECTIONS,
        }
    }

    /// Wakes the event loop when there is a message.
    pub(crate) fn register(&mut self, registry: &Registry, token: Token) -> std::io::Result<()> {
        match self {
            Self::Raw(images) => images.register(registry, token, Interest::READABLE),
            Self::Compressed(images) => images.register(registry, token, Interest::READABLE),
            Self::Boxes(boxes) => boxes.register(registry, token, Interest::READABLE),
        }
    }

    /// Returns the next message, if there is one; damaged ones are left out.
    pub(crate) fn take(&self) -> Option<Received> {
        match self {
            Self::Raw(images) => next(images).map(Received::Raw),
            Self::Compressed(images) => next(images).map(Received::Compressed),
            Self::Boxes(boxes) => next(boxes).map(Received::Boxes),
        }
    }
}

/// Returns the next message; damaged ones are left out.
pub(crate) fn next<M: serde::de::DeserializeOwned + 'static>(
    messages: &Subscription<M>,
) -> Option<M> {
    loop {
        match messages.take() {
            Ok(Some((message, _))) => return Some(message),
            Ok(None) => return None,
            Err(_) => {}
        }
    }
}

impl Received {
    /// Returns its stamp, which may be zero.
    pub(crate) fn stamp(&self) -> Time {
        let (sec, nanosec) = match self {
            Self::Raw(image) => (image.stamp().sec, image.stamp().nanosec),
            Self::Compressed(image) => (image.stamp().sec, image.stamp().nanosec),
            Self::Boxes(boxes) => (boxes.header.stamp.sec, boxes.header.stamp.nanosec),
        };
        Time { sec, nanosec }
    }

    /// Returns the image as a frame of this time, or the boxes.
    pub(crate) fn content(&self, time_s: f64) -> Result<Content, String> {
        let pixels = match self {
            Self::Raw(image) => image.pixels()?,
            Self::Compressed(image) => image.pixels()?,
            Self::Boxes(boxes) => {
                let boxes = boxes.detections.iter().filter_map(ClassBox::of);
                return boxes.collect::<Result<_, _>>().map(Content::Boxes);
            }
        };
        let (width, height) = pixels.size_px;
        let encoding = YuvEncoding::default();
        let frame = Frame::new(pixels.format, encoding, width, height, pixels.bytes, time_s);
        frame.map(Content::Frame).map_err(|error| error.to_string())
    }
}

impl ClassBox {
    /// Returns the box of a detection with its likeliest class; `None` without a class.
    fn of(detection: &Detection2D) -> Option<Result<Self, String>> {
        let classes = detection.results.iter().map(|result| &result.hypothesis);
        let likeliest = classes.max_by(|a, b| a.score.total_cmp(&b.score))?;
        let BoundingBox2D {
            center: [u, v],
            theta,
            size: [width, height],
        } = detection.bbox;
        if theta != 0.0 {
            return Some(Err(format!(
                "a box is turned by {theta} radians; allowed: 0"
            )));
        }
        // They count from the corner of the first pixel, as in Pardalis from its centre.
        let (left, top) = (u - 0.5 - width / 2.0, v - 0.5 - height / 2.0);
        let image_box = ImageBox::new([left, top, left + width, top + height])
            .and_then(|image_box| image_box.with_score(likeliest.score));
        let class = likeliest.class_id.clone();
        let found = image_box.map(|image_box| Self { class, image_box });
        Some(found.map_err(|error| error.to_string()))
    }
}

impl Time {
    pub(crate) const ZERO: Self = Self { sec: 0, nanosec: 0 };

    pub(crate) fn nanoseconds(self) -> i64 {
        i64::from(self.sec) * 1_000_000_000 + i64::from(self.nanosec)
    }

    pub(crate) fn of_nanoseconds(ns: i64) -> Self {
        Self {
            sec: ns.div_euclid(1_000_000_000) as i32,
            nanosec: ns.rem_euclid(1_000_000_000) as u32,
        }
    }

    pub(crate) fn seconds(self) -> f64 {
        f64::from(self.sec) + 1e-9 * f64::from(self.nanosec)
    }
}

/// Calibrations of a camera, and the motion of a platform.
pub(crate) type Calibrations = Subscription<CameraInfo>;
pub(crate) type Motion = Subscription<Odometry>;
