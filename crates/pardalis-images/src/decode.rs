//! Decoding of JPEG and PNG files. An incomplete file is an error and never gives a half-grey image.

use std::borrow::Cow;

use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

use super::exif::Exif;
use super::from_png::rgb_from_png;
use super::{GrayImage, RgbImage};

/// Maximum length of a side, in pixels.
pub const MAX_SIDE_PX: usize = 16_384;

/// Maximum number of pixels of an image, and so the bound of the memory that a small file can demand: decoding takes up to
/// nine bytes per pixel for progressive JPEG images, and three for all others.
pub const MAX_PIXELS: usize = 1 << 26;

/// Maximum number of scans of a progressive JPEG image. Each takes as long as a whole image; usual are up to a dozen.
const MAX_SCANS: usize = 64;

/// The reason why a file cannot be decoded. Messages continue a sentence that begins with the file's name.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum DecodeError {
    /// The file has no bytes.
    #[error("the file is empty (0 bytes); replace or remove it")]
    Empty,
    /// The first bytes are not those of a JPEG or PNG file.
    #[error("this is not a JPEG or PNG image; replace or remove it")]
    OtherFormat,
    /// The file has an image format that is not read. Contains its name with its article.
    #[error(
        "this is {0} image, and only JPEG and PNG are read; convert it, for example with `ffmpeg -i IMAGE IMAGE.png`"
    )]
    UnreadFormat(&'static str),
    /// The width or height in the header is 0.
    #[error("the image has no pixels ({0} x {1}); replace or remove it")]
    NoPixels(usize, usize),
    /// A side is longer than [`MAX_SIDE_PX`].
    #[error(
        "the image is {0} x {1} pixels; at most {MAX_SIDE_PX} per side are supported: scale it down"
    )]
    TooLarge(usize, usize),
    /// The image has more than [`MAX_PIXELS`] pixels.
    #[error(
        "the image is {0} x {1} pixels; at most {MAX_PIXELS} in all are supported, such as 8192 x 8192: scale it down"
    )]
    TooManyPixels(usize, usize),
    /// The file ends before its image does. Contains its length in bytes.
    #[error(
        "the file ends before its image does, as if cut off while it was written or copied ({0} bytes); \
         replace or remove it"
    )]
    Incomplete(usize),
    /// The compressed data are damaged or not supported. Contains the decoder's message.
    #[error(
        "the image is damaged or not supported: {0}; \
         replace it by an intact JPEG (baseline or progressive) or PNG image"
    )]
    Damaged(String),
}

/// Decodes a JPEG or PNG file of any pixel type to 8-bit RGB. Alpha is dropped; 16-bit samples are rounded. JPEG images are
/// turned upright as their EXIF data demand.
pub fn decode(file: &[u8]) -> Result<RgbImage, DecodeError> {
    let Header {
        kind,
        stored_size: (width, height),
        exif,
    } = Header::read(file)?;
    let rgb = match kind {
        Kind::Jpeg { scans_end } => rgb_from_jpeg(file, scans_end),
        Kind::Png => rgb_from_png(file, (width, height)),
    };
    let samples = rgb.map_err(DecodeError::Damaged)?;
    let count = samples.len();
    let stored = RgbImage::from_raw(width as u32, height as u32, samples).ok_or_else(|| {
        DecodeError::Damaged(format!(
            "decoded to {count} bytes for {width} x {height} pixels"
        ))
    })?;
    Ok(exif.orientation.upright(stored))
}

/// Decodes a JPEG or PNG file of any pixel type to 8-bit grey. Colours are combined with the weights of BT.601.
pub fn decode_grey(file: &[u8]) -> Result<GrayImage, DecodeError> {
    Ok(decode(file)?.to_grey())
}

/// Returns the width and height in pixels, upright, of a JPEG or PNG file from its header. The pixels are not decoded, so
/// that damaged data are not detected.
pub fn size(file: &[u8]) -> Result<(usize, usize), DecodeError> {
    let header = Header::read(file)?;
    Ok(header.exif.orientation.size(header.stored_size))
}

/// Returns the focal length in pixels of the camera of a JPEG file, if its EXIF data state it: certain to a few per cent.
/// Errors are those of [`size`].
///
/// It follows from the focal length on film of 36 x 24 mm with the same diagonal angle, or else from the focal length and
/// the resolution of the sensor. An image that was cropped later has another one.
pub fn exif_focal_length_px(file: &[u8]) -> Result<Option<f64>, DecodeError> {
    let header = Header::read(file)?;
    Ok(header.exif.focal_length_px(header.stored_size))
}

/// Supported file formats.
#[derive(Clone, Copy)]
enum Kind {
    Jpeg {
        /// Position of the end marker of a sequential (not progressive) image.
        scans_end: Option<usize>,
    },
    Png,
}

/// The properties of an image that its file states before the pixels.
struct Header {
    kind: Kind,
    /// Width and height in pixels, before the image is turned upright.
    stored_size: (usize, usize),
    exif: Exif,
}

impl Header {
    /// Determines the format from the first bytes and checks the size in the header before memory is allocated.
    fn read(file: &[u8]) -> Result<Self, DecodeError> {
        let structure = match file {
            [] => return Err(DecodeError::Empty),
            [0xFF, 0xD8, ..] => jpeg_structure(file),
            [0x89, b'P', b'N', b'G', ..] => png_structure(file),
            _ => {
                return Err(
                    unread_format(file).map_or(DecodeError::OtherFormat, DecodeError::UnreadFormat)
                );
            }
        };
        if let Some((width, height)) = structure.size {
            if width == 0 || height == 0 {
                return Err(DecodeError::NoPixels(width, height));
            }
            if width.max(height) > MAX_SIDE_PX {
                return Err(DecodeError::TooLarge(width, height));
            }
            if width * height > MAX_PIXELS {
                return Err(DecodeError::TooManyPixels(width, height));
            }
        }
        match structure.size {
            Some(stored_size) if structure.complete => Ok(Self {
                kind: structure.kind,
                stored_size,
                exif: structure.exif,
            }),
            _ => Err(DecodeError::Incomplete(file.len())),
        }
    }
}

/// Names the format of an image that is not read, by its first bytes.
fn unread_format(file: &[u8]) -> Option<&'static str> {
    match file {
        [b'B', b'M', ..] => Some("a BMP"),
        [b'G', b'I', b'F', b'8', ..] => Some("a GIF"),
        [b'I', b'I', 42, 0, ..] | [b'M', b'M', 0, 42, ..] => Some("a TIFF"),
        [
            b'R',
            b'I',
            b'F',
            b'F',
            _,
            _,
            _,
            _,
            b'W',
            b'E',
            b'B',
            b'P',
            ..,
        ] => Some("a WebP"),
        [
            _,
            _,
            _,
            _,
            b'f',
            b't',
            b'y',
            b'p',
            b'a',
            b'v',
            b'i',
            b'f',
            ..,
        ] => Some("an AVIF"),
        [
            _,
            _,
            _,
            _,
            b'f',
            b't',
            b'y',
            b'p',
            b'h' | b'm',
            b'e' | b'i',
            b'i' | b'f',
            ..,
        ] => Some("a HEIC"),
        _ => None,
    }
}

/// The structure of an image file according to its markers.
struct Structure {
    kind: Kind,
    /// Width and height in pixels, if the file contains them.
    size: Option<(usize, usize)>,
    /// Whether the file contains its end marker.
    complete: bool,
    exif: Exif,
}

/// Parses the markers of a JPEG file.
fn jpeg_structure(bytes: &[u8]) -> Structure {
    let mut structure = Structure {
        kind: Kind::Jpeg { scans_end: None },
        size: None,
        complete: false,
        exif: Exif::default(),
    };
    let mut is_progressive = false;
    let mut rest = &bytes[2..];
    // Between segments, and in entropy-coded data, a marker is 0xFF and a byte other than stuffing (0x00),
    // fill (0xFF) and restart markers, which have no segment.
    while let Some(at) = rest.iter().position(|&byte| byte == 0xFF) {
        rest = &rest[at + 1..];
        let Some(&marker) = rest.first() else { break };
        match marker {
            0x00 | 0x01 | 0xD0..=0xD8 => rest = &rest[1..],
            0xFF => {}
            0xD9 => {
                structure.complete = true;
                let end = bytes.len() - rest.len() - 1;
                structure.kind = Kind::Jpeg {
                    scans_end: (!is_progressive).then_some(end),
                };
                break;
            }
            _ => {
                // Frame headers: C0 to CF except tables (C4), extensions (C8) and arithmetic conditioning (CC).
                let is_frame =
                    matches!(marker, 0xC0..=0xCF) && !matches!(marker, 0xC4 | 0xC8 | 0xCC);
                // The decoder takes the first of several, too.
                let is_first = is_frame && structure.size.is_none();
                if let (true, [_, _, _, _, h1, h0, w1, w0, ..]) = (is_first, rest) {
                    let size = [[w1, w0], [h1, h0]].map(|[a, b]| u16::from_be_bytes([*a, *b]));
                    structure.size = Some((usize::from(size[0]), usize::from(size[1])));
                }
                is_progressive |= marker == 0xC2;
                let [_, l1, l0, ..] = rest else { break };
                let length = usize::from(u16::from_be_bytes([*l1, *l0]));
                let tiff = rest
                    .get(3..1 + length)
                    .and_then(|data| data.strip_prefix(b"Exif\0\0"));
                if let (0xE1, Some(tiff)) = (marker, tiff) {
                    structure.exif = Exif::read(tiff);
                }
                rest = rest.get(1 + length..).unwrap_or_default();
            }
        }
    }
    structure
}

/// Parses the chunks of a PNG file. The decoder verifies their checksums.
fn png_structure(bytes: &[u8]) -> Structure {
    let mut structure = Structure {
        kind: Kind::Png,
        size: None,
        complete: false,
        exif: Exif::default(),
    };
    let mut rest = bytes.get(8..).unwrap_or_default();
    while let Some((&[l3, l2, l1, l0, k0, k1, k2, k3], body)) = rest.split_first_chunk::<8>() {
        let length = u32::from_be_bytes([l3, l2, l1, l0]) as usize;
        match (&[k0, k1, k2, k3], body) {
            // The decoder takes the first of several, too.
            (b"IHDR", &[w3, w2, w1, w0, h3, h2, h1, h0, ..]) if structure.size.is_none() => {
                let [width, height] = [[w3, w2, w1, w0], [h3, h2, h1, h0]].map(u32::from_be_bytes);
                structure.size = Some((width as usize, height as usize));
            }
            (b"IEND", _) => {
                structure.complete = true;
                break;
            }
            _ => {}
        }
        // Each chunk ends with a checksum of four bytes.
        rest = body.get(length.saturating_add(4)..).unwrap_or_default();
    }
    structure
}

fn rgb_from_jpeg(bytes: &[u8], scans_end: Option<usize>) -> Result<Vec<u8>, String> {
    let options = DecoderOptions::default()
        .set_strict_mode(true)
        .set_max_width(MAX_SIDE_PX)
        .set_max_height(MAX_SIDE_PX)
        .jpeg_set_max_scans(MAX_SCANS)
        .jpeg_set_out_colorspace(ColorSpace::RGB);
    // The decoder fills in data missing before an end marker, for example where a camera lost part of a frame. With
    // zeros instead of the marker, for reading ahead, it reports that data are missing. Progressive scans need the
    // marker.
    let data = match scans_end {
        Some(end) => Cow::from([&bytes[..end], &[0; 8]].concat()),
        None => Cow::from(bytes),
    };
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(&*data), options);
    decoder.decode().map_err(|error| format!("JPEG: {error}"))
}
