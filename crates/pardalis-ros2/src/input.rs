//! What the node subscribes to.

use anyhow::Result;
use pardalis::Frame;
use pardalis::color::YuvEncoding;
use pardalis_cli::ros2::{CameraInfo, CompressedImage, Image};
use ros2_client::{MessageTypeName, Name, Node, QosProfile, Subscription};
use rustdds::mio1::event::Source;
use rustdds::mio1::{Interest, Registry, Token};

use crate::clock;
use crate::messages::{Odometry, Time};

/// A subscription to the images of a camera.
pub(crate) enum Images {
    Raw(Subscription<Image>),
    Compressed(Subscription<CompressedImage>),
}

/// An image that has not been decoded.
pub(crate) enum Received {
    Raw(Image),
    Compressed(CompressedImage),
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
    (package, message): (&str, &str),
    qos: &QosProfile,
) -> Result<Subscription<M>> {
    let topic = node.create_topic(
        &name_of(topic)?,
        MessageTypeName::new(package, message),
        qos,
    )?;
    Ok(node.create_subscription(&topic, None)?)
}

impl Images {
    /// Subscribes to a topic of images, which are compressed if its name says so.
    pub(crate) fn subscribe(node: &mut Node, topic: &str, qos: &QosProfile) -> Result<Self> {
        if topic.ends_with("/compressed") {
            let kind = ("sensor_msgs", "CompressedImage");
            return Ok(Self::Compressed(subscribe(node, topic, kind, qos)?));
        }
        Ok(Self::Raw(subscribe(
            node,
            topic,
            ("sensor_msgs", "Image"),
            qos,
        )?))
    }

    /// Wakes the event loop when there is an image.
    pub(crate) fn register(&mut self, registry: &Registry, token: Token) -> std::io::Result<()> {
        match self {
            Self::Raw(images) => images.register(registry, token, Interest::READABLE),
            Self::Compressed(images) => images.register(registry, token, Interest::READABLE),
        }
    }

    /// Returns the next image, if there is one; damaged messages are left out.
    pub(crate) fn take(&self) -> Option<Received> {
        match self {
            Self::Raw(images) => next(images).map(Received::Raw),
            Self::Compressed(images) => next(images).map(Received::Compressed),
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
    /// Returns when it was taken, or received if it does not say so.
    pub(crate) fn stamp(&self) -> Time {
        let stamp = match self {
            Self::Raw(image) => image.stamp(),
            Self::Compressed(image) => image.stamp(),
        };
        if stamp.seconds().is_some() {
            return Time {
                sec: stamp.sec,
                nanosec: stamp.nanosec,
            };
        }
        clock::now()
    }

    /// Returns the image as a frame of this time.
    pub(crate) fn frame(&self, time_s: f64) -> Result<Frame, String> {
        let pixels = match self {
            Self::Raw(image) => image.pixels()?,
            Self::Compressed(image) => image.pixels()?,
        };
        let (width, height) = pixels.size_px;
        let encoding = YuvEncoding::default();
        let frame = Frame::new(pixels.format, encoding, width, height, pixels.bytes, time_s);
        frame.map_err(|error| error.to_string())
    }
}

impl Time {
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
