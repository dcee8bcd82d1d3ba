//! The pixels of images in messages.

use pardalis::PixelFormat;
use pardalis_images::decode;

/// A decoded image.
pub struct Pixels {
    /// Width and height in pixels.
    pub size_px: (usize, usize),
    /// Their format.
    pub format: PixelFormat,
    /// The pixels, row by row.
    pub bytes: Vec<u8>,
}

/// Decodes a JPEG or PNG image.
pub(super) fn compressed(data: &[u8]) -> Result<Pixels, String> {
    let image = decode(data).map_err(|error| error.to_string())?;
    Ok(Pixels {
        size_px: image.size_px(),
        format: PixelFormat::Rgb8,
        bytes: image.into_raw(),
    })
}

/// The encodings of raw images, as ROS and Foxglove call them, for messages.
const ENCODINGS: &str =
    "rgb8, bgr8, rgba8, bgra8, mono8, 8UC1, 8UC3, yuv422, uyvy, yuv422_yuy2, yuyv, nv12";

/// Reads an image without compression, whose rows begin `step` bytes apart.
pub(super) fn raw(
    (width, height): (u32, u32),
    step: u32,
    encoding: &str,
    data: &[u8],
) -> Result<Pixels, String> {
    /// The channels of a pixel, and where red, green and blue are among them.
    type Layout = (usize, [usize; 3]);
    let (width, height, step) = (width as usize, height as usize, step as usize);
    // Bytes of a row, number of rows, and the format.
    let (row, rows, format): (_, _, Result<Layout, PixelFormat>) = match encoding {
        "rgb8" => (3 * width, height, Err(PixelFormat::Rgb8)),
        "bgr8" | "8UC3" => (3 * width, height, Ok((3, [2, 1, 0]))),
        "rgba8" => (4 * width, height, Ok((4, [0, 1, 2]))),
        "bgra8" => (4 * width, height, Ok((4, [2, 1, 0]))),
        "mono8" | "8UC1" => (width, height, Ok((1, [0, 0, 0]))),
        "yuv422" | "uyvy" => (4 * width.div_ceil(2), height, Err(PixelFormat::Uyvy)),
        "yuv422_yuy2" | "yuyv" => (4 * width.div_ceil(2), height, Err(PixelFormat::Yuyv)),
        "nv12" => (
            2 * width.div_ceil(2),
            height + height.div_ceil(2),
            Err(PixelFormat::Nv12),
        ),
        _ => {
            return Err(format!(
                "its encoding is \"{encoding}\"; allowed: {ENCODINGS}; convert it, or record the compressed images"
            ));
        }
    };
    if width == 0 || height == 0 || step < row || data.len() < (rows - 1) * step + row {
        return Err(format!(
            "its {width} x {height} pixels with rows {step} bytes apart do not fit into its {} bytes",
            data.len()
        ));
    }
    let each_row = data.chunks(step).take(rows).map(|bytes| &bytes[..row]);
    let (format, bytes) = match format {
        Err(format) => (format, each_row.flatten().copied().collect()),
        Ok((channels, places)) => {
            let pixels = each_row.flat_map(|bytes| bytes.chunks_exact(channels));
            let bytes = pixels.flat_map(|pixel| places.map(|place| pixel[place]));
            (PixelFormat::Rgb8, bytes.collect())
        }
    };
    Ok(Pixels {
        size_px: (width, height),
        format,
        bytes,
    })
}
