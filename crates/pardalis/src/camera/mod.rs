//! Camera models: from points in the camera's frame (x right, y down, z along the optical axis, metres) to pixels and back.
//!
//! Pixel centres lie at integer coordinates, (0, 0) is the centre of the top left pixel.

mod equidistant;
mod mask;
mod perspective_mirror;
mod pinhole;
mod unified;

pub use equidistant::Equidistant;
pub use mask::Mask;
pub use perspective_mirror::PerspectiveMirror;
pub use pinhole::Pinhole;
pub use unified::Unified;

use crate::Error;
use crate::real::Real;

/// A camera model with one viewpoint.
///
/// Law, tested over every model's whole field of view: where `project` says valid, `unproject` of the pixel gives the point's direction.
pub trait Projection<R: Real>: Copy + Send + Sync {
    /// The pixel of a point, and whether the point lies in the model's domain. Without branches; outside the domain the
    /// pixel means nothing.
    fn project(&self, point_in_camera: [R; 3]) -> ([R; 2], bool);

    /// The unit direction of a pixel's ray from the camera's origin, or `None` where the model has no ray.
    fn unproject(&self, pixel: [R; 2]) -> Option<[R; 3]>;
}

/// Any camera model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Camera {
    /// Equidistant fisheye.
    Equidistant(Equidistant<f64>),
    /// Pinhole with Brown-Conrady distortion.
    Pinhole(Pinhole<f64>),
    /// Unified model of mirror cameras.
    Unified(Unified<f64>),
    /// Perspective model of mirror cameras.
    PerspectiveMirror(PerspectiveMirror<f64>),
}

/// Calls `$body` with `$model` bound to the camera's model: the one place where cameras are told apart.
macro_rules! with_model {
    ($camera:expr, $model:ident => $body:expr) => {
        match $camera {
            $crate::camera::Camera::Equidistant($model) => $body,
            $crate::camera::Camera::Pinhole($model) => $body,
            $crate::camera::Camera::Unified($model) => $body,
            $crate::camera::Camera::PerspectiveMirror($model) => $body,
        }
    };
}
pub(crate) use with_model;

impl Camera {
    /// The pixel of one point, or `None` outside the model's domain. Kernels match the model once a batch instead.
    pub fn project(&self, point_in_camera: [f64; 3]) -> Option<[f64; 2]> {
        let (pixel, valid) = with_model!(self, model => model.project(point_in_camera));
        valid.then_some(pixel)
    }

    /// The unit direction of a pixel's ray, or `None` where the model has none.
    pub fn unproject(&self, pixel: [f64; 2]) -> Option<[f64; 3]> {
        with_model!(self, model => model.unproject(pixel))
    }
}

fn check_focal(name: &str, value: f64) -> Result<(), Error> {
    if value.is_finite() && value > 0.0 && value <= 1e6 {
        return Ok(());
    }
    Err(Error::out_of_range(
        name,
        value,
        "a positive number up to 1e6",
    ))
}

fn check_principal_point([cx, cy]: [f64; 2]) -> Result<(), Error> {
    for (name, value) in [("cx_px", cx), ("cy_px", cy)] {
        if !(value.abs() <= 1e6) {
            return Err(Error::out_of_range(
                name,
                value,
                "a number between -1e6 and 1e6",
            ));
        }
    }
    Ok(())
}

fn check_angle(name: &str, value: f64) -> Result<(), Error> {
    if value > 0.0 && value <= std::f64::consts::PI {
        return Ok(());
    }
    Err(Error::out_of_range(
        name,
        value,
        "above 0 and at most pi (180 degrees)",
    ))
}

fn check_coefficients(name: &str, values: &[f64]) -> Result<(), Error> {
    match values.iter().find(|v| !(v.abs() <= 1e9)) {
        None => Ok(()),
        Some(value) => Err(Error::out_of_range(
            name,
            value,
            "numbers between -1e9 and 1e9",
        )),
    }
}
