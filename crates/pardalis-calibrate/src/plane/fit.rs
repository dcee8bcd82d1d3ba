//! Homography from point pairs: normalised linear solution, outlier rejection by consensus, least squares in
//! pixels.

use nalgebra::{DMatrix, DVector, Matrix3, SMatrix, Vector2, Vector3};

use crate::rms;
use pardalis_camera::Homography;
use pardalis_core::Error;
use pardalis_core::rng::philox4x32_10;

/// Distance in pixels beyond which a point is an outlier. It separates typing errors from the noise of manual
/// clicks.
pub const OUTLIER_PX: f64 = 4.0;

/// Largest plausible coordinate in metres or pixels.
const MAX_COORDINATE: f64 = 1e6;

/// Three points count as collinear if one is nearer to the line through the others than this share of their
/// distance.
const IN_LINE_SHARE: f64 = 1e-3;

/// Largest number of quadruples that are tried; beyond it, a sample is drawn.
const MAX_FOURS: usize = 5000;

/// A point on the plane and its pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PointPair {
    /// Pixel; pixel centres are at integer coordinates.
    pub pixel: [f64; 2],
    /// Position on the plane, in metres.
    pub plane_m: [f64; 2],
}

/// A plane fitted to points.
#[derive(Debug, Clone, PartialEq)]
pub struct PlaneFit {
    /// Homography from the plane (metres) to the image (pixels).
    pub homography: Homography,
    /// Projected minus observed position per pair, in pixels; `None` for outliers behind the camera.
    pub residuals_px: Vec<Option<[f64; 2]>>,
    /// Indices of the rejected pairs, ascending.
    pub outliers: Vec<usize>,
    /// Root mean square distance of the remaining pairs, in pixels.
    pub rms_px: f64,
}

/// Fits a plane to four or more pairs of points.
///
/// Four points are met exactly. With more, the fit minimises the squared pixel distances and rejects points
/// beyond [`OUTLIER_PX`], provided that at least five pairs and at least half of all pairs agree (any four
/// always do).
///
/// # Errors
///
/// Fails for fewer than four points, implausible coordinates, repeated points, collinear points, crossed
/// order, a mirrored plane and inconsistent points. Messages number the points from 1.
pub fn fit(pairs: &[PointPair]) -> Result<PlaneFit, Error> {
    check(pairs)?;
    let fours = usable_fours(pairs)?;
    let all: Vec<usize> = (0..pairs.len()).collect();
    let mut kept = all.clone();
    let mut matrix = least_squares(pairs, &kept);
    if agreeing(&matrix, pairs).len() < pairs.len() {
        let best = fours
            .iter()
            .map(|four| agreeing(&linear(pairs, four), pairs))
            .max_by_key(Vec::len)
            .unwrap_or_default();
        // A quadruple in crossed order is met exactly, but with some points behind the camera; the check
        // below reports it.
        if pairs.len() > 4 {
            kept = consensus(pairs, best)?;
            matrix = least_squares(pairs, &kept);
        }
    }
    check_seen_from_above(&matrix, pairs, &kept)?;
    let homography = Homography::new(matrix)?;
    let residual = |pair: &PointPair| {
        let [u, v] = homography.pixel_of(pair.plane_m)?;
        Some([u - pair.pixel[0], v - pair.pixel[1]])
    };
    let residuals_px: Vec<_> = pairs.iter().map(residual).collect();
    Ok(PlaneFit {
        homography,
        rms_px: rms(kept.iter().filter_map(|&i| residuals_px[i])),
        residuals_px,
        outliers: all.into_iter().filter(|i| !kept.contains(i)).collect(),
    })
}

fn check(pairs: &[PointPair]) -> Result<(), Error> {
    if pairs.len() < 4 {
        return Err(Error::refused(
            format!("{} points are too few for a plane", pairs.len()),
            "give four or more, no three of them on one line",
        ));
    }
    let sane = |c: &f64| c.abs() <= MAX_COORDINATE;
    for (i, a) in pairs.iter().enumerate() {
        if !a.pixel.iter().chain(&a.plane_m).all(sane) {
            return Err(Error::refused(
                format!(
                    "point {} has a coordinate that is not a number or beyond 1e6",
                    i + 1
                ),
                "give pixels and metres",
            ));
        }
        let is_same = |b: &PointPair| a.pixel == b.pixel || a.plane_m == b.plane_m;
        if let Some(j) = pairs[..i].iter().position(is_same) {
            let place = if a.plane_m == pairs[j].plane_m {
                "on the plane"
            } else {
                "in the image"
            };
            return Err(Error::refused(
                format!("points {} and {} are the same {place}", j + 1, i + 1),
                "give each point once",
            ));
        }
    }
    Ok(())
}

/// Returns quadruples of points without three collinear ones, on the plane or in the image.
fn usable_fours(pairs: &[PointPair]) -> Result<Vec<[usize; 4]>, Error> {
    let in_line = |three: [usize; 3]| {
        three_in_line(three.map(|i| pairs[i].plane_m))
            || three_in_line(three.map(|i| pairs[i].pixel))
    };
    let threes = |[a, b, c, d]: [usize; 4]| [[a, b, c], [a, b, d], [a, c, d], [b, c, d]];
    let fours = fours(pairs.len());
    let usable: Vec<_> = fours
        .iter()
        .copied()
        .filter(|four| !threes(*four).into_iter().any(in_line))
        .collect();
    if !usable.is_empty() {
        return Ok(usable);
    }
    let three = threes([0, 1, 2, 3])
        .into_iter()
        .find(|three| in_line(*three));
    let which = match three {
        Some([a, b, c]) if pairs.len() == 4 => {
            format!("points {}, {} and {} lie on one line", a + 1, b + 1, c + 1)
        }
        _ => "all points but one lie on one line".to_owned(),
    };
    Err(Error::refused(
        format!("{which}, on the plane or in the image"),
        "spread the points so that four of them have no three on one line",
    ))
}

/// Reports whether the smallest height of a triangle is negligible compared to its longest side.
fn three_in_line([a, b, c]: [[f64; 2]; 3]) -> bool {
    let [a, b, c] = [a, b, c].map(Vector2::from);
    let longest = (b - a).norm().max((c - b).norm()).max((a - c).norm());
    (b - a).perp(&(c - a)).abs() < IN_LINE_SHARE * longest * longest
}

/// Returns all quadruples of `count` points, or a sample of them.
fn fours(count: usize) -> Vec<[usize; 4]> {
    let total = (count - 3..=count).fold(1.0, |product, n| product * n as f64) / 24.0;
    if total > MAX_FOURS as f64 {
        // Drawn by a counter, so that the same points always give the same plane.
        return (0..MAX_FOURS as u32)
            .map(|draw| {
                philox4x32_10([draw, 0, 0, 0], [0, 0])
                    .map(|bits| ((u64::from(bits) * count as u64) >> 32) as usize)
            })
            .filter(|[a, b, c, d]| a != b && a != c && a != d && b != c && b != d && c != d)
            .collect();
    }
    let mut fours = Vec::with_capacity(total as usize);
    for a in 0..count {
        for b in a + 1..count {
            for c in b + 1..count {
                fours.extend((c + 1..count).map(|d| [a, b, c, d]));
            }
        }
    }
    fours
}

/// Returns the pairs within the outlier distance under a homography of unknown sign. All lie on the same side
/// of the horizon: the one with more of them.
fn agreeing(matrix: &Matrix3<f64>, pairs: &[PointPair]) -> Vec<usize> {
    let mut sides = [Vec::new(), Vec::new()];
    for (i, pair) in pairs.iter().enumerate() {
        let (pixel, depth) = projected(matrix, pair);
        if (pixel - Vector2::from(pair.pixel)).norm() <= OUTLIER_PX {
            sides[usize::from(depth < 0.0)].push(i);
        }
    }
    let [before, behind] = sides;
    if before.len() >= behind.len() {
        before
    } else {
        behind
    }
}

/// Returns the image position of a pair's point under a homography, and its depth up to scale.
fn projected(matrix: &Matrix3<f64>, pair: &PointPair) -> (Vector2<f64>, f64) {
    let [x, y] = pair.plane_m;
    let p = matrix * Vector3::new(x, y, 1.0);
    (p.xy() / p.z, p.z)
}

/// Selects the pairs to keep: alternates between fitting and rejecting until the selection is stable.
fn consensus(pairs: &[PointPair], mut kept: Vec<usize>) -> Result<Vec<usize>, Error> {
    const ROUNDS: usize = 20;
    for _ in 0..ROUNDS {
        if kept.len() < 5.max(pairs.len().div_ceil(2)) {
            return Err(Error::refused(
                format!(
                    "the points are inconsistent: one plane explains at most {} of {} within {OUTLIER_PX} pixels",
                    kept.len(),
                    pairs.len()
                ),
                "check their pixels and metres and that each pixel is paired with its own point; with six or more points, a single wrong one is detected",
            ));
        }
        let now = agreeing(&least_squares(pairs, &kept), pairs);
        if now == kept {
            break;
        }
        kept = now;
    }
    Ok(kept)
}

/// Rejects homographies that put points behind the camera or exchange left and right.
fn check_seen_from_above(
    matrix: &Matrix3<f64>,
    pairs: &[PointPair],
    kept: &[usize],
) -> Result<(), Error> {
    let behind: Vec<usize> = kept
        .iter()
        .copied()
        .filter(|&i| projected(matrix, &pairs[i]).1 < 0.0)
        .collect();
    if behind.is_empty() || behind.len() == kept.len() {
        let towards_viewer = if behind.is_empty() { 1.0 } else { -1.0 };
        if towards_viewer * matrix.determinant() < 0.0 {
            return Ok(());
        }
        return Err(Error::refused(
            "the plane is mirrored (left and right are swapped): points in counter-clockwise order on the plane appear in clockwise order in the image",
            "give points as seen from above, x to the right and y up; pixels as (u, v), u to the right and v down",
        ));
    }
    let by_order = |points: fn(&PointPair) -> [f64; 2]| {
        <[usize; 4]>::try_from(kept).is_ok_and(|four| crosses(four.map(|i| points(&pairs[i]))))
    };
    if by_order(|p| p.pixel) != by_order(|p| p.plane_m) {
        return Err(Error::refused(
            "the order of the points is crossed: their polygon intersects itself either in the image or on the plane, but not in both",
            "pair each pixel with its own point, and list the points in order around the polygon",
        ));
    }
    let mut fewer = behind;
    if 2 * fewer.len() > kept.len() {
        fewer = kept
            .iter()
            .copied()
            .filter(|i| !fewer.contains(i))
            .collect();
    }
    let numbers: Vec<String> = fewer.iter().map(|i| (i + 1).to_string()).collect();
    Err(Error::refused(
        format!(
            "the points are inconsistent: point {} would lie behind the horizon",
            numbers.join(", ")
        ),
        "pair each pixel with its own point",
    ))
}

/// Reports whether a quadrilateral intersects itself.
fn crosses(corners: [[f64; 2]; 4]) -> bool {
    let [a, b, c, d] = corners.map(Vector2::from);
    let apart = |a: Vector2<f64>, b: Vector2<f64>, p: Vector2<f64>, q: Vector2<f64>| {
        ((b - a).perp(&(p - a)) < 0.0) != ((b - a).perp(&(q - a)) < 0.0)
    };
    let cut = |a, b, c, d| apart(a, b, c, d) && apart(c, d, a, b);
    cut(a, b, c, d) || cut(b, c, d, a)
}

/// Computes the transform that moves the points' mean to 0 and scales their mean distance from it to √2
/// (Hartley 1997).
fn normalising(points: impl Iterator<Item = [f64; 2]> + Clone) -> Matrix3<f64> {
    let count = points.clone().count() as f64;
    let mean = points.clone().map(Vector2::from).sum::<Vector2<f64>>() / count;
    let distance = points
        .map(|p| (Vector2::from(p) - mean).norm())
        .sum::<f64>()
        / count;
    let scale = std::f64::consts::SQRT_2 / distance;
    Matrix3::new_scaling(scale) * Matrix3::new_translation(&-mean)
}

/// Computes the normalisations of pixels and plane positions for the pairs with the indices `of`.
fn normalisations(pairs: &[PointPair], of: &[usize]) -> [Matrix3<f64>; 2] {
    [
        normalising(of.iter().map(|&i| pairs[i].pixel)),
        normalising(of.iter().map(|&i| pairs[i].plane_m)),
    ]
}

/// Inverts a normalisation, which consists of a scale and a translation.
fn undone(normalisation: &Matrix3<f64>) -> Matrix3<f64> {
    let scale = normalisation[(0, 0)];
    let shift = Vector2::new(normalisation[(0, 2)], normalisation[(1, 2)]);
    Matrix3::new_translation(&(-shift / scale)) * Matrix3::new_scaling(1.0 / scale)
}

/// Computes the homography with the smallest algebraic error; its sign is arbitrary.
fn linear(pairs: &[PointPair], of: &[usize]) -> Matrix3<f64> {
    let [image, plane] = normalisations(pairs, of);
    let mut products = SMatrix::<f64, 9, 9>::zeros();
    for &i in of {
        let q = image * Vector3::new(pairs[i].pixel[0], pairs[i].pixel[1], 1.0);
        let p = plane * Vector3::new(pairs[i].plane_m[0], pairs[i].plane_m[1], 1.0);
        for (axis, coordinate) in [(0, q.x), (1, q.y)] {
            let mut row = SMatrix::<f64, 9, 1>::zeros();
            for c in 0..3 {
                row[3 * axis + c] = p[c];
                row[6 + c] = -coordinate * p[c];
            }
            products += row * row.transpose();
        }
    }
    let eigen = products.symmetric_eigen();
    let h = eigen.eigenvectors.column(eigen.eigenvalues.imin());
    undone(&image) * Matrix3::from_row_slice(h.as_slice()) * plane
}

/// Computes the homography with the smallest squared pixel distances by Gauss-Newton steps from the linear
/// solution; its sign is arbitrary.
fn least_squares(pairs: &[PointPair], of: &[usize]) -> Matrix3<f64> {
    const STEPS: usize = 20;
    let [image, plane] = normalisations(pairs, of);
    let mut matrix = image * linear(pairs, of) * undone(&plane);
    matrix /= matrix.norm();
    let mut cost = f64::INFINITY;
    let mut best = matrix;
    for _ in 0..STEPS {
        let mut slopes = DMatrix::zeros(2 * of.len(), 9);
        let mut residuals = DVector::zeros(2 * of.len());
        for (row, &i) in of.iter().enumerate() {
            let q = image * Vector3::new(pairs[i].pixel[0], pairs[i].pixel[1], 1.0);
            let p = plane * Vector3::new(pairs[i].plane_m[0], pairs[i].plane_m[1], 1.0);
            let mapped = matrix * p;
            for axis in 0..2 {
                let ratio = mapped[axis] / mapped.z;
                residuals[2 * row + axis] = ratio - q[axis];
                for c in 0..3 {
                    slopes[(2 * row + axis, 3 * axis + c)] = p[c] / mapped.z;
                    slopes[(2 * row + axis, 6 + c)] = -ratio * p[c] / mapped.z;
                }
            }
        }
        let now = residuals.norm_squared();
        // Also stops if a point reaches the horizon.
        if !(now < cost) {
            break;
        }
        let gain = cost - now;
        (best, cost) = (matrix, now);
        if gain <= 1e-14 * now {
            break;
        }
        // The scale is free: among equivalent steps, the shortest one preserves it.
        let Ok(step) = slopes.svd(true, true).solve(&residuals, 1e-10) else {
            break;
        };
        matrix -= Matrix3::from_row_slice(step.as_slice());
        matrix /= matrix.norm();
    }
    undone(&image) * best * plane
}
