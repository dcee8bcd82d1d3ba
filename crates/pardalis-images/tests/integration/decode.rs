//! Decoding of real and damaged files.

use pardalis_images::{
    JpegSampling, RgbImage, decode, decode_grey, encode_jpeg, encode_png, exif_focal_length_px,
    size,
};

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
        (
            b"BM\x36\x00",
            "a BMP image, and only JPEG and PNG are read; convert it",
        ),
        (b"GIF89a", "a GIF image"),
        (b"II*\0\x08", "a TIFF image"),
        (b"MM\0*\0", "a TIFF image"),
        (b"RIFF\x00\x01\x00\x00WEBPVP8 ", "a WebP image"),
        (b"\0\0\0\x18ftypheic\0\0", "a HEIC image"),
        (b"\0\0\0\x18ftypmif1\0\0", "a HEIC image"),
        (b"\0\0\0\x1cftypavif\0\0", "an AVIF image"),
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
fn palettes_that_end_within_a_color_are_an_error() {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, 1, 1);
    encoder.set_color(png::ColorType::Indexed);
    encoder.set_palette(vec![200; 4]);
    let mut writer = encoder.write_header().expect("a header");
    writer.write_image_data(&[0]).expect("one pixel");
    writer.finish().expect("an end");
    let error = error_of(&bytes);
    assert!(error.contains("palette"), "{error}");
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

/// A tag of EXIF data: its number, its type, and its value as a number or a fraction.
type Tag = (u16, u16, [u32; 2]);

const SHORT: u16 = 3;
const LONG: u16 = 4;
const RATIONAL: u16 = 5;

/// Returns EXIF data with tags in the first directory and in that of details.
fn exif(is_big_endian: bool, first: &[Tag], details: &[Tag]) -> Vec<u8> {
    let u16_bytes = |v: u16| {
        if is_big_endian {
            v.to_be_bytes()
        } else {
            v.to_le_bytes()
        }
    };
    let u32_bytes = |v: u32| {
        if is_big_endian {
            v.to_be_bytes()
        } else {
            v.to_le_bytes()
        }
    };
    let mut tiff = if is_big_endian {
        b"MM".to_vec()
    } else {
        b"II".to_vec()
    };
    tiff.extend(u16_bytes(42));
    tiff.extend(u32_bytes(8));
    let details_at = 8 + 2 + 12 * (first.len() as u32 + 1) + 4;
    let fractions_at = details_at + 2 + 12 * details.len() as u32 + 4;
    let mut fractions = Vec::new();
    let pointer = (0x8769, LONG, [details_at, 0]);
    for directory in [&[first, &[pointer]].concat()[..], details] {
        tiff.extend(u16_bytes(directory.len() as u16));
        for &(tag, kind, [value, denominator]) in directory {
            tiff.extend(u16_bytes(tag));
            tiff.extend(u16_bytes(kind));
            tiff.extend(u32_bytes(1));
            match kind {
                SHORT => tiff.extend([u16_bytes(value as u16), [0; 2]].concat()),
                LONG => tiff.extend(u32_bytes(value)),
                _ => {
                    tiff.extend(u32_bytes(fractions_at + fractions.len() as u32));
                    fractions.extend(u32_bytes(value));
                    fractions.extend(u32_bytes(denominator));
                }
            }
        }
        tiff.extend(u32_bytes(0));
    }
    [b"Exif\0\0".to_vec(), tiff, fractions].concat()
}

/// Returns a JPEG file with these EXIF data.
fn jpeg_with(image: &RgbImage, exif: &[u8]) -> Vec<u8> {
    let plain = encode_jpeg(image, 100, JpegSampling::Automatic).expect("a JPEG image");
    let length = (exif.len() as u16 + 2).to_be_bytes();
    [&plain[..2], &[0xFF, 0xE1], &length, exif, &plain[2..]].concat()
}

/// Returns where a pixel x, y of an upright image of this width and height is stored.
type StoredAt = fn(u32, u32, u32, u32) -> [u32; 2];

#[test]
fn jpeg_images_are_turned_upright() {
    // Squares of 8 pixels, so that compression does not mix them.
    let colors = [
        [200, 0, 0],
        [0, 200, 0],
        [0, 0, 200],
        [200, 200, 0],
        [0, 200, 200],
        [99; 3],
    ];
    let upright = RgbImage::from_fn(24, 16, |x, y| colors[(x / 8 + 3 * (y / 8)) as usize]);
    let [width, height] = [24, 16];
    // Where each orientation stores the pixel x, y of the upright image.
    let stored_at: [StoredAt; 8] = [
        |x, y, _, _| [x, y],
        |x, y, w, _| [w - 1 - x, y],
        |x, y, w, h| [w - 1 - x, h - 1 - y],
        |x, y, _, h| [x, h - 1 - y],
        |x, y, _, _| [y, x],
        |x, y, w, _| [y, w - 1 - x],
        |x, y, w, h| [h - 1 - y, w - 1 - x],
        |x, y, _, h| [h - 1 - y, x],
    ];
    for (number, stored_at) in (1..).zip(stored_at) {
        let (stored_width, stored_height) = if number < 5 { (24, 16) } else { (16, 24) };
        let mut stored = RgbImage::new(stored_width, stored_height);
        for (x, y, pixel) in upright.enumerate_pixels() {
            let [column, row] = stored_at(x, y, width, height);
            stored.put_pixel(column, row, pixel);
        }
        for is_big_endian in [false, true] {
            let data = exif(is_big_endian, &[(0x0112, SHORT, [number, 0])], &[]);
            let file = jpeg_with(&stored, &data);
            assert_eq!(size(&file), Ok((24, 16)), "orientation {number}");
            let decoded = decode(&file).expect("a JPEG image");
            assert_eq!(decoded.dimensions(), (24, 16), "orientation {number}");
            for (x, y, pixel) in upright.enumerate_pixels() {
                let found = decoded.get_pixel(x, y);
                let is_near = (0..3).all(|c| pixel[c].abs_diff(found[c]) < 30);
                assert!(
                    is_near,
                    "orientation {number}, {x} {y}: {found:?} {pixel:?}"
                );
            }
        }
    }
}

#[test]
fn focal_lengths_follow_from_exif_data() {
    let image = RgbImage::new(40, 30);
    let focal_px = |tags: &[Tag]| {
        let file = jpeg_with(&image, &exif(true, &[], tags));
        exif_focal_length_px(&file).expect("a JPEG image")
    };
    // 40 x 30 pixels have a diagonal of 50, film one of 43.27 mm.
    let film = (0xA405, SHORT, [26, 0]);
    let expected = 26.0 / 43.266_615 * 50.0;
    assert!((focal_px(&[film]).expect("a length") - expected).abs() < 1e-4);
    let millimetres = (0x920A, RATIONAL, [42, 10]);
    let per_centimetre = [(0xA20E, RATIONAL, [1000, 1]), (0xA210, SHORT, [3, 0])];
    let sensor = [&[millimetres], &per_centimetre[..]].concat();
    assert_eq!(focal_px(&sensor), Some(4.2 * 100.0));
    // The image was recorded with 80 columns and scaled to 40.
    let scaled = [&sensor[..], &[(0xA002, LONG, [80, 0])]].concat();
    assert_eq!(focal_px(&scaled), Some(210.0));
    assert_eq!(
        focal_px(&[millimetres, (0xA20E, RATIONAL, [2540, 1])]),
        Some(420.0)
    );
    assert_eq!(focal_px(&[film, sensor[0], sensor[1]]), focal_px(&[film]));
    for unknown in [
        &[][..],
        &[millimetres],
        &per_centimetre,
        &[(0xA405, SHORT, [0, 0])],
        &[(0x920A, RATIONAL, [42, 0]), per_centimetre[0]],
    ] {
        assert_eq!(focal_px(unknown), None, "{unknown:?}");
    }
    assert_eq!(exif_focal_length_px(&real_jpeg()), Ok(None));
    assert_eq!(exif_focal_length_px(&png(&image)), Ok(None));
}

#[test]
fn damaged_exif_data_are_left_out() {
    let image = RgbImage::new(40, 30);
    let whole = exif(
        false,
        &[(0x0112, SHORT, [1, 0])],
        &[(0xA405, SHORT, [26, 0]), (0x920A, RATIONAL, [42, 10])],
    );
    for cut in 0..whole.len() {
        let file = jpeg_with(&image, &whole[..cut]);
        assert_eq!(size(&file), Ok((40, 30)), "{cut} bytes");
    }
    for at in 6..whole.len() {
        let mut damaged = whole.clone();
        damaged[at] = 0xFF;
        let file = jpeg_with(&image, &damaged);
        assert!(
            decode(&file).is_ok() && exif_focal_length_px(&file).is_ok(),
            "byte {at}"
        );
    }
}
