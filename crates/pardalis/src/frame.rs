//! One image in the camera's own pixel format.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use crate::color_space::YuvEncoding;
use pardalis_core::Error;
use pardalis_core::error::MAX_IMAGE_SIDE_PX;

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

/// Calls `$body` with `$components` bound to a closure from a pixel (x, y) of the frame to its three raw components, R, G, B or Y, U, V. The
/// format is matched once, outside of whatever loop `$body` is.
macro_rules! with_pixels {
    ($frame:expr, $components:ident => $body:expr) => {{
        let frame: &$crate::Frame = $frame;
        let bytes = frame.bytes();
        let (width, height) = (frame.width(), frame.height());
        let chroma_width = width.div_ceil(2);
        match frame.format() {
            $crate::PixelFormat::Rgb8 => {
                let $components = |x: usize, y: usize| {
                    let i = 3 * (y * width + x);
                    [bytes[i], bytes[i + 1], bytes[i + 2]]
                };
                $body
            }
            $crate::PixelFormat::Yuyv => {
                let $components = |x: usize, y: usize| {
                    let i = 4 * (y * chroma_width + x / 2);
                    [bytes[i + 2 * (x % 2)], bytes[i + 1], bytes[i + 3]]
                };
                $body
            }
            $crate::PixelFormat::Uyvy => {
                let $components = |x: usize, y: usize| {
                    let i = 4 * (y * chroma_width + x / 2);
                    [bytes[i + 1 + 2 * (x % 2)], bytes[i], bytes[i + 2]]
                };
                $body
            }
            $crate::PixelFormat::Nv12 => {
                let $components = |x: usize, y: usize| {
                    let c = width * height + 2 * ((y / 2) * chroma_width + x / 2);
                    [bytes[y * width + x], bytes[c], bytes[c + 1]]
                };
                $body
            }
            $crate::PixelFormat::I420 => {
                let v_plane = width * height + chroma_width * height.div_ceil(2);
                let $components = |x: usize, y: usize| {
                    let c = (y / 2) * chroma_width + x / 2;
                    [
                        bytes[y * width + x],
                        bytes[width * height + c],
                        bytes[v_plane + c],
                    ]
                };
                $body
            }
        }
    }};
}
pub(crate) use with_pixels;

/// The largest time stamp, in seconds, either way from zero: some 30 000 years, so that the square of a time is still a plain number.
pub const MAX_TIME_S: f64 = 1e12;

/// Returns an error for time stamps that are not finite, or beyond [`MAX_TIME_S`].
pub(crate) fn check_time(time_s: f64) -> Result<(), Error> {
    if time_s.abs() <= MAX_TIME_S {
        return Ok(());
    }
    let allowed = "-1e12 to 1e12 seconds";
    Err(Error::out_of_range("time_s", time_s, allowed))
}

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
        check_time(time_s)?;
        Ok(Self {
            format,
            encoding,
            width,
            height,
            bytes,
            time_s,
        })
    }

    /// Creates a frame from packed red, green and blue bytes, three per pixel, the top row first. `time_s` is the middle of the exposure.
    ///
    /// Errors: a size or number of bytes that does not fit, a time that is not finite.
    pub fn from_rgb(
        width: usize,
        height: usize,
        rgb: impl Into<Arc<[u8]>>,
        time_s: f64,
    ) -> Result<Self, Error> {
        let encoding = YuvEncoding::default();
        Self::new(PixelFormat::Rgb8, encoding, width, height, rgb, time_s)
    }

    /// The same image with another time stamp, in seconds; the pixels are shared.
    pub fn with_time_s(&self, time_s: f64) -> Result<Self, Error> {
        check_time(time_s)?;
        Ok(Self {
            time_s,
            ..self.clone()
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
        with_pixels!(self, components => components(x, y))
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

#[cfg(test)]
mod tests {
    use super::*;

    /// The same 3 x 2 picture, odd in width, in every YUV format: chroma is shared by pairs or by squares.
    #[test]
    fn components_of_every_format() {
        let y = [10, 20, 30, 40, 50, 60];
        let frame = |format, bytes: &[u8]| {
            Frame::new(format, YuvEncoding::default(), 3, 2, bytes, 0.0).unwrap()
        };
        let i420 = frame(PixelFormat::I420, &[&y[..], &[1, 2], &[3, 4]].concat());
        let nv12 = frame(PixelFormat::Nv12, &[&y[..], &[1, 3, 2, 4]].concat());
        let yuyv = frame(
            PixelFormat::Yuyv,
            &[10, 1, 20, 3, 30, 2, 0, 4, 40, 1, 50, 3, 60, 2, 0, 4],
        );
        let uyvy = frame(
            PixelFormat::Uyvy,
            &[1, 10, 3, 20, 2, 30, 4, 0, 1, 40, 3, 50, 2, 60, 4, 0],
        );
        for frame in [&i420, &nv12, &yuyv, &uyvy] {
            for (i, luma) in y.into_iter().enumerate() {
                let (column, row) = (i % 3, i / 3);
                let expected = [luma, [1, 1, 2][column], [3, 3, 4][column]];
                assert_eq!(
                    frame.components(column, row),
                    expected,
                    "{:?}",
                    frame.format()
                );
            }
        }
        let rgb = frame(PixelFormat::Rgb8, &(0..18).collect::<Vec<u8>>());
        assert_eq!(rgb.components(2, 1), [15, 16, 17]);
        assert_eq!(rgb.to_rgb8().len(), 18);
        assert_eq!(
            i420.to_rgb8()[..3],
            YuvEncoding::default().rgb8_from_yuv([10, 1, 3])
        );
    }

    #[test]
    fn frames_that_cannot_be_are_refused() {
        let new = |w, h, n, t| {
            Frame::new(
                PixelFormat::Rgb8,
                YuvEncoding::default(),
                w,
                h,
                vec![0; n],
                t,
            )
        };
        assert_eq!(
            new(2, 2, 11, 0.0).unwrap_err(),
            Error::ImageBytes {
                expected: 12,
                found: 11
            }
        );
        assert!(new(0, 2, 0, 0.0).is_err());
        assert!(new(60_000, 60_000, 3, 0.0).is_err());
        assert!(new(1, 1, 3, f64::NAN).is_err());
    }
}
