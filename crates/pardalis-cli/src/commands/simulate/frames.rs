//! The images of a camera and its times.csv.

use std::fmt::Write as _;
use std::path::PathBuf;

use anyhow::Result;
use image::{ExtendedColorType, ImageEncoder as _};
use jpeg_encoder::{ChromaSubsamplingMethod, ColorType, Encoder, SamplingFactor};
use pardalis_simulate::{Renderer, WorldCamera};
use rayon::prelude::*;

use super::Sequence;
use crate::folder::Folder;
use crate::progress::Progress;
use crate::user_error::user_error;

/// The folder of a camera's images: one for each where there are several.
pub(super) fn folder_of(sequence: &Sequence, camera: usize) -> PathBuf {
    let folder = PathBuf::from("frames");
    match &sequence.world().cameras[..] {
        [_] => folder,
        cameras => folder.join(&cameras[camera].name),
    }
}

/// Writes what a camera delivers: images numbered from 0 in the order in which they arrive, and their times as its clock says.
pub(super) fn write(
    sequence: &Sequence,
    number: usize,
    folder: &Folder,
    progress: &Progress,
) -> Result<()> {
    let camera = &sequence.world().cameras[number];
    let deliveries = &sequence.deliveries[number];
    let images = folder_of(sequence, number);
    folder.make(&images)?;
    let has_delays = camera.timing.has_delays();
    let mut times = "frame,time_s".to_owned() + if has_delays { ",arrival_s\n" } else { "\n" };
    for (frame, delivery) in deliveries.iter().enumerate() {
        // Writing to a String cannot fail.
        let _ = write!(times, "{frame},{}", delivery.stamp_s);
        if has_delays {
            let _ = write!(times, ",{}", delivery.arrival_s);
        }
        times.push('\n');
    }
    folder.write(images.join("times.csv"), times.as_bytes())?;
    let renderer = Renderer::new(sequence.world(), number);
    deliveries
        .par_iter()
        .enumerate()
        .try_for_each(|(frame, delivery)| {
            let (exposure, time_s) = delivery.shown;
            let mut bytes = encoded(camera, &renderer.image(exposure, time_s))?;
            if delivery.is_broken {
                bytes.truncate(bytes.len() / 2);
            }
            let name = format!("{frame:06}.{}", ending_of(camera));
            folder.write(images.join(name), &bytes)?;
            progress.step()
        })
}

/// What a camera's image files end in.
pub(super) fn ending_of(camera: &WorldCamera) -> &'static str {
    match camera.image.jpeg_quality {
        Some(_) => "jpg",
        None => "png",
    }
}

/// The file of a camera's image of three bytes a pixel.
pub(super) fn encoded(camera: &WorldCamera, rgb: &[u8]) -> Result<Vec<u8>> {
    let (width, height) = camera.size_px;
    let mut bytes = Vec::new();
    if let Some(quality) = camera.image.jpeg_quality {
        let side = |px: usize| {
            u16::try_from(px).map_err(|_| user_error!("{px} pixels are too many for JPEG"))
        };
        let mut encoder = Encoder::new(&mut bytes, quality);
        // As webcams deliver it: colours are soft over two pixels, and where they belong; one pixel's colour for four would move them by half a pixel.
        encoder.set_sampling_factor(SamplingFactor::F_2_2);
        encoder.set_chroma_subsampling_method(ChromaSubsamplingMethod::Average);
        encoder.encode(rgb, side(width)?, side(height)?, ColorType::Rgb)?;
    } else {
        let encoder = image::codecs::png::PngEncoder::new(&mut bytes);
        encoder.write_image(rgb, width as u32, height as u32, ExtendedColorType::Rgb8)?;
    }
    Ok(bytes)
}
