//! Reference implementations of the likelihoods and the particle filter: naive, in double precision, directly
//! from the equations, one particle and one point at a time.
//!
//! Tests compare every optimised implementation with these, which share no code with them. They are slow and
//! allocate freely.

use nalgebra::{Matrix3, Vector3};

mod boxed;
mod detected;
mod edge;
mod outline;
mod patch;
mod streak;

pub use boxed::boxes_log_ratio;
pub use detected::{
    Rivals, association_log_weight, mixture_log_ratio, predicted_visibility, size_posterior,
    updated_visibility,
};
pub use edge::{EdgeLines, color_posterior};
pub use outline::{boundary, boundary_along_normals, boundary_of_scales, outline_points};
pub use patch::{difference_log_likelihood, region_log_likelihood, region_pixels};
pub use streak::StreakOfDisc;

use crate::Frame;
use crate::color::{ColorModel, ColorRanges, Histogram, Palette, PixelKind};
use crate::likelihood::{ContourSettings, WindowSettings};
use crate::shape::Shape;
use crate::view::View;

/// Returns the pixel nearest to the given coordinates; `None` outside the image and where the mask is closed.
pub fn open_pixel(view: &View, [u, v]: [f64; 2]) -> Option<[usize; 2]> {
    let (width, height) = view.size();
    let (x, y) = (u.round(), v.round());
    if !(x >= 0.0 && x < width as f64 && y >= 0.0 && y < height as f64) {
        return None;
    }
    let (x, y) = (x as usize, y as usize);
    let open = view.mask().is_none_or(|mask| mask.open()[y * width + x]);
    open.then_some([x, y])
}

/// Returns the bin of three raw bytes. Bytes are quantised to multiples of four, each step represented by its
/// centre, as in pixel tables.
pub fn bin_of_bytes(palette: Palette, kind: PixelKind, bytes: [u8; 3]) -> u16 {
    let middles = bytes.map(|byte| f64::from(byte / 4 * 4) + 1.5);
    match (kind, palette) {
        (PixelKind::Rgb, _) => palette.bin_of_rgb(middles),
        (PixelKind::Yuv(of_frame), Palette::Yuv { encoding, .. }) if encoding == of_frame => {
            let bins = palette.channel_bins();
            let channel = |c: usize| (middles[c] * f64::from(bins[c]) / 256.0).floor() as u16;
            palette
                .bin_of_channels([channel(0), channel(1), channel(2)])
                .expect("bytes are below 256")
        }
        (PixelKind::Yuv(of_frame), _) => palette.bin_of_rgb(of_frame.rgb_from_yuv(middles)),
    }
}

/// Returns the open pixels at the given coordinates.
fn open_pixels(view: &View, coordinates: &[Option<[f64; 2]>]) -> Vec<[usize; 2]> {
    let valid = coordinates.iter().flatten();
    valid.filter_map(|&pixel| open_pixel(view, pixel)).collect()
}

/// Computes the colour histogram of pixels of a frame (Taiana 2007, eq. 4.9); `None` if there are none.
pub fn histogram(palette: Palette, frame: &Frame, pixels: &[[usize; 2]]) -> Option<Histogram> {
    let mut counts = vec![0; palette.bin_count()];
    for &[x, y] in pixels {
        let bin = bin_of_bytes(palette, PixelKind::of(frame), frame.components(x, y));
        counts[usize::from(bin)] += 1;
    }
    Histogram::from_counts(&counts)
}

/// Computes the contour cue's log-likelihood of a body at a position in the world: the product over the
/// frames of one instant, each with its camera's index.
///
/// D = ((1 − S(model, inner)) + κ·S(outer, inner)) / (κ + 1), p = exp(−|D|/b). A camera that sees fewer than
/// half the points of either contour counts as pure background: S(model, inner) = 0 and S(outer, inner) = 1,
/// so that D = 1.
pub fn contour_log_likelihood(
    settings: &ContourSettings,
    shape: &Shape,
    colors: &ColorModel,
    views: &[View],
    frames: &[(usize, Frame)],
    position_m: [f64; 3],
) -> f64 {
    let of_camera = |(camera, frame): &(usize, Frame)| {
        let view = &views[*camera];
        let samples = settings.sampling.samples(settings.points);
        let pixels =
            boundary(view, shape, settings, position_m).map(|side| open_pixels(view, &side));
        if pixels.iter().any(|valid| 2 * valid.len() < samples) {
            return -1.0 / settings.b;
        }
        let [inner, outer] = pixels.map(|pixels| histogram(colors.palette(), frame, &pixels));
        let (inner, outer) = (
            inner.expect("half the points"),
            outer.expect("half the points"),
        );
        let unlike_model = 1.0 - colors.histogram().similarity(&inner);
        let like_outside = outer.similarity(&inner);
        let distance = (unlike_model + settings.kappa * like_outside) / (settings.kappa + 1.0);
        -distance.abs() / settings.b
    };
    frames.iter().map(of_camera).sum()
}

/// Reports whether three raw bytes lie in ranges of colour. Bytes are quantised to multiples of four, each
/// step represented by its centre, as in lookup tables.
pub fn matches(ranges: &ColorRanges, kind: PixelKind, bytes: [u8; 3]) -> bool {
    let middles = bytes.map(|byte| f64::from(byte / 4 * 4) + 1.5);
    ranges.contain_rgb(match kind {
        PixelKind::Rgb => middles,
        PixelKind::Yuv(encoding) => encoding.rgb_from_yuv(middles),
    })
}

/// Computes the window cue's log-likelihood of a target at a position in the world: the product over the
/// frames of one instant, each with its camera's index (Barrera 2005, eqs. 5 to 7).
pub fn window_log_likelihood(
    settings: &WindowSettings,
    ranges: &ColorRanges,
    views: &[View],
    frames: &[(usize, Frame)],
    position_m: [f64; 3],
) -> f64 {
    let of_camera = |(camera, frame): &(usize, Frame)| {
        let view = &views[*camera];
        let in_camera = view.camera_from_world() * nalgebra::Point3::from(position_m);
        let projected = view
            .camera()
            .project([in_camera.x, in_camera.y, in_camera.z]);
        let Some([x, y]) = projected.and_then(|pixel| open_pixel(view, pixel)) else {
            return settings.outside;
        };
        let half = settings.size_px as i64 / 2;
        let mut matching = 0;
        for dy in -half..=half {
            for dx in -half..=half {
                let pixel = [x as f64 + dx as f64, y as f64 + dy as f64];
                matching += open_pixel(view, pixel).is_some_and(|[x, y]| {
                    matches(ranges, PixelKind::of(frame), frame.components(x, y))
                }) as u32;
            }
        }
        let share = f64::from(matching) / (settings.size_px * settings.size_px) as f64;
        share.max(settings.floor)
    };
    frames.iter().map(|frame| libm::log(of_camera(frame))).sum()
}

/// The state of a particle filter after an update.
#[derive(Debug, Clone, PartialEq)]
pub struct Posterior {
    /// Weights of the particles, which sum to one.
    pub weights: Vec<f64>,
    /// Weighted mean of the positions, in metres.
    pub mean_m: Vector3<f64>,
    /// Weighted covariance of the positions, in m².
    pub covariance_m2: Matrix3<f64>,
    /// Effective sample size, 1/Σw².
    pub effective_sample_size: f64,
}

/// Weights particles by their likelihoods: w ∝ prior weight · p. `None` if all weights are zero. NaN counts
/// as a likelihood of zero.
pub fn posterior(
    prior_weights: &[f64],
    log_likelihoods: &[f64],
    positions_m: &[Vector3<f64>],
) -> Option<Posterior> {
    let largest = log_likelihoods
        .iter()
        .copied()
        .fold(f64::NEG_INFINITY, f64::max);
    let unnormalised: Vec<f64> = prior_weights
        .iter()
        .zip(log_likelihoods)
        .map(|(prior, log)| prior * libm::exp(log - largest))
        .map(|weight| if weight.is_nan() { 0.0 } else { weight })
        .collect();
    let total: f64 = unnormalised.iter().sum();
    if !(total > 0.0) {
        return None;
    }
    let weights: Vec<f64> = unnormalised.iter().map(|w| w / total).collect();
    let mean_m = weights
        .iter()
        .zip(positions_m)
        .map(|(w, x)| x * *w)
        .sum::<Vector3<f64>>();
    let covariance_m2 = weights
        .iter()
        .zip(positions_m)
        .map(|(w, x)| (x - mean_m) * (x - mean_m).transpose() * *w)
        .sum();
    let effective_sample_size = 1.0 / weights.iter().map(|w| w * w).sum::<f64>();
    Some(Posterior {
        weights,
        mean_m,
        covariance_m2,
        effective_sample_size,
    })
}
