//! Spherical errors: distance, elevation and azimuth from a reference point.

use std::f64::consts::TAU;

use nalgebra::Vector3;

use super::{EstimatedState, TrueState, difference, norm};

/// Error of an estimate (estimate minus truth) in spherical coordinates around a point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SphericalError {
    /// True distance from the point, in metres.
    pub true_distance_m: f64,
    /// Error of the distance, in metres.
    pub distance_m: f64,
    /// Error of the elevation above the horizontal, in radians.
    pub elevation_rad: f64,
    /// Error of the azimuth about the world's z axis, in radians, wrapped to ±π.
    pub azimuth_rad: f64,
}

/// Computes the error of an estimate as seen from a point of the world, in metres.
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

/// Converts a vector in metres to distance (metres), elevation and azimuth (radians).
fn spherical_from_point([x, y, z]: [f64; 3]) -> [f64; 3] {
    let elevation_rad = libm::atan2(z, libm::hypot(x, y));
    [norm([x, y, z]), elevation_rad, libm::atan2(y, x)]
}

/// Returns the angle between two vectors in radians, accurate for small angles; 0 for a zero vector.
pub(super) fn angle_between(a: [f64; 3], b: [f64; 3]) -> f64 {
    let (a, b) = (Vector3::from(a), Vector3::from(b));
    libm::atan2(a.cross(&b).norm(), a.dot(&b))
}

/// Wraps an angle to ±π.
pub fn wrapped_rad(angle_rad: f64) -> f64 {
    libm::remainder(angle_rad, TAU)
}
