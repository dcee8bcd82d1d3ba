//! Homographies: how a pinhole camera maps a plane to its image.
//!
//! Plane frame: metres, z = 0 on the plane, z towards the viewer: seen from above, y lies to the left of x. A pinhole camera takes the plane to
//! the image by a homography (Hartley and Zisserman 2004, sections 4.1 and 4.4); with known intrinsics it also gives the camera's place.

use nalgebra::{Matrix3, Vector3};

use pardalis_core::Error;

/// The least ratio of a homography's determinant to the cube of its norm, at points and pixels of usual size: below it the plane is seen edge-on.
const LEAST_DETERMINANT: f64 = 1e-30;

/// Takes points of a plane to pixels, as a pinhole camera above it does.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Homography {
    pixel_from_plane: Matrix3<f64>,
    plane_from_pixel: Matrix3<f64>,
}

impl Homography {
    /// Takes a matrix from (x, y, 1) in metres to (u, v, 1) in pixels, of any scale. Its sign is made such that the plane is seen from above.
    ///
    /// Refused: what is not finite, or has no inverse.
    pub fn new(matrix: Matrix3<f64>) -> Result<Self, Error> {
        let scaled = matrix / matrix.norm();
        let determinant = scaled.determinant();
        // Seen from above, what turns counter-clockwise on the plane does so in the image, and therefore clockwise in numbers, as v points down.
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

    /// From (x, y, 1) to (u, v, 1): its third coordinate is positive for all that lies before the camera. Its Frobenius norm is 1.
    pub fn matrix(&self) -> Matrix3<f64> {
        self.pixel_from_plane
    }

    /// The pixel that shows a point of the plane; none for points behind the camera.
    pub fn pixel_of(&self, plane_m: [f64; 2]) -> Option<[f64; 2]> {
        mapped(&self.pixel_from_plane, plane_m)
    }

    /// The point of the plane that a pixel shows; none for pixels at or above the horizon.
    pub fn plane_of(&self, pixel: [f64; 2]) -> Option<[f64; 2]> {
        mapped(&self.plane_from_pixel, pixel)
    }
}

fn mapped(matrix: &Matrix3<f64>, [x, y]: [f64; 2]) -> Option<[f64; 2]> {
    let p = matrix * Vector3::new(x, y, 1.0);
    let mapped = [p.x / p.z, p.y / p.z];
    (p.z > 0.0 && mapped.iter().all(|c| c.is_finite())).then_some(mapped)
}
