//! Measurements of other sensors than cameras: a position, a velocity, a range or a bearing, each with its uncertainty and a time of its own.

use nalgebra::{Matrix3, RowVector3, Vector3};

use crate::estimate::covariance_matrix;
use crate::gaussian::MAX_START;
use pardalis_core::Error;

/// The least standard deviation in metres or metres per second, or radians. Hand-set: no sensor is as good, and computations stay within double precision.
const MIN_SIGMA: f64 = 1e-6;

/// Times lie within this, seconds. Derivation: microseconds remain exact.
const MAX_TIME_S: f64 = 1e12;

/// The least distance at which the direction to a target depends on its position, metres.
const MIN_DISTANCE_M: f64 = 1e-6;

/// What another sensor measures of a target, in the world frame, at a time of its own.
///
/// Errors of measurements are independent of one another and of the images. A sensor whose error stays the same for a while, such as a map that is off, needs a standard
/// deviation that says so.
///
/// ```
/// use pardalis_filter::Measurement;
///
/// // A laser finds the target at 3.2 m from its place in the world, give or take 2 cm.
/// let range = Measurement::range(0.52, [0.0, 0.0, 1.0], 3.2, 0.02)?;
/// // Another robot knows x and y, but not z, to 10 cm.
/// let variance_m2 = 0.1 * 0.1;
/// let covariance_m2 = [variance_m2, 0.0, 0.0, variance_m2, 0.0, 0.0];
/// let place = Measurement::position(0.55, [Some(1.0), Some(2.0), None], covariance_m2)?;
/// assert_eq!((range.time_s(), place.time_s()), (0.52, 0.55));
/// // A standard deviation of 0 would silence the cameras.
/// assert!(Measurement::range(0.52, [0.0, 0.0, 1.0], 3.2, 0.0).is_err());
/// # Ok::<(), pardalis_filter::Error>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measurement {
    time_s: f64,
    quantity: Quantity,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Quantity {
    Position(Coordinates),
    Velocity(Coordinates),
    Range {
        from_m: Vector3<f64>,
        range_m: f64,
        variance_m2: f64,
    },
    Bearing {
        from_m: Vector3<f64>,
        direction: Vector3<f64>,
        /// Two unit vectors at right angles to the direction and to each other, as rows; the third row is 0.
        across: Matrix3<f64>,
        variance_rad2: f64,
    },
}

/// Some of the coordinates of a vector. Those that are not measured have the variance 1 and no covariance, so that they change nothing.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Coordinates {
    values: Vector3<f64>,
    /// 1 on the diagonal for those that are measured.
    measured: Matrix3<f64>,
    covariance: Matrix3<f64>,
}

/// How far a measurement is from what is expected of a state, and how that depends on the state. Rows that measure nothing are 0.
pub(crate) struct Innovation {
    /// Measured less expected.
    pub(crate) off: Vector3<f64>,
    /// The derivatives of what is expected by the position, per metre, ...
    pub(crate) by_position: Matrix3<f64>,
    /// ... and by the velocity, per m/s.
    pub(crate) by_velocity: Matrix3<f64>,
}

impl Measurement {
    /// A position in the world, metres, or some of its coordinates, with their covariance (xx, xy, xz, yy, yz, zz in m²); entries of coordinates that are not
    /// measured are ignored. `time_s` is in seconds, on the clock of the frames.
    ///
    /// Returns an error if no coordinate is measured, the time or a coordinate is not finite or too large, or the covariance is not positive definite.
    pub fn position(
        time_s: f64,
        position_m: [Option<f64>; 3],
        covariance_m2: [f64; 6],
    ) -> Result<Self, Error> {
        let coordinates = Coordinates::new(position_m, covariance_m2, ["position_m", "m²"])?;
        Self::new(time_s, Quantity::Position(coordinates))
    }

    /// A velocity in the world, m/s, or some of its coordinates, with their covariance in m²/s², as for [`Measurement::position`].
    ///
    /// Returns an error in the same cases.
    pub fn velocity(
        time_s: f64,
        velocity_mps: [Option<f64>; 3],
        covariance_m2ps2: [f64; 6],
    ) -> Result<Self, Error> {
        let names = ["velocity_mps", "m²/s²"];
        let coordinates = Coordinates::new(velocity_mps, covariance_m2ps2, names)?;
        Self::new(time_s, Quantity::Velocity(coordinates))
    }

    /// The distance of the target from a point in the world, with its standard deviation, all in metres.
    ///
    /// Returns an error unless the range is from 0 to 1e6, the standard deviation from 1e-6 to 1e6 and the point finite.
    pub fn range(time_s: f64, from_m: [f64; 3], range_m: f64, sigma_m: f64) -> Result<Self, Error> {
        if !(0.0..=MAX_START).contains(&range_m) {
            return Err(Error::out_of_range("range_m", range_m, "0 to 1e6"));
        }
        let quantity = Quantity::Range {
            from_m: checked("from_m", from_m)?,
            range_m,
            variance_m2: variance("range_sigma_m", sigma_m)?,
        };
        Self::new(time_s, quantity)
    }

    /// The direction from a point in the world (metres) to the target: a vector of any length, with the standard deviation in radians of the angle on each of the two
    /// axes across it.
    ///
    /// Returns an error unless the direction is finite and not 0, the standard deviation from 1e-6 to 1e6 and the point finite.
    pub fn bearing(
        time_s: f64,
        from_m: [f64; 3],
        direction: [f64; 3],
        sigma_rad: f64,
    ) -> Result<Self, Error> {
        let vector = checked("direction", direction)?;
        let length = vector.norm();
        if !(length > MIN_SIGMA) {
            let value = format!("{direction:?}");
            let allowed = "a vector with a length above 1e-6";
            return Err(Error::out_of_range("direction", value, allowed));
        }
        let direction = vector / length;
        // At right angles to the axis along which the direction is least.
        let axis = Vector3::from_fn(|i, _| f64::from(i == direction.iamin()));
        let first = direction.cross(&axis).normalize();
        let second = direction.cross(&first);
        let rows = [first.transpose(), second.transpose(), RowVector3::zeros()];
        let quantity = Quantity::Bearing {
            from_m: checked("from_m", from_m)?,
            direction,
            across: Matrix3::from_rows(&rows),
            variance_rad2: variance("direction_sigma_rad", sigma_rad)?,
        };
        Self::new(time_s, quantity)
    }

    fn new(time_s: f64, quantity: Quantity) -> Result<Self, Error> {
        if !(time_s.abs() <= MAX_TIME_S) {
            let allowed = "a number of seconds within ±1e12";
            return Err(Error::out_of_range("time_s", time_s, allowed));
        }
        Ok(Self { time_s, quantity })
    }

    /// Returns its time in seconds.
    pub fn time_s(&self) -> f64 {
        self.time_s
    }

    /// Returns whether it concerns the velocity, which not all motion models have.
    pub fn is_of_velocity(&self) -> bool {
        matches!(self.quantity, Quantity::Velocity(_))
    }

    /// Returns the position (metres) and its covariance (xx, xy, xz, yy, yz, zz in m²), if it is one with all coordinates along the first of these axes.
    pub fn full_position(&self, axes: usize) -> Option<([f64; 3], [f64; 6])> {
        let Quantity::Position(known) = &self.quantity else {
            return None;
        };
        let is_full = (0..axes).all(|axis| known.measured[(axis, axis)] > 0.0);
        let covariance_m2 = known.measured * known.covariance * known.measured;
        let at = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)];
        is_full.then(|| (known.values.into(), at.map(|at| covariance_m2[at])))
    }

    /// Returns it without what it says of the third axis, for a target that moves in a plane whose height is known.
    pub(crate) fn in_plane(mut self) -> Self {
        if let Quantity::Position(known) | Quantity::Velocity(known) = &mut self.quantity {
            known.measured[(2, 2)] = 0.0;
            for axis in 0..3 {
                known.covariance[(axis, 2)] = f64::from(axis == 2);
                known.covariance[(2, axis)] = f64::from(axis == 2);
            }
        }
        self
    }

    /// The number of independent numbers in it, 0 to 3.
    pub(crate) fn dimensions(&self) -> usize {
        match &self.quantity {
            Quantity::Position(known) | Quantity::Velocity(known) => {
                let measured = (0..3).filter(|axis| known.measured[(*axis, *axis)] > 0.0);
                measured.count()
            }
            Quantity::Range { .. } => 1,
            Quantity::Bearing { .. } => 2,
        }
    }

    /// The covariance of its errors; 1 on the diagonal of rows that measure nothing.
    pub(crate) fn noise(&self) -> Matrix3<f64> {
        match &self.quantity {
            Quantity::Position(known) | Quantity::Velocity(known) => known.covariance,
            Quantity::Range { variance_m2, .. } => {
                Matrix3::from_diagonal(&Vector3::new(*variance_m2, 1.0, 1.0))
            }
            Quantity::Bearing { variance_rad2, .. } => {
                Matrix3::from_diagonal(&Vector3::new(*variance_rad2, *variance_rad2, 1.0))
            }
        }
    }

    /// How far what is expected is off from linear over positions with this variance on each axis around one, in metres and m²: the mean and the covariance of the terms of second order.
    pub(crate) fn bend(
        &self,
        position_m: &Vector3<f64>,
        variance_m2: f64,
    ) -> (Vector3<f64>, Matrix3<f64>) {
        let distance_m = |from_m: &Vector3<f64>| (position_m - from_m).norm().max(MIN_DISTANCE_M);
        let (mut mean, mut covariance) = (Vector3::zeros(), Matrix3::zeros());
        match &self.quantity {
            Quantity::Position(_) | Quantity::Velocity(_) => {}
            Quantity::Range { from_m, .. } => {
                let bend_m = variance_m2 / distance_m(from_m);
                mean.x = bend_m;
                covariance[(0, 0)] = bend_m * bend_m;
            }
            Quantity::Bearing { from_m, .. } => {
                let bend_rad = variance_m2 / distance_m(from_m).powi(2);
                covariance[(0, 0)] = bend_rad * bend_rad;
                covariance[(1, 1)] = bend_rad * bend_rad;
            }
        }
        (mean, covariance)
    }

    /// Compares it with a position (metres) and a velocity (m/s).
    pub(crate) fn innovation(
        &self,
        position_m: &Vector3<f64>,
        velocity_mps: &Vector3<f64>,
    ) -> Innovation {
        let none = Matrix3::zeros();
        match &self.quantity {
            Quantity::Position(known) => Innovation {
                off: known.measured * (known.values - position_m),
                by_position: known.measured,
                by_velocity: none,
            },
            Quantity::Velocity(known) => Innovation {
                off: known.measured * (known.values - velocity_mps),
                by_position: none,
                by_velocity: known.measured,
            },
            Quantity::Range {
                from_m, range_m, ..
            } => {
                let way_m = position_m - from_m;
                let distance_m = way_m.norm();
                let mut by_position = none;
                by_position.set_row(0, &(way_m / distance_m.max(MIN_DISTANCE_M)).transpose());
                Innovation {
                    off: Vector3::new(range_m - distance_m, 0.0, 0.0),
                    by_position,
                    by_velocity: none,
                }
            }
            Quantity::Bearing {
                from_m,
                direction,
                across,
                ..
            } => {
                let way_m = position_m - from_m;
                let distance_m = way_m.norm().max(MIN_DISTANCE_M);
                let way = way_m / distance_m;
                // The angle to the measured direction, and on which side of it.
                let side = across * way;
                let (sin, cos) = (side.norm(), way.dot(direction));
                let angle_rad = libm::atan2(sin, cos);
                let stretch = if sin > MIN_SIGMA {
                    angle_rad / sin
                } else {
                    1.0
                };
                let off = if cos < 0.0 && sin <= MIN_SIGMA {
                    Vector3::new(angle_rad, 0.0, 0.0)
                } else {
                    -stretch * side
                };
                let turned = (Matrix3::identity() - way * way.transpose()) / distance_m;
                Innovation {
                    off,
                    by_position: stretch * across * turned,
                    by_velocity: none,
                }
            }
        }
    }
}

impl Coordinates {
    fn new(
        values: [Option<f64>; 3],
        entries: [f64; 6],
        [name, unit]: [&str; 2],
    ) -> Result<Self, Error> {
        if values == [None; 3] {
            return Err(Error::Empty {
                what: name.to_owned(),
                remedy: "give at least one of x, y and z".to_owned(),
            });
        }
        let numbers = checked(name, values.map(Option::unwrap_or_default))?;
        let measured = Vector3::from(values.map(|value| f64::from(value.is_some())));
        let measured = Matrix3::from_diagonal(&measured);
        let given = covariance_matrix(entries);
        // What is not measured may be anything, NaN included.
        let covariance = Matrix3::from_fn(|row, column| {
            if values[row].is_some() && values[column].is_some() {
                given[(row, column)]
            } else {
                f64::from(row == column)
            }
        });
        let range = MIN_SIGMA * MIN_SIGMA..=MAX_START * MAX_START;
        let diagonal = covariance.diagonal();
        let is_in_range = diagonal.iter().all(|variance| range.contains(variance))
            && covariance.iter().all(|v| v.abs() <= *range.end());
        // Relative to the variances, so that the units of the axes do not matter.
        let scale =
            Matrix3::from_diagonal(&diagonal.map(|v| 1.0 / v.max(f64::MIN_POSITIVE).sqrt()));
        let correlation = scale * covariance * scale;
        if !is_in_range || !(correlation.symmetric_eigenvalues().min() > 1e-9) {
            let value = format!("{entries:?}");
            let allowed = format!(
                "[xx, xy, xz, yy, yz, zz] of a positive definite matrix with variances of 1e-12 to 1e12 {unit}"
            );
            return Err(Error::out_of_range("the covariance", value, &allowed));
        }
        Ok(Self {
            values: numbers,
            measured,
            covariance,
        })
    }
}

/// Returns a vector with finite coordinates up to 1e6.
fn checked(name: &str, values: [f64; 3]) -> Result<Vector3<f64>, Error> {
    if values.iter().all(|value| value.abs() <= MAX_START) {
        return Ok(values.into());
    }
    let value = format!("{values:?}");
    let allowed = "numbers between -1e6 and 1e6";
    Err(Error::out_of_range(name, value, allowed))
}

fn variance(name: &str, sigma: f64) -> Result<f64, Error> {
    if (MIN_SIGMA..=MAX_START).contains(&sigma) {
        return Ok(sigma * sigma);
    }
    Err(Error::out_of_range(name, sigma, "1e-6 to 1e6"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn all() -> Vec<Measurement> {
        let covariance = [0.04, 0.01, 0.0, 0.09, -0.02, 0.25];
        vec![
            Measurement::position(0.0, [Some(1.0), Some(-2.0), Some(0.5)], covariance).unwrap(),
            Measurement::position(0.0, [None, Some(-2.0), None], covariance).unwrap(),
            Measurement::velocity(0.0, [Some(0.3), None, Some(-4.0)], covariance).unwrap(),
            Measurement::range(0.0, [0.5, 0.5, 1.0], 2.5, 0.1).unwrap(),
            Measurement::bearing(0.0, [0.5, 0.5, 1.0], [0.5, -3.0, -0.4], 0.02).unwrap(),
            Measurement::bearing(0.0, [0.5, 0.5, 1.0], [-2.0, 1.0, 0.1], 0.02).unwrap(),
        ]
    }

    #[test]
    fn derivatives_are_those_of_small_steps() {
        let (position_m, velocity_mps) =
            (Vector3::new(1.2, -1.9, 0.7), Vector3::new(0.1, 2.0, 1.0));
        for measurement in all() {
            let here = measurement.innovation(&position_m, &velocity_mps);
            for axis in 0..3 {
                let step = Vector3::from_fn(|i, _| if i == axis { 1e-6 } else { 0.0 });
                let there = measurement
                    .innovation(&(position_m + step), &velocity_mps)
                    .off;
                let faster = measurement
                    .innovation(&position_m, &(velocity_mps + step))
                    .off;
                let found = [(here.off - there) * 1e6, (here.off - faster) * 1e6];
                let expected =
                    [here.by_position, here.by_velocity].map(|by| by.column(axis).into_owned());
                // Far from the measured direction, angles are not linear.
                let is_near = here.off.norm() < 1.0 || measurement.dimensions() != 2;
                for (found, expected) in found.iter().zip(&expected) {
                    assert!(
                        !is_near || (found - expected).norm() < 1e-2 * (1.0 + expected.norm()),
                        "{measurement:?} {found} {expected}"
                    );
                }
            }
        }
    }

    #[test]
    fn the_angle_of_a_bearing_is_whole_even_behind() {
        let bearing = Measurement::bearing(0.0, [0.0; 3], [2.0, 0.0, 0.0], 0.1).unwrap();
        let off = |x: f64, y: f64| {
            bearing
                .innovation(&Vector3::new(x, y, 0.0), &Vector3::zeros())
                .off
                .norm()
        };
        let quarter = std::f64::consts::FRAC_PI_2;
        for (x, y, expected) in [
            (3.0, 0.0, 0.0),
            (1.0, 1.0, 0.5 * quarter),
            (0.0, 2.0, quarter),
            (-5.0, 0.0, 2.0 * quarter),
            (-1.0, 1.0, 1.5 * quarter),
        ] {
            assert!(
                (off(x, y) - expected).abs() < 1e-12,
                "{x} {y}: {}",
                off(x, y)
            );
        }
    }

    #[test]
    fn bad_measurements_are_refused() {
        let good = [0.01, 0.0, 0.0, 0.01, 0.0, 0.01];
        let at = [Some(0.0); 3];
        for (error, wanted) in [
            (Measurement::position(f64::NAN, at, good), "time_s is NaN"),
            (
                Measurement::position(0.0, [None; 3], good),
                "position_m is empty",
            ),
            (
                Measurement::position(0.0, [Some(f64::INFINITY), None, None], good),
                "position_m is [inf",
            ),
            (
                Measurement::position(0.0, at, [0.01, 0.01, 0.0, 0.01, 0.0, 0.01]),
                "the covariance is [0.01, 0.01",
            ),
            (
                Measurement::position(0.0, at, [0.0; 6]),
                "the covariance is [0.0",
            ),
            (
                Measurement::velocity(0.0, at, [f64::NAN; 6]),
                "the covariance is [NaN",
            ),
            (
                Measurement::velocity(0.0, [None; 3], good),
                "velocity_mps is empty",
            ),
            (
                Measurement::range(0.0, [0.0; 3], -1.0, 0.1),
                "range_m is -1",
            ),
            (
                Measurement::range(0.0, [0.0; 3], 1.0, 0.0),
                "range_sigma_m is 0",
            ),
            (
                Measurement::bearing(0.0, [0.0; 3], [0.0; 3], 0.1),
                "direction is [0.0",
            ),
            (
                Measurement::bearing(0.0, [f64::NAN; 3], [1.0; 3], 0.1),
                "from_m is [NaN",
            ),
            (
                Measurement::bearing(0.0, [0.0; 3], [1.0; 3], f64::NAN),
                "direction_sigma_rad is NaN",
            ),
        ] {
            let error = error.unwrap_err().to_string();
            assert!(error.starts_with(wanted), "{error}");
        }
        // Entries of what is not measured do not matter.
        let unknown = [0.01, f64::NAN, f64::NAN, f64::NAN, f64::NAN, f64::NAN];
        assert!(Measurement::position(0.0, [Some(1.0), None, None], unknown).is_ok());
    }
}
