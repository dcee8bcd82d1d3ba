//! Decoding of real and damaged files.

use pardalis_images::{RgbImage, decode, decode_grey, encode_png};

fn real(file: &str) -> Vec<u8> {
    let data = concat!(env!("CARGO_MANIFEST_DIR"), "/../../data");
    std::fs::read(format!("{data}/{file}")).expect("bundled data")
}

fn real_jpeg() -> Vec<u8> {
    real("dioptric-jump/frames/000030.jpg")
}

fn patterned() -> RgbImage {
    RgbImage::from_fn(64, 48, |x, y| [x as u8, y as u8, (x * y % 251) as u8])
}

fn png(image: &RgbImage) -> Vec<u8> {
    encode_png(image).expect("a PNG image")
}

/// Returns a PNG file of one pixel.
fn one_pixel(color: png::ColorType, depth: png::BitDepth, sample: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, 1, 1);
    encoder.set_color(color);
    encoder.set_depth(depth);
    let mut writer = encoder.write_header().expect("a header");
    writer.write_image_data(sample).expect("one pixel");
    writer.finish().expect("an end");
    bytes
}

fn error_of(file: &[u8]) -> String {
    match decode(file) {
        Ok(image) => panic!("{} x {} pixels were decoded", image.width(), image.height()),
        Err(error) => error.to_string(),
    }
}

fn assert_cuts_are_errors(whole: &[u8], cuts: impl Iterator<Item = usize>) {
    for cut in cuts {
        let error = error_of(&whole[..cut]);
        assert!(error.contains("replace"), "{error}");
    }
}

/// Returns the 64-bit FNV-1a hash of the samples.
fn checksum(image: &RgbImage) -> u64 {
    let fold = |hash: u64, byte: &u8| (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3);
    image.as_raw().iter().fold(0xcbf2_9ce4_8422_2325, fold)
}

/// Files with their first pixel and the hash of all pixels, as decoded by the crate `image` 0.25.
const KNOWN: [(&str, [u8; 3], u64); 4] = [
    (
        "dioptric-jump/frames/000004.jpg",
        [1, 1, 1],
        0xf93a_18f9_6958_6075,
    ),
    (
        "plane-robot/frames/000000.jpg",
        [162, 154, 141],
        0x267b_ad49_9303_4180,
    ),
    (
        "calibration/opencv-stereo/left03.jpg",
        [0, 0, 0],
        0x466e_ac3c_768b_d3a4,
    ),
    (
        "training/webcam/002_ball_mask.png",
        [0, 0, 0],
        0xff0c_5e05_f1f6_b098,
    ),
];

#[test]
fn decoded_pixels_have_known_values() {
    for (file, first, expected) in KNOWN {
        let image = decode(&real(file)).expect("bundled data");
        assert_eq!(image.get_pixel(0, 0), first, "{file}");
        assert_eq!(checksum(&image), expected, "{file}");
    }
}

#[test]
fn truncated_jpeg_files_are_an_error() {
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
fn truncated_png_files_are_an_error() {
    let whole = png(&patterned());
    // The last four bytes are the checksum of the end chunk.
    assert_cuts_are_errors(&whole, 0..whole.len() - 4);
}

#[test]
fn complete_jpeg_files_may_be_followed_by_other_bytes() {
    let mut bytes = real_jpeg();
    let image = decode(&bytes).expect("whole");
    assert_eq!(
        (image.dimensions(), image.as_raw().len()),
        ((640, 480), 640 * 480 * 3)
    );
    bytes.extend(b"recorder's notes");
    assert_eq!(decode(&bytes).expect("whole"), image);
}

#[test]
fn invalid_sizes_in_headers_are_rejected() {
    let mut huge_jpeg = real_jpeg();
    let sof = huge_jpeg
        .windows(2)
        .position(|pair| pair == [0xFF, 0xC0])
        .expect("a frame header");
    huge_jpeg[sof + 5..sof + 9].copy_from_slice(&[0xEA, 0x60, 0xEA, 0x60]);
    let mut empty_jpeg = huge_jpeg.clone();
    empty_jpeg[sof + 5..sof + 9].copy_from_slice(&[0, 0, 2, 128]);
    let mut huge_png = png(&RgbImage::new(4, 4));
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
        let error = error_of(bytes);
        assert!(error.contains(expected), "{error}");
    }
}

#[test]
fn damaged_png_data_are_an_error() {
    let mut bytes = png(&patterned());
    let middle = bytes.len() / 2;
    bytes[middle] ^= 0x55;
    let error = error_of(&bytes);
    assert!(error.contains("damaged"), "{error}");
}

#[test]
fn all_pixel_types_of_png_decode_to_rgb_and_grey() {
    use png::BitDepth::{Eight, One, Sixteen};
    use png::ColorType::{Grayscale, GrayscaleAlpha, Rgb, Rgba};
    let one = |color, depth, sample: &[u8]| {
        let file = one_pixel(color, depth, sample);
        let grey = decode_grey(&file).expect("decodes").into_raw();
        (decode(&file).expect("decodes").into_raw(), grey)
    };
    let grey = (vec![200; 3], vec![200]);
    assert_eq!(one(Grayscale, Eight, &[200]), grey);
    assert_eq!(one(Grayscale, Sixteen, &[200, 200]), grey);
    // 200.506 and 199.504 of 255: rounded, not truncated.
    assert_eq!(one(Grayscale, Sixteen, &[201, 74]).1, [201]);
    assert_eq!(one(Grayscale, Sixteen, &[200, 72]).1, [200]);
    assert_eq!(one(Grayscale, One, &[0x80]).1, [255]);
    assert_eq!(one(GrayscaleAlpha, Eight, &[200, 3]), grey);
    let colored = (vec![10, 20, 30], vec![18]);
    assert_eq!(one(Rgba, Eight, &[10, 20, 30, 0]), colored);
    assert_eq!(one(Rgb, Sixteen, &[10, 10, 20, 20, 30, 30]), colored);
    // An image of 2 x 1 pixels with a one-bit palette: blue and white.
    let palette: &[u8] = &[
        0x89, 0x50, 0x4E, 0x47, 0x0D, 0x0A, 0x1A, 0x0A, 0, 0, 0, 13, 0x49, 0x48, 0x44, 0x52, 0, 0,
        0, 2, 0, 0, 0, 1, 1, 3, 0, 0, 0, 0xce, 0xec, 0xed, 0xc9, 0, 0, 0, 6, 0x50, 0x4c, 0x54,
        0x45, 0, 0, 0xff, 0xff, 0xff, 0xff, 0x7b, 0xdc, 0x99, 0x2c, 0, 0, 0, 0xa, 0x49, 0x44, 0x41,
        0x54, 0x78, 0x9c, 0x63, 0x70, 0, 0, 0, 0x42, 0, 0x41, 0x29, 0x37, 0xf4, 0xef, 0, 0, 0, 0,
        0x49, 0x45, 0x4e, 0x44, 0xae, 0x42, 0x60, 0x82,
    ];
    let image = decode(palette).expect("decodes");
    assert_eq!(image.as_raw(), [0, 0, 255, 255, 255, 255]);
}

#[test]
fn real_masks_are_black_and_white() {
    let mask = decode_grey(&real("training/dioptric/000_ball_mask.png")).expect("a mask");
    assert_eq!(mask.dimensions(), (640, 480));
    let inside: usize = mask
        .as_raw()
        .iter()
        .map(|byte| usize::from(byte / 255))
        .sum();
    assert!(
        inside > 50 && mask.as_raw().iter().all(|byte| [0, 255].contains(byte)),
        "{inside}"
    );
}

#[test]
fn jpeg_files_with_missing_data_before_the_end_marker_are_an_error() {
    let whole = real_jpeg();
    for cut in (700..whole.len() - 2).step_by(307) {
        let bytes = [&whole[..cut], &[0xFF, 0xD9]].concat();
        let error = error_of(&bytes);
        assert!(error.contains("damaged"), "cut at {cut}: {error}");
    }
}
