//! Elements that several formats share: camera matrices, image sizes, distortion in OpenCV's order,
//! poses and names.

use std::f64::consts::PI;

use super::Lens;
use super::document::{Entry, Matrix};
use crate::pose::{Pose, pose_from_matrix};
use crate::{Camera, KannalaBrandt, Mei, Pinhole};
use pardalis_core::Error;
use pardalis_core::error::MAX_IMAGE_SIDE_PX;

/// A camera matrix: focal lengths, skew and principal point, in pixels.
pub(super) struct CameraMatrix<'a> {
    entry: Entry<'a>,
    f_px: [f64; 2],
    skew_px: f64,
    center_px: [f64; 2],
}

impl<'a> CameraMatrix<'a> {
    /// Reads a 3x3 matrix whose last row must be 0, 0, 1.
    pub(super) fn read(matrix: Matrix<'a>) -> Result<Self, Error> {
        let [[fx, skew, cx], [zero, fy, cy], last] = matrix.rows::<3, 3>()?;
        let entry = matrix.entry;
        if last != [0.0, 0.0, 1.0] {
            return Err(entry.error(format!("has {last:?} in its last row; allowed: 0, 0, 1")));
        }
        if zero != 0.0 {
            return Err(entry.error(format!("has {zero} in row 2, column 1; allowed: 0")));
        }
        Ok(Self {
            entry,
            f_px: [fx, fy],
            skew_px: skew,
            center_px: [cx, cy],
        })
    }

    fn check_no_skew(&self) -> Result<(), Error> {
        if self.skew_px == 0.0 {
            return Ok(());
        }
        Err(self.entry.error(format!(
            "has the skew {} in row 1, column 2; allowed: 0 (of OpenCV's models only omnidir has a skew here)",
            self.skew_px
        )))
    }

    /// Creates a pinhole camera with 0, 4, 5, 8, 12 or 14 coefficients in OpenCV's order.
    pub(super) fn pinhole(&self, distortion: &Entry, numbers: &[f64]) -> Result<Camera, Error> {
        self.check_no_skew()?;
        let kept = match numbers.len() {
            14 if numbers[12] != 0.0 || numbers[13] != 0.0 => {
                return Err(distortion.error(format!(
                    "has the sensor tilt tau_x = {}, tau_y = {}; allowed: 0 (tilted sensors are not supported)",
                    numbers[12], numbers[13]
                )));
            }
            14 => &numbers[..12],
            0 | 4 | 5 | 8 | 12 => numbers,
            n => {
                return Err(distortion.error(format!(
                    "has {n} numbers; allowed for a pinhole: 4, 5, 8, 12 or 14 (k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4 tau_x tau_y)"
                )));
            }
        };
        let model = Pinhole::new(self.f_px, self.center_px, kept);
        self.entry.checked(model).map(Camera::Pinhole)
    }

    /// Creates OpenCV's fisheye from its four coefficients. Files contain no largest angle: the
    /// model alone limits it.
    pub(super) fn fisheye(&self, distortion: &Entry, numbers: &[f64]) -> Result<Camera, Error> {
        self.check_no_skew()?;
        let k = four_coefficients(distortion, numbers, "a fisheye: k1 k2 k3 k4")?;
        let model = KannalaBrandt::new(self.f_px, self.center_px, k, PI);
        self.entry.checked(model).map(Camera::KannalaBrandt)
    }

    /// Creates OpenCV's omnidir model.
    pub(super) fn omnidir(
        &self,
        xi: f64,
        distortion: &Entry,
        numbers: &[f64],
    ) -> Result<Camera, Error> {
        let distortion = four_coefficients(distortion, numbers, "omnidir: k1 k2 p1 p2")?;
        let model = Mei::new(self.f_px, self.skew_px, self.center_px, xi, distortion);
        self.entry.checked(model).map(Camera::Mei)
    }
}

fn four_coefficients(entry: &Entry, numbers: &[f64], of: &str) -> Result<[f64; 4], Error> {
    numbers.try_into().map_err(|_| {
        entry.error(format!(
            "has {} numbers; allowed: 4 for {of}",
            numbers.len()
        ))
    })
}

/// Returns the lens named by a value.
pub(super) fn lens_of(entry: &Entry) -> Result<Lens, Error> {
    match entry.text()?.to_ascii_lowercase().as_str() {
        "pinhole" | "perspective" | "plumb_bob" | "radtan" | "rational_polynomial"
        | "thin_prism" => Ok(Lens::Pinhole),
        "fisheye" | "equidistant" | "kannala_brandt" | "kannala_brandt4" | "kb4" => {
            Ok(Lens::Fisheye)
        }
        "omnidir" | "omni" | "mei" => Ok(Lens::Omnidir),
        _ => Err(entry.invalid(
            "pinhole, plumb_bob, radtan, rational_polynomial, thin_prism; fisheye, equidistant, kannala_brandt; omnidir, omni, mei",
        )),
    }
}

/// Determines the lens from the file (`stated`), the caller (`asked`) and the number of
/// coefficients. File and caller must agree; the number of coefficients decides if neither names a
/// lens.
pub(super) fn resolve_lens(
    stated: Option<Lens>,
    asked: Option<Lens>,
    distortion: &Entry,
    count: usize,
) -> Result<Lens, Error> {
    match (stated, asked) {
        (Some(stated), Some(asked)) if stated != asked => Err(distortion.error(format!(
            "belongs to a {} camera according to the file, but was to be read as {}; omit the lens (--as, or calibration_lens in a scene)",
            stated.name(),
            asked.name()
        ))),
        (Some(lens), _) | (None, Some(lens)) => Ok(lens),
        (None, None) if count == 4 => Err(distortion.error(
            "has 4 numbers, which may be those of a pinhole (k1 k2 p1 p2) or a fisheye (k1 k2 k3 k4), and the file does not say which; \
             specify pinhole or fisheye (--as, or calibration_lens in a scene; `pardalis camera convert --as` writes an unambiguous file)",
        )),
        (None, None) => Ok(Lens::Pinhole),
    }
}

/// Reads width and height of the images, in pixels.
pub(super) fn size_px(width: &Entry, height: &Entry) -> Result<(usize, usize), Error> {
    Ok((
        width.whole(1, MAX_IMAGE_SIDE_PX)?,
        height.whole(1, MAX_IMAGE_SIDE_PX)?,
    ))
}

/// Reads width and height of the images, in pixels, from a row or column of two numbers.
pub(super) fn size_from_pair(entry: &Entry) -> Result<(usize, usize), Error> {
    let whole = |v: f64| v.fract() == 0.0 && v >= 1.0 && v <= MAX_IMAGE_SIDE_PX as f64;
    let matrix = entry.matrix()?;
    match *matrix.vector()? {
        [width, height] if whole(width) && whole(height) => Ok((width as usize, height as usize)),
        ref other => Err(entry.error(format!(
            "is {other:?}; allowed: width and height, whole numbers from 1 to {MAX_IMAGE_SIDE_PX}"
        ))),
    }
}

/// Reads a rigid transform from a 4x4 matrix.
pub(super) fn transform(entry: &Entry) -> Result<Pose, Error> {
    let rows = entry.matrix()?.rows::<4, 4>()?;
    entry.checked(pose_from_matrix(rows))
}

/// Creates a rigid transform from a rotation matrix and a translation in metres.
pub(super) fn transform_from_parts(
    rotation: &Entry,
    [r0, r1, r2]: [[f64; 3]; 3],
    [x, y, z]: [f64; 3],
) -> Result<Pose, Error> {
    let row = |[a, b, c]: [f64; 3], t| [a, b, c, t];
    let rows = [row(r0, x), row(r1, y), row(r2, z), [0.0, 0.0, 0.0, 1.0]];
    rotation.checked(pose_from_matrix(rows))
}

/// Returns a name that scene files allow: other characters become `_`, and an empty name becomes
/// `default`.
pub(super) fn sanitized_name(name: &str, default: &str) -> String {
    let sanitized = |c: char| {
        if c.is_ascii_alphanumeric() || c == '-' {
            c
        } else {
            '_'
        }
    };
    let name: String = name
        .trim_matches('/')
        .chars()
        .take(64)
        .map(sanitized)
        .collect();
    if name.is_empty() {
        default.to_owned()
    } else {
        name
    }
}
