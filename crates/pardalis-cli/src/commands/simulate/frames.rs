//! The images of a camera, and its times.csv.

use std::fmt::Write as _;
use std::path::PathBuf;

use anyhow::Result;
use pardalis_images::{JpegSampling, RgbImage, encode_jpeg, encode_png};
use pardalis_simulate::{Renderer, WorldCamera};
use rayon::prelude::*;

use super::Sequence;
use crate::folder::Folder;
use crate::progress::Progress;
use crate::user_error::user_error;

/// Returns the folder of a camera's images: a separate one for each if there are several cameras.
pub(super) fn folder_of(sequence: &Sequence, camera: usize) -> PathBuf {
    let folder = PathBuf::from("frames");
    match &sequence.world().cameras[..] {
        [_] => folder,
        cameras => folder.join(&cameras[camera].name),
    }
}

/// Writes the images of a camera, numbered from 0 in order of arrival, and their times on its clock.
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
            let mut bytes = encoded(camera, renderer.image(exposure, time_s))?;
            if delivery.is_broken {
                bytes.truncate(bytes.len() / 2);
            }
            let name = format!("{frame:06}.{}", ending_of(camera));
            folder.write(images.join(name), &bytes)?;
            progress.step()
        })
}

/// Returns the extension of a camera's image files.
pub(super) fn ending_of(camera: &WorldCamera) -> &'static str {
    match camera.image.jpeg_quality {
        Some(_) => "jpg",
        None => "png",
    }
}

/// Encodes a camera's image of three bytes per pixel.
pub(super) fn encoded(camera: &WorldCamera, rgb: Vec<u8>) -> Result<Vec<u8>> {
    let (width, height) = camera.size_px;
    let image =
        RgbImage::from_raw(width as u32, height as u32, rgb).expect("three bytes per pixel");
    let file = match camera.image.jpeg_quality {
        // Like webcams, but without chroma sited half a pixel off, which the encoder's own choice would produce.
        Some(quality) => encode_jpeg(&image, quality, JpegSampling::TwoByTwo),
        None => encode_png(&image),
    };
    file.map_err(|error| user_error!("{error}"))
}
