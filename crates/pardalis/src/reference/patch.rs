//! Reference implementation of the region and difference cues: one pixel at a time, channel by channel.

use nalgebra::{Point3, Vector3};

use super::open_pixel;
use crate::color::{ChannelBins, ColorModel};
use crate::likelihood::PatchSettings;
use crate::shape::{FlatForm, Shape};
use crate::view::View;
use crate::{Frame, PixelFormat};

/// Returns the sample pixels of a region around a flat shape at a position in the world. The rectangle around
/// the shape, scaled and at the shape's height, is divided into `settings.samples` equal cells along x and
/// along y; samples are their centres. `None` for a sample that has no pixel.
///
/// # Panics
///
/// The shape is not flat.
pub fn region_pixels(
    view: &View,
    shape: &Shape,
    settings: &PatchSettings,
    position_m: [f64; 3],
) -> Vec<Option<[f64; 2]>> {
    let Shape::Flat(flat) = shape else {
        panic!("only flat shapes have regions");
    };
    let [width_m, depth_m] = match flat.form {
        FlatForm::Disc { radius_m } => [2.0 * radius_m, 2.0 * radius_m],
        FlatForm::Rectangle { size_m } => size_m,
    }
    .map(|side_m| side_m * settings.scale);
    let [cell_x_m, cell_y_m] = [width_m, depth_m].map(|side_m| side_m / settings.samples as f64);
    let mut pixels = Vec::new();
    for row in 0..settings.samples {
        for column in 0..settings.samples {
            let from_middle = Vector3::new(
                (column as f64 + 0.5) * cell_x_m - width_m / 2.0,
                (row as f64 + 0.5) * cell_y_m - depth_m / 2.0,
                flat.height_m,
            );
            let place = view.camera_from_world() * (Point3::from(position_m) + from_middle);
            pixels.push(view.camera().project(place.into()));
        }
    }
    pixels
}

/// Computes the region cue's log-likelihood of a target at a position in the world: the product over the
/// frames of one instant, each with its camera's index.
///
/// D² = 1 − Σ√(h·h_ref) for each of red, green and blue, p = exp(−ΣD²/2σ²) (Campos 2009, eqs. 9 and 10). A
/// camera that sees fewer than half the samples contributes D = 1.
pub fn region_log_likelihood(
    settings: &PatchSettings,
    shape: &Shape,
    colors: &ColorModel,
    views: &[View],
    frames: &[(usize, Frame)],
    position_m: [f64; 3],
) -> f64 {
    let channels = colors
        .channels()
        .expect("a model with histograms of channels");
    let references = channels.shares(settings.bins);
    let of_camera = |(camera, frame): &(usize, Frame)| {
        let pixels = region_pixels(&views[*camera], shape, settings, position_m);
        let of_channel = |channel: usize| {
            let value = |x, y| frame.rgb(x, y)[channel];
            squared_distance(
                &views[*camera],
                settings,
                &pixels,
                value,
                &references[channel],
            )
        };
        let squared_distances = of_channel(0) + of_channel(1) + of_channel(2);
        -squared_distances / (2.0 * settings.sigma.powi(2))
    };
    frames.iter().map(of_camera).sum()
}

/// Computes the difference cue's log-likelihood of a target at a position in the world: the product over the
/// frames of one instant, each with its camera's index, compared with the frames that the views have kept.
///
/// Compares the histogram of absolute grey differences with a uniform one (Campos 2009, eqs. 11 and 12). A
/// camera without a previous frame sees no difference.
pub fn difference_log_likelihood(
    settings: &PatchSettings,
    shape: &Shape,
    views: &[View],
    frames: &[(usize, Frame)],
    position_m: [f64; 3],
) -> f64 {
    let bins = settings.bins.count();
    let uniform = vec![1.0 / bins as f64; bins];
    let of_camera = |(camera, frame): &(usize, Frame)| {
        let view = &views[*camera];
        let squared_distance = match view.prepared(frame).before() {
            Some(before) => {
                let pixels = region_pixels(view, shape, settings, position_m);
                let value = |x, y| grey(frame, x, y).abs_diff(grey(before, x, y));
                squared_distance(view, settings, &pixels, value, &uniform)
            }
            None => 1.0 - (1.0 / bins as f64).sqrt(),
        };
        -squared_distance / (2.0 * settings.sigma.powi(2))
    };
    frames.iter().map(of_camera).sum()
}

/// Returns the mean of red, green and blue as an integer; for YUV, Y.
fn grey(frame: &Frame, x: usize, y: usize) -> u8 {
    let components = frame.components(x, y);
    if frame.format() == PixelFormat::Rgb8 {
        let mean = components.map(f64::from).iter().sum::<f64>() / 3.0;
        mean.floor() as u8
    } else {
        components[0]
    }
}

/// Computes D² between the histogram of `value` over the visible pixels and a reference.
fn squared_distance(
    view: &View,
    settings: &PatchSettings,
    pixels: &[Option<[f64; 2]>],
    value: impl Fn(usize, usize) -> u8,
    reference: &[f64],
) -> f64 {
    let seen = pixels.iter().flatten();
    let values: Vec<u8> = seen
        .filter_map(|&pixel| open_pixel(view, pixel))
        .map(|[x, y]| value(x, y))
        .collect();
    if 2 * values.len() < pixels.len() {
        return 1.0;
    }
    let share = |bin: usize| {
        let in_bin = values
            .iter()
            .filter(|&&value| bin_of(settings.bins, value) == bin);
        in_bin.count() as f64 / values.len() as f64
    };
    let similarity = |(bin, reference): (usize, &f64)| (share(bin) * reference).sqrt();
    1.0 - reference.iter().enumerate().map(similarity).sum::<f64>()
}

fn bin_of(bins: ChannelBins, value: u8) -> usize {
    usize::from(value) * bins.count() / 256
}
