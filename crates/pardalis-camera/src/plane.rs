//! A camera of unknown lens and pose, described by its view of the plane z = 0.

use nalgebra::Matrix3;

use super::{Projection, Ray};
use crate::Homography;
use pardalis_core::Error;
use pardalis_core::real::Real;

/// A projective camera without distortion, defined by the homography H from the plane z = 0 of the
/// world to pixels and by its centre (Campos 2009, section 3.1; Hartley and Zisserman 2004, chapter
/// 6). Its frame is the world frame, so that its pose is the identity:
///
/// (u, v, 1)·w = H·(x, y, 1) + z·q with q = −H·(xc, yc, 1)/zc, for which the camera's centre (xc,
/// yc, zc) has no image.
///
/// A point at height z therefore appears where its ray meets the plane, zc/(zc − z) times as far
/// from the camera's foot point. The published correction multiplies by that factor instead of
/// dividing by it (Campos 2009, eq. 16). An unknown centre is treated as infinitely high: q = 0.
///
/// Domain: w > 0, in front of the camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plane<R> {
    pixel_from_plane: [[R; 3]; 3],
    plane_from_pixel: [[R; 3]; 3],
    foot_m: [R; 2],
    /// 1/zc in 1/m; 0 if the centre is unknown.
    inverse_height_per_m: R,
    /// q.
    by_height: [R; 3],
}

/// Height above the plane at which rays start if the centre is unknown, in metres.
const UNKNOWN_HEIGHT_M: f64 = 1e6;

/// Largest distance of the centre, in metres.
const MAX_DISTANCE_M: f64 = 1e9;

impl Plane<f64> {
    /// Creates a camera. `center_m` is the camera's centre in the world frame, above the plane, or
    /// `None` if it is unknown.
    pub fn new(homography: &Homography, center_m: Option<[f64; 3]>) -> Result<Self, Error> {
        let matrix = homography.matrix();
        let pixel_from_plane = [0, 1, 2].map(|i| [0, 1, 2].map(|j| matrix[(i, j)]));
        let (foot_m, inverse_height_per_m) = match center_m {
            None => ([0.0; 2], 0.0),
            Some([x, y, z]) => {
                let sane = x.abs() <= MAX_DISTANCE_M && y.abs() <= MAX_DISTANCE_M;
                if !(sane && z > 1e-6 && z <= MAX_DISTANCE_M) {
                    return Err(Error::out_of_range(
                        "camera_center_m",
                        format!("{center_m:?}"),
                        "three numbers in metres; the third, the height above the plane, above 0",
                    ));
                }
                ([x, y], 1.0 / z)
            }
        };
        Ok(Self::of(pixel_from_plane, foot_m, inverse_height_per_m))
    }

    /// Returns the camera whose plane is the image itself: x and y are in pixels. It serves for
    /// tracking in the image.
    pub fn image() -> Self {
        let identity = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        Self::of(identity, [0.0; 2], 0.0)
    }

    /// Returns the homography from the plane (metres) to pixels.
    pub fn pixel_from_plane(&self) -> [[f64; 3]; 3] {
        self.pixel_from_plane
    }

    /// Returns the camera's centre in the world frame, in metres, or `None` if it is unknown.
    pub fn center_m(&self) -> Option<[f64; 3]> {
        let [x, y] = self.foot_m;
        (self.inverse_height_per_m > 0.0).then(|| [x, y, 1.0 / self.inverse_height_per_m])
    }

    /// Returns the centre, or a point far above the plane if it is unknown.
    pub(super) fn viewpoint_m(&self) -> [f64; 3] {
        self.center_m().unwrap_or([0.0, 0.0, UNKNOWN_HEIGHT_M])
    }

    #[allow(clippy::unused_self)] // uniform signature for all models
    pub(super) fn with_parameters(&self, p: [f64; 12]) -> Result<Self, Error> {
        let center_m = (p[11] > 0.0).then(|| [p[9], p[10], 1.0 / p[11]]);
        Self::new(
            &Homography::new(Matrix3::from_row_slice(&p[..9]))?,
            center_m,
        )
    }

    /// Returns the camera in single precision, for vectorised kernels.
    pub fn to_f32(&self) -> Plane<f32> {
        let single = |rows: [[f64; 3]; 3]| rows.map(|row| row.map(|v| v as f32));
        Plane {
            pixel_from_plane: single(self.pixel_from_plane),
            plane_from_pixel: single(self.plane_from_pixel),
            foot_m: self.foot_m.map(|v| v as f32),
            inverse_height_per_m: self.inverse_height_per_m as f32,
            by_height: self.by_height.map(|v| v as f32),
        }
    }
}

impl<R: Real> Plane<R> {
    /// Names of the parameters, in order.
    pub(super) const NAMES: [&'static str; 12] = [
        "h11",
        "h12",
        "h13",
        "h21",
        "h22",
        "h23",
        "h31",
        "h32",
        "h33",
        "foot_x_m",
        "foot_y_m",
        "inverse_height_per_m",
    ];

    pub(super) fn parameters(&self) -> [R; 12] {
        std::array::from_fn(|i| match i {
            0..9 => self.pixel_from_plane[i / 3][i % 3],
            9 | 10 => self.foot_m[i - 9],
            _ => self.inverse_height_per_m,
        })
    }

    /// Returns the camera with other parameters, unchecked and of any number type.
    #[allow(clippy::unused_self)] // uniform signature for all models
    pub(super) fn vary<S: Real>(&self, p: [S; 12]) -> Plane<S> {
        let rows = [0, 3, 6].map(|i| [p[i], p[i + 1], p[i + 2]]);
        Plane::of(rows, [p[9], p[10]], p[11])
    }

    fn of(pixel_from_plane: [[R; 3]; 3], foot_m: [R; 2], inverse_height_per_m: R) -> Self {
        let [x, y] = foot_m;
        Self {
            pixel_from_plane,
            plane_from_pixel: inverse(&pixel_from_plane),
            foot_m,
            inverse_height_per_m,
            by_height: pixel_from_plane
                .map(|[a, b, c]| -(a * x + b * y + c) * inverse_height_per_m),
        }
    }
}

impl<R: Real> Projection<R> for Plane<R> {
    #[inline(always)]
    fn project(&self, [x, y, z]: [R; 3]) -> ([R; 2], bool) {
        let along = |i: usize| {
            let [a, b, c] = self.pixel_from_plane[i];
            a * x + b * y + c + self.by_height[i] * z
        };
        let w = along(2);
        let in_front = w > R::of(0.0);
        let inverse = R::of(1.0) / if in_front { w } else { R::of(1.0) };
        ([along(0) * inverse, along(1) * inverse], in_front)
    }

    fn unproject(&self, [u, v]: [R; 2]) -> Option<Ray<R>> {
        let [x, y, w] = self.plane_from_pixel.map(|[a, b, c]| a * u + b * v + c);
        let zero = R::of(0.0);
        if self.inverse_height_per_m > zero {
            let height_m = R::of(1.0) / self.inverse_height_per_m;
            let [foot_x, foot_y] = self.foot_m;
            // Towards the plane, or away from it for pixels above the horizon.
            let direction = [x - w * foot_x, y - w * foot_y, -w * height_m];
            let is_number = w.abs() >= zero;
            return is_number.then(|| Ray {
                origin: [foot_x, foot_y, height_m],
                ..Ray::towards(direction)
            });
        }
        (w > zero).then(|| Ray {
            origin: [x / w, y / w, R::of(UNKNOWN_HEIGHT_M)],
            direction: [zero, zero, R::of(-1.0)],
        })
    }
}

fn determinant<R: Real>(m: &[[R; 3]; 3]) -> R {
    (0..3)
        .map(|i| m[0][i] * cofactor(m, 0, i))
        .reduce(|a, b| a + b)
        .unwrap_or(R::of(0.0))
}

fn cofactor<R: Real>(m: &[[R; 3]; 3], row: usize, column: usize) -> R {
    let at = |i: usize, j: usize| m[(row + i) % 3][(column + j) % 3];
    at(1, 1) * at(2, 2) - at(1, 2) * at(2, 1)
}

fn inverse<R: Real>(m: &[[R; 3]; 3]) -> [[R; 3]; 3] {
    let scale = R::of(1.0) / determinant(m);
    [0, 1, 2].map(|i| [0, 1, 2].map(|j| cofactor(m, j, i) * scale))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Centre of a pinhole camera with a focal length of 560 px that looks down at the plane.
    const CENTER_M: [f64; 3] = [0.0, -3.2, 3.0];

    fn mast() -> Plane<f64> {
        let (sin, cos) = libm::sincos(0.9_f64);
        // Rows of the rotation: right, down, forward.
        let rows = [[1.0, 0.0, 0.0], [0.0, -sin, -cos], [0.0, cos, -sin]];
        let h = rows.map(|r| {
            let t = -(r[0] * CENTER_M[0] + r[1] * CENTER_M[1] + r[2] * CENTER_M[2]);
            [r[0], r[1], t]
        });
        let [a, b, w] = h;
        let pixel = |row: [f64; 3], center: f64| [0, 1, 2].map(|i| 560.0 * row[i] + center * w[i]);
        let rows = [pixel(a, 319.5), pixel(b, 239.5), w];
        Plane::new(&homography(rows), Some(CENTER_M)).unwrap()
    }

    fn homography(rows: [[f64; 3]; 3]) -> Homography {
        Homography::new(Matrix3::from_row_slice(rows.as_flattened())).unwrap()
    }

    #[test]
    fn points_above_the_plane_project_as_in_a_pinhole_camera() {
        let camera = mast();
        for point in [[0.3, -0.2, 0.0], [0.3, -0.2, 0.406], [-1.0, 2.0, 1.2]] {
            let (sin, cos) = libm::sincos(0.9_f64);
            let d: [f64; 3] = std::array::from_fn(|i| point[i] - CENTER_M[i]);
            let (x, y, z) = (d[0], -sin * d[1] - cos * d[2], cos * d[1] - sin * d[2]);
            let expected = [560.0 * x / z + 319.5, 560.0 * y / z + 239.5];
            let (pixel, valid) = camera.project(point);
            assert!(valid);
            for axis in 0..2 {
                assert!((pixel[axis] - expected[axis]).abs() < 1e-9, "{point:?}");
            }
        }
    }

    /// By similar triangles, a point raised to height z appears h/(h − z) times as far from the
    /// camera's foot point. The published formula moves it closer instead.
    #[test]
    fn heights_are_corrected_by_similar_triangles() {
        let camera = mast();
        let (z, h) = (0.406, CENTER_M[2]);
        let point = [0.7, 0.4];
        let (pixel, _) = camera.project([point[0], point[1], z]);
        let ray = camera.unproject(pixel).unwrap();
        let t = -ray.origin[2] / ray.direction[2];
        for axis in 0..2 {
            let on_plane = ray.origin[axis] + t * ray.direction[axis];
            let from_foot = on_plane - CENTER_M[axis];
            let corrected = CENTER_M[axis] + from_foot * (h - z) / h;
            let published = CENTER_M[axis] + from_foot * h / (h - z);
            assert!((corrected - point[axis]).abs() < 1e-9);
            assert!((published - point[axis]).abs() > 0.1);
        }
    }

    #[test]
    fn pixels_do_not_depend_on_height_if_the_centre_is_unknown() {
        let mast = mast();
        let camera = Plane::new(&homography(mast.pixel_from_plane()), None).unwrap();
        let (low, _) = camera.project([0.5, 0.2, 0.0]);
        let (high, _) = camera.project([0.5, 0.2, 0.4]);
        assert_eq!(low, high);
        let ray = camera.unproject(low).unwrap();
        assert!((ray.origin[0] - 0.5).abs() < 1e-9 && (ray.origin[1] - 0.2).abs() < 1e-9);
        assert_eq!(ray.direction, [0.0, 0.0, -1.0]);
    }

    #[test]
    fn points_behind_have_no_pixel_and_invalid_centres_are_rejected() {
        assert!(!mast().project([0.0, -9.0, 0.0]).1);
        for center in [[0.0, 0.0, 0.0], [0.0, 0.0, -1.0], [f64::NAN, 0.0, 1.0]] {
            assert!(Plane::new(&homography(mast().pixel_from_plane()), Some(center)).is_err());
        }
    }
}
