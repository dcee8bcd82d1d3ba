//! A rectangle's corners to a fraction of a pixel, from lines through the steepest points across its sides.

use pardalis_images::Image;

use super::quads::Quad;

/// An image of linear light (0 to 255) instead of sRGB levels.
pub(super) type Light = Image<f32, 1>;

/// Search range to either side of the expected edge, per round.
const REACH_PX: [f64; 2] = [4.0, 2.0];

/// Sampling step across an edge.
const STEP_PX: f64 = 0.25;

/// The ends of a side are omitted because the adjacent sides are near: fraction of its length, and least length in pixels.
const END_FRACTION: f64 = 0.04;
const END_PX: f64 = 4.0;

/// An edge is visible where its gradient is at least this fraction of the side's median gradient, and at least this many
/// levels (of 255) per pixel.
const MIN_GRADIENT_FRACTION: f64 = 0.4;
const MIN_GRADIENT: f64 = 1.0;

/// Least fraction of a side with a visible edge.
const MIN_VISIBLE_FRACTION: f64 = 0.3;

/// Residuals beyond this many robust standard deviations, and at least this many pixels, are outliers.
const OUTLIER_SIGMAS: f64 = 3.0;
const OUTLIER_PX: f64 = 0.3;

/// A rectangle measured in one image.
#[derive(Debug, Clone)]
pub(super) struct Measured {
    pub(super) corners_px: [[f64; 2]; 4],
    /// Root mean square distance of the visible edges from the straight lines.
    pub(super) rms_px: f64,
    /// Visible parts of the side from each corner to the next.
    visible: [VisibleParts; 4],
}

impl Measured {
    /// Reports whether a side's edge is visible at the position nearest to a point.
    pub(super) fn is_visible(&self, side: usize, point: [f64; 2]) -> bool {
        self.visible[side].contains(point)
    }
}

/// Parts of a side whose edge is visible.
#[derive(Debug, Clone, Default)]
struct VisibleParts {
    first: [f64; 2],
    along: [f64; 2],
    /// Whether the edge is visible, for each pixel along the side from `first`.
    pixels: Vec<bool>,
}

impl VisibleParts {
    fn contains(&self, point: [f64; 2]) -> bool {
        let offset = [0, 1].map(|c| point[c] - self.first[c]);
        let position = (offset[0] * self.along[0] + offset[1] * self.along[1]).round();
        position >= 0.0
            && self
                .pixels
                .get(position as usize)
                .is_some_and(|visible| *visible)
    }
}

/// A side's line through two points, the root mean square distance of its edge from the line, and its visible parts.
struct Side {
    points: [[f64; 2]; 2],
    rms_px: f64,
    visible: VisibleParts,
}

/// Measures the rectangle near a quadrilateral of the same image; `None` if too little of a side is visible.
pub(super) fn measure(image: &Light, quad: &Quad) -> Option<Measured> {
    let mut measured = Measured {
        corners_px: quad.corners_px,
        rms_px: 0.0,
        visible: Default::default(),
    };
    for reach_px in REACH_PX {
        let corners = measured.corners_px;
        let side = |i: usize| {
            let ends = [corners[i], corners[(i + 1) % 4]];
            fitted(image, ends, quad.inside_is_brighter, reach_px)
        };
        let sides = [side(0)?, side(1)?, side(2)?, side(3)?];
        let corner = |i: usize| intersection(sides[(i + 3) % 4].points, sides[i].points);
        measured = Measured {
            corners_px: [corner(0)?, corner(1)?, corner(2)?, corner(3)?],
            rms_px: (sides.iter().map(|s| s.rms_px.powi(2)).sum::<f64>() / 4.0).sqrt(),
            visible: sides.map(|s| s.visible),
        };
    }
    Some(measured)
}

/// Returns the light at a point inside the image, interpolated bilinearly.
fn light(image: &Light, [x, y]: [f64; 2]) -> f64 {
    let (left, top) = (x as u32, y as u32);
    let (right, bottom) = (
        (left + 1).min(image.width() - 1),
        (top + 1).min(image.height() - 1),
    );
    let (s, t) = (x - f64::from(left), y - f64::from(top));
    let at = |x, y| f64::from(image.get_pixel(x, y)[0]);
    (1.0 - t) * ((1.0 - s) * at(left, top) + s * at(right, top))
        + t * ((1.0 - s) * at(left, bottom) + s * at(right, bottom))
}

/// Fits a line to the edge between two corners.
fn fitted(
    image: &Light,
    [from, to]: [[f64; 2]; 2],
    inside_is_brighter: bool,
    reach_px: f64,
) -> Option<Side> {
    let step = [to[0] - from[0], to[1] - from[1]];
    let length_px = libm::hypot(step[0], step[1]);
    let along = step.map(|c| c / length_px);
    // The corners are counter-clockwise as seen in the image, so that the inside is on the left.
    let normal = if inside_is_brighter {
        [along[1], -along[0]]
    } else {
        [-along[1], along[0]]
    };
    let at = |t: f64, s: f64| [0, 1].map(|c| from[c] + t * along[c] + s * normal[c]);
    let inside = |p: [f64; 2]| {
        (0.0..=f64::from(image.width() - 1)).contains(&p[0])
            && (0.0..=f64::from(image.height() - 1)).contains(&p[1])
    };
    let end_px = (END_FRACTION * length_px).max(END_PX);
    let last = (length_px - 2.0 * end_px).max(0.0) as usize;
    let edges: Vec<(f64, EdgePoint)> = (0..=last)
        .map(|i| end_px + i as f64)
        .filter(|t| inside(at(*t, -reach_px - 1.0)) && inside(at(*t, reach_px + 1.0)))
        .filter_map(|t| Some((t, edge_across(|s| light(image, at(t, s)), reach_px)?)))
        .collect();
    let typical = median(edges.iter().map(|e| e.1.gradient).collect())?;
    let least = (MIN_GRADIENT_FRACTION * typical).max(MIN_GRADIENT);
    let visible: Vec<[f64; 2]> = edges
        .iter()
        .filter(|e| e.1.gradient >= least)
        .map(|(t, edge)| [*t, edge.position_px])
        .collect();
    let (line, kept) = robust_line(&visible)?;
    if (kept.len() as f64) < MIN_VISIBLE_FRACTION * (last + 1) as f64 {
        return None;
    }
    let squares: f64 = kept.iter().map(|p| residual(line, *p).powi(2)).sum();
    let mut visible = VisibleParts {
        first: at(end_px, 0.0),
        along,
        pixels: vec![false; last + 1],
    };
    for [t, _] in &kept {
        visible.pixels[(t - end_px).round() as usize] = true;
    }
    Some(Side {
        visible,
        points: [0.0, length_px].map(|t| at(t, line[0] + line[1] * t)),
        rms_px: (squares / kept.len() as f64).sqrt(),
    })
}

/// Steepest point of a profile across a side.
#[derive(Clone, Copy)]
struct EdgePoint {
    position_px: f64,
    /// In levels of light per pixel.
    gradient: f64,
}

/// Returns the steepest rise of a profile within the search range, refined by a parabola through the steepest step and
/// its neighbours.
fn edge_across(profile: impl Fn(f64) -> f64, reach_px: f64) -> Option<EdgePoint> {
    let count = (2.0 * reach_px / STEP_PX) as usize;
    let position = |i: usize| i as f64 * STEP_PX - reach_px;
    let gradients: Vec<f64> = (0..=count)
        .map(|i| profile(position(i) + 0.5) - profile(position(i) - 0.5))
        .collect();
    let top = (0..=count).max_by(|a, b| gradients[*a].total_cmp(&gradients[*b]))?;
    // Bilinear interpolation makes gradients piecewise linear; a parabola wider than a pixel evens this out.
    let arm = (0.75 / STEP_PX) as usize;
    let [before, middle, after] = [
        *gradients.get(top.checked_sub(arm)?)?,
        gradients[top],
        *gradients.get(top + arm)?,
    ];
    let bend = before - 2.0 * middle + after;
    let shift = if bend < 0.0 {
        0.5 * (before - after) / bend
    } else {
        0.0
    };
    Some(EdgePoint {
        position_px: position(top) + shift.clamp(-1.0, 1.0) * arm as f64 * STEP_PX,
        gradient: middle,
    })
}

/// Fits a line `y = line[0] + line[1] * x` with the Theil-Sen estimator, then by least squares without outliers. Returns
/// the line and its inliers.
fn robust_line(points: &[[f64; 2]]) -> Option<([f64; 2], Vec<[f64; 2]>)> {
    const ROUNDS: usize = 5;
    let slopes = points.iter().enumerate().flat_map(|(i, a)| {
        let later = points[i + 1..].iter();
        later.map(move |b| (b[1] - a[1]) / (b[0] - a[0]))
    });
    let slope = median(slopes.collect())?;
    let mut line = [
        median(points.iter().map(|p| p[1] - slope * p[0]).collect())?,
        slope,
    ];
    let mut kept = points.to_vec();
    for _ in 0..ROUNDS {
        let sizes = kept.iter().map(|p| residual(line, *p).abs());
        let sigma_px = 1.4826 * median(sizes.collect())?;
        let limit_px = (OUTLIER_SIGMAS * sigma_px).max(OUTLIER_PX);
        let agrees = |p: &&[f64; 2]| residual(line, **p).abs() <= limit_px;
        kept = points.iter().filter(agrees).copied().collect();
        let count = kept.len() as f64;
        let mean = [0, 1].map(|c| kept.iter().map(|p| p[c]).sum::<f64>() / count);
        let moment = |c: usize| {
            let products = kept.iter().map(|p| (p[0] - mean[0]) * (p[c] - mean[c]));
            products.sum::<f64>()
        };
        let slope = moment(1) / moment(0);
        line = [mean[1] - slope * mean[0], slope];
    }
    line.iter().all(|c| c.is_finite()).then_some((line, kept))
}

/// Returns the vertical distance of a point from a line.
fn residual(line: [f64; 2], [x, y]: [f64; 2]) -> f64 {
    y - line[0] - line[1] * x
}

/// Returns the median, of an even number of values the upper one; `None` if there are no values.
pub(super) fn median(mut values: Vec<f64>) -> Option<f64> {
    let middle = values.len() / 2;
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(middle, f64::total_cmp).1)
}

/// Returns the intersection of two lines, each through two points.
fn intersection([a, b]: [[f64; 2]; 2], [c, d]: [[f64; 2]; 2]) -> Option<[f64; 2]> {
    let cross = |p: [f64; 2], q: [f64; 2]| p[0] * q[1] - p[1] * q[0];
    let minus = |p: [f64; 2], q: [f64; 2]| [p[0] - q[0], p[1] - q[1]];
    let (along, other) = (minus(b, a), minus(d, c));
    let t = cross(minus(c, a), other) / cross(along, other);
    let point = [0, 1].map(|i| a[i] + t * along[i]);
    point.iter().all(|c| c.is_finite()).then_some(point)
}
