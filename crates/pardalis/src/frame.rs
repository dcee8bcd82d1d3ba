//! A camera image in its native pixel format.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use crate::color_space::YuvEncoding;
use pardalis_core::Error;
use pardalis_core::error::MAX_IMAGE_SIDE_PX;

/// Memory layout of the bytes of an image. Rows are tightly packed, the top row first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum PixelFormat {
    /// Red, green, blue: three bytes per pixel.
    Rgb8,
    /// Packed YUV 4:2:2: bytes `Y0 U Y1 V` for two horizontally adjacent pixels.
    Yuyv,
    /// Packed YUV 4:2:2: bytes `U Y0 V Y1` for two horizontally adjacent pixels.
    Uyvy,
    /// Semi-planar YUV 4:2:0: a plane of Y, then one of interleaved U and V at half size.
    Nv12,
    /// Planar YUV 4:2:0: a plane of Y, then one of U and one of V at half size.
    I420,
}

impl PixelFormat {
    /// Returns the number of bytes of an image; odd sizes round chroma up.
    pub fn byte_count(self, width: usize, height: usize) -> usize {
        let chroma_width = width.div_ceil(2);
        match self {
            Self::Rgb8 => 3 * width * height,
            Self::Yuyv | Self::Uyvy => 4 * chroma_width * height,
            Self::Nv12 | Self::I420 => width * height + 2 * chroma_width * height.div_ceil(2),
        }
    }
}

/// Runs `$body` with `$components` bound to a closure from a pixel (x, y) of the frame to its three raw
/// components (R, G, B or Y, U, V). The format is matched once, outside of any loop in `$body`.
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

/// The first, second and third components of pixels of a row, apart: loops over them are vectorised. Its memory is kept.
#[derive(Debug, Clone, Default)]
pub(crate) struct Row([Vec<u8>; 3]);

impl Row {
    /// The components, equally many of each.
    #[inline(always)]
    pub(crate) fn components(&self) -> [&[u8]; 3] {
        self.0.each_ref().map(Vec::as_slice)
    }

    #[inline(always)]
    pub(crate) fn components_mut(&mut self) -> [&mut [u8]; 3] {
        self.0.each_mut().map(Vec::as_mut_slice)
    }

    /// Reads every `step_px`th pixel of row `y` of a frame.
    #[inline(always)]
    pub(crate) fn sample(&mut self, frame: &Frame, y: usize, step_px: usize) {
        if step_px == 1 {
            self.read(frame, y);
            return;
        }
        let count = frame.width.div_ceil(step_px);
        self.0
            .iter_mut()
            .for_each(|of_component| of_component.resize(count, 0));
        let [first, second, third] = self.components_mut();
        with_pixels!(frame, components => {
            let pixels = first.iter_mut().zip(second).zip(third).enumerate();
            for (i, ((first, second), third)) in pixels {
                [*first, *second, *third] = components(i * step_px, y);
            }
        });
    }

    /// Reads row `y` of a frame.
    #[inline(always)]
    pub(crate) fn read(&mut self, frame: &Frame, y: usize) {
        let (width, height, bytes) = (frame.width, frame.height, frame.bytes());
        // Nothing happens if they have this length.
        self.0
            .iter_mut()
            .for_each(|of_component| of_component.resize(width, 0));
        let [first, second, third] = self.components_mut();
        let chroma_width = width.div_ceil(2);
        let twice = |from: &[u8], to: &mut [u8]| {
            for (to, from) in to.chunks_mut(2).zip(from) {
                to.fill(*from);
            }
        };
        match frame.format {
            PixelFormat::Rgb8 => {
                let pixels = bytes[3 * width * y..].chunks_exact(3);
                for (((first, second), third), pixel) in
                    first.iter_mut().zip(second).zip(third).zip(pixels)
                {
                    [*first, *second, *third] = [pixel[0], pixel[1], pixel[2]];
                }
            }
            PixelFormat::I420 => {
                first.copy_from_slice(&bytes[width * y..][..width]);
                let chroma = width * height + chroma_width * (y / 2);
                twice(&bytes[chroma..][..chroma_width], second);
                let chroma = chroma + chroma_width * height.div_ceil(2);
                twice(&bytes[chroma..][..chroma_width], third);
            }
            PixelFormat::Yuyv | PixelFormat::Uyvy | PixelFormat::Nv12 => {
                with_pixels!(frame, components => for x in 0..width {
                    [first[x], second[x], third[x]] = components(x, y);
                });
            }
        }
    }
}

/// The largest absolute time stamp in seconds, some 30 000 years, so that the square of a time is exact
/// enough.
pub const MAX_TIME_S: f64 = 1e12;

/// Returns an error for time stamps that are not finite or lie beyond [`MAX_TIME_S`].
pub(crate) fn check_time(time_s: f64) -> Result<(), Error> {
    if time_s.abs() <= MAX_TIME_S {
        return Ok(());
    }
    let allowed = "-1e12 to 1e12 seconds";
    Err(Error::out_of_range("time_s", time_s, allowed))
}

/// A time-stamped image. Cloning shares the pixels.
#[derive(Debug, Clone)]
pub struct Frame {
    format: PixelFormat,
    /// Meaning of the numbers of a YUV image; ignored for RGB.
    encoding: YuvEncoding,
    width: usize,
    height: usize,
    bytes: Arc<[u8]>,
    time_s: f64,
}

impl Frame {
    /// Creates a frame from the bytes of an image. `time_s` is the middle of the exposure in seconds;
    /// `encoding` is the encoding of a YUV format and is ignored for RGB.
    ///
    /// # Errors
    ///
    /// The size is zero or does not fit the number of bytes, or the time is not within ±[`MAX_TIME_S`].
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

    /// Creates a frame from packed red, green and blue bytes, three per pixel, the top row first. `time_s` is
    /// the middle of the exposure.
    ///
    /// # Errors
    ///
    /// The size and the number of bytes do not match, or the time is not finite.
    pub fn from_rgb(
        width: usize,
        height: usize,
        rgb: impl Into<Arc<[u8]>>,
        time_s: f64,
    ) -> Result<Self, Error> {
        let encoding = YuvEncoding::default();
        Self::new(PixelFormat::Rgb8, encoding, width, height, rgb, time_s)
    }

    /// Returns the same image with another time stamp, in seconds. The pixels are shared.
    ///
    /// # Errors
    ///
    /// The time is not finite.
    pub fn with_time_s(&self, time_s: f64) -> Result<Self, Error> {
        check_time(time_s)?;
        Ok(Self {
            time_s,
            ..self.clone()
        })
    }

    /// Returns the layout of [`Frame::bytes`].
    pub fn format(&self) -> PixelFormat {
        self.format
    }

    /// Returns the matrix and range of a YUV frame.
    pub fn encoding(&self) -> YuvEncoding {
        self.encoding
    }

    /// Returns the width in pixels.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Returns the height in pixels.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Returns the middle of the exposure in seconds.
    pub fn time_s(&self) -> f64 {
        self.time_s
    }

    /// Returns the pixels in the camera's native format.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// Returns the three raw components of a pixel: R, G, B or Y, U, V, without conversion.
    ///
    /// # Panics
    ///
    /// The pixel lies outside the image.
    #[inline]
    pub fn components(&self, x: usize, y: usize) -> [u8; 3] {
        assert!(
            x < self.width && y < self.height,
            "pixel ({x}, {y}) lies outside the image"
        );
        with_pixels!(self, components => components(x, y))
    }

    /// Returns a pixel as red, green and blue, for display.
    pub fn rgb(&self, x: usize, y: usize) -> [u8; 3] {
        let components = self.components(x, y);
        match self.format {
            PixelFormat::Rgb8 => components,
            _ => self.encoding.rgb8_from_yuv(components),
        }
    }

    /// Converts the image to packed RGB, for display.
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

    /// The same 3 x 2 picture, odd in width, in every YUV format. Chroma is shared by pairs or 2 x 2 blocks
    /// of pixels.
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
        let mut row = Row::default();
        for frame in [&i420, &nv12, &yuyv, &uyvy] {
            for (i, luma) in y.into_iter().enumerate() {
                let (column, y) = (i % 3, i / 3);
                let expected = [luma, [1, 1, 2][column], [3, 3, 4][column]];
                assert_eq!(
                    frame.components(column, y),
                    expected,
                    "{:?}",
                    frame.format()
                );
                row.read(frame, y);
                let in_row = row.components().map(|of_component| of_component[column]);
                assert_eq!(in_row, expected, "{:?}", frame.format());
            }
        }
        let rgb = frame(PixelFormat::Rgb8, &(0..18).collect::<Vec<u8>>());
        assert_eq!(rgb.components(2, 1), [15, 16, 17]);
        row.read(&rgb, 1);
        assert_eq!(row.components(), [[9, 12, 15], [10, 13, 16], [11, 14, 17]]);
        assert_eq!(rgb.to_rgb8().len(), 18);
        assert_eq!(
            i420.to_rgb8()[..3],
            YuvEncoding::default().rgb8_from_yuv([10, 1, 3])
        );
    }

    #[test]
    fn invalid_frames_are_rejected() {
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
