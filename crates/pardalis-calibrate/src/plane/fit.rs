//! A homography from pairs of points: normalised linear start, outliers by consensus, least squares of pixel distances.

use nalgebra::{DMatrix, DVector, Matrix3, SMatrix, Vector2, Vector3};

use crate::rms;
use pardalis_camera::Homography;
use pardalis_core::Error;
use pardalis_core::rng::philox4x32_10;

/// Points that are farther than this from where the others put them, in pixels, are outliers: a mistaken number, not an unsteady hand.
pub const OUTLIER_PX: f64 = 4.0;

/// The largest coordinate in metres or pixels that can be meant.
const MAX_COORDINATE: f64 = 1e6;

/// Three points are in line where one is nearer to the line of the others than this share of their distance.
const IN_LINE_SHARE: f64 = 1e-3;

/// Of more fours than this, so many are drawn.
const MAX_FOURS: usize = 5000;

/// A point of the plane and where it was seen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PointPair {
    /// Its pixel; centres of pixels are at integers.
    pub pixel: [f64; 2],
    /// Its place on the plane, in metres.
    pub plane_m: [f64; 2],
}

/// A plane from points.
#[derive(Debug, Clone, PartialEq)]
pub struct PlaneFit {
    /// From the plane to the image.
    pub homography: Homography,
    /// For each pair, in pixels, where its point comes out less where it was seen; none for outliers behind the camera.
    pub residuals_px: Vec<Option<[f64; 2]>>,
    /// Which pairs were left out, by their index, ascending.
    pub outliers: Vec<usize>,
    /// Root mean square distance in pixels of the pairs that were kept.
    pub rms_px: f64,
}

/// Fits a plane to four or more pairs of points. Refusals count the points from 1.
///
/// Four points are met exactly; with more, the squared pixel distances are least, and points beyond [`OUTLIER_PX`] are left out where at least half of
/// all, and five (any four agree), agree on that.
///
/// Refused: fewer than four points, points that cannot be meant, the same point twice, points in line, crossed order, a mirrored plane,
/// points that do not agree.
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
        // A four in crossed order is met exactly, with some of its points behind the camera: it is refused below for what it is.
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
            "give four or more, no three of them in line",
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

/// Fours of points no three of which are in line, on the plane or in the image.
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
            format!("points {}, {} and {} are in line", a + 1, b + 1, c + 1)
        }
        _ => "all points but one are in line".to_owned(),
    };
    Err(Error::refused(
        format!("{which}, on the plane or in the image"),
        "spread the points, four of them so that no three are in line",
    ))
}

/// Whether the least height of a triangle is nothing beside its longest side.
fn three_in_line([a, b, c]: [[f64; 2]; 3]) -> bool {
    let [a, b, c] = [a, b, c].map(Vector2::from);
    let longest = (b - a).norm().max((c - b).norm()).max((a - c).norm());
    (b - a).perp(&(c - a)).abs() < IN_LINE_SHARE * longest * longest
}

/// All fours of so many points, or as many of them as are tried.
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

/// The pairs that a homography of any sign brings together, all of them on one side of the horizon: the one with more.
fn agreeing(matrix: &Matrix3<f64>, pairs: &[PointPair]) -> Vec<usize> {
    let mut sides = [Vec::new(), Vec::new()];
    for (i, pair) in pairs.iter().enumerate() {
        let (pixel, depth) = seen(matrix, pair);
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

/// Where a homography puts a pair's point, and its depth up to scale.
fn seen(matrix: &Matrix3<f64>, pair: &PointPair) -> (Vector2<f64>, f64) {
    let [x, y] = pair.plane_m;
    let p = matrix * Vector3::new(x, y, 1.0);
    (p.xy() / p.z, p.z)
}

/// The pairs to keep: fits and leaves out in turn until nothing changes.
fn consensus(pairs: &[PointPair], mut kept: Vec<usize>) -> Result<Vec<usize>, Error> {
    const ROUNDS: usize = 20;
    for _ in 0..ROUNDS {
        if kept.len() < 5.max(pairs.len().div_ceil(2)) {
            return Err(Error::refused(
                format!(
                    "the points do not agree: at most {} of {} lie within {OUTLIER_PX} pixels of where one plane puts them",
                    kept.len(),
                    pairs.len()
                ),
                "check their pixels and metres and that each pixel stands beside its own point; with six or more, a single wrong one is found",
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

/// Refuses homographies under which points lie behind the camera, or left and right are swapped.
fn check_seen_from_above(
    matrix: &Matrix3<f64>,
    pairs: &[PointPair],
    kept: &[usize],
) -> Result<(), Error> {
    let behind: Vec<usize> = kept
        .iter()
        .copied()
        .filter(|&i| seen(matrix, &pairs[i]).1 < 0.0)
        .collect();
    if behind.is_empty() || behind.len() == kept.len() {
        let towards_viewer = if behind.is_empty() { 1.0 } else { -1.0 };
        if towards_viewer * matrix.determinant() < 0.0 {
            return Ok(());
        }
        return Err(Error::refused(
            "the plane is mirrored: points that turn counter-clockwise on it do so clockwise in the image, so that left and right are swapped",
            "give points as seen from above, x to the right and y up; pixels as (u, v), u to the right and v down",
        ));
    }
    let by_order = |points: fn(&PointPair) -> [f64; 2]| {
        <[usize; 4]>::try_from(kept).is_ok_and(|four| crosses(four.map(|i| points(&pairs[i]))))
    };
    if by_order(|p| p.pixel) != by_order(|p| p.plane_m) {
        return Err(Error::refused(
            "the order of the points is crossed: joined in it they make a figure that crosses itself in the image or on the plane, but not in both",
            "give each pixel beside its own point, and all points in one order around the figure",
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
            "the points do not fit together: point {} would lie behind the horizon",
            numbers.join(", ")
        ),
        "give each pixel beside its own point",
    ))
}

/// Whether a quadrilateral crosses itself.
fn crosses(corners: [[f64; 2]; 4]) -> bool {
    let [a, b, c, d] = corners.map(Vector2::from);
    let apart = |a: Vector2<f64>, b: Vector2<f64>, p: Vector2<f64>, q: Vector2<f64>| {
        ((b - a).perp(&(p - a)) < 0.0) != ((b - a).perp(&(q - a)) < 0.0)
    };
    let cut = |a, b, c, d| apart(a, b, c, d) && apart(c, d, a, b);
    cut(a, b, c, d) || cut(b, c, d, a)
}

/// Moves and scales points so that their mean is 0 and their mean distance from it the root of 2 (Hartley 1997).
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

/// The normalisations of pixels and plane of some pairs.
fn normalisations(pairs: &[PointPair], of: &[usize]) -> [Matrix3<f64>; 2] {
    [
        normalising(of.iter().map(|&i| pairs[i].pixel)),
        normalising(of.iter().map(|&i| pairs[i].plane_m)),
    ]
}

/// Undoes a normalisation, which is a scale and a shift.
fn undone(normalisation: &Matrix3<f64>) -> Matrix3<f64> {
    let scale = normalisation[(0, 0)];
    let shift = Vector2::new(normalisation[(0, 2)], normalisation[(1, 2)]);
    Matrix3::new_translation(&(-shift / scale)) * Matrix3::new_scaling(1.0 / scale)
}

/// The homography of least algebraic error, of any sign.
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

/// The homography of least squared pixel distances, of any sign: Gauss-Newton steps from the linear one.
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
        // Also ends where a point came to lie on the horizon.
        if !(now < cost) {
            break;
        }
        let gain = cost - now;
        (best, cost) = (matrix, now);
        if gain <= 1e-14 * now {
            break;
        }
        // The scale is free: of all steps that do the same the shortest leaves it.
        let Ok(step) = slopes.svd(true, true).solve(&residuals, 1e-10) else {
            break;
        };
        matrix -= Matrix3::from_row_slice(step.as_slice());
        matrix /= matrix.norm();
    }
    undone(&image) * best * plane
}
