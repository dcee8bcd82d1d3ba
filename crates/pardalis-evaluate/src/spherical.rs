//! Errors as a camera sees them: distance, elevation and azimuth from a point.

use std::f64::consts::TAU;

use nalgebra::Vector3;

use super::{EstimatedState, TrueState, difference, norm};

/// The error of one estimate, estimate minus truth, as seen from a point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SphericalError {
    /// From the point to the truth, in metres.
    pub true_distance_m: f64,
    /// Of the distance, in metres.
    pub distance_m: f64,
    /// Of the elevation above the world's horizontal, in radians.
    pub elevation_rad: f64,
    /// Of the azimuth about the world's z, in radians, wrapped to ±π.
    pub azimuth_rad: f64,
}

/// The error of an estimate as seen from a point of the world, in metres.
pub fn spherical_error(
    estimate: &EstimatedState,
    truth: &TrueState,
    around_m: [f64; 3],
) -> SphericalError {
    let estimated = spherical_from_point(difference(estimate.position_m, around_m));
    let true_one = spherical_from_point(difference(truth.position_m, around_m));
    let [distance_m, elevation_rad, azimuth_rad] = difference(estimated, true_one);
    SphericalError {
        true_distance_m: true_one[0],
        distance_m,
        elevation_rad,
        azimuth_rad: wrapped_rad(azimuth_rad),
    }
}

/// Distance in metres, elevation and azimuth in radians of a vector in metres.
fn spherical_from_point([x, y, z]: [f64; 3]) -> [f64; 3] {
    let elevation_rad = libm::atan2(z, libm::hypot(x, y));
    [norm([x, y, z]), elevation_rad, libm::atan2(y, x)]
}

/// Between two vectors, in radians, accurate for small angles too; 0 where one has no direction.
pub(super) fn angle_between(a: [f64; 3], b: [f64; 3]) -> f64 {
    let (a, b) = (Vector3::from(a), Vector3::from(b));
    libm::atan2(a.cross(&b).norm(), a.dot(&b))
}

/// The same direction between -π and π.
pub fn wrapped_rad(angle_rad: f64) -> f64 {
    libm::remainder(angle_rad, TAU)
}
