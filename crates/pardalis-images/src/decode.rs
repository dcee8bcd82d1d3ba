//! JPEG and PNG files as images. A file that is not complete is an error, never a half-grey image.

use std::borrow::Cow;
use std::io::Cursor;

use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

use super::{GrayImage, RgbImage};

/// The longest side that is decoded, in pixels.
pub const MAX_SIDE_PX: usize = 16_384;

/// Why a file cannot be decoded, as the end of a sentence about it.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum DecodeError {
    /// The file has no bytes.
    #[error("the file is empty (0 bytes); replace or remove it")]
    Empty,
    /// The first bytes are not those of a JPEG or PNG file.
    #[error("this is not a JPEG or PNG image; replace or remove it")]
    OtherFormat,
    /// The header gives a width or height of 0.
    #[error("the image has no pixels ({0} x {1}); replace or remove it")]
    NoPixels(usize, usize),
    /// A side is longer than [`MAX_SIDE_PX`].
    #[error("the image is {0} x {1} pixels; at most {MAX_SIDE_PX} a side are taken: scale it down")]
    TooLarge(usize, usize),
    /// The file ends before its image does; with its length in bytes.
    #[error(
        "the file ends before its image does, as if cut off while it was written or copied ({0} bytes); \
         replace or remove it"
    )]
    Incomplete(usize),
    /// The compressed data are damaged, or of a kind that is not supported; with the decoder's reason.
    #[error(
        "the image is damaged or of an unknown kind: {0}; \
         replace it by a sound JPEG (baseline or progressive) or PNG image"
    )]
    Damaged(String),
}

/// Decodes a JPEG or PNG file of any pixel type to 8-bit RGB. Alpha is dropped; 16-bit samples are rounded.
pub fn decode(file: &[u8]) -> Result<RgbImage, DecodeError> {
    let (kind, (width, height)) = check(file)?;
    let rgb = match kind {
        Kind::Jpeg { scans_end } => rgb_from_jpeg(file, scans_end),
        Kind::Png => rgb_from_png(file),
    };
    let samples = rgb.map_err(DecodeError::Damaged)?;
    let count = samples.len();
    RgbImage::from_raw(width as u32, height as u32, samples).ok_or_else(|| {
        DecodeError::Damaged(format!(
            "decoded to {count} bytes for {width} x {height} pixels"
        ))
    })
}

/// Decodes a JPEG or PNG file of any pixel type to 8-bit grey; colours by the weights of BT.601.
pub fn decode_grey(file: &[u8]) -> Result<GrayImage, DecodeError> {
    Ok(decode(file)?.map(|[r, g, b]| {
        let sum = 299 * u32::from(r) + 587 * u32::from(g) + 114 * u32::from(b);
        [((sum + 500) / 1000) as u8]
    }))
}

/// Width and height of a JPEG or PNG file in pixels, from its header; the pixels are not decoded, so that damage in
/// them goes unnoticed.
pub fn size(file: &[u8]) -> Result<(usize, usize), DecodeError> {
    Ok(check(file)?.1)
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

/// Finds the format by the first bytes, and the size in the header before anything is allocated for it.
fn check(file: &[u8]) -> Result<(Kind, (usize, usize)), DecodeError> {
    let outline = match file {
        [] => return Err(DecodeError::Empty),
        [0xFF, 0xD8, ..] => jpeg_outline(file),
        [0x89, b'P', b'N', b'G', ..] => png_outline(file),
        _ => return Err(DecodeError::OtherFormat),
    };
    if let Some((width, height)) = outline.size {
        if width == 0 || height == 0 {
            return Err(DecodeError::NoPixels(width, height));
        }
        if width.max(height) > MAX_SIDE_PX {
            return Err(DecodeError::TooLarge(width, height));
        }
    }
    match outline.size {
        Some(size) if outline.complete => Ok((outline.kind, size)),
        _ => Err(DecodeError::Incomplete(file.len())),
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

fn rgb_from_jpeg(bytes: &[u8], scans_end: Option<usize>) -> Result<Vec<u8>, String> {
    let options = DecoderOptions::default()
        .set_strict_mode(true)
        .set_max_width(MAX_SIDE_PX)
        .set_max_height(MAX_SIDE_PX)
        .jpeg_set_out_colorspace(ColorSpace::RGB);
    // The decoder makes up what is missing before an end mark, as where a camera lost part of a frame. With some
    // zeros in its place, for reading ahead, it tells that the data run out. Progressive scans need the mark.
    let data = match scans_end {
        Some(end) => Cow::from([&bytes[..end], &[0; 8]].concat()),
        None => Cow::from(bytes),
    };
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(&*data), options);
    decoder.decode().map_err(|error| format!("JPEG: {error}"))
}

fn rgb_from_png(bytes: &[u8]) -> Result<Vec<u8>, String> {
    // The size has been checked: enough for 16 bits of red, green, blue and alpha at the largest.
    let limits = png::Limits {
        bytes: 8 * MAX_SIDE_PX * MAX_SIDE_PX,
    };
    let mut decoder = png::Decoder::new_with_limits(Cursor::new(bytes), limits);
    // Palettes become colours, and fewer than 8 bits become 8.
    decoder.set_transformations(png::Transformations::EXPAND);
    let reason = |error: png::DecodingError| format!("PNG: {error}");
    let mut reader = decoder.read_info().map_err(reason)?;
    let count = reader.output_buffer_size().ok_or("PNG: too large")?;
    let mut samples = vec![0; count];
    let info = reader.next_frame(&mut samples).map_err(reason)?;
    samples.truncate(info.buffer_size());
    if info.bit_depth == png::BitDepth::Sixteen {
        samples = eight_bits(&samples);
    }
    Ok(match info.color_type {
        png::ColorType::Grayscale => rgb_from(&samples, |[grey]| [grey; 3]),
        png::ColorType::GrayscaleAlpha => rgb_from(&samples, |[grey, _]| [grey; 3]),
        png::ColorType::Rgba => rgb_from(&samples, |[r, g, b, _]| [r, g, b]),
        // Palettes have been expanded.
        png::ColorType::Rgb | png::ColorType::Indexed => samples,
    })
}

/// Rounds samples of two bytes, the high one first, to one.
fn eight_bits(samples: &[u8]) -> Vec<u8> {
    let (samples, _) = samples.as_chunks();
    let rounded = |sample: u16| ((u32::from(sample) + 128) / 257) as u8;
    samples
        .iter()
        .map(|&bytes| rounded(u16::from_be_bytes(bytes)))
        .collect()
}

fn rgb_from<const CHANNELS: usize>(
    samples: &[u8],
    rgb: impl Fn([u8; CHANNELS]) -> [u8; 3],
) -> Vec<u8> {
    let (pixels, _) = samples.as_chunks();
    pixels.iter().flat_map(|&pixel| rgb(pixel)).collect()
}
