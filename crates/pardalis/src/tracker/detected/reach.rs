//! Where a target can be that is nowhere but near its prediction.

use nalgebra::{Matrix3, Point3};

use super::candidates::Ray;
use crate::detect::Blob;
use crate::likelihood::edge::EdgeFrame;
use pardalis_filter::estimate::{StateEstimate, covariance_matrix};

/// Streaks of a target that is nowhere but near its prediction are looked for within this many standard deviations. Hand-set.
const REACH_SIGMAS: f64 = 5.0;

/// Where a target is that is nowhere but near its prediction.
#[derive(Debug, Clone, Copy)]
pub(super) struct Reach {
    mean: Point3<f64>,
    /// The inverse of the covariance, 1/m².
    information: Matrix3<f64>,
}

impl Reach {
    /// That of a target with this prediction, and this diameter in metres. A streak may be off by its size. `None` if the prediction says nothing.
    pub(super) fn of(predicted: &StateEstimate, diameter_m: f64) -> Option<Self> {
        let of_size = Matrix3::from_diagonal_element(diameter_m * diameter_m);
        let information = (covariance_matrix(predicted.covariance_m2) + of_size).try_inverse()?;
        Some(Self {
            mean: predicted.position_m.into(),
            information,
        })
    }

    /// Whether the ray through a blob passes by.
    pub(super) fn holds(&self, frame: &EdgeFrame, blob: &Blob) -> bool {
        let ray = Ray::of(frame, blob.centroid_px, blob.area_px);
        ray.is_some_and(|ray| {
            let off = ray.nearest_to(&self.mean) - self.mean;
            off.dot(&(self.information * off)) < REACH_SIGMAS * REACH_SIGMAS
        })
    }
}
