//! Decoding of JPEG and PNG files; errors name the file.

use std::path::Path;

use anyhow::Result;
use pardalis_images::{DecodeError, GrayImage, RgbImage, decode, decode_grey, size};

use crate::user_error::user_error;

// Every image that can be decoded can be tracked.
const _: () = assert!(pardalis_images::MAX_SIDE_PX == pardalis_core::error::MAX_IMAGE_SIDE_PX);

/// Decodes a JPEG or PNG file of any pixel type to 8-bit RGB. Alpha is dropped.
///
/// # Errors
///
/// The file cannot be read, is not a complete JPEG or PNG image, or is empty or too large.
pub(crate) fn decode_image(path: &Path) -> Result<RgbImage> {
    decoded(path, decode)
}

/// Decodes a JPEG or PNG file of any pixel type to 8-bit grey, converting colours with the weights of BT.601.
///
/// # Errors
///
/// As [`decode_image`].
pub(crate) fn decode_mask(path: &Path) -> Result<GrayImage> {
    decoded(path, decode_grey)
}

/// Reads width and height in pixels from the header of a JPEG or PNG file.
///
/// # Errors
///
/// As [`decode_image`], except for damage inside the compressed data.
pub(crate) fn image_size(path: &Path) -> Result<(usize, usize)> {
    decoded(path, size)
}

fn decoded<T>(path: &Path, decode: impl Fn(&[u8]) -> Result<T, DecodeError>) -> Result<T> {
    let name = path.display();
    let file =
        std::fs::read(path).map_err(|error| user_error!("{name}: cannot be read: {error}"))?;
    decode(&file).map_err(|error| user_error!("{name}: {error}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_named_in_errors() {
        let error = decode_image(Path::new("nowhere.png"))
            .unwrap_err()
            .to_string();
        assert!(error.contains("nowhere.png: cannot be read"), "{error}");
        let folder = tempfile::TempDir::new().unwrap();
        let path = folder.path().join("cut.jpg");
        std::fs::write(&path, [0xFF, 0xD8, 0xFF]).unwrap();
        for error in [
            decode_image(&path).map(|_| ()),
            decode_mask(&path).map(|_| ()),
            image_size(&path).map(|_| ()),
        ] {
            let error = error.unwrap_err();
            assert!(error.is::<crate::user_error::UserError>());
            let text = error.to_string();
            assert!(text.contains("cut.jpg: the file ends before"), "{text}");
        }
    }
}
