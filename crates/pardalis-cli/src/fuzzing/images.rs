//! Images and their metadata.

use pardalis_images::{DecodeError, decode, decode_grey, encode_png, exif_focal_length_px, size};

use crate::fuzzed_file::check_message;

/// Larger images are not decoded, because that takes long. Their sizes are checked before.
const DECODED_PX: usize = 1 << 18;

/// Decodes a PNG image as it is, and with the checksums that it should have, so that damage gets past them.
pub(super) fn png(bytes: &[u8]) -> bool {
    let mut mended = bytes.to_vec();
    mend_checksums(&mut mended);
    let is_read = image(bytes);
    image(&mended) || is_read
}

pub(super) fn jpeg(bytes: &[u8]) -> bool {
    image(bytes)
}

fn image(bytes: &[u8]) -> bool {
    let size_px = match size(bytes) {
        Ok(size_px) => size_px,
        Err(error) => {
            check_damage(&error);
            assert_eq!(decode(bytes), Err(error));
            return false;
        }
    };
    check_focal_length(bytes);
    let (width, height) = size_px;
    assert!(width > 0 && height > 0);
    assert!(width.max(height) <= pardalis_images::MAX_SIDE_PX);
    assert!(width * height <= pardalis_images::MAX_PIXELS);
    if width * height > DECODED_PX {
        return false;
    }
    match decode(bytes) {
        Ok(image) => {
            assert_eq!(image.size_px(), size_px);
            let written = encode_png(&image).expect("a valid image");
            assert_eq!(decode(&written).as_ref(), Ok(&image));
            let grey = decode_grey(bytes).expect("it was decoded");
            assert_eq!(grey.size_px(), size_px);
            true
        }
        Err(error) => {
            check_damage(&error);
            false
        }
    }
}

fn check_damage(error: &DecodeError) {
    check_message(&error.to_string());
}

/// Reads EXIF data in the smallest JPEG file around them.
pub(super) fn exif(bytes: &[u8]) -> bool {
    let tiff = &bytes[..bytes.len().min(usize::from(u16::MAX) - 8)];
    let length = (tiff.len() + 8) as u16;
    let frame = [
        0xFF, 0xC0, 0, 11, 8, 0, 48, 0, 64, 1, 1, 0x11, 0, 0xFF, 0xD9,
    ];
    let file = [
        &[0xFF, 0xD8, 0xFF, 0xE1],
        &length.to_be_bytes()[..],
        b"Exif\0\0",
        tiff,
        &frame,
    ];
    let file = file.concat();
    let size_px = size(&file).expect("whatever the EXIF data are");
    assert!([(64, 48), (48, 64)].contains(&size_px), "{size_px:?}");
    check_focal_length(&file)
}

/// Reports whether a file whose size is valid states a focal length.
fn check_focal_length(file: &[u8]) -> bool {
    let focal_px = exif_focal_length_px(file).expect("its size is valid");
    assert!(
        focal_px.is_none_or(|f_px| f_px > 0.0 && f_px.is_finite()),
        "{focal_px:?}"
    );
    focal_px.is_some()
}

/// Sets the checksum of each chunk of a PNG file.
fn mend_checksums(file: &mut [u8]) {
    let mut at = 8;
    while let Some(length) = file.get(at..).and_then(<[u8]>::first_chunk) {
        let length = u32::from_be_bytes(*length) as usize;
        let (start, end) = (at + 4, at.saturating_add(8).saturating_add(length));
        let Some(chunk) = file.get(start..end) else {
            return;
        };
        let sum = checksum(chunk);
        let Some(stored) = file.get_mut(end..end + 4) else {
            return;
        };
        stored.copy_from_slice(&sum.to_be_bytes());
        at = end + 4;
    }
}

/// The CRC-32 of PNG.
fn checksum(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(u32::MAX, |sum, &byte| {
        (0..8).fold(sum ^ u32::from(byte), |sum, _| {
            sum >> 1 ^ if sum & 1 == 1 { 0xEDB8_8320 } else { 0 }
        })
    })
}
