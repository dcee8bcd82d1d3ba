//! Times of exposure: a camera shows a body in motion where it is when its row is exposed. Frames of one instant may differ by some milliseconds, and of rolling shutters also the rows.

use nalgebra::{Matrix3, Vector3};
use pardalis_camera::Camera;

/// Half the step of numerical derivatives of the projection, relative to the distance. Derivation: its error is far below that of single precision.
const STEP: f64 = 1e-4;

/// If the body moves by more than this share of a row while one row is exposed, its image is too distorted for a linear model. Hand-set: balls that cross 500 rows in a tenth of
/// a second reach 0.15 with a delay of 30 µs.
const MAX_ROW_SHARE: f64 = 0.5;

/// Where a camera shows a body with a known velocity, in the camera frame at the time of the frame: an affine map, as rows are a linear function of the place near the body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct RowMotion {
    shown_from_true: Matrix3<f64>,
    true_from_shown: Matrix3<f64>,
    /// Metres.
    offset_m: Vector3<f64>,
}

impl RowMotion {
    /// The motion of a body from the instant at which it is at this position in the camera frame (metres) with this velocity (m/s) to the exposure of its rows: the middle one is exposed `later_s`
    /// seconds after the instant, and the camera has this number of rows and exposes each this long after the one above it, in seconds. `None` if all rows are exposed at the instant, the camera does not
    /// see the position, or shows the body too distorted.
    pub(crate) fn new(
        camera: &Camera,
        (rows, line_delay_s): (usize, f64),
        later_s: f64,
        middle: Vector3<f64>,
        velocity: Vector3<f64>,
    ) -> Option<Self> {
        if line_delay_s == 0.0 && later_s == 0.0 {
            return None;
        }
        let row = |place: Vector3<f64>| Some(camera.project(place.into())?[1]);
        let step_m = STEP * middle.norm();
        let mut rows_per_m = Vector3::zeros();
        for axis in 0..3 {
            let mut step = Vector3::zeros();
            step[axis] = step_m;
            rows_per_m[axis] = (row(middle + step)? - row(middle - step)?) / (2.0 * step_m);
        }
        // A place p is shown at p + v δ, in the row that is exposed δ later: δ = τ + d (row(p) + g v δ - middle row) with the time τ of the middle row, the delay d and the gradient g of rows.
        let row_share = line_delay_s * rows_per_m.dot(&velocity);
        if !(row_share.abs() <= MAX_ROW_SHARE) {
            return None;
        }
        let last_row = rows as f64 - 1.0;
        let below_middle = row(middle)?.clamp(0.0, last_row) - 0.5 * last_row;
        let way = velocity * (line_delay_s / (1.0 - row_share));
        let earlier = velocity * (later_s / (1.0 - row_share));
        let shown_from_true = Matrix3::identity() + way * rows_per_m.transpose();
        Some(Self {
            shown_from_true,
            true_from_shown: shown_from_true.try_inverse()?,
            offset_m: way * (below_middle - rows_per_m.dot(&middle)) + earlier,
        })
    }

    /// Maps a place in the camera frame at the time of the frame (metres) to where it is shown.
    pub(crate) fn shown_m(&self, place_m: Vector3<f64>) -> Vector3<f64> {
        self.shown_from_true * place_m + self.offset_m
    }

    /// The inverse of [`RowMotion::shown_m`].
    pub(crate) fn true_m(&self, shown_m: Vector3<f64>) -> Vector3<f64> {
        self.true_from_shown * (shown_m - self.offset_m)
    }

    /// The matrix and the offset (metres) of [`RowMotion::shown_m`].
    pub(crate) fn shown_from_true(&self) -> (&Matrix3<f64>, &Vector3<f64>) {
        (&self.shown_from_true, &self.offset_m)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pardalis_camera::Pinhole;

    const ROWS: usize = 480;

    fn camera() -> Camera {
        Pinhole::new([500.0, 500.0], [319.5, 239.5], &[])
            .unwrap()
            .into()
    }

    fn motion(
        (line_delay_s, later_s): (f64, f64),
        middle_m: [f64; 3],
        velocity_mps: [f64; 3],
    ) -> Option<RowMotion> {
        RowMotion::new(
            &camera(),
            (ROWS, line_delay_s),
            later_s,
            middle_m.into(),
            velocity_mps.into(),
        )
    }

    /// Where a place of a body in motion is shown, by iteration: it has moved until its row is exposed.
    fn iterated(
        (line_delay_s, later_s): (f64, f64),
        place: Vector3<f64>,
        velocity: Vector3<f64>,
    ) -> Vector3<f64> {
        let mut shown = place;
        for _ in 0..50 {
            let [_, row] = camera().project(shown.into()).unwrap();
            shown = place + velocity * (later_s + line_delay_s * (row - 239.5));
        }
        shown
    }

    #[test]
    fn places_on_a_moving_ball_are_shown_where_iteration_finds_them() {
        let (middle_m, radius_m) = ([0.7, 0.9, 3.0], 0.1);
        for times_s in [(50e-6, 0.0), (-30e-6, 0.0), (0.0, -0.004), (50e-6, 0.003)] {
            for velocity_mps in [[6.0, 0.0, 0.0], [0.5, 5.0, -2.0], [0.0, -5.0, 1.0]] {
                let motion = motion(times_s, middle_m, velocity_mps).unwrap();
                for offset in [
                    [0.0; 3],
                    [0.0, radius_m, 0.0],
                    [0.0, -radius_m, 0.0],
                    [radius_m, 0.0, -radius_m],
                ] {
                    let place = Vector3::from(middle_m) + Vector3::from(offset);
                    let expected = iterated(times_s, place, velocity_mps.into());
                    let shown = motion.shown_m(place);
                    let way_m = (expected - place).norm();
                    // What is not linear is the depth within a radius.
                    assert!(
                        (shown - expected).norm() < 0.01 * way_m,
                        "{shown} {expected}"
                    );
                    assert!(way_m > 0.005 && (motion.true_m(shown) - place).norm() < 1e-12);
                }
            }
        }
    }

    #[test]
    fn bodies_at_rest_and_global_shutters_show_bodies_where_they_are() {
        let place = [0.7, 0.9, 3.0];
        assert!(motion((0.0, 0.0), place, [5.0; 3]).is_none());
        let at_rest = motion((50e-6, 0.002), place, [0.0; 3]).unwrap();
        let place_m = Vector3::from(place);
        assert_eq!(at_rest.shown_m(place_m), place_m);
        // Behind the camera, and faster than rows are exposed.
        assert!(motion((50e-6, 0.0), [0.0, 0.0, -3.0], [5.0; 3]).is_none());
        assert!(motion((50e-6, 0.0), place, [0.0, 100.0, 0.0]).is_none());
    }
}
