//! Decoding of JPEG and PNG files; errors name the file.

use std::fs;
use std::io::{self, Read as _};
use std::path::Path;

use anyhow::Result;
use pardalis_images::{DecodeError, GrayImage, RgbImage, decode, decode_grey, size};

use crate::output::Shown;
use crate::user_error::user_error;

// Every image that can be decoded can be tracked.
const _: () = assert!(pardalis_images::MAX_SIDE_PX == pardalis_core::error::MAX_IMAGE_SIDE_PX);

/// Maximum size of an image file in bytes: more than the largest image takes without compression.
const MAX_FILE_BYTES: u64 = 256 << 20;

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

/// Returns "image", "video" or, of MCAP, "recording" if a file is one by its first bytes, to tell users that it is at the wrong place.
pub(crate) fn media_kind(path: &Path) -> Option<&'static str> {
    // No pipe, which would keep the program waiting.
    if !path.is_file() {
        return None;
    }
    let mut head = Vec::new();
    let mut file = fs::File::open(path).ok()?.take(12);
    file.read_to_end(&mut head).ok()?;
    match &head[..] {
        [0x89, b'M', b'C', b'A', b'P', ..] => Some("recording"),
        [0xFF, 0xD8, 0xFF, ..] | [0x89, b'P', b'N', b'G', ..] => Some("image"),
        // MP4 and MOV, Matroska and WebM, AVI.
        [_, _, _, _, b'f', b't', b'y', b'p', ..]
        | [0x1A, 0x45, 0xDF, 0xA3, ..]
        | [b'R', b'I', b'F', b'F', _, _, _, _, b'A', b'V', b'I', ..] => Some("video"),
        _ => None,
    }
}

/// Fails with the reason if an image cannot be a file of a possible length.
pub(crate) fn check_file(path: &Path) -> Result<()> {
    let name = path.shown();
    let metadata = fs::metadata(path).map_err(|error| match error.kind() {
        io::ErrorKind::NotFound if path.is_symlink() => {
            user_error!(
                "{name}: is a link to a file that does not exist; restore that file, or remove the link"
            )
        }
        io::ErrorKind::NotFound => {
            user_error!("{name}: cannot be read: there is no such file; check the name")
        }
        _ => user_error!("{name}: cannot be read: {error}; check its permissions"),
    })?;
    if metadata.is_dir() {
        return Err(user_error!("{name}: is a folder; give a JPEG or PNG image"));
    }
    // Reading a pipe or a device might wait for ever.
    if !metadata.is_file() {
        return Err(user_error!(
            "{name}: is a pipe or a device; give a JPEG or PNG image"
        ));
    }
    if metadata.len() > MAX_FILE_BYTES {
        return Err(user_error!(
            "{name}: has {} bytes; allowed for an image: at most {MAX_FILE_BYTES}",
            metadata.len()
        ));
    }
    Ok(())
}

fn decoded<T>(path: &Path, decode: impl Fn(&[u8]) -> Result<T, DecodeError>) -> Result<T> {
    check_file(path)?;
    let name = path.shown();
    let file = fs::read(path)
        .map_err(|error| user_error!("{name}: cannot be read: {error}; check its permissions"))?;
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
        assert!(
            error.contains("nowhere.png: cannot be read: there is no such file"),
            "{error}"
        );
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
