//! Pixels of PNG files, converted row by row: no more memory than the RGB image and a few rows.

use std::io::Cursor;

use png::{BitDepth, ColorType, Decoder, DecodingError, InterlaceInfo, Transformations};

/// Decodes a PNG file with this width and height, which its header states, to 8-bit RGB samples. Compressed chunks without
/// pixels are skipped: they could fill any memory.
pub(crate) fn rgb_from_png(
    bytes: &[u8],
    (width, height): (usize, usize),
) -> Result<Vec<u8>, String> {
    let reason = |error: DecodingError| format!("PNG: {error}");
    let mut decoder = Decoder::new(Cursor::new(bytes));
    decoder.set_ignore_text_chunk(true);
    decoder.set_ignore_iccp_chunk(true);
    // Converts palettes to colours, and samples of fewer than 8 bits to 8 bits.
    decoder.set_transformations(Transformations::EXPAND);
    let mut reader = decoder.read_info().map_err(reason)?;
    // The decoder would panic.
    let palette = reader.info().palette.as_deref().unwrap_or_default();
    if palette.len() % 3 != 0 {
        return Err("PNG: the palette ends within a colour".to_owned());
    }
    let (color, depth) = reader.output_color_type();
    let stride = 3 * width;
    let mut samples = vec![0; stride * height];
    let mut line = 0;
    while let Some(row) = reader.next_interlaced_row().map_err(reason)? {
        let rgb = rgb_from_row(row.data(), color, depth);
        match row.interlace() {
            InterlaceInfo::Null(_) => samples[line * stride..][..stride].copy_from_slice(&rgb),
            InterlaceInfo::Adam7(pass) => {
                png::expand_interlaced_row(&mut samples, stride, &rgb, pass, 24);
            }
        }
        line += 1;
    }
    Ok(samples)
}

/// Converts a row of samples to 8-bit RGB.
fn rgb_from_row(row: &[u8], color: ColorType, depth: BitDepth) -> Vec<u8> {
    let rounded;
    let row = if depth == BitDepth::Sixteen {
        rounded = eight_bits(row);
        &rounded
    } else {
        row
    };
    match color {
        ColorType::Grayscale => rgb_from(row, |[grey]| [grey; 3]),
        ColorType::GrayscaleAlpha => rgb_from(row, |[grey, _]| [grey; 3]),
        ColorType::Rgba => rgb_from(row, |[r, g, b, _]| [r, g, b]),
        // Palettes have been expanded.
        ColorType::Rgb | ColorType::Indexed => row.to_vec(),
    }
}

/// Rounds big-endian samples of two bytes to one byte.
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
