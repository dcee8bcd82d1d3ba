//! Likelihoods that are wider along a line than the frames say.

use nalgebra::Vector3;

use super::LANES;

/// Makes a detection's likelihood wider along a line through it: places count as nearer to it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Widening {
    /// The position of the detection, metres.
    pub(crate) center_m: Vector3<f64>,
    /// The unit vector of the line.
    pub(crate) along: Vector3<f64>,
    /// How near to the centre a place on the line counts, relative to where it is.
    pub(crate) nearness: f64,
}

impl Widening {
    /// Where a block of places (world frame, metres) counts.
    pub(super) fn moved(&self, positions: &[[f32; LANES]; 3]) -> [[f32; LANES]; 3] {
        let [center, along] = [self.center_m, self.along].map(|v| v.map(|v| v as f32));
        let less = (1.0 - self.nearness) as f32;
        let mut moved = *positions;
        for lane in 0..LANES {
            let place = Vector3::from_fn(|axis, _| positions[axis][lane]);
            let place = place - less * along.dot(&(place - center)) * along;
            for (column, component) in moved.iter_mut().zip(place.iter()) {
                column[lane] = *component;
            }
        }
        moved
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Matrix3;

    /// The line is a principal axis of the likelihood.
    #[test]
    fn places_count_as_in_a_gaussian_that_is_wider_along_the_line() {
        let along = Vector3::new(0.6, 0.0, 0.8_f64);
        let of_line = along * along.transpose();
        let own: Matrix3<f64> = 1e-6 * (Matrix3::identity() - of_line) + 4e-6 * of_line;
        let wide = own + 0.008_f64.powi(2) * of_line;
        let widening = Widening {
            center_m: Vector3::new(0.5, 0.1, 0.9),
            along,
            nearness: (4e-6 / (4e-6 + 0.008_f64.powi(2))).sqrt(),
        };
        let squared = |place_m: Vector3<f64>, covariance: Matrix3<f64>| {
            let off_m = place_m - widening.center_m;
            off_m.dot(&(covariance.try_inverse().unwrap() * off_m))
        };
        let across = Vector3::new(0.8, 0.0, -0.6_f64);
        for (far_m, beside_m) in [(0.01, 0.0), (-0.02, 0.001), (0.003, -0.002), (0.0, 0.004)] {
            let place_m = widening.center_m + far_m * along + beside_m * across;
            let columns = [0, 1, 2].map(|axis| [place_m[axis] as f32; LANES]);
            let moved = widening.moved(&columns);
            let moved_m = Vector3::from_fn(|axis, _| f64::from(moved[axis][LANES - 1]));
            let (found, expected) = (squared(moved_m, own), squared(place_m, wide));
            assert!(
                (found - expected).abs() < 1e-3 * expected + 1e-3,
                "{far_m} {beside_m}: {found} for {expected}"
            );
        }
    }
}
