//! Messages of ROS 2 in the encoding CDR, as `sensor_msgs` defines them.

use std::io::{self, Read as _};

use cdr_encoding::from_bytes;
use serde::Deserialize;
use serde::de::DeserializeOwned;

/// `builtin_interfaces/Time`.
#[derive(Deserialize)]
pub(super) struct Time {
    sec: i32,
    nanosec: u32,
}

impl Time {
    /// Seconds; `None` if it was left at zero.
    pub(super) fn seconds(&self) -> Option<f64> {
        let is_set = self.sec != 0 || self.nanosec != 0;
        is_set.then(|| f64::from(self.sec) + 1e-9 * f64::from(self.nanosec))
    }
}

/// `std_msgs/Header`.
#[derive(Deserialize)]
pub(super) struct Header {
    pub(super) stamp: Time,
    _frame_id: String,
}

/// `sensor_msgs/Image`.
#[derive(Deserialize)]
pub(super) struct Image {
    pub(super) header: Header,
    pub(super) height: u32,
    pub(super) width: u32,
    pub(super) encoding: String,
    _is_bigendian: u8,
    pub(super) step: u32,
    #[serde(with = "serde_bytes")]
    pub(super) data: Vec<u8>,
}

/// `sensor_msgs/CompressedImage`.
#[derive(Deserialize)]
pub(super) struct CompressedImage {
    pub(super) header: Header,
    _format: String,
    #[serde(with = "serde_bytes")]
    pub(super) data: Vec<u8>,
}

/// `sensor_msgs/CameraInfo`.
#[derive(Deserialize)]
pub(super) struct CameraInfo {
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

/// `sensor_msgs/RegionOfInterest`.
#[derive(Deserialize)]
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
