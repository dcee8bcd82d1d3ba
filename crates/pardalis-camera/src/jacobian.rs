//! Derivatives of projections, by evaluating the generic models with dual numbers.

use super::{Camera, Projection};
use crate::with_model;
use pardalis_core::real::Dual;

/// Capacity for the parameters of any model and the three coordinates of a point.
const PARTS: usize = 20;

/// A pixel and its derivatives.
#[derive(Debug, Clone, PartialEq)]
pub struct ProjectionJacobian {
    /// The pixel.
    pub pixel: [f64; 2],
    /// ∂u and ∂v with respect to the point's x, y, z in the camera frame, in pixels per metre.
    pub by_point: [[f64; 3]; 2],
    /// ∂(u, v) with respect to each parameter, in the order of [`Camera::parameters`].
    pub by_parameters: Vec<[f64; 2]>,
}

impl Camera {
    /// Returns the pixel of a point and its derivatives, or `None` outside the model's domain.
    pub fn project_with_jacobian(&self, point_in_camera: [f64; 3]) -> Option<ProjectionJacobian> {
        let (count, [u, v], valid) = with_model!(self, model => {
            let values = model.parameters();
            let count = values.len();
            let mut parameters = values.map(Dual::<PARTS>::constant);
            for (i, parameter) in parameters.iter_mut().enumerate() {
                parameter.derivatives[i] = 1.0;
            }
            let point = std::array::from_fn(|i| Dual::variable(point_in_camera[i], count + i));
            let (pixel, valid) = model.vary(parameters).project(point);
            (count, pixel, valid)
        });
        valid.then(|| ProjectionJacobian {
            pixel: [u.value, v.value],
            by_point: [u, v].map(|w| std::array::from_fn(|i| w.derivatives[count + i])),
            by_parameters: (0..count)
                .map(|i| [u.derivatives[i], v.derivatives[i]])
                .collect(),
        })
    }
}
