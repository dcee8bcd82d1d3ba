//! JPEG and PNG files as packed bytes. A file that is not whole is an error, never a half-grey image.

use std::borrow::Cow;
use std::io::Cursor;
use std::path::Path;

use anyhow::{Context, Result, ensure};
use image::codecs::png::PngDecoder;
use image::{DynamicImage, ImageDecoder, Limits};
use pardalis::PixelFormat;
use pardalis_core::error::MAX_IMAGE_SIDE_PX;
use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

use crate::user_error::user_error;

/// An image of packed red, green and blue bytes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct RgbImage {
    /// Width in pixels.
    pub(crate) width: usize,
    /// Height in pixels.
    pub(crate) height: usize,
    /// Three bytes a pixel, row by row from the top.
    pub(crate) bytes: Vec<u8>,
}

/// An image of one byte a pixel.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct GrayImage {
    /// Width in pixels.
    pub(crate) width: usize,
    /// Height in pixels.
    pub(crate) height: usize,
    /// One byte a pixel, row by row from the top.
    pub(crate) bytes: Vec<u8>,
}

/// Decodes a JPEG or PNG file of any pixel type to 8-bit RGB. Alpha is left out.
///
/// Errors: the file can not be read, is not a whole JPEG or PNG image, or is empty or too large.
pub(crate) fn decode_image(path: &Path) -> Result<RgbImage> {
    let bytes = read(path)?;
    let (kind, (width, height)) = check(path, &bytes)?;
    let rgb = match kind {
        Kind::Jpeg { scans_end } => rgb_from_jpeg(&bytes, scans_end),
        Kind::Png => rgb_from_png(&bytes),
    };
    let bytes = rgb.map_err(|error| {
        user_error!(
            "{}: the image is damaged or of an unknown kind: {error:#}; \
             replace it by a sound JPEG (baseline or progressive) or PNG image",
            path.display()
        )
    })?;
    ensure!(
        bytes.len() == PixelFormat::Rgb8.byte_count(width, height),
        "{}: decoded to {} bytes, which is not {width} x {height} pixels of red, green and blue",
        path.display(),
        bytes.len()
    );
    Ok(RgbImage {
        width,
        height,
        bytes,
    })
}

/// Decodes a JPEG or PNG file of any pixel type to 8-bit grey; colours by the weights of BT.601.
///
/// Errors as [`decode_image`].
pub(crate) fn decode_mask(path: &Path) -> Result<GrayImage> {
    let rgb = decode_image(path)?;
    let grey = |[r, g, b]: [u8; 3]| {
        let sum = 299 * u32::from(r) + 587 * u32::from(g) + 114 * u32::from(b);
        ((sum + 500) / 1000) as u8
    };
    let (pixels, _) = rgb.bytes.as_chunks::<3>();
    Ok(GrayImage {
        width: rgb.width,
        height: rgb.height,
        bytes: pixels.iter().copied().map(grey).collect(),
    })
}

/// Width and height of a JPEG or PNG file in pixels, from its header; nothing is decoded.
///
/// Errors as [`decode_image`], except for damage inside the compressed data.
pub(crate) fn image_size(path: &Path) -> Result<(usize, usize)> {
    Ok(check(path, &read(path)?)?.1)
}

/// The file formats that are decoded.
#[derive(Clone, Copy)]
enum Kind {
    Jpeg {
        /// Where the end mark of a sequential (not progressive) image stands.
        scans_end: Option<usize>,
    },
    Png,
}

fn read(path: &Path) -> Result<Vec<u8>> {
    std::fs::read(path).map_err(|error| user_error!("{}: can not be read: {error}", path.display()))
}

/// Tells the kind by the first bytes, and the size by the header before anything is allocated for it.
fn check(path: &Path, bytes: &[u8]) -> Result<(Kind, (usize, usize))> {
    let name = path.display();
    let outline = match bytes {
        [] => {
            return Err(user_error!(
                "{name}: the file is empty (0 bytes); replace or remove it"
            ));
        }
        [0xFF, 0xD8, ..] => jpeg_outline(bytes),
        [0x89, b'P', b'N', b'G', ..] => png_outline(bytes),
        _ => {
            return Err(user_error!(
                "{name}: this is not a JPEG or PNG image; replace or remove it"
            ));
        }
    };
    if let Some((width, height)) = outline.size {
        if width == 0 || height == 0 {
            return Err(user_error!(
                "{name}: the image has no pixels ({width} x {height}); replace or remove it"
            ));
        }
        if width.max(height) > MAX_IMAGE_SIDE_PX {
            return Err(user_error!(
                "{name}: the image is {width} x {height} pixels; \
                 at most {MAX_IMAGE_SIDE_PX} a side are taken: scale it down"
            ));
        }
    }
    match outline.size {
        Some(size) if outline.complete => Ok((outline.kind, size)),
        _ => Err(user_error!(
            "{name}: the file ends before its image does, as if cut off while it was written \
             or copied ({} bytes); replace or remove it",
            bytes.len()
        )),
    }
}

/// What the markers of an image file say.
struct Outline {
    kind: Kind,
    /// Width and height in pixels, where the file goes on that far.
    size: Option<(usize, usize)>,
    /// Whether the file goes on to the mark of its end.
    complete: bool,
}

/// Goes from marker to marker.
fn jpeg_outline(bytes: &[u8]) -> Outline {
    let mut outline = Outline {
        kind: Kind::Jpeg { scans_end: None },
        size: None,
        complete: false,
    };
    let mut is_progressive = false;
    let mut rest = &bytes[2..];
    // Between segments, and in entropy-coded data, a marker is 0xFF and a byte other than stuffing (0x00),
    // fill (0xFF) and restart marks, which stand alone.
    while let Some(at) = rest.iter().position(|&byte| byte == 0xFF) {
        rest = &rest[at + 1..];
        let Some(&marker) = rest.first() else { break };
        match marker {
            0x00 | 0x01 | 0xD0..=0xD8 => rest = &rest[1..],
            0xFF => {}
            0xD9 => {
                outline.complete = true;
                let end = bytes.len() - rest.len() - 1;
                outline.kind = Kind::Jpeg {
                    scans_end: (!is_progressive).then_some(end),
                };
                break;
            }
            _ => {
                // The frame headers: all of C0 to CF but tables (C4), extensions (C8), arithmetic conditions (CC).
                let is_frame =
                    matches!(marker, 0xC0..=0xCF) && !matches!(marker, 0xC4 | 0xC8 | 0xCC);
                if let (true, [_, _, _, _, h1, h0, w1, w0, ..]) = (is_frame, rest) {
                    let size = [[w1, w0], [h1, h0]].map(|[a, b]| u16::from_be_bytes([*a, *b]));
                    outline.size = Some((usize::from(size[0]), usize::from(size[1])));
                }
                is_progressive |= marker == 0xC2;
                let [_, l1, l0, ..] = rest else { break };
                let length = usize::from(u16::from_be_bytes([*l1, *l0]));
                rest = rest.get(1 + length..).unwrap_or_default();
            }
        }
    }
    outline
}

/// Goes from chunk to chunk; the decoder checks their sums.
fn png_outline(bytes: &[u8]) -> Outline {
    let mut outline = Outline {
        kind: Kind::Png,
        size: None,
        complete: false,
    };
    let mut rest = bytes.get(8..).unwrap_or_default();
    while let Some((&[l3, l2, l1, l0, k0, k1, k2, k3], body)) = rest.split_first_chunk::<8>() {
        let length = u32::from_be_bytes([l3, l2, l1, l0]) as usize;
        match (&[k0, k1, k2, k3], body) {
            (b"IHDR", &[w3, w2, w1, w0, h3, h2, h1, h0, ..]) => {
                let [width, height] = [[w3, w2, w1, w0], [h3, h2, h1, h0]].map(u32::from_be_bytes);
                outline.size = Some((width as usize, height as usize));
            }
            (b"IEND", _) => {
                outline.complete = true;
                break;
            }
            _ => {}
        }
        // Each chunk ends with a sum of four bytes.
        rest = body.get(length.saturating_add(4)..).unwrap_or_default();
    }
    outline
}

fn rgb_from_jpeg(bytes: &[u8], scans_end: Option<usize>) -> Result<Vec<u8>> {
    let options = DecoderOptions::default()
        .set_strict_mode(true)
        .set_max_width(MAX_IMAGE_SIDE_PX)
        .set_max_height(MAX_IMAGE_SIDE_PX)
        .jpeg_set_out_colorspace(ColorSpace::RGB);
    // The decoder makes up what is missing before an end mark, as where a camera lost part of a frame. With some
    // zeros in its place, for reading ahead, it tells that the data run out. Progressive scans need the mark.
    let data = match scans_end {
        Some(end) => Cow::from([&bytes[..end], &[0; 8]].concat()),
        None => Cow::from(bytes),
    };
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(&*data), options);
    decoder.decode().context("JPEG")
}

fn rgb_from_png(bytes: &[u8]) -> Result<Vec<u8>> {
    let mut limits = Limits::default();
    // The size has been checked: enough for 16 bits of red, green, blue and alpha at the largest.
    limits.max_alloc = Some(8 * (MAX_IMAGE_SIDE_PX * MAX_IMAGE_SIDE_PX) as u64);
    let mut decoder = PngDecoder::with_limits(Cursor::new(bytes), limits.clone()).context("PNG")?;
    decoder.set_limits(limits).context("PNG")?;
    let decoded = DynamicImage::from_decoder(decoder).context("PNG")?;
    Ok(decoded.into_rgb8().into_raw())
}

#[cfg(test)]
#[path = "decode_tests.rs"]
mod tests;
