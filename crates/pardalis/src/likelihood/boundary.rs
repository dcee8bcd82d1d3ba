//! The image points just inside and just outside an outline that are compared (Taiana 2007, sections 4.2.1
//! and 4.2.2).

use nalgebra::DMatrix;
use serde::{Deserialize, Serialize};

use super::outline::Coordinates;
use pardalis_camera::LANES;
use pardalis_core::Error;

/// How the points on either side of the outline are found.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Sampling {
    /// The projected outlines of a smaller and of a larger body.
    Scaled(ScaledSampling),
    /// Points along the normals of a B-spline through the projected outline.
    Spline(SplineSampling),
}

/// Points on the outlines of a smaller and of a larger body.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ScaledSampling {
    /// Scale of the inner contour relative to the outline of the shape, below 1.
    pub inner_scale: f64,
    /// Scale of the outer contour relative to the outline of the shape, above 1.
    pub outer_scale: f64,
    /// The remedy for projections so small that both contours share pixels; `None` to apply none.
    pub shared_pixels: Option<SharedPixels>,
}

/// A remedy for small projections: if the inner contour shares too many pixels with the outer one, both are
/// replaced by points at a fixed distance from the outline along its normals.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct SharedPixels {
    /// Maximum share of the inner contour's pixels that may also be on the outer contour.
    pub max_share: f64,
    /// Distance of the points from the outline, in pixels.
    pub distance_px: f64,
}

impl Default for SharedPixels {
    /// The paper's distance. The paper does not give the share.
    fn default() -> Self {
        Self {
            max_share: 0.5,
            distance_px: 2.0,
        }
    }
}

/// Points along the normals of a closed quadratic B-spline fitted to the projected outline (eqs. 4.1 to 4.6).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct SplineSampling {
    /// Control points of the spline.
    pub control_points: usize,
    /// Distance of the farthest points along the normals, in pixels.
    pub reach_px: f64,
    /// Points along each normal on either side, evenly spaced up to the reach.
    pub steps: usize,
    /// Whether the point on the outline itself counts on both sides.
    pub middle: bool,
}

impl SplineSampling {
    /// Returns the default for an outline of this many points: a control point for every fourth, and samples 1 and 2
    /// pixels from the outline.
    pub fn of_points(points: usize) -> Self {
        Self {
            control_points: (points / 4).max(3),
            reach_px: 2.0,
            steps: 2,
            middle: false,
        }
    }
}

impl Sampling {
    /// Returns the number of points on either side of an outline of `points` points.
    pub fn samples(&self, points: usize) -> usize {
        match self {
            Self::Scaled(_) => points,
            Self::Spline(spline) => points * (spline.steps + usize::from(spline.middle)),
        }
    }

    /// Returns the scales of the outlines to draw in order to show what is compared.
    pub fn shown_scales(&self) -> Vec<f64> {
        match self {
            Self::Scaled(scaled) => vec![scaled.inner_scale, scaled.outer_scale],
            Self::Spline(_) => vec![1.0],
        }
    }

    /// Checks the settings for an outline of `points` points.
    ///
    /// # Errors
    ///
    /// A number is out of range.
    pub fn check(&self, points: usize) -> Result<(), Error> {
        let inside = |name, value: f64, ok, allowed| {
            if ok {
                return Ok(());
            }
            Err(Error::out_of_range(name, value, allowed))
        };
        let distance = |v: f64| v > 0.0 && v <= 100.0;
        match *self {
            Self::Scaled(ScaledSampling {
                inner_scale: inner,
                outer_scale: outer,
                shared_pixels,
            }) => {
                let (inner_ok, outer_ok) =
                    (inner > 0.0 && inner < 1.0, outer > 1.0 && outer <= 10.0);
                inside("inner_scale", inner, inner_ok, "above 0 and below 1")?;
                inside("outer_scale", outer, outer_ok, "above 1 and at most 10")?;
                let Some(SharedPixels {
                    max_share,
                    distance_px,
                }) = shared_pixels
                else {
                    return Ok(());
                };
                let shared_ok = (0.0..1.0).contains(&max_share);
                inside("max_share", max_share, shared_ok, "0 to below 1")?;
                inside(
                    "distance_px",
                    distance_px,
                    distance(distance_px),
                    "above 0 and at most 100",
                )
            }
            Self::Spline(SplineSampling {
                control_points,
                reach_px,
                steps,
                ..
            }) => {
                if !(3..=points / 2).contains(&control_points) {
                    let allowed = format!("3 to half of points, {}", points / 2);
                    return Err(Error::out_of_range(
                        "control_points",
                        control_points,
                        &allowed,
                    ));
                }
                inside(
                    "reach_px",
                    reach_px,
                    distance(reach_px),
                    "above 0 and at most 100",
                )?;
                if !(1..=10).contains(&steps) {
                    return Err(Error::out_of_range("steps", steps, "1 to 10"));
                }
                Ok(())
            }
        }
    }
}

/// A closed uniform quadratic B-spline through a fixed number of points. The basis and its pseudo-inverse are
/// computed once.
#[derive(Debug)]
pub(super) struct SplineBasis {
    /// Rows of the matrix from points to control points: B⁺ = (BᵀB)⁻¹Bᵀ.
    fit: Vec<Vec<f32>>,
    /// For each point of the curve, the index of its first control point and the weights of this and the next
    /// two, for the point and for its derivative.
    curve: Vec<(usize, [f32; 3], [f32; 3])>,
}

impl SplineBasis {
    /// Creates the basis for `points` points evenly spaced in the curve's parameter, at least twice as many
    /// as `control_points`.
    pub(super) fn new(points: usize, control_points: usize) -> Self {
        let mut basis = DMatrix::<f64>::zeros(points, control_points);
        let mut curve = Vec::with_capacity(points);
        for i in 0..points {
            // Integer arithmetic keeps the whole part from being rounded across a knot.
            let (first, rest) = (i * control_points / points, i * control_points % points);
            let t = rest as f64 / points as f64;
            let weights = [
                0.5 * (1.0 - t) * (1.0 - t),
                0.5 + t * (1.0 - t),
                0.5 * t * t,
            ];
            let slopes = [t - 1.0, 1.0 - 2.0 * t, t];
            for (j, weight) in weights.into_iter().enumerate() {
                basis[(i, (first + j) % control_points)] += weight;
            }
            curve.push((first, weights.map(|w| w as f32), slopes.map(|s| s as f32)));
        }
        let transposed = basis.transpose();
        let normal = (&transposed * &basis)
            .cholesky()
            .expect("a basis with two samples per control point has full rank");
        let fit = normal.solve(&transposed);
        Self {
            fit: (0..control_points)
                .map(|j| fit.row(j).iter().map(|&w| w as f32).collect())
                .collect(),
            curve,
        }
    }

    /// Fits the control points of the curves nearest to the outlines, relative to each outline's first point.
    #[inline(always)]
    pub(super) fn fit(&self, outline: &[Coordinates], control: &mut [Coordinates]) {
        let origin = outline[0];
        for (weights, control) in self.fit.iter().zip(control) {
            let mut sums = [[0_f32; LANES]; 2];
            for (weight, point) in weights.iter().zip(outline) {
                for axis in 0..2 {
                    for lane in 0..LANES {
                        sums[axis][lane] += weight * (point[axis][lane] - origin[axis][lane]);
                    }
                }
            }
            *control = sums;
        }
    }

    /// Writes the curves and their outward unit normals.
    #[inline(always)]
    pub(super) fn trace(
        &self,
        origin: &Coordinates,
        control: &[Coordinates],
        curve: &mut [Coordinates],
        normals: &mut [Coordinates],
    ) {
        let outwards = orientation(control);
        let next = |j: usize| if j == control.len() { 0 } else { j };
        for ((&(first, weights, slopes), point), normal) in
            self.curve.iter().zip(curve).zip(normals)
        {
            let second = next(first + 1);
            let three = [
                &control[first],
                &control[second],
                &control[next(second + 1)],
            ];
            let mut tangent = [[0_f32; LANES]; 2];
            for axis in 0..2 {
                for lane in 0..LANES {
                    let [a, b, c] = three.map(|c| c[axis][lane]);
                    point[axis][lane] =
                        origin[axis][lane] + (weights[0] * a + weights[1] * b + weights[2] * c);
                    tangent[axis][lane] = slopes[0] * a + slopes[1] * b + slopes[2] * c;
                }
            }
            *normal = normals_of(&tangent, &outwards);
        }
    }
}

/// Writes the outward unit normals of closed outlines, perpendicular to the line from the previous point to
/// the next.
#[inline(always)]
pub(super) fn normals_by_neighbours(outline: &[Coordinates], normals: &mut [Coordinates]) {
    let outwards = orientation(outline);
    let count = outline.len();
    for (k, normal) in normals.iter_mut().enumerate() {
        let before = &outline[if k == 0 { count - 1 } else { k - 1 }];
        let after = &outline[if k + 1 == count { 0 } else { k + 1 }];
        let mut tangent = [[0_f32; LANES]; 2];
        for axis in 0..2 {
            for lane in 0..LANES {
                tangent[axis][lane] = after[axis][lane] - before[axis][lane];
            }
        }
        *normal = normals_of(&tangent, &outwards);
    }
}

/// Returns the sign of the enclosed area: 1 for closed lines that run from u to v, −1 for the opposite
/// direction. NaN for incomplete lines.
#[inline(always)]
fn orientation(line: &[Coordinates]) -> [f32; LANES] {
    let mut areas = [0_f32; LANES];
    let [u0, v0] = &line[0];
    for pair in line.windows(2) {
        let ([u1, v1], [u2, v2]) = (&pair[0], &pair[1]);
        for lane in 0..LANES {
            areas[lane] += (u1[lane] - u0[lane]) * (v2[lane] - v0[lane])
                - (u2[lane] - u0[lane]) * (v1[lane] - v0[lane]);
        }
    }
    areas.map(|area| {
        if area.is_nan() {
            area
        } else {
            1_f32.copysign(area)
        }
    })
}

/// Returns the unit vectors perpendicular to tangents; NaN for missing ones.
#[inline(always)]
fn normals_of([tu, tv]: &Coordinates, outwards: &[f32; LANES]) -> Coordinates {
    let mut normals = [[0_f32; LANES]; 2];
    for lane in 0..LANES {
        let scale = outwards[lane] / (tu[lane] * tu[lane] + tv[lane] * tv[lane]).sqrt();
        normals[0][lane] = tv[lane] * scale;
        normals[1][lane] = -tu[lane] * scale;
    }
    normals
}
