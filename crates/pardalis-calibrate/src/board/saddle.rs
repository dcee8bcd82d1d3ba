//! Saddle points of the brightness, at which two dark and two light squares meet.

use std::f64::consts::PI;

use chess_corners_core::{ChessParams, find_corners_u8};
use nalgebra::{SMatrix, SVector};
use pardalis_images::GrayImage;

/// Maximum number of saddle points per image; the strongest are kept.
const MAX_SADDLES: usize = 3000;

/// Least response of the detector. A sharp corner with a contrast of n grey levels has 8 n, noise hardly any.
const MIN_RESPONSE: f32 = 30.0;

/// A saddle point.
#[derive(Debug, Clone, Copy)]
pub(super) struct Saddle {
    /// Position in pixels; pixel centres have integer coordinates.
    pub(super) pixel: [f64; 2],
    /// Directions of the four edges that meet, as angles from x towards y of the image. The image is dark from the
    /// first to the second and from the third to the fourth, and light between the others.
    pub(super) directions_rad: [f64; 4],
}

/// Returns all candidate saddle points; many of them are not corners of squares.
pub(super) fn find(image: &GrayImage) -> Vec<Saddle> {
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

/// Returns the brightness, 0 to 255, interpolated bilinearly; beyond the image that of its border.
pub(super) fn brightness(image: &GrayImage, [x, y]: [f64; 2]) -> f64 {
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

/// Fits two crossing blurred edges to the pixels within `radius_px` of `start` by the Levenberg-Marquardt method: the
/// brightness is mean + contrast tanh(a / width) tanh(b / width), with the distances a and b from the edges.
///
/// Returns the saddle point and the width, or `None` if the pixels do not show such a crossing, or if it is farther than
/// `radius_px` from the start.
pub(super) fn refine(image: &GrayImage, start: Saddle, radius_px: f64) -> Option<(Saddle, f64)> {
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
    // Position, angles of both edges, mean, contrast, width.
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
    let moved_px = libm::hypot(at[0] - start.pixel[0], at[1] - start.pixel[1]);
    let spread = samples
        .iter()
        .map(|(_, v)| (v - at[4]).powi(2))
        .sum::<f64>();
    // The crossing must explain more than half of the variance.
    (moved_px <= radius_px && at[5] > 0.0 && cost < 0.5 * spread).then(|| {
        let saddle = Saddle {
            pixel: [at[0], at[1]],
            directions_rad: [at[2], at[3], at[2] + PI, at[3] + PI],
        };
        (saddle, at[6].abs())
    })
}

/// Returns the pixels within a radius of a point, with their brightness.
fn samples_around(image: &GrayImage, [x, y]: [f64; 2], radius_px: f64) -> Vec<([f64; 2], f64)> {
    let range = |middle: f64, size: u32| {
        let first = (middle - radius_px).ceil().max(0.0) as u32;
        first..((middle + radius_px).floor().max(-1.0) + 1.0).min(f64::from(size)) as u32
    };
    let mut samples = Vec::new();
    for row in range(y, image.height()) {
        for column in range(x, image.width()) {
            let pixel = [f64::from(column), f64::from(row)];
            if libm::hypot(pixel[0] - x, pixel[1] - y) <= radius_px {
                samples.push((pixel, f64::from(image.get_pixel(column, row)[0])));
            }
        }
    }
    samples
}

/// Returns the sum of squared differences between the samples and the crossing.
fn cost_at(at: &SVector<f64, 7>, samples: &[([f64; 2], f64)]) -> f64 {
    let square = |&(pixel, value): &([f64; 2], f64)| (value - crossing(at, pixel).0).powi(2);
    samples.iter().map(square).sum()
}

/// Returns the brightness of the crossing at a pixel, and its derivatives with respect to the seven parameters.
fn crossing(at: &SVector<f64, 7>, [x, y]: [f64; 2]) -> (f64, SVector<f64, 7>) {
    let [x0, y0, first, second, mean, contrast, width] = (*at).into();
    let (dx, dy) = (x - x0, y - y0);
    // Signed distance from an edge, positive on the side of greater angles, and position along it.
    let across = |angle: f64| {
        (
            libm::cos(angle) * dy - libm::sin(angle) * dx,
            libm::cos(angle) * dx + libm::sin(angle) * dy,
        )
    };
    let ((a, along_a), (b, along_b)) = (across(first), across(second));
    let (ta, tb) = (libm::tanh(a / width), libm::tanh(b / width));
    let (sa, sb) = ((1.0 - ta * ta) / width, (1.0 - tb * tb) / width);
    // It is dark from the first edge to the second, where a > 0 and b < 0.
    let slope = SVector::from([
        contrast * (sa * tb * libm::sin(first) + ta * sb * libm::sin(second)),
        -contrast * (sa * tb * libm::cos(first) + ta * sb * libm::cos(second)),
        -contrast * sa * tb * along_a,
        -contrast * ta * sb * along_b,
        1.0,
        ta * tb,
        -contrast * (sa * tb * a + ta * sb * b) / width,
    ]);
    (mean + contrast * ta * tb, slope)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fits_a_crossing_to_hundredths_of_a_pixel() {
        let (center, first, second, width) = ([20.37, 18.81], 0.3_f64, 2.0_f64, 1.3);
        let image = GrayImage::from_fn(40, 40, |x, y| {
            let (dx, dy) = (f64::from(x) - center[0], f64::from(y) - center[1]);
            let side = |angle: f64| ((angle.cos() * dy - angle.sin() * dx) / width).tanh();
            [(120.0 + 80.0 * side(first) * side(second)).round() as u8]
        });
        let start = Saddle {
            pixel: [21.0, 18.0],
            directions_rad: [0.4, 1.9, 0.4 + PI, 1.9 + PI],
        };
        let (fitted, width_px) = refine(&image, start, 8.0).unwrap();
        let error_px = (fitted.pixel[0] - center[0]).hypot(fitted.pixel[1] - center[1]);
        assert!(error_px < 0.005, "{:?}", fitted.pixel);
        assert!((fitted.directions_rad[0] - first).abs() < 0.002);
        assert!((width_px - width).abs() < 0.01, "{width_px}");
    }
}
