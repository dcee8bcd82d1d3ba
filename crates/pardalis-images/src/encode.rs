//! Encoding of JPEG and PNG files.

use jpeg_encoder::{ChromaSubsamplingMethod, ColorType, Encoder, SamplingFactor};

use super::{Image, RgbImage};

/// The reason why an image cannot be encoded.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum EncodeError {
    /// JPEG allows at most 65 535 pixels per side.
    #[error("a side has {0} pixels, but JPEG allows at most 65535")]
    TooLarge(u32),
    /// The JPEG encoder failed.
    #[error("JPEG: {0}")]
    Jpeg(#[from] jpeg_encoder::EncodingError),
    /// The PNG encoder failed.
    #[error("PNG: {0}")]
    Png(#[from] png::EncodingError),
}

/// Chroma subsampling of a JPEG image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum JpegSampling {
    /// Chosen by the encoder according to the quality.
    Automatic,
    /// Two by two pixels share their mean colour, centred between them, as most cameras do (4:2:0).
    TwoByTwo,
}

/// Encodes an image as PNG: grey for one channel, grey with alpha for two, RGB for three, RGBA for four.
///
/// # Panics
///
/// Panics if there is another number of channels.
pub fn encode_png<const CHANNELS: usize>(
    image: &Image<u8, CHANNELS>,
) -> Result<Vec<u8>, EncodeError> {
    let color = match CHANNELS {
        1 => png::ColorType::Grayscale,
        2 => png::ColorType::GrayscaleAlpha,
        3 => png::ColorType::Rgb,
        4 => png::ColorType::Rgba,
        _ => panic!("PNG does not support {CHANNELS} channels"),
    };
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, image.width(), image.height());
    encoder.set_color(color);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_compression(png::Compression::Fast);
    encoder.set_filter(png::Filter::Adaptive);
    let mut writer = encoder.write_header()?;
    writer.write_image_data(image.as_raw())?;
    writer.finish()?;
    Ok(bytes)
}

/// Encodes an image as baseline JPEG with a quality from 1 to 100.
pub fn encode_jpeg(
    image: &RgbImage,
    quality: u8,
    sampling: JpegSampling,
) -> Result<Vec<u8>, EncodeError> {
    let side = |px: u32| u16::try_from(px).map_err(|_| EncodeError::TooLarge(px));
    let (width, height) = (side(image.width())?, side(image.height())?);
    let mut bytes = Vec::new();
    let mut encoder = Encoder::new(&mut bytes, quality);
    if sampling == JpegSampling::TwoByTwo {
        encoder.set_sampling_factor(SamplingFactor::F_2_2);
        encoder.set_chroma_subsampling_method(ChromaSubsamplingMethod::Average);
    }
    encoder.encode(image.as_raw(), width, height, ColorType::Rgb)?;
    Ok(bytes)
}
