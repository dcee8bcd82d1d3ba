//! Estimates.

use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;

use crate::arrays;

/// What the tracker says of a target at one instant.
///
/// `position_m` (3), `velocity_mps` (3) and their covariances `covariance_m2` and `velocity_covariance_m2ps2` (3 x 3) are in the world's frame, and
/// `None` unless the state is "tracking" or "occluded".
#[pyclass(frozen, module = "pardalis")]
#[derive(Debug, Clone)]
pub(crate) struct Estimate {
    pub(crate) known: pardalis::Estimate,
    /// Its time, seconds.
    pub(crate) time_s: f64,
    /// The number of a member of a crowd.
    pub(crate) number: Option<u32>,
}

#[pymethods]
impl Estimate {
    /// Its time, seconds.
    #[getter]
    fn time_s(&self) -> f64 {
        self.time_s
    }

    /// The number of a member of a crowd, from 1; `None` for other targets.
    #[getter]
    fn number(&self) -> Option<u32> {
        self.number
    }

    /// "searching", "tracking", "occluded" or "lost".
    #[getter]
    fn state(&self) -> &'static str {
        self.known.state.name()
    }

    /// The probability that the target is within one diameter of the position; without one, that it is in view.
    #[getter]
    fn confidence(&self) -> f64 {
        self.known.confidence
    }

    /// Its position, metres.
    #[getter]
    fn position_m<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<f64>>> {
        let known = self.known.kinematics?;
        Some(arrays::vector(py, known.position_m))
    }

    /// Its velocity, m/s.
    #[getter]
    fn velocity_mps<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<f64>>> {
        let velocity_mps = self.known.kinematics?.velocity_mps?;
        Some(arrays::vector(py, velocity_mps))
    }

    /// The covariance of the position, m².
    #[getter]
    fn covariance_m2<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray2<f64>>> {
        let known = self.known.kinematics?;
        Some(symmetric(py, known.covariance_m2))
    }

    /// The covariance of the velocity, m²/s².
    #[getter]
    fn velocity_covariance_m2ps2<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray2<f64>>> {
        let known = self.known.kinematics?;
        Some(symmetric(py, known.velocity_covariance_m2ps2?))
    }

    /// Where a body that turns faces, radians counter-clockwise from x.
    #[getter]
    fn heading_rad(&self) -> Option<f64> {
        self.known.heading_rad
    }

    /// The standard deviation of the heading, radians.
    #[getter]
    fn heading_sigma_rad(&self) -> Option<f64> {
        self.known.heading_sigma_rad
    }

    /// The radius of a ball, metres, if the cameras determine it.
    #[getter]
    fn radius_m(&self) -> Option<f64> {
        self.known.radius.map(|radius| radius.radius_m)
    }

    /// The standard deviation of the radius, metres.
    #[getter]
    fn radius_sigma_m(&self) -> Option<f64> {
        self.known.radius.map(|radius| radius.sigma_m)
    }

    fn __repr__(&self) -> String {
        let state = self.known.state.name();
        let confidence = self.known.confidence;
        let place = self.known.kinematics.map_or(String::new(), |known| {
            let [x, y, z] = known.position_m;
            format!(" at ({x:.4}, {y:.4}, {z:.4}) m")
        });
        let time_s = self.time_s;
        format!("<Estimate {time_s:.3} s: {state}{place}, confidence {confidence:.2}>")
    }
}

/// The matrix with the entries xx, xy, xz, yy, yz, zz.
fn symmetric(py: Python<'_>, [xx, xy, xz, yy, yz, zz]: [f64; 6]) -> Bound<'_, PyArray2<f64>> {
    arrays::array(py, vec![[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
}
