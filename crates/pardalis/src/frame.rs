//! One image in the camera's own pixel format.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use crate::Error;
use crate::color::YuvEncoding;

/// How the bytes of an image are laid out. Rows are tightly packed, the top row first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum PixelFormat {
    /// Red, green, blue: three bytes a pixel.
    Rgb8,
    /// Packed YUV 4:2:2, bytes `Y0 U Y1 V` for two pixels side by side.
    Yuyv,
    /// Packed YUV 4:2:2, bytes `U Y0 V Y1` for two pixels side by side.
    Uyvy,
    /// Planar YUV 4:2:0: a plane of Y, then one of alternating U and V at half size.
    Nv12,
    /// Planar YUV 4:2:0: a plane of Y, then one of U and one of V at half size.
    I420,
}

impl PixelFormat {
    /// The number of bytes of an image of this size; odd sizes round chroma up.
    pub fn byte_count(self, width: usize, height: usize) -> usize {
        let chroma_width = width.div_ceil(2);
        match self {
            Self::Rgb8 => 3 * width * height,
            Self::Yuyv | Self::Uyvy => 4 * chroma_width * height,
            Self::Nv12 | Self::I420 => width * height + 2 * chroma_width * height.div_ceil(2),
        }
    }
}

/// The largest image width or height that is taken, in pixels: image offsets then fit in 31 bits.
pub const MAX_IMAGE_SIDE_PX: usize = 16_384;

/// One image with its time stamp. Cloning shares the pixels.
#[derive(Debug, Clone)]
pub struct Frame {
    format: PixelFormat,
    /// What the numbers of a YUV image mean; ignored for RGB.
    encoding: YuvEncoding,
    width: usize,
    height: usize,
    bytes: Arc<[u8]>,
    time_s: f64,
}

impl Frame {
    /// Takes the bytes of an image. `time_s` is the middle of its exposure.
    ///
    /// `encoding` says which YUV the numbers of a YUV format are; RGB frames ignore it.
    pub fn new(
        format: PixelFormat,
        encoding: YuvEncoding,
        width: usize,
        height: usize,
        bytes: impl Into<Arc<[u8]>>,
        time_s: f64,
    ) -> Result<Self, Error> {
        let bytes = bytes.into();
        if !(1..=MAX_IMAGE_SIDE_PX).contains(&width) || !(1..=MAX_IMAGE_SIDE_PX).contains(&height) {
            return Err(Error::ImageSize { width, height });
        }
        let expected = format.byte_count(width, height);
        if bytes.len() != expected {
            return Err(Error::ImageBytes {
                expected,
                found: bytes.len(),
            });
        }
        if !time_s.is_finite() {
            return Err(Error::out_of_range(
                "time_s",
                time_s,
                "a finite number of seconds",
            ));
        }
        Ok(Self {
            format,
            encoding,
            width,
            height,
            bytes,
            time_s,
        })
    }

    /// The layout of [`Frame::bytes`].
    pub fn format(&self) -> PixelFormat {
        self.format
    }

    /// The matrix and range of a YUV frame.
    pub fn encoding(&self) -> YuvEncoding {
        self.encoding
    }

    /// Width in pixels.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Height in pixels.
    pub fn height(&self) -> usize {
        self.height
    }

    /// The middle of the exposure, in seconds.
    pub fn time_s(&self) -> f64 {
        self.time_s
    }

    /// The pixels in the camera's own format.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// The three raw components of one pixel: R, G, B or Y, U, V, nothing converted.
    ///
    /// Panics when the pixel lies outside the image.
    #[inline]
    pub fn components(&self, x: usize, y: usize) -> [u8; 3] {
        assert!(
            x < self.width && y < self.height,
            "pixel ({x}, {y}) lies outside the image"
        );
        let bytes = &*self.bytes;
        let (w, h) = (self.width, self.height);
        let cw = w.div_ceil(2);
        match self.format {
            PixelFormat::Rgb8 => {
                let i = 3 * (y * w + x);
                [bytes[i], bytes[i + 1], bytes[i + 2]]
            }
            PixelFormat::Yuyv => {
                let i = 4 * (y * cw + x / 2);
                [bytes[i + 2 * (x % 2)], bytes[i + 1], bytes[i + 3]]
            }
            PixelFormat::Uyvy => {
                let i = 4 * (y * cw + x / 2);
                [bytes[i + 1 + 2 * (x % 2)], bytes[i], bytes[i + 2]]
            }
            PixelFormat::Nv12 => {
                let c = w * h + 2 * ((y / 2) * cw + x / 2);
                [bytes[y * w + x], bytes[c], bytes[c + 1]]
            }
            PixelFormat::I420 => {
                let c = w * h + (y / 2) * cw + x / 2;
                [bytes[y * w + x], bytes[c], bytes[c + cw * h.div_ceil(2)]]
            }
        }
    }

    /// One pixel as red, green and blue, for pictures that people look at.
    pub fn rgb(&self, x: usize, y: usize) -> [u8; 3] {
        let components = self.components(x, y);
        match self.format {
            PixelFormat::Rgb8 => components,
            _ => self.encoding.rgb8_from_yuv(components),
        }
    }

    /// The whole image as packed RGB, for pictures that people look at.
    pub fn to_rgb8(&self) -> Vec<u8> {
        if self.format == PixelFormat::Rgb8 {
            return self.bytes.to_vec();
        }
        let mut rgb = Vec::with_capacity(3 * self.width * self.height);
        for y in 0..self.height {
            for x in 0..self.width {
                rgb.extend_from_slice(&self.rgb(x, y));
            }
        }
        rgb
    }
}
