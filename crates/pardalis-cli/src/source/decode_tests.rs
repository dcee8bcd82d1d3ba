use std::path::PathBuf;

use image::{DynamicImage, ImageFormat, Luma, LumaA, Rgb, RgbImage as Picture, Rgba};
use tempfile::TempDir;

use super::*;

fn real_jpeg() -> Vec<u8> {
    let path = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../data/dioptric-jump/frames/000030.jpg"
    );
    std::fs::read(path).expect("a frame of the sequence")
}

fn png(image: &DynamicImage) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    image
        .write_to(&mut bytes, ImageFormat::Png)
        .expect("a PNG image");
    bytes.into_inner()
}

fn write(folder: &TempDir, bytes: &[u8]) -> PathBuf {
    let path = folder.path().join("picture.jpg");
    std::fs::write(&path, bytes).expect("written");
    path
}

fn error_of(path: &Path) -> String {
    match decode_image(path) {
        Ok(image) => panic!("{} x {} pixels came out", image.width, image.height),
        Err(error) => error.to_string(),
    }
}

fn assert_cuts_are_errors(whole: &[u8], cuts: impl Iterator<Item = usize>) {
    let folder = TempDir::new().expect("a folder");
    for cut in cuts {
        let path = write(&folder, &whole[..cut]);
        let error = error_of(&path);
        assert!(error.contains("picture.jpg: "), "{error}");
        assert!(error.contains("replace"), "{error}");
    }
}

#[test]
fn a_jpeg_cut_anywhere_is_an_error() {
    let whole = real_jpeg();
    let count = whole.len();
    assert_cuts_are_errors(
        &whole,
        (0..700)
            .chain((700..count).step_by(211))
            .chain(count - 200..count),
    );
}

#[test]
fn a_png_cut_anywhere_is_an_error() {
    let picture = Picture::from_fn(64, 48, |x, y| Rgb([x as u8, y as u8, (x * y % 251) as u8]));
    let whole = png(&picture.into());
    // The last four bytes are the end chunk's sum.
    assert_cuts_are_errors(&whole, 0..whole.len() - 4);
}

#[test]
fn a_whole_jpeg_decodes_and_may_have_bytes_after_it() {
    let folder = TempDir::new().expect("a folder");
    let mut bytes = real_jpeg();
    let image = decode_image(&write(&folder, &bytes)).expect("whole");
    assert_eq!(
        (image.width, image.height, image.bytes.len()),
        (640, 480, 640 * 480 * 3)
    );
    bytes.extend(b"recorder's notes");
    assert_eq!(decode_image(&write(&folder, &bytes)).expect("whole"), image);
}

#[test]
fn sizes_are_refused_from_the_header_alone() {
    let folder = TempDir::new().expect("a folder");
    let mut huge_jpeg = real_jpeg();
    let sof = huge_jpeg
        .windows(2)
        .position(|pair| pair == [0xFF, 0xC0])
        .expect("a frame header");
    huge_jpeg[sof + 5..sof + 9].copy_from_slice(&[0xEA, 0x60, 0xEA, 0x60]);
    let mut empty_jpeg = huge_jpeg.clone();
    empty_jpeg[sof + 5..sof + 9].copy_from_slice(&[0, 0, 2, 128]);
    let mut huge_png = png(&Picture::new(4, 4).into());
    huge_png[16..24].copy_from_slice(&[0, 0, 0xEA, 0x60, 0, 0, 0xEA, 0x60]);
    let mut empty_png = huge_png.clone();
    empty_png[16..24].copy_from_slice(&[0, 0, 0, 4, 0, 0, 0, 0]);
    for (bytes, expected) in [
        (huge_jpeg.as_slice(), "60000 x 60000 pixels; at most 16384"),
        (
            &huge_jpeg[..sof + 20],
            "60000 x 60000 pixels; at most 16384",
        ),
        (&empty_jpeg, "no pixels (640 x 0)"),
        (&huge_png, "60000 x 60000 pixels; at most 16384"),
        (&huge_png[..40], "60000 x 60000 pixels; at most 16384"),
        (&empty_png, "no pixels (4 x 0)"),
        (&[], "empty (0 bytes)"),
        (b"frame,time_s\n0,0\n", "not a JPEG or PNG"),
    ] {
        let error = error_of(&write(&folder, bytes));
        assert!(error.contains(expected), "{error}");
    }
}

#[test]
fn damage_inside_a_png_is_an_error() {
    let folder = TempDir::new().expect("a folder");
    let picture = Picture::from_fn(64, 48, |x, y| Rgb([x as u8, y as u8, (x * y % 251) as u8]));
    let mut bytes = png(&picture.into());
    let middle = bytes.len() / 2;
    bytes[middle] ^= 0x55;
    let error = error_of(&write(&folder, &bytes));
    assert!(error.contains("damaged"), "{error}");
}

#[test]
fn every_type_of_png_becomes_rgb_and_grey() {
    let folder = TempDir::new().expect("a folder");
    let one = |image: DynamicImage| {
        let path = write(&folder, &png(&image));
        let rgb = decode_image(&path).expect("decodes").bytes;
        (rgb, decode_mask(&path).expect("decodes").bytes)
    };
    let grey8 = image::ImageBuffer::from_pixel(1, 1, Luma([200_u8]));
    assert_eq!(one(grey8.into()), (vec![200; 3], vec![200]));
    let grey16 = image::ImageBuffer::from_pixel(1, 1, Luma([200_u16 * 257]));
    assert_eq!(one(grey16.into()), (vec![200; 3], vec![200]));
    let grey_alpha = image::ImageBuffer::from_pixel(1, 1, LumaA([200_u8, 3]));
    assert_eq!(one(grey_alpha.into()), (vec![200; 3], vec![200]));
    let rgba = image::ImageBuffer::from_pixel(1, 1, Rgba([10_u8, 20, 30, 0]));
    assert_eq!(one(rgba.into()), (vec![10, 20, 30], vec![18]));
    let rgb16 = image::ImageBuffer::from_pixel(1, 1, Rgb([2570_u16, 5140, 7710]));
    assert_eq!(one(rgb16.into()), (vec![10, 20, 30], vec![18]));
    // Two by one pixels of a palette, one bit each: blue and white.
    let palette: &[u8] = &[
        0x89, 0x50, 0x4E, 0x47, 0x0D, 0x0A, 0x1A, 0x0A, 0, 0, 0, 13, 0x49, 0x48, 0x44, 0x52, 0, 0,
        0, 2, 0, 0, 0, 1, 1, 3, 0, 0, 0, 0xce, 0xec, 0xed, 0xc9, 0, 0, 0, 6, 0x50, 0x4c, 0x54,
        0x45, 0, 0, 0xff, 0xff, 0xff, 0xff, 0x7b, 0xdc, 0x99, 0x2c, 0, 0, 0, 0xa, 0x49, 0x44, 0x41,
        0x54, 0x78, 0x9c, 0x63, 0x70, 0, 0, 0, 0x42, 0, 0x41, 0x29, 0x37, 0xf4, 0xef, 0, 0, 0, 0,
        0x49, 0x45, 0x4e, 0x44, 0xae, 0x42, 0x60, 0x82,
    ];
    let path = write(&folder, palette);
    assert_eq!(
        decode_image(&path).expect("decodes").bytes,
        [0, 0, 255, 255, 255, 255]
    );
}

#[test]
fn real_masks_are_black_and_white() {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../../data/training/dioptric");
    let mask = decode_mask(&Path::new(folder).join("000_ball_mask.png")).expect("a mask");
    assert_eq!((mask.width, mask.height), (640, 480));
    let inside: usize = mask.bytes.iter().map(|byte| usize::from(byte / 255)).sum();
    assert!(
        inside > 50 && mask.bytes.iter().all(|byte| [0, 255].contains(byte)),
        "{inside}"
    );
}

#[test]
fn a_missing_file_is_named() {
    let error = error_of(Path::new("nowhere.png"));
    assert!(error.contains("nowhere.png: can not be read"), "{error}");
}

#[test]
fn a_jpeg_that_lacks_data_before_its_end_mark_is_an_error() {
    let whole = real_jpeg();
    let folder = TempDir::new().expect("a folder");
    for cut in (700..whole.len() - 2).step_by(307) {
        let bytes = [&whole[..cut], &[0xFF, 0xD9]].concat();
        let error = error_of(&write(&folder, &bytes));
        assert!(error.contains("damaged"), "cut at {cut}: {error}");
    }
}
