//! What observations must be for a calibration to mean something.

use super::spread::Spread;
use super::{CalibrationView, Correspondence, Refusal};
use pardalis_camera::Camera;

/// The largest coordinate of a point in metres or of a pixel that can be meant.
const MAX_COORDINATE: f64 = 1e6;

/// So many numbers are needed for each unknown: with hardly more than unknowns, any model fits.
const NUMBERS_PER_UNKNOWN: usize = 2;

/// At least so many correspondences, all of them finite.
pub(super) fn enough_points(
    what: &str,
    correspondences: &[Correspondence],
    least: usize,
) -> Result<(), Refusal> {
    if correspondences.len() < least {
        return Err(Refusal::new(
            format!(
                "{} points are too few for {what}, which needs {least}",
                correspondences.len()
            ),
            "give more points",
        ));
    }
    let sane = |c: &Correspondence| {
        c.point_m.iter().all(|v| v.abs() <= MAX_COORDINATE)
            && c.pixel.iter().all(|v| v.abs() <= MAX_COORDINATE)
    };
    match correspondences.iter().position(|c| !sane(c)) {
        None => Ok(()),
        Some(i) => Err(Refusal::new(
            format!(
                "point {} of {} for {what} has a coordinate that is not a number or beyond 1e6",
                i + 1,
                correspondences.len()
            ),
            "give metres and pixels",
        )),
    }
}

/// Pixels that lie in the image.
pub(super) fn pixels(
    pixels: impl Iterator<Item = [f64; 2]>,
    (width, height): (usize, usize),
) -> Result<(), Refusal> {
    let [low, high] = extent(pixels);
    if low[0] >= -1.0 && low[1] >= -1.0 && high[0] <= width as f64 && high[1] <= height as f64 {
        return Ok(());
    }
    Err(Refusal::new(
        format!(
            "pixels run from ({:.0}, {:.0}) to ({:.0}, {:.0}), outside of images of {width} x {height}",
            low[0], low[1], high[0], high[1]
        ),
        "give the size of the images in which the points were seen",
    ))
}

/// The least and the greatest coordinates.
fn extent(pixels: impl Iterator<Item = [f64; 2]>) -> [[f64; 2]; 2] {
    let (mut low, mut high) = ([f64::MAX; 2], [f64::MIN; 2]);
    for pixel in pixels {
        for c in 0..2 {
            low[c] = low[c].min(pixel[c]);
            high[c] = high[c].max(pixel[c]);
        }
    }
    [low, high]
}

/// How the points of a view lie: not all in one place, nor in a line.
pub(super) fn spread(what: &str, correspondences: &[Correspondence]) -> Result<Spread, Refusal> {
    let points = correspondences.iter().map(|c| c.point_m);
    let remedy = "spread them over a board or a room";
    if points
        .clone()
        .zip(points.clone().skip(1))
        .all(|(a, b)| a == b)
    {
        return Err(Refusal::new(
            format!("all points of {what} are the same"),
            remedy,
        ));
    }
    let spread = Spread::of(points);
    if spread.widths_m[1] < 1e-3 * spread.widths_m[0] {
        return Err(Refusal::new(
            format!("all points of {what} lie in a line"),
            remedy,
        ));
    }
    Ok(spread)
}

/// Views with points and pixels that can be meant.
pub(super) fn points(views: &[CalibrationView], size_px: (usize, usize)) -> Result<(), Refusal> {
    if views.is_empty() {
        return Err(Refusal::new(
            "there are no views",
            "give images of a board or a list of points",
        ));
    }
    for view in views {
        enough_points(&view.name, &view.correspondences, 4)?;
    }
    pixels(all(views).map(|c| c.pixel), size_px)
}

/// The correspondences of all views.
fn all(views: &[CalibrationView]) -> impl Iterator<Item = &Correspondence> {
    views.iter().flat_map(|v| &v.correspondences)
}

/// Views whose points can determine a camera.
pub(super) fn views(
    views: &[CalibrationView],
    parameters: usize,
    (width, height): (usize, usize),
) -> Result<(), Refusal> {
    for view in views {
        let spread = spread(&view.name, &view.correspondences)?;
        if views.len() == 1 && spread.flat() {
            return Err(Refusal::new(
                format!("all points of {} lie in one plane", view.name),
                "give points at other heights too, or several views of the plane from other sides",
            ));
        }
    }
    let numbers = 2 * all(views).count();
    let unknowns = parameters + 6 * views.len();
    if numbers < NUMBERS_PER_UNKNOWN * unknowns {
        let wanted = (NUMBERS_PER_UNKNOWN * unknowns).div_ceil(2);
        return Err(Refusal::new(
            format!(
                "{numbers} coordinates are too few for {unknowns} unknowns: they would be fitted whether the model is right or not"
            ),
            format!(
                "give more points or more views (at least {wanted} points in as many views), or take a model with fewer parameters"
            ),
        ));
    }
    let [low, high] = extent(all(views).map(|c| c.pixel));
    let size = (width as f64, height as f64);
    let share = (high[0] - low[0]) * (high[1] - low[1]) / (size.0 * size.1);
    if share < 0.1 {
        return Err(Refusal::new(
            format!("all points lie within {:.0} % of the image", 100.0 * share),
            "show points all over it: the rest of the lens is not known otherwise",
        ));
    }
    Ok(())
}

/// Which residuals belong to the many: not far beyond what their median says of the noise. Points without a pixel never do.
pub(super) fn inliers(residuals_px: &[Option<[f64; 2]>], outlier_sigmas: f64) -> Vec<bool> {
    let mut lengths: Vec<f64> = residuals_px
        .iter()
        .flatten()
        .map(|[u, v]| u.hypot(*v))
        .collect();
    if lengths.is_empty() {
        return vec![false; residuals_px.len()];
    }
    let middle = lengths.len() / 2;
    let (_, median, _) = lengths.select_nth_unstable_by(middle, f64::total_cmp);
    // The median length of Gaussian residuals is 1.1774 s.d. of a coordinate; exact points are rounded somewhere, too.
    let bound = (outlier_sigmas * *median / 1.1774).max(1e-6);
    residuals_px
        .iter()
        .map(|r| r.is_some_and(|[u, v]| u.hypot(v) <= bound))
        .collect()
}

/// Most of the points must agree.
pub(super) fn mostly_inliers(what: &str, used: &[bool]) -> Result<(), Refusal> {
    let count = used.iter().filter(|u| **u).count();
    if 3 * count >= 2 * used.len() {
        return Ok(());
    }
    Err(Refusal::new(
        format!(
            "only {count} of {} points agree with one another about {what}",
            used.len()
        ),
        "check the order of the points, their units (metres), and that the camera's model is the right one",
    ))
}

/// Beyond this, points and pixels do not belong together: a hundredth of the image's diagonal.
pub(super) fn largest_rms_px((width, height): (usize, usize)) -> f64 {
    0.01 * (width as f64).hypot(height as f64)
}

/// Points and pixels agree only when mirrored.
pub(super) fn mirrored(rms_px: f64) -> Refusal {
    let apart = if rms_px.is_finite() {
        format!(" (otherwise {rms_px:.1} px apart)")
    } else {
        String::new()
    };
    Refusal::new(
        format!("points and pixels agree only when mirrored{apart}"),
        "give right-handed coordinates (with x to the right and y up on a board, z points at who reads it), and u before v",
    )
}

/// The board is seen from its back.
pub(super) fn from_behind(camera: &Camera) -> Refusal {
    let (of, other) = if camera.looks_into_mirror() {
        ("mirrors", "a lens if the camera looks through one")
    } else {
        ("lenses", "a mirror if the camera looks into one")
    };
    Refusal {
        seen_from_behind: true,
        ..Refusal::new(
            format!(
                "by this model of {of} the board is seen from behind, its corners ordered as in a mirror"
            ),
            format!("take a model of {other}, or check whether the images are flipped"),
        )
    }
}
