//! Images in memory: decoding and encoding JPEG and PNG, and resizing.
//!
//! An [`Image`] is a grid of pixels with interleaved channels, row by row from the top left. Colours are the bytes
//! of the file; embedded colour profiles and gamma are ignored, and alpha is dropped. The EXIF orientation of JPEG files is respected.
//!
//! ```
//! use pardalis_images::{RgbImage, decode, encode_png};
//!
//! let image = RgbImage::from_fn(4, 2, |x, y| [10 * x as u8, 20 * y as u8, 255]);
//! let file = encode_png(&image)?;
//! assert_eq!(decode(&file)?, image);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod decode;
mod encode;
mod exif;
mod from_png;
mod image;
mod resize;

pub use decode::{
    DecodeError, MAX_PIXELS, MAX_SIDE_PX, decode, decode_grey, exif_focal_length_px, size,
};
pub use encode::{EncodeError, JpegSampling, encode_jpeg, encode_png};
pub use image::{GrayImage, Image, RgbImage};
