//! A rectangle on the plane, whose corners somebody finds in images.

use super::PointPair;

/// A rectangle by its corners in the world. By itself it has no place and no turn: which corner is which, the caller says.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rectangle {
    /// Its corners on the plane in metres, counterclockwise as seen from above.
    pub corners_m: [[f64; 2]; 4],
    /// The number, from 0, of the corner that is nearest the image's bottom left.
    pub nearest: usize,
}

impl Rectangle {
    /// A rectangle with sides of these lengths in metres that is the world: its origin is the corner nearest the image's bottom left, x runs along the first
    /// side, the one that follows counterclockwise.
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

    /// Its corners with their pixels, which are given counterclockwise to the eye from the one nearest the image's bottom left.
    pub fn pairs(&self, corners_px: [[f64; 2]; 4]) -> [PointPair; 4] {
        std::array::from_fn(|i| PointPair {
            pixel: corners_px[i],
            plane_m: self.corners_m[(self.nearest + i) % 4],
        })
    }
}
