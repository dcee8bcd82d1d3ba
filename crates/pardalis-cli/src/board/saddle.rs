//! Saddle points of the brightness: where two dark and two light corners of squares meet.

use std::f64::consts::PI;

use chess_corners_core::{ChessParams, find_corners_u8};
use nalgebra::{SMatrix, SVector};
use pardalis_images::GrayImage;

/// The saddle points of one image at most: the strongest are kept.
const MAX_SADDLES: usize = 3000;

/// The least response of the detector: a sharp corner of n grey levels' contrast has 8 n, noise hardly any.
const MIN_RESPONSE: f32 = 30.0;

/// A saddle point.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Saddle {
    /// Place in pixels; centres of pixels are at integers.
    pub(crate) pixel: [f64; 2],
    /// Directions of the four edges that meet, as angles in rad from x towards y of the image. From the first to the second and
    /// from the third to the fourth the image is dark, between the others light.
    pub(crate) directions_rad: [f64; 4],
}

/// All saddle points that the image may have, many of them no corners of any square.
pub(crate) fn find(image: &GrayImage) -> Vec<Saddle> {
    let (width, height) = (image.width() as usize, image.height() as usize);
    let mut settings = ChessParams::default();
    settings.threshold = MIN_RESPONSE;
    let mut corners = find_corners_u8(image.as_raw(), width, height, &settings);
    corners.sort_by(|a, b| b.response.total_cmp(&a.response));
    corners.truncate(MAX_SADDLES);
    corners
        .iter()
        .filter_map(|corner| {
            let [first, second] = corner.axes?.map(|axis| f64::from(axis.angle));
            Some(Saddle {
                pixel: [f64::from(corner.x), f64::from(corner.y)],
                directions_rad: [first, second, first + PI, second + PI],
            })
        })
        .collect()
}

/// Brightness between the centres of pixels, 0 to 255; beyond the border that of the border.
pub(crate) fn brightness(image: &GrayImage, [x, y]: [f64; 2]) -> f64 {
    let (x_max, y_max) = (image.width() - 1, image.height() - 1);
    let (x, y) = (
        x.clamp(0.0, f64::from(x_max)),
        y.clamp(0.0, f64::from(y_max)),
    );
    let (left, top) = (x as u32, y as u32);
    let (right, bottom) = ((left + 1).min(x_max), (top + 1).min(y_max));
    let (s, t) = (x - f64::from(left), y - f64::from(top));
    let at = |x, y| f64::from(image.get_pixel(x, y)[0]);
    (1.0 - t) * ((1.0 - s) * at(left, top) + s * at(right, top))
        + t * ((1.0 - s) * at(left, bottom) + s * at(right, bottom))
}

/// Fits the brightness of two blurred edges that cross, mean + contrast tanh(a / width) tanh(b / width) with a and b the
/// distances from the edges, to the pixels within `radius_px`, by Levenberg and Marquardt from `start`.
///
/// `None`: the pixels are no such crossing, or it lies beyond `radius_px` from the start.
pub(crate) fn refine(image: &GrayImage, start: Saddle, radius_px: f64) -> Option<Saddle> {
    const STEPS: usize = 30;
    let samples = samples_around(image, start.pixel, radius_px);
    if samples.len() < 12 {
        return None;
    }
    let (low, high) = samples
        .iter()
        .fold((f64::MAX, f64::MIN), |(low, high), &(_, value)| {
            (low.min(value), high.max(value))
        });
    // Place, angles of both edges, mean, contrast, width.
    let mut at = SVector::<f64, 7>::from([
        start.pixel[0],
        start.pixel[1],
        start.directions_rad[0],
        start.directions_rad[1],
        f64::midpoint(low, high),
        (high - low) / 2.0,
        1.0,
    ]);
    let mut cost = cost_at(&at, &samples);
    let mut damping = 1e-2;
    for _ in 0..STEPS {
        let (mut normal, mut right) = (SMatrix::<f64, 7, 7>::zeros(), SVector::<f64, 7>::zeros());
        for &(pixel, value) in &samples {
            let (model, slope) = crossing(&at, pixel);
            normal += slope * slope.transpose();
            right += slope * (value - model);
        }
        for i in 0..7 {
            normal[(i, i)] += damping * normal[(i, i)] + 1e-9;
        }
        let step = normal.cholesky()?.solve(&right);
        let next = at + step;
        let next_cost = cost_at(&next, &samples);
        if next_cost < cost {
            (at, cost, damping) = (next, next_cost, damping * 0.2);
            if step.fixed_rows::<2>(0).norm() < 1e-4 {
                break;
            }
        } else {
            damping *= 5.0;
            if damping > 1e6 {
                break;
            }
        }
    }
    let moved_px = (at[0] - start.pixel[0]).hypot(at[1] - start.pixel[1]);
    let spread = samples
        .iter()
        .map(|(_, v)| (v - at[4]).powi(2))
        .sum::<f64>();
    // What the crossing leaves unexplained is less than half of what there is.
    (moved_px <= radius_px && at[5] > 0.0 && cost < 0.5 * spread).then(|| Saddle {
        pixel: [at[0], at[1]],
        directions_rad: [at[2], at[3], at[2] + PI, at[3] + PI],
    })
}

/// The pixels within a radius of a place with their brightness.
fn samples_around(image: &GrayImage, [x, y]: [f64; 2], radius_px: f64) -> Vec<([f64; 2], f64)> {
    let range = |middle: f64, size: u32| {
        let first = (middle - radius_px).ceil().max(0.0) as u32;
        first..((middle + radius_px).floor().max(-1.0) + 1.0).min(f64::from(size)) as u32
    };
    let mut samples = Vec::new();
    for row in range(y, image.height()) {
        for column in range(x, image.width()) {
            let pixel = [f64::from(column), f64::from(row)];
            if (pixel[0] - x).hypot(pixel[1] - y) <= radius_px {
                samples.push((pixel, f64::from(image.get_pixel(column, row)[0])));
            }
        }
    }
    samples
}

/// Squared differences between the samples and the crossing, summed.
fn cost_at(at: &SVector<f64, 7>, samples: &[([f64; 2], f64)]) -> f64 {
    let square = |&(pixel, value): &([f64; 2], f64)| (value - crossing(at, pixel).0).powi(2);
    samples.iter().map(square).sum()
}

/// Brightness of the crossing at a pixel, and its derivatives by the seven parameters.
fn crossing(at: &SVector<f64, 7>, [x, y]: [f64; 2]) -> (f64, SVector<f64, 7>) {
    let [x0, y0, first, second, mean, contrast, width] = (*at).into();
    let (dx, dy) = (x - x0, y - y0);
    // Distance from an edge to the side towards which angles grow, and along it.
    let across = |angle: f64| {
        (
            angle.cos() * dy - angle.sin() * dx,
            angle.cos() * dx + angle.sin() * dy,
        )
    };
    let ((a, along_a), (b, along_b)) = (across(first), across(second));
    let (ta, tb) = ((a / width).tanh(), (b / width).tanh());
    let (sa, sb) = ((1.0 - ta * ta) / width, (1.0 - tb * tb) / width);
    // Dark from the first edge to the second: there a > 0 and b < 0.
    let slope = SVector::from([
        contrast * (sa * tb * first.sin() + ta * sb * second.sin()),
        -contrast * (sa * tb * first.cos() + ta * sb * second.cos()),
        -contrast * sa * tb * along_a,
        -contrast * ta * sb * along_b,
        1.0,
        ta * tb,
        -contrast * (sa * tb * a + ta * sb * b) / width,
    ]);
    (mean + contrast * ta * tb, slope)
}
