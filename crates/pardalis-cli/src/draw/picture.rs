//! Images that are drawn into: pixels in and out, text, files.

use std::path::Path;

use image::{ImageFormat, RgbImage};
use jpeg_encoder::{ColorType, Encoder};
use pardalis::Frame;
use resvg::tiny_skia::{Color, Pixmap, Transform};

use super::svg::{FONT_FAMILY, parsed};
use super::{Rgb, shortened};
use crate::files::write_file;
use crate::user_error::user_error;

const JPEG_QUALITY: u8 = 90;

/// The pixels of a frame, for drawing on.
pub(crate) fn picture_of(frame: &Frame) -> RgbImage {
    RgbImage::from_raw(frame.width() as u32, frame.height() as u32, frame.to_rgb8())
        .expect("three bytes a pixel")
}

/// Writes a picture as JPEG or PNG, as the file's name ends.
pub(crate) fn write_picture(path: &Path, picture: &RgbImage) -> anyhow::Result<()> {
    let mut bytes = Vec::new();
    match ImageFormat::from_path(path) {
        Ok(ImageFormat::Jpeg) => {
            let side = |px: u32| {
                u16::try_from(px).map_err(|_| {
                    user_error!(
                        "{}: {px} pixels are too many for JPEG; write a .png",
                        path.display()
                    )
                })
            };
            let (width, height) = (side(picture.width())?, side(picture.height())?);
            let encoder = Encoder::new(&mut bytes, JPEG_QUALITY);
            encoder.encode(picture.as_raw(), width, height, ColorType::Rgb)?;
        }
        Ok(ImageFormat::Png) => {
            picture.write_to(&mut std::io::Cursor::new(&mut bytes), ImageFormat::Png)?;
        }
        _ => {
            return Err(user_error!(
                "{}: pictures are written as .jpg, .jpeg or .png; give the file such a name",
                path.display()
            ));
        }
    }
    write_file(path, &bytes)
}

/// The picture as a canvas to draw on; nothing where it has no pixels.
pub(super) fn canvas_of(picture: &RgbImage) -> Option<Pixmap> {
    let mut canvas = Pixmap::new(picture.width(), picture.height())?;
    let pixels = canvas.data_mut().chunks_exact_mut(4);
    for (to, from) in pixels.zip(picture.as_raw().chunks_exact(3)) {
        to.copy_from_slice(&[from[0], from[1], from[2], 255]);
    }
    Some(canvas)
}

/// What was drawn on an opaque canvas.
pub(super) fn picture_from(canvas: &Pixmap) -> RgbImage {
    let mut picture = RgbImage::new(canvas.width(), canvas.height());
    let pixels = canvas.data().chunks_exact(4);
    for (to, from) in picture.chunks_exact_mut(3).zip(pixels) {
        to.copy_from_slice(&from[..3]);
    }
    picture
}

/// Text to write on a canvas.
pub(super) struct Caption<'a> {
    pub(super) text: &'a str,
    /// Left end of its base line, in pixels of the canvas.
    pub(super) at_px: [f32; 2],
    pub(super) height_px: f32,
    /// Longer text is set smaller.
    pub(super) max_width_px: f32,
    pub(super) color: Rgb,
}

/// Writes a caption on a canvas.
pub(super) fn write_caption(canvas: &mut Pixmap, caption: &Caption<'_>) -> anyhow::Result<()> {
    let escaped = shortened(caption.text, 300)
        .replace('&', "&amp;")
        .replace('<', "&lt;");
    let ([r, g, b], size) = (caption.color, caption.height_px);
    let tree = parsed(&format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"1\" height=\"1\"><text xml:space=\"preserve\" \
         font-family=\"{FONT_FAMILY}\" font-size=\"{size}\" fill=\"rgb({r},{g},{b})\">{escaped}</text></svg>"
    ))?;
    let width_px = tree.root().abs_bounding_box().right().max(1.0);
    let scale = (caption.max_width_px / width_px).min(1.0);
    let [x, y] = caption.at_px;
    let transform = Transform::from_scale(scale, scale).post_translate(x, y);
    resvg::render(&tree, transform, &mut canvas.as_mut());
    Ok(())
}

/// An opaque colour of the canvas.
pub(super) fn opaque([r, g, b]: Rgb) -> Color {
    Color::from_rgba8(r, g, b, 255)
}
