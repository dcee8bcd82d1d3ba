//! Homographies between a plane and its image in a pinhole camera.
//!
//! Plane frame: metres, z = 0 on the plane, z towards the viewer; seen from above, y lies to the
//! left of x. A pinhole camera maps the plane to its image by a homography (Hartley and Zisserman
//! 2004, sections 4.1 and 4.4). With known intrinsics, the homography also determines the camera's
//! pose.

use nalgebra::{Matrix3, Vector3};

use pardalis_core::Error;

/// Smallest ratio of a homography's determinant to the cube of its norm, for points and pixels of
/// usual magnitude. Below it the plane is seen edge-on.
const LEAST_DETERMINANT: f64 = 1e-30;

/// A map from points of a plane to pixels of a pinhole camera above it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Homography {
    pixel_from_plane: Matrix3<f64>,
    plane_from_pixel: Matrix3<f64>,
}

impl Homography {
    /// Creates a homography from a matrix of any scale that maps (x, y, 1) in metres to (u, v, 1)
    /// in pixels. Its sign is chosen such that the plane is seen from above.
    ///
    /// # Errors
    ///
    /// The matrix must be finite and invertible.
    pub fn new(matrix: Matrix3<f64>) -> Result<Self, Error> {
        let scaled = matrix / matrix.norm();
        let determinant = scaled.determinant();
        // Seen from above, a counter-clockwise turn on the plane is counter-clockwise in the image.
        // As v points down, it reverses the orientation in pixel coordinates: the determinant is
        // negative.
        let pixel_from_plane = if determinant > 0.0 { -scaled } else { scaled };
        let plane_from_pixel = pixel_from_plane.try_inverse();
        match plane_from_pixel.filter(|_| determinant.abs() > LEAST_DETERMINANT) {
            Some(plane_from_pixel) => Ok(Self {
                pixel_from_plane,
                plane_from_pixel,
            }),
            None => Err(Error::out_of_range(
                "homography",
                format!("{:?}", matrix.transpose().as_slice()),
                "a finite matrix with an inverse",
            )),
        }
    }

    /// Returns the matrix from (x, y, 1) to (u, v, 1). The third coordinate is positive for points
    /// in front of the camera, and the Frobenius norm is 1.
    pub fn matrix(&self) -> Matrix3<f64> {
        self.pixel_from_plane
    }

    /// Returns the pixel of a point of the plane, or `None` if the point lies behind the camera.
    pub fn pixel_of(&self, plane_m: [f64; 2]) -> Option<[f64; 2]> {
        mapped(&self.pixel_from_plane, plane_m)
    }

    /// Returns the point of the plane seen by a pixel, or `None` if the pixel lies on or above the
    /// horizon.
    pub fn plane_of(&self, pixel: [f64; 2]) -> Option<[f64; 2]> {
        mapped(&self.plane_from_pixel, pixel)
    }
}

fn mapped(matrix: &Matrix3<f64>, [x, y]: [f64; 2]) -> Option<[f64; 2]> {
    let p = matrix * Vector3::new(x, y, 1.0);
    let mapped = [p.x / p.z, p.y / p.z];
    (p.z > 0.0 && mapped.iter().all(|c| c.is_finite())).then_some(mapped)
}
