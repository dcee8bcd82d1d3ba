//! Messages of ROS 2 in the encoding CDR, as `sensor_msgs` defines them, with the methods that its programs need.

use std::io::{self, Read as _};

use cdr_encoding::from_bytes;
use serde::Deserialize;
use serde::de::DeserializeOwned;

use super::camera_info::Info;
use super::pixels::{Pixels, compressed, raw};

/// `builtin_interfaces/Time`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
pub struct Time {
    /// Seconds since 1970.
    pub sec: i32,
    /// Nanoseconds beyond.
    pub nanosec: u32,
}

impl Time {
    /// Seconds since 1970; `None` if it was left at zero.
    pub fn seconds(&self) -> Option<f64> {
        let is_set = self.sec != 0 || self.nanosec != 0;
        is_set.then(|| f64::from(self.sec) + 1e-9 * f64::from(self.nanosec))
    }
}

/// `std_msgs/Header`.
#[derive(Debug, Deserialize)]
struct Header {
    stamp: Time,
    _frame_id: String,
}

/// `sensor_msgs/Image`.
#[derive(Debug, Deserialize)]
pub struct Image {
    header: Header,
    height: u32,
    width: u32,
    encoding: String,
    _is_bigendian: u8,
    step: u32,
    #[serde(with = "serde_bytes")]
    data: Vec<u8>,
}

impl Image {
    /// Returns when it was taken.
    pub fn stamp(&self) -> Time {
        self.header.stamp
    }

    /// Returns its pixels.
    ///
    /// # Errors
    ///
    /// It has another encoding than those that are supported, or too few bytes.
    pub fn pixels(&self) -> Result<Pixels, String> {
        let size_px = (self.width, self.height);
        raw(size_px, self.step, &self.encoding, &self.data)
    }
}

/// `sensor_msgs/CompressedImage`.
#[derive(Debug, Deserialize)]
pub struct CompressedImage {
    header: Header,
    _format: String,
    #[serde(with = "serde_bytes")]
    data: Vec<u8>,
}

impl CompressedImage {
    /// Returns when it was taken.
    pub fn stamp(&self) -> Time {
        self.header.stamp
    }

    /// Decodes it.
    ///
    /// # Errors
    ///
    /// It is no complete JPEG or PNG image.
    pub fn pixels(&self) -> Result<Pixels, String> {
        compressed(&self.data)
    }
}

/// `sensor_msgs/CameraInfo`.
#[derive(Debug, Deserialize)]
pub struct CameraInfo {
    _header: Header,
    pub(super) height: u32,
    pub(super) width: u32,
    pub(super) distortion_model: String,
    pub(super) d: Vec<f64>,
    pub(super) k: [f64; 9],
    pub(super) r: [f64; 9],
    pub(super) p: [f64; 12],
    pub(super) binning_x: u32,
    pub(super) binning_y: u32,
    pub(super) roi: RegionOfInterest,
}

impl CameraInfo {
    /// Returns the text of a calibration file of ROS, with a camera of this name.
    pub fn text(&self, name: &str) -> String {
        self.info().text(name)
    }

    pub(super) fn info(&self) -> Info {
        let roi = &self.roi;
        Info {
            size_px: [self.width, self.height],
            distortion_model: self.distortion_model.clone(),
            d: self.d.clone(),
            k: self.k.to_vec(),
            r: self.r.to_vec(),
            p: self.p.to_vec(),
            binning: [self.binning_x, self.binning_y],
            region: [roi.x_offset, roi.y_offset, roi.height, roi.width],
        }
    }
}

/// `sensor_msgs/RegionOfInterest`.
#[derive(Debug, Deserialize)]
pub(super) struct RegionOfInterest {
    pub(super) x_offset: u32,
    pub(super) y_offset: u32,
    pub(super) height: u32,
    pub(super) width: u32,
    _do_rectify: bool,
}

/// Maximum size of a message in bytes: more than the largest image takes.
const MAX_MESSAGE_BYTES: u64 = 256 << 20;

/// Reads a message. Its first four bytes say in which order those of numbers are; rosbag2 compresses single messages without a word in the recording.
pub(super) fn read<T: DeserializeOwned>(data: &[u8]) -> Result<T, String> {
    if data.starts_with(&[0x28, 0xB5, 0x2F, 0xFD]) {
        let damaged = |error: io::Error| format!("the compressed message is damaged: {error}");
        let mut message = Vec::new();
        let decoder = zstd::Decoder::new(data).map_err(damaged)?;
        let mut decoder = decoder.take(MAX_MESSAGE_BYTES);
        decoder.read_to_end(&mut message).map_err(damaged)?;
        return read_plain(&message);
    }
    read_plain(data)
}

fn read_plain<T: DeserializeOwned>(data: &[u8]) -> Result<T, String> {
    let (order, body) = data
        .split_first_chunk::<4>()
        .ok_or("the message is shorter than its header")?;
    let read = match order[..2] {
        [0, 0] => from_bytes::<T, byteorder::BigEndian>(body),
        [0, 1] => from_bytes::<T, byteorder::LittleEndian>(body),
        _ => {
            return Err(format!(
                "the message has the representation {order:?}; allowed: plain CDR, 0 0 or 0 1"
            ));
        }
    };
    match read {
        Ok((message, _)) => Ok(message),
        Err(error) => Err(format!("the message is damaged: {error}")),
    }
}
