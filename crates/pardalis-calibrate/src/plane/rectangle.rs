//! A rectangle on the plane whose corners were found in an image.

use super::PointPair;

/// A rectangle given by its corners in the world. The caller states which image corner is which, because the
/// rectangle alone determines neither position nor orientation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rectangle {
    /// Corners on the plane in metres, counter-clockwise as seen from above.
    pub corners_m: [[f64; 2]; 4],
    /// Index (from 0) of the corner nearest to the image's bottom left.
    pub nearest: usize,
}

impl Rectangle {
    /// Returns a rectangle with sides of these lengths in metres that defines the world frame: the origin is
    /// the corner nearest to the image's bottom left, and x runs along the first side, counter-clockwise from
    /// it.
    pub fn of_size([first_m, second_m]: [f64; 2]) -> Self {
        Self {
            corners_m: [
                [0.0, 0.0],
                [first_m, 0.0],
                [first_m, second_m],
                [0.0, second_m],
            ],
            nearest: 0,
        }
    }

    /// Pairs the corners with their pixels, which are in counter-clockwise order in the image from the corner
    /// nearest to its bottom left.
    pub fn pairs(&self, corners_px: [[f64; 2]; 4]) -> [PointPair; 4] {
        std::array::from_fn(|i| PointPair {
            pixel: corners_px[i],
            plane_m: self.corners_m[(self.nearest + i) % 4],
        })
    }
}
