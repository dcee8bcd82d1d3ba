//! Free flight: what gravity, air and spin make of a thrown body, and when and where it will cross a plane.
//!
//! While a body flies, its acceleration is
//!
//! ```text
//! a(v) = g − k |v| v + w × v
//! ```
//!
//! with gravity g, the drag coefficient k = ½ ρ C_D A / m in 1/m, and the spin's w in 1/s, which is along its axis (Magnus force). Position and velocity, k and w are fitted
//! to the positions measured since the last contact: nonlinear least squares (Gauss and Newton), with priors of k and w. A straight line is fitted, too: a body that rests, rolls or is
//! carried does not fly.

use std::collections::VecDeque;

use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

use crate::estimate::covariance_matrix;
use crate::modes::GRAVITY_MPS2;
use pardalis_core::Error;

/// Priors of the drag and the spin of bodies in flight.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FlightSettings {
    /// Gravity in m/s², with z upwards by default.
    pub gravity_mps2: [f64; 3],
    /// The likeliest drag coefficient, 1/m, ...
    pub drag_per_m: f64,
    /// ... and its standard deviation.
    pub drag_sigma_per_m: f64,
    /// The standard deviation of each component of w, 1/s.
    pub spin_sigma_hz: f64,
}

impl Default for FlightSettings {
    /// Between a table tennis ball, 0.13/m, and a solid one of rubber; spins of up to 40 turns a second of the former.
    fn default() -> Self {
        Self {
            gravity_mps2: [0.0, 0.0, -GRAVITY_MPS2],
            drag_per_m: 0.06,
            drag_sigma_per_m: 0.06,
            spin_sigma_hz: 0.3,
        }
    }
}

/// A plane in the world.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plane {
    point_m: Vector3<f64>,
    normal: Vector3<f64>,
}

impl Plane {
    /// Creates the plane through a point in metres that is perpendicular to a direction of any length.
    ///
    /// # Errors
    ///
    /// A number is not finite or above 10⁶, or the direction is shorter than 10⁻⁶.
    pub fn new(point_m: [f64; 3], normal: [f64; 3]) -> Result<Self, Error> {
        let is_valid = |v: &f64| v.abs() <= 1e6;
        if !point_m.iter().all(is_valid) {
            let value = format!("{point_m:?}");
            return Err(Error::out_of_range(
                "point_m",
                value,
                "numbers within ±1000000",
            ));
        }
        let direction = Vector3::from(normal);
        let normalised = direction.try_normalize(1e-6);
        let normalised = normalised.filter(|_| normal.iter().all(is_valid));
        let Some(normal) = normalised else {
            let value = format!("{normal:?}");
            return Err(Error::out_of_range(
                "normal",
                value,
                "a direction other than zero",
            ));
        };
        Ok(Self {
            point_m: point_m.into(),
            normal,
        })
    }

    /// Creates the level plane at a height in metres.
    ///
    /// # Errors
    ///
    /// The height is not finite or beyond ±10⁶ m.
    pub fn level(z_m: f64) -> Result<Self, Error> {
        Self::new([0.0, 0.0, z_m], [0.0, 0.0, 1.0])
    }

    fn height_m(&self, position_m: &Vector3<f64>) -> f64 {
        self.normal.dot(&(position_m - self.point_m))
    }
}

/// When and where a body is predicted to cross a plane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Crossing {
    /// When, in seconds.
    pub time_s: f64,
    /// The standard deviation of that, seconds.
    pub sigma_s: f64,
    /// Where, in metres: a point of the plane.
    pub position_m: [f64; 3],
    /// Its covariance (xx, xy, xz, yy, yz, zz) in m²: zero across the plane.
    pub covariance_m2: [f64; 6],
}

/// The most measurements that are fitted.
const MOST: usize = 60;

/// Measurements that are older than the latest by more than this are not fitted, seconds: flights are shorter, and integrating them takes time.
const LONGEST_S: f64 = 3.0;

/// Fewer measurements are not fitted. Hand-set.
const LEAST: usize = 6;

/// Flights are integrated in steps of at most this, seconds. Hand-set: a ball at 30 m/s then moves within micrometres of the exact path.
const STEP_S: f64 = 0.01;

/// Crossings farther ahead are not predicted, seconds.
const MOST_AHEAD_S: f64 = 3.0;

/// A measurement this many standard deviations from the flight does not belong to it, ...
const OUTLIER_SIGMAS: f64 = 5.0;

/// ... and this many in succession follow a contact.
const CONTACT_OUTLIERS: usize = 2;

/// A body flies if its flight explains the measurements better than a straight line by this, nats, ...
const FLIES_NATS: f64 = 8.0;

/// ... and if the squared deviations from it, in standard deviations, have at most this mean.
const MOST_SQUARES: f64 = 3.0;

/// Crossings are predicted if these are at most so much larger than those of a path that bends in any way, ...
const MOST_RATIO: f64 = 8.0;

/// ... where these count with at least this mean. Hand-set, as those before.
const LEAST_SQUARES: f64 = 0.05;

/// Iterations of a fit. Hand-set: the third moves it by micrometres.
const ITERATIONS: usize = 4;

/// The number of what is fitted: position, velocity, drag and spin.
const UNKNOWNS: usize = 10;

/// Position, velocity, drag coefficient and w.
type State = SVector<f64, UNKNOWNS>;
type Covariance = SMatrix<f64, UNKNOWNS, UNKNOWNS>;

/// Small changes over which states are differentiated.
const CHANGES: [f64; UNKNOWNS] = [1e-4, 1e-4, 1e-4, 1e-3, 1e-3, 1e-3, 1e-3, 1e-3, 1e-3, 1e-3];

/// A measured position.
#[derive(Debug, Clone, Copy)]
struct Point {
    time_s: f64,
    position_m: Vector3<f64>,
    information: Matrix3<f64>,
}

/// A state at a time, and how certain it is.
#[derive(Debug, Clone, Copy)]
struct Fit {
    time_s: f64,
    state: State,
    covariance: Covariance,
    /// Whether another path explains the measurements better, so that it may be carried.
    bends_otherwise: bool,
}

/// The latest flight of a body, if it flies.
#[derive(Debug, Clone)]
pub struct Flight {
    settings: FlightSettings,
    points: VecDeque<Point>,
    /// The number of the latest measurements that are outliers.
    outliers: usize,
    /// Errors that the measurements share.
    shared_m2: Matrix3<f64>,
    fit: Option<Fit>,
}

/// The acceleration of a body in flight.
fn acceleration_mps2(
    gravity_mps2: &Vector3<f64>,
    velocity_mps: &Vector3<f64>,
    drag_per_m: f64,
    spin_hz: &Vector3<f64>,
) -> Vector3<f64> {
    gravity_mps2 - drag_per_m * velocity_mps.norm() * velocity_mps + spin_hz.cross(velocity_mps)
}

/// Moves a state on by a time, forwards or backwards: Runge and Kutta's method of fourth order.
fn moved(settings: &FlightSettings, state: &State, dt_s: f64) -> State {
    let gravity = Vector3::from(settings.gravity_mps2);
    let (drag, spin) = (state[6], Vector3::new(state[7], state[8], state[9]));
    let steps = (dt_s.abs() / STEP_S).ceil().max(1.0);
    let h = dt_s / steps;
    let mut position: Vector3<f64> = state.fixed_rows::<3>(0).into();
    let mut velocity: Vector3<f64> = state.fixed_rows::<3>(3).into();
    let acceleration = |v: &Vector3<f64>| acceleration_mps2(&gravity, v, drag, &spin);
    for _ in 0..steps as usize {
        let a1 = acceleration(&velocity);
        let a2 = acceleration(&(velocity + 0.5 * h * a1));
        let a3 = acceleration(&(velocity + 0.5 * h * a2));
        let a4 = acceleration(&(velocity + h * a3));
        position += h * velocity + h * h / 6.0 * (a1 + a2 + a3);
        velocity += h / 6.0 * (a1 + 2.0 * (a2 + a3) + a4);
    }
    let mut moved = *state;
    moved.fixed_rows_mut::<3>(0).copy_from(&position);
    moved.fixed_rows_mut::<3>(3).copy_from(&velocity);
    moved
}

impl Flight {
    /// Creates the flight of a body that has not been measured yet.
    ///
    /// # Errors
    ///
    /// A setting is not finite, or drag, its deviation or that of the spin is negative.
    pub fn new(settings: FlightSettings) -> Result<Self, Error> {
        let FlightSettings {
            gravity_mps2,
            drag_per_m,
            drag_sigma_per_m,
            spin_sigma_hz,
        } = settings;
        for (name, value) in [
            ("drag_per_m", drag_per_m),
            ("drag_sigma_per_m", drag_sigma_per_m),
            ("spin_sigma_hz", spin_sigma_hz),
        ] {
            if !(0.0..=1000.0).contains(&value) {
                return Err(Error::out_of_range(name, value, "0 to 1000"));
            }
        }
        if !gravity_mps2.iter().all(|v| v.abs() <= 1000.0) {
            let value = format!("{gravity_mps2:?}");
            return Err(Error::out_of_range(
                "gravity_mps2",
                value,
                "numbers within ±1000",
            ));
        }
        Ok(Self {
            settings,
            points: VecDeque::with_capacity(MOST + 1),
            outliers: 0,
            shared_m2: Matrix3::zeros(),
            fit: None,
        })
    }

    /// Forgets all measurements.
    pub fn reset(&mut self) {
        self.points.clear();
        self.outliers = 0;
        self.fit = None;
    }

    /// Adds a measured position in metres, with the covariance of its own error and of that which it shares with others (xx, xy, xz, yy, yz, zz in m²). Times must ascend; what
    /// does not is left out.
    pub fn add(
        &mut self,
        time_s: f64,
        position_m: [f64; 3],
        (covariance_m2, shared_m2): ([f64; 6], [f64; 6]),
    ) {
        if self.points.back().is_some_and(|last| last.time_s >= time_s) {
            return;
        }
        let covariance = covariance_matrix(covariance_m2);
        let Some(cholesky) = covariance.cholesky() else {
            return;
        };
        self.shared_m2 = covariance_matrix(shared_m2);
        let point = Point {
            time_s,
            position_m: position_m.into(),
            information: cholesky.inverse(),
        };
        let is_recent = |point: &Point| time_s - point.time_s <= LONGEST_S;
        self.points.retain(is_recent);
        if self.points.is_empty() {
            self.fit = None;
        }
        let is_outlier = self.fit.as_ref().is_some_and(|fit| {
            let predicted = moved(&self.settings, &fit.state, time_s - fit.time_s);
            let way = self.derivative(&fit.state, time_s - fit.time_s);
            let sum = way * fit.covariance * way.transpose() + covariance;
            let off = point.position_m - predicted.fixed_rows::<3>(0);
            sum.cholesky()
                .is_some_and(|sum| off.dot(&sum.solve(&off)) > OUTLIER_SIGMAS * OUTLIER_SIGMAS)
        });
        self.outliers = if is_outlier { self.outliers + 1 } else { 0 };
        self.points.push_back(point);
        if self.outliers == CONTACT_OUTLIERS {
            let before = self.points.len() - CONTACT_OUTLIERS;
            self.points.drain(..before);
            self.outliers = 0;
        }
        if self.points.len() > MOST {
            self.points.pop_front();
        }
        if self.outliers == 0 {
            self.fit = None;
            let mut first = 0;
            while self.points.len() >= first + LEAST {
                self.fit = self.fitted(first);
                if self.fit.is_some() {
                    self.points.drain(..first);
                    break;
                }
                // It may have been thrown since: the later half is tried by itself.
                first += (self.points.len() - first).div_ceil(2);
            }
        }
    }

    /// Returns when and where the body crosses a plane next, if it flies on undisturbed. `None` if it does not fly, if the latest measurement contradicts its flight, or if it crosses the plane
    /// later than is predicted.
    pub fn crossing(&self, plane: &Plane) -> Option<Crossing> {
        let is_flight = |fit: &&Fit| self.outliers == 0 && !fit.bends_otherwise;
        let fit = self.fit.as_ref().filter(is_flight)?;
        let (after_s, position) = self.crosses(&fit.state, plane)?;
        let mut derivative = SMatrix::<f64, 4, UNKNOWNS>::zeros();
        for (unknown, change) in CHANGES.into_iter().enumerate() {
            let mut changed = fit.state;
            changed[unknown] += change;
            // One that crosses nowhere grazes the plane.
            let (then_s, there) = self.crosses(&changed, plane)?;
            let off = (there - position).push(then_s - after_s);
            derivative.set_column(unknown, &(off / change));
        }
        let covariance = derivative * fit.covariance * derivative.transpose();
        // What all measurements share moves the flight, and thus the crossing.
        let of_position = derivative.fixed_view::<4, 3>(0, 0);
        let covariance = covariance + of_position * self.shared_m2 * of_position.transpose();
        Some(Crossing {
            time_s: fit.time_s + after_s,
            sigma_s: covariance[(3, 3)].max(0.0).sqrt(),
            position_m: (position - plane.height_m(&position) * plane.normal).into(),
            covariance_m2: [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)]
                .map(|at| covariance[at]),
        })
    }

    /// After how many seconds, and where, a state crosses a plane next.
    fn crosses(&self, state: &State, plane: &Plane) -> Option<(f64, Vector3<f64>)> {
        let position = |state: &State| -> Vector3<f64> { state.fixed_rows::<3>(0).into() };
        let (mut after_s, mut here) = (0.0, *state);
        let mut height_m = plane.height_m(&position(&here));
        while after_s < MOST_AHEAD_S {
            let next = moved(&self.settings, &here, STEP_S);
            let next_m = plane.height_m(&position(&next));
            if height_m != 0.0 && (next_m > 0.0) != (height_m > 0.0) {
                // Along the flight the height hardly bends within a step: three steps of the secant method.
                let (mut low, mut high) = ((0.0, height_m), (STEP_S, next_m));
                for _ in 0..3 {
                    let at_s = low.0 - low.1 * (high.0 - low.0) / (high.1 - low.1);
                    let at_m = plane.height_m(&position(&moved(&self.settings, &here, at_s)));
                    if (at_m > 0.0) == (low.1 > 0.0) {
                        low = (at_s, at_m);
                    } else {
                        high = (at_s, at_m);
                    }
                }
                let at_s = low.0 - low.1 * (high.0 - low.0) / (high.1 - low.1);
                return Some((
                    after_s + at_s,
                    position(&moved(&self.settings, &here, at_s)),
                ));
            }
            (here, height_m) = (next, next_m);
            after_s += STEP_S;
        }
        None
    }

    /// How the position after a time depends on a state.
    fn derivative(&self, state: &State, after_s: f64) -> SMatrix<f64, 3, UNKNOWNS> {
        let there = moved(&self.settings, state, after_s);
        let mut derivative = SMatrix::<f64, 3, UNKNOWNS>::zeros();
        for (unknown, change) in CHANGES.into_iter().enumerate() {
            let mut changed = *state;
            changed[unknown] += change;
            let off = moved(&self.settings, &changed, after_s) - there;
            derivative.set_column(unknown, &(off.fixed_rows::<3>(0) / change));
        }
        derivative
    }

    /// Fits the flight to the measurements from this number on, at the time of the latest; `None` if the body does not fly.
    fn fitted(&self, first: usize) -> Option<Fit> {
        let last = self.points.back()?;
        let (line, straight) = self.polynomial::<6>(first)?;
        let mut information = Covariance::zeros();
        let mut prior = State::zeros();
        prior[6] = self.settings.drag_per_m;
        for unknown in 6..UNKNOWNS {
            let sigma = if unknown == 6 {
                self.settings.drag_sigma_per_m
            } else {
                self.settings.spin_sigma_hz
            };
            information[(unknown, unknown)] = sigma.max(1e-6).powi(-2);
        }
        let mut state = prior;
        state.fixed_rows_mut::<6>(0).copy_from(&line);
        let mut covariance = None;
        for _ in 0..ITERATIONS {
            let mut normal = information;
            let mut right = information * (prior - state);
            for point in self.points.range(first..) {
                let after_s = point.time_s - last.time_s;
                let way = self.derivative(&state, after_s);
                let there = moved(&self.settings, &state, after_s);
                let off = point.position_m - there.fixed_rows::<3>(0);
                let weighted = way.transpose() * point.information;
                normal += weighted * way;
                right += weighted * off;
            }
            let inverse = inverse(&normal)?;
            state += inverse * right;
            state[6] = state[6].max(0.0);
            covariance = Some(inverse);
        }
        let squares = |position: &dyn Fn(f64) -> Vector3<f64>| -> f64 {
            let of_point = |point: &Point| {
                let off = point.position_m - position(point.time_s - last.time_s);
                off.dot(&(point.information * off))
            };
            self.points.range(first..).map(of_point).sum()
        };
        let of_flight = squares(&|after_s| {
            moved(&self.settings, &state, after_s)
                .fixed_rows::<3>(0)
                .into()
        });
        let off = state - prior;
        let explained = 0.5 * (straight - of_flight - (off.transpose() * information * off)[0]);
        let count = 3.0 * (self.points.len() - first) as f64;
        let flies = explained > FLIES_NATS && of_flight < MOST_SQUARES * count;
        flies.then_some(Fit {
            time_s: last.time_s,
            state,
            covariance: covariance?,
            bends_otherwise: self.bends_otherwise(first, of_flight),
        })
    }

    /// Whether a path of the third order in time, such as that of a hand that slows down, explains the measurements from this number on significantly better than a flight does, which deviates from
    /// them by this sum of squares (Fisher's F test, so that measurements may be more precise than their covariances say).
    fn bends_otherwise(&self, first: usize, of_flight: f64) -> bool {
        const COEFFICIENTS: usize = 12;
        let Some((_, of_path)) = self.polynomial::<COEFFICIENTS>(first) else {
            return false;
        };
        let free = 3 * (self.points.len() - first) - COEFFICIENTS;
        let mean = (of_path / free as f64).max(LEAST_SQUARES);
        (of_flight - of_path) / 3.0 > MOST_RATIO * mean
    }

    /// The coefficients of the polynomial in time since the latest measurement that is nearest to the measurements from this number on, three of each order: position, velocity and so on. Also
    /// returns the sum of the squared deviations from it, in standard deviations.
    fn polynomial<const COEFFICIENTS: usize>(
        &self,
        first: usize,
    ) -> Option<(SVector<f64, COEFFICIENTS>, f64)> {
        let last_s = self.points.back()?.time_s;
        let mut normal = SMatrix::<f64, COEFFICIENTS, COEFFICIENTS>::zeros();
        let mut right = SVector::<f64, COEFFICIENTS>::zeros();
        let way = |point: &Point| {
            let mut way = SMatrix::<f64, 3, COEFFICIENTS>::zeros();
            let mut power = 1.0;
            for order in 0..COEFFICIENTS / 3 {
                for axis in 0..3 {
                    way[(axis, 3 * order + axis)] = power;
                }
                power *= point.time_s - last_s;
            }
            way
        };
        for point in self.points.range(first..) {
            let weighted = way(point).transpose() * point.information;
            normal += weighted * way(point);
            right += weighted * point.position_m;
        }
        let coefficients = inverse(&normal)? * right;
        let of_point = |point: &Point| {
            let off = point.position_m - way(point) * coefficients;
            off.dot(&(point.information * off))
        };
        Some((coefficients, self.points.range(first..).map(of_point).sum()))
    }
}

/// The inverse of a symmetric matrix whose rows have different units; `None` if it is singular.
fn inverse<const SIZE: usize>(
    matrix: &SMatrix<f64, SIZE, SIZE>,
) -> Option<SMatrix<f64, SIZE, SIZE>> {
    let scale = matrix.diagonal().map(|v| 1.0 / v.max(1e-300).sqrt());
    let scaled =
        |m: &SMatrix<f64, SIZE, SIZE>| SMatrix::from_fn(|i, j| m[(i, j)] * scale[i] * scale[j]);
    let one: SMatrix<f64, SIZE, SIZE> = scaled(matrix);
    let inverse: SMatrix<f64, SIZE, SIZE> = scaled(&one.try_inverse()?);
    let is_finite = inverse.iter().all(|v| v.is_finite());
    is_finite.then_some(inverse)
}

#[cfg(test)]
mod tests;
