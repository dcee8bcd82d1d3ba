//! What observations must be for a calibration to mean something.

use super::pose::Spread;
use super::{CalibrationView, Correspondence, Refusal};

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
        c.point_m.iter().all(|v| v.abs() <= 1e6) && c.pixel.iter().all(|v| v.abs() <= 1e6)
    };
    match correspondences.iter().position(|c| !sane(c)) {
        None => Ok(()),
        Some(i) => Err(Refusal::new(
            format!("point {i} has a coordinate that is not a number or beyond 1e6"),
            "give metres and pixels",
        )),
    }
}

/// Views whose points can determine a camera.
pub(super) fn views(
    views: &[CalibrationView],
    parameters: usize,
    (width, height): (usize, usize),
) -> Result<(), Refusal> {
    if views.is_empty() {
        return Err(Refusal::new(
            "there are no views",
            "give images of a board or a list of points",
        ));
    }
    let mut numbers = 0;
    for view in views {
        enough_points(&view.name, &view.correspondences, 4)?;
        numbers += 2 * view.correspondences.len();
        let points = view.correspondences.iter().map(|c| c.point_m);
        let spread = Spread::of(points);
        if spread.widths_m[1] < 1e-3 * spread.widths_m[0] {
            return Err(Refusal::new(
                format!("all points of {} lie in a line", view.name),
                "spread them over a board or a room",
            ));
        }
        if views.len() == 1 && spread.flat() {
            return Err(Refusal::new(
                format!("all points of {} lie in one plane", view.name),
                "give points at other heights too, or several views of the plane from other sides",
            ));
        }
    }
    let unknowns = parameters + 6 * views.len();
    if numbers <= unknowns {
        return Err(Refusal::new(
            format!("{numbers} coordinates are too few for {unknowns} unknowns"),
            "give more points or more views",
        ));
    }
    let size = (width as f64, height as f64);
    let pixels = views
        .iter()
        .flat_map(|v| &v.correspondences)
        .map(|c| c.pixel);
    let (mut low, mut high) = ([f64::MAX; 2], [f64::MIN; 2]);
    for pixel in pixels {
        for c in 0..2 {
            low[c] = low[c].min(pixel[c]);
            high[c] = high[c].max(pixel[c]);
        }
    }
    if low[0] < -1.0 || low[1] < -1.0 || high[0] > size.0 || high[1] > size.1 {
        return Err(Refusal::new(
            format!(
                "pixels run from ({:.0}, {:.0}) to ({:.0}, {:.0}), outside of images of {width} x {height}",
                low[0], low[1], high[0], high[1]
            ),
            "give the size of the images in which the points were seen",
        ));
    }
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
        "check the order of the points, their units (metres) and the model",
    ))
}
