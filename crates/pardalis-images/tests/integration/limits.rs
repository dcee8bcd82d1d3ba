//! Files that are large, or claim to be, and the order of rows in interlaced ones.

use pardalis_images::{
    DecodeError, JpegSampling, MAX_PIXELS, RgbImage, decode, encode_jpeg, encode_png, size,
};

/// Adds a chunk with its length and its checksum.
fn push_chunk(file: &mut Vec<u8>, name: [u8; 4], data: &[u8]) {
    file.extend((data.len() as u32).to_be_bytes());
    let start = file.len();
    file.extend(name);
    file.extend(data);
    let mut crc = u32::MAX;
    for byte in &file[start..] {
        crc ^= u32::from(*byte);
        for _ in 0..8 {
            crc = (crc >> 1) ^ (0xEDB8_8320 & (crc & 1).wrapping_neg());
        }
    }
    file.extend((!crc).to_be_bytes());
}

/// Returns an RGB image as a PNG file whose rows are interlaced, and not compressed.
fn interlaced_png(image: &RgbImage) -> Vec<u8> {
    let (width, height) = image.dimensions();
    let mut rows = Vec::new();
    // The first column and row of each pass, and its steps (PNG specification, 8.2).
    for [u0, v0, du, dv] in [
        [0, 0, 8, 8],
        [4, 0, 8, 8],
        [0, 4, 4, 8],
        [2, 0, 4, 4],
        [0, 2, 2, 4],
        [1, 0, 2, 2],
        [0, 1, 1, 2],
    ] {
        for v in (v0..height).step_by(dv as usize) {
            if u0 < width {
                rows.push(0);
            }
            for u in (u0..width).step_by(du as usize) {
                rows.extend(image.get_pixel(u, v));
            }
        }
    }
    // One block that is stored as it is, and the Adler checksum.
    let length = rows.len() as u16;
    let mut data = vec![0x78, 0x01, 1];
    data.extend(length.to_le_bytes());
    data.extend((!length).to_le_bytes());
    data.extend(&rows);
    let (mut a, mut b) = (1_u32, 0_u32);
    for byte in &rows {
        a = (a + u32::from(*byte)) % 65_521;
        b = (b + a) % 65_521;
    }
    data.extend((b << 16 | a).to_be_bytes());
    let mut header = [width.to_be_bytes(), height.to_be_bytes()].concat();
    header.extend([8, 2, 0, 0, 1]);
    let mut file = b"\x89PNG\r\n\x1a\n".to_vec();
    push_chunk(&mut file, *b"IHDR", &header);
    push_chunk(&mut file, *b"IDAT", &data);
    push_chunk(&mut file, *b"IEND", &[]);
    file
}

#[test]
fn interlaced_png_files_decode_to_the_same_pixels() {
    for (width, height) in [(1, 1), (3, 2), (8, 8), (13, 21)] {
        let image = RgbImage::from_fn(width, height, |u, v| [u as u8, v as u8, (u * v) as u8]);
        let plain = decode(&encode_png(&image).expect("a PNG image"));
        assert_eq!(plain.as_ref(), Ok(&image));
        assert_eq!(decode(&interlaced_png(&image)), plain);
    }
}

#[test]
fn images_with_too_many_pixels_are_refused_by_their_headers() {
    let with_size = |width: u32, height: u32| {
        let mut file = encode_png(&RgbImage::new(4, 4)).expect("a PNG image");
        file[16..20].copy_from_slice(&width.to_be_bytes());
        file[20..24].copy_from_slice(&height.to_be_bytes());
        file
    };
    assert_eq!(size(&with_size(8192, 8192)), Ok((8192, 8192)));
    assert_eq!(8192 * 8192, MAX_PIXELS);
    for result in [
        size(&with_size(8192, 8193)).map(|_| ()),
        decode(&with_size(8192, 8193)).map(|_| ()),
    ] {
        let error = result.expect_err("too large").to_string();
        assert!(
            error.contains("8192 x 8193 pixels; at most 67108864"),
            "{error}"
        );
    }
}

/// A later header neither frees a file from the limits of size nor contradicts the pixels.
#[test]
fn the_first_of_several_headers_holds() {
    let image = |width, height| RgbImage::from_fn(width, height, |x, y| [x as u8, y as u8, 7]);
    let [small, large] = [image(2, 2), image(40, 30)];
    let [first, second] = [&small, &large].map(|image| encode_png(image).unwrap());
    // Without its last chunk, and without the signature.
    let two = [&first[..first.len() - 12], &second[8..]].concat();
    assert_eq!(size(&two), Ok((2, 2)));
    assert!(!matches!(decode(&two), Ok(image) if image != small));

    let mut jpeg = encode_jpeg(&small, 90, JpegSampling::Automatic).unwrap();
    let frame = jpeg
        .windows(2)
        .position(|marker| marker == [0xFF, 0xC0])
        .unwrap();
    let length = 2 + usize::from(jpeg[frame + 3]);
    let header = jpeg[frame..frame + length].to_vec();
    let end = jpeg.len() - 2;
    jpeg.splice(end..end, header);
    jpeg[frame + 5..frame + 9].copy_from_slice(&[0x40, 0, 0x40, 0]);
    assert_eq!(
        decode(&jpeg),
        Err(DecodeError::TooManyPixels(16_384, 16_384))
    );
}
