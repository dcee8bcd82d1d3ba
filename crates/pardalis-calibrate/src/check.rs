//! Requirements on observations, and the errors that report their violation.

use super::spread::Spread;
use super::{CalibrationError, CalibrationView, Correspondence};
use pardalis_camera::Camera;

/// Largest plausible coordinate of a point in metres or of a pixel.
const MAX_COORDINATE: f64 = 1e6;

/// Number of observed coordinates required per unknown: with hardly more coordinates than unknowns, any model
/// fits.
const NUMBERS_PER_UNKNOWN: usize = 2;

/// Requires at least `least` correspondences with finite coordinates.
pub(super) fn enough_points(
    what: &str,
    correspondences: &[Correspondence],
    least: usize,
) -> Result<(), CalibrationError> {
    if correspondences.len() < least {
        return Err(CalibrationError::new(
            format!(
                "{} points are too few for {what}, which needs {least}",
                correspondences.len()
            ),
            "add points",
        ));
    }
    let sane = |c: &Correspondence| {
        c.point_m.iter().all(|v| v.abs() <= MAX_COORDINATE)
            && c.pixel.iter().all(|v| v.abs() <= MAX_COORDINATE)
    };
    match correspondences.iter().position(|c| !sane(c)) {
        None => Ok(()),
        Some(i) => Err(CalibrationError::new(
            format!(
                "point {} of {} for {what} has a coordinate that is not a number or beyond 1e6",
                i + 1,
                correspondences.len()
            ),
            "give points in metres and pixels",
        )),
    }
}

/// Requires pixels inside the image.
pub(super) fn pixels(
    pixels: impl Iterator<Item = [f64; 2]>,
    (width, height): (usize, usize),
) -> Result<(), CalibrationError> {
    let [low, high] = extent(pixels);
    if low[0] >= -1.0 && low[1] >= -1.0 && high[0] <= width as f64 && high[1] <= height as f64 {
        return Ok(());
    }
    Err(CalibrationError::new(
        format!(
            "pixels run from ({:.0}, {:.0}) to ({:.0}, {:.0}), outside images of {width} x {height}",
            low[0], low[1], high[0], high[1]
        ),
        "give the size of the images in which the points were observed",
    ))
}

/// Returns the smallest and the largest coordinates.
pub(super) fn extent(pixels: impl Iterator<Item = [f64; 2]>) -> [[f64; 2]; 2] {
    let (mut low, mut high) = ([f64::MAX; 2], [f64::MIN; 2]);
    for pixel in pixels {
        for c in 0..2 {
            low[c] = low[c].min(pixel[c]);
            high[c] = high[c].max(pixel[c]);
        }
    }
    [low, high]
}

/// Computes the extent of a view's points, and requires that they neither coincide nor are collinear.
pub(super) fn spread(
    what: &str,
    correspondences: &[Correspondence],
) -> Result<Spread, CalibrationError> {
    let points = correspondences.iter().map(|c| c.point_m);
    let remedy = "spread them over a board or a room";
    if points
        .clone()
        .zip(points.clone().skip(1))
        .all(|(a, b)| a == b)
    {
        return Err(CalibrationError::new(
            format!("all points of {what} are the same"),
            remedy,
        ));
    }
    let spread = Spread::of(points);
    if spread.widths_m[1] < 1e-3 * spread.widths_m[0] {
        return Err(CalibrationError::new(
            format!("all points of {what} lie on one line"),
            remedy,
        ));
    }
    Ok(spread)
}

/// Requires views with plausible points and pixels.
pub(super) fn points(
    views: &[CalibrationView],
    size_px: (usize, usize),
) -> Result<(), CalibrationError> {
    if views.is_empty() {
        return Err(CalibrationError::new(
            "there are no views",
            "give images of a board or a list of points",
        ));
    }
    for view in views {
        enough_points(&view.name, &view.correspondences, 4)?;
    }
    pixels(all(views).map(|c| c.pixel), size_px)
}

/// Iterates over the correspondences of all views.
fn all(views: &[CalibrationView]) -> impl Iterator<Item = &Correspondence> {
    views.iter().flat_map(|v| &v.correspondences)
}

/// Requires views whose points can determine a camera.
pub(super) fn views(
    views: &[CalibrationView],
    parameters: usize,
    (width, height): (usize, usize),
) -> Result<(), CalibrationError> {
    for view in views {
        let spread = spread(&view.name, &view.correspondences)?;
        if views.len() == 1 && spread.flat() {
            return Err(CalibrationError::new(
                format!("all points of {} lie in one plane", view.name),
                "add points at other heights, or several views of the plane from different directions",
            ));
        }
    }
    let numbers = 2 * all(views).count();
    let unknowns = parameters + 6 * views.len();
    if numbers < NUMBERS_PER_UNKNOWN * unknowns {
        let points = (NUMBERS_PER_UNKNOWN * unknowns).div_ceil(2);
        return Err(CalibrationError::new(
            format!(
                "{numbers} coordinates are too few for {unknowns} unknowns: any model would fit them"
            ),
            format!(
                "add points or views (at least {points} points in as many views), or use a model with fewer parameters"
            ),
        ));
    }
    let [low, high] = extent(all(views).map(|c| c.pixel));
    let size = (width as f64, height as f64);
    let share = (high[0] - low[0]) * (high[1] - low[1]) / (size.0 * size.1);
    if share < 0.1 {
        return Err(CalibrationError::new(
            format!("all points lie within {:.0} % of the image", 100.0 * share),
            "distribute the points over the whole image, because they do not determine the rest of the lens",
        ));
    }
    Ok(())
}

/// Reports for each residual whether it is an inlier: not far beyond the noise that the median residual
/// indicates. Points without a pixel are outliers.
pub(super) fn inliers(residuals_px: &[Option<[f64; 2]>], outlier_sigmas: f64) -> Vec<bool> {
    let mut lengths: Vec<f64> = residuals_px
        .iter()
        .flatten()
        .map(|[u, v]| libm::hypot(*u, *v))
        .collect();
    if lengths.is_empty() {
        return vec![false; residuals_px.len()];
    }
    let middle = lengths.len() / 2;
    let (_, median, _) = lengths.select_nth_unstable_by(middle, f64::total_cmp);
    // The median length of Gaussian residuals is 1.1774 standard deviations of a coordinate. The lower bound
    // allows for rounding of exact points.
    let bound = (outlier_sigmas * *median / 1.1774).max(1e-6);
    residuals_px
        .iter()
        .map(|r| r.is_some_and(|[u, v]| libm::hypot(u, v) <= bound))
        .collect()
}

/// Requires that most of the points are inliers.
pub(super) fn mostly_inliers(what: &str, used: &[bool]) -> Result<(), CalibrationError> {
    let count = used.iter().filter(|u| **u).count();
    if 3 * count >= 2 * used.len() {
        return Ok(());
    }
    Err(CalibrationError::new(
        format!("only {count} of {} points agree on {what}", used.len()),
        "check the order of the points, their units (metres) and the camera model",
    ))
}

/// Returns the RMS residual beyond which points and pixels do not match: one percent of the image's diagonal.
pub(super) fn max_rms_px((width, height): (usize, usize)) -> f64 {
    0.01 * libm::hypot(width as f64, height as f64)
}

/// Error for points and pixels that match only if mirrored.
pub(super) fn mirrored(rms_px: f64) -> CalibrationError {
    let apart = if rms_px.is_finite() {
        format!(" (unmirrored they are {rms_px:.1} px apart)")
    } else {
        String::new()
    };
    CalibrationError::new(
        format!("points and pixels match only when mirrored{apart}"),
        "give right-handed coordinates (with x to the right and y up on a board, z points towards the viewer), and u before v",
    )
}

/// Error for a board seen from behind.
pub(super) fn from_behind(camera: &Camera) -> CalibrationError {
    let (of, other) = if camera.looks_into_mirror() {
        ("mirrors", "a lens if the camera has no mirror")
    } else {
        ("lenses", "a mirror if the camera looks into one")
    };
    CalibrationError {
        seen_from_behind: true,
        ..CalibrationError::new(
            format!(
                "with this model for {of} the board appears from behind: its corners are in mirrored order"
            ),
            format!("use a model for {other}, or check whether the images are flipped"),
        )
    }
}
