//! Images that are drawn into: conversion to and from canvases, and files.

use std::path::Path;

use pardalis::Frame;
use pardalis_images::{EncodeError, JpegSampling, RgbImage, encode_jpeg, encode_png};
use tiny_skia::{Color, Pixmap};

use super::Rgb;
use crate::files::write_file;
use crate::output::Shown;
use crate::user_error::user_error;

const JPEG_QUALITY: u8 = 90;

/// Returns the pixels of a frame, to draw on.
pub(crate) fn picture_of(frame: &Frame) -> RgbImage {
    RgbImage::from_raw(frame.width() as u32, frame.height() as u32, frame.to_rgb8())
        .expect("three bytes per pixel")
}

/// Returns a picture as the bytes of a JPEG file.
#[cfg(any(feature = "mcap", feature = "studio"))]
pub(crate) fn jpeg_of(picture: &RgbImage) -> anyhow::Result<Vec<u8>> {
    Ok(encode_jpeg(picture, JPEG_QUALITY, JpegSampling::Automatic)?)
}

/// Writes a picture as JPEG or PNG, depending on the extension of the file's name.
pub(crate) fn write_picture(path: &Path, picture: &RgbImage) -> anyhow::Result<()> {
    let ending = path.extension().map(std::ffi::OsStr::to_ascii_lowercase);
    let bytes = match ending.as_ref().and_then(|e| e.to_str()) {
        Some("jpg" | "jpeg") => {
            let file = encode_jpeg(picture, JPEG_QUALITY, JpegSampling::Automatic);
            file.map_err(|error| match error {
                EncodeError::TooLarge(_) => {
                    user_error!("{}: {error}; write a .png", path.shown())
                }
                other => other.into(),
            })?
        }
        Some("png") => encode_png(picture)?,
        _ => {
            return Err(user_error!(
                "{}: pictures are written as .jpg, .jpeg or .png; give the file such a name",
                path.shown()
            ));
        }
    };
    write_file(path, &bytes)
}

/// Returns the picture as a canvas to draw on; `None` if it has no pixels.
pub(super) fn canvas_of(picture: &RgbImage) -> Option<Pixmap> {
    let mut canvas = Pixmap::new(picture.width(), picture.height())?;
    let pixels = canvas.data_mut().chunks_exact_mut(4);
    for (to, from) in pixels.zip(picture.pixels()) {
        to.copy_from_slice(&[from[0], from[1], from[2], 255]);
    }
    Some(canvas)
}

/// Returns the pixels of an opaque canvas.
pub(super) fn picture_from(canvas: &Pixmap) -> RgbImage {
    let (pixels, _) = canvas.data().as_chunks::<4>();
    let mut samples = Vec::with_capacity(3 * pixels.len());
    for [rgb @ .., _] in pixels {
        samples.extend_from_slice(rgb);
    }
    RgbImage::from_raw(canvas.width(), canvas.height(), samples).expect("three bytes per pixel")
}

/// Returns an opaque colour for a canvas.
pub(super) fn opaque([r, g, b]: Rgb) -> Color {
    Color::from_rgba8(r, g, b, 255)
}
