//! Smoothing: the best estimate at each time from measurements before *and* after it.
//!
//! A target moves in one of several ways, its *modes*: it rolls or rests, somebody moves it, it flies freely, or something hits it. An interacting mixture of
//! Kalman filters (Blom and Bar-Shalom 1988), one per mode, runs forwards. A backward pass (Rauch, Tung and Striebel 1965; for mixtures Helmick, Blair and Hoffman 1995) then gives each
//! state what the later measurements say of it. All is Gaussian, so that velocities need no particles.

use nalgebra::{Matrix3, Matrix6, Matrix6x3, SMatrix, SVector, Vector3, Vector6};

/// The number of modes.
const MODES: usize = 4;

/// Acceleration of a free fall, m/s². Air and spin are part of the noise.
pub const GRAVITY_MPS2: f64 = 9.81;

/// A way to move.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mode {
    /// Constant acceleration, m/s².
    pub acceleration_mps2: [f64; 3],
    /// Spectral density of the rest of the acceleration, m²/s³.
    pub density_m2ps3: f64,
    /// How often the target begins to move in another way, per second.
    pub leave_hz: f64,
    /// How likely the target begins to move in this way when it leaves another, relative to the other ways.
    pub share: f64,
}

/// Settings of [`smooth`].
#[derive(Debug, Clone, PartialEq)]
pub struct SmootherSettings {
    /// The ways in which the target may move.
    pub modes: [Mode; MODES],
    /// Standard deviation of the velocity before the first measurement, m/s.
    pub velocity_sigma_mps: f64,
}

impl Default for SmootherSettings {
    /// Rolling or at rest, moved by somebody, in free flight with z upwards, and hit. Hand-set: between a ball on a desk and one that is thrown through a hall.
    fn default() -> Self {
        let mode = |fall_mps2: f64, density_m2ps3, leave_hz, share| Mode {
            acceleration_mps2: [0.0, 0.0, -fall_mps2],
            density_m2ps3,
            leave_hz,
            share,
        };
        Self {
            modes: [
                mode(0.0, 0.3, 0.5, 1.0),
                mode(0.0, 5.0, 2.0, 1.0),
                mode(GRAVITY_MPS2, 0.05, 0.5, 1.0),
                mode(0.0, 3000.0, 20.0, 0.7),
            ],
            velocity_sigma_mps: 5.0,
        }
    }
}

impl SmootherSettings {
    /// The default for a target that stays on a plane: it does not fly.
    pub fn planar() -> Self {
        let mut settings = Self::default();
        settings.modes[2].share = 0.0;
        settings
    }
}

/// What was measured at one time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measured {
    /// The time in seconds; later than that of the one before.
    pub time_s: f64,
    /// Position in metres and its covariance (xx, xy, xz, yy, yz, zz in m²); `None` if the target was not measured.
    pub position: Option<([f64; 3], [f64; 6])>,
}

/// A smoothed state.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SmoothedState {
    /// Position in metres.
    pub position_m: [f64; 3],
    /// Velocity in m/s.
    pub velocity_mps: [f64; 3],
    /// Covariance of the position (xx, xy, xz, yy, yz, zz) in m².
    pub covariance_m2: [f64; 6],
    /// Covariance of the velocity (xx, xy, xz, yy, yz, zz) in m²/s².
    pub velocity_covariance_m2ps2: [f64; 6],
    /// The probability of each mode.
    pub modes: [f64; MODES],
}

/// A Gaussian of position and velocity.
#[derive(Debug, Clone, Copy)]
struct Gaussian {
    mean: Vector6<f64>,
    covariance: Matrix6<f64>,
}

/// One Gaussian per mode, and the modes' probabilities.
#[derive(Debug, Clone, Copy)]
struct Mixture {
    modes: [Gaussian; MODES],
    weights: SVector<f64, MODES>,
}

/// What led from one mixture to the next.
#[derive(Debug, Clone, Copy)]
struct Transition {
    /// The state before, given the mode after.
    mixed: [Gaussian; MODES],
    /// The prediction from it.
    predicted: [Gaussian; MODES],
    /// The probability of each mode before (row), given the mode after (column).
    before: SMatrix<f64, MODES, MODES>,
    dt_s: f64,
}

fn matrix_of([xx, xy, xz, yy, yz, zz]: [f64; 6]) -> Matrix3<f64> {
    Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz)
}

fn entries_of(matrix: &Matrix6<f64>, at: usize) -> [f64; 6] {
    [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)].map(|(i, j)| matrix[(at + i, at + j)])
}

/// Merges Gaussians with weights that sum to one.
fn merged(parts: impl Iterator<Item = (f64, Gaussian)> + Clone) -> Gaussian {
    let mut mean = Vector6::zeros();
    for (weight, part) in parts.clone() {
        mean += weight * part.mean;
    }
    let mut covariance = Matrix6::zeros();
    for (weight, part) in parts {
        let off = part.mean - mean;
        covariance += weight * (part.covariance + off * off.transpose());
    }
    Gaussian { mean, covariance }
}

/// The matrix that moves a state on at constant velocity.
fn transition_of(dt_s: f64) -> Matrix6<f64> {
    let mut matrix = Matrix6::identity();
    for axis in 0..3 {
        matrix[(axis, axis + 3)] = dt_s;
    }
    matrix
}

impl Gaussian {
    fn predicted(&self, mode: &Mode, dt_s: f64) -> Self {
        let transition = transition_of(dt_s);
        let acceleration = Vector3::from(mode.acceleration_mps2);
        let mut mean = transition * self.mean;
        let mut covariance = transition * self.covariance * transition.transpose();
        let density = mode.density_m2ps3;
        for axis in 0..3 {
            mean[axis] += 0.5 * acceleration[axis] * dt_s * dt_s;
            mean[axis + 3] += acceleration[axis] * dt_s;
            covariance[(axis, axis)] += density * dt_s.powi(3) / 3.0;
            covariance[(axis, axis + 3)] += density * dt_s * dt_s / 2.0;
            covariance[(axis + 3, axis)] += density * dt_s * dt_s / 2.0;
            covariance[(axis + 3, axis + 3)] += density * dt_s;
        }
        Self { mean, covariance }
    }

    /// Updates with a measured position; returns the logarithm of the measurement's likelihood, too.
    fn updated(&self, position_m: [f64; 3], covariance_m2: &Matrix3<f64>) -> (Self, f64) {
        let of_position = self.covariance.fixed_view::<3, 3>(0, 0) + covariance_m2;
        // A measurement without any error along an axis on which the state has none either, as on a plane, says nothing there.
        let least = 1e-12 + 1e-9 * of_position.trace();
        let sum = of_position + Matrix3::from_diagonal_element(least);
        let Some(cholesky) = sum.cholesky() else {
            return (*self, f64::NEG_INFINITY);
        };
        let position = self.mean.fixed_view::<3, 1>(0, 0);
        let innovation = Vector3::from(position_m) - position;
        let cross: Matrix6x3<f64> = self.covariance.fixed_view::<6, 3>(0, 0).into_owned();
        let gain = cholesky.solve(&cross.transpose()).transpose();
        let log_determinant: f64 = cholesky
            .l()
            .diagonal()
            .iter()
            .map(|v| 2.0 * libm::log(*v))
            .sum();
        let squares = innovation.dot(&cholesky.solve(&innovation));
        let covariance = self.covariance - gain * cross.transpose();
        let updated = Self {
            mean: self.mean + gain * innovation,
            covariance: 0.5 * (covariance + covariance.transpose()),
        };
        (updated, -0.5 * (squares + log_determinant))
    }

    /// The logarithm of the density of another's mean under both, up to a constant.
    fn log_agreement(&self, other: &Self) -> f64 {
        let sum = self.covariance + other.covariance;
        let scale = sum.diagonal().map(|v| 1.0 / v.max(1e-18).sqrt());
        let scaled = Matrix6::from_fn(|i, j| sum[(i, j)] * scale[i] * scale[j])
            + Matrix6::from_diagonal_element(1e-9);
        let Some(cholesky) = scaled.cholesky() else {
            return 0.0;
        };
        let off = (other.mean - self.mean).component_mul(&scale);
        let diagonal = cholesky.l_dirty().diagonal();
        let log_determinant: f64 = diagonal.iter().map(|v| 2.0 * libm::log(*v)).sum();
        let log_scale: f64 = scale.iter().map(|v| libm::log(*v)).sum();
        log_scale - 0.5 * (off.dot(&cholesky.solve(&off)) + log_determinant)
    }
}

/// Turns logarithms into weights that sum to one, times factors.
fn normalised(logs: &SVector<f64, MODES>, factors: &SVector<f64, MODES>) -> SVector<f64, MODES> {
    let most = (0..MODES)
        .filter(|&mode| factors[mode] > 0.0)
        .map(|mode| logs[mode])
        .fold(f64::NEG_INFINITY, f64::max);
    if most == f64::NEG_INFINITY {
        return *factors / factors.sum().max(f64::MIN_POSITIVE);
    }
    let weights = SVector::<f64, MODES>::from_fn(|mode, _| {
        if factors[mode] > 0.0 {
            factors[mode] * libm::exp(logs[mode] - most)
        } else {
            0.0
        }
    });
    let sum: f64 = weights.sum();
    weights / sum
}

/// The probabilities of the modes (columns) after a time, given those before (rows).
fn mode_transition(modes: &[Mode; MODES], dt_s: f64) -> SMatrix<f64, MODES, MODES> {
    let mut matrix = SMatrix::zeros();
    for (from, mode) in modes.iter().enumerate() {
        let others = |to: usize| if to == from { 0.0 } else { modes[to].share };
        let sum: f64 = (0..MODES).map(others).sum();
        let stay = libm::exp(-mode.leave_hz * dt_s);
        for to in 0..MODES {
            matrix[(from, to)] = if to == from {
                stay
            } else {
                (1.0 - stay) * others(to) / sum.max(f64::MIN_POSITIVE)
            };
        }
    }
    matrix
}

impl Mixture {
    /// The mixture at the first measurement.
    fn begun(
        (position_m, covariance_m2): ([f64; 3], [f64; 6]),
        settings: &SmootherSettings,
    ) -> Self {
        let mut state = Gaussian {
            mean: Vector6::zeros(),
            covariance: Matrix6::from_diagonal_element(settings.velocity_sigma_mps.powi(2)),
        };
        for axis in 0..3 {
            state.mean[axis] = position_m[axis];
        }
        let of_position = matrix_of(covariance_m2);
        state
            .covariance
            .fixed_view_mut::<3, 3>(0, 0)
            .copy_from(&of_position);
        let shares = SVector::<f64, MODES>::from_fn(|mode, _| settings.modes[mode].share);
        Self {
            modes: [state; MODES],
            weights: shares / shares.sum(),
        }
    }

    /// Moves the mixture on, and updates it with what was measured then.
    fn next(
        &self,
        measured: Option<([f64; 3], [f64; 6])>,
        dt_s: f64,
        settings: &SmootherSettings,
    ) -> (Self, Transition) {
        let transition = mode_transition(&settings.modes, dt_s);
        let prior = transition.transpose() * self.weights;
        let before = SMatrix::from_fn(|from, to| {
            transition[(from, to)] * self.weights[from] / prior[to].max(f64::MIN_POSITIVE)
        });
        let mixed = std::array::from_fn(|to| {
            merged((0..MODES).map(|from| (before[(from, to)], self.modes[from])))
        });
        let predicted = std::array::from_fn(|to: usize| {
            Gaussian::predicted(&mixed[to], &settings.modes[to], dt_s)
        });
        let mut modes = predicted;
        let mut weights = prior / prior.sum();
        if let Some((position_m, covariance_m2)) = measured {
            let covariance_m2 = matrix_of(covariance_m2);
            let mut logs = SVector::zeros();
            for (mode, state) in modes.iter_mut().enumerate() {
                (*state, logs[mode]) = state.updated(position_m, &covariance_m2);
            }
            weights = normalised(&logs, &prior);
        }
        let transition = Transition {
            mixed,
            predicted,
            before,
            dt_s,
        };
        (Self { modes, weights }, transition)
    }

    /// The mixture given what the next one says, which includes all later measurements.
    fn smoothed(&self, transition: &Transition, later: &Self) -> Self {
        let matrix = transition_of(transition.dt_s);
        // The state now, given the mode after.
        let given: [Gaussian; MODES] = std::array::from_fn(|to| {
            let (mixed, predicted) = (&transition.mixed[to], &transition.predicted[to]);
            let gain = gain_of(
                &(mixed.covariance * matrix.transpose()),
                &predicted.covariance,
            );
            let covariance = mixed.covariance
                + gain * (later.modes[to].covariance - predicted.covariance) * gain.transpose();
            Gaussian {
                mean: mixed.mean + gain * (later.modes[to].mean - predicted.mean),
                covariance: 0.5 * (covariance + covariance.transpose()),
            }
        });
        // The mode now, given the mode after and that state.
        let mut joint = SMatrix::<f64, MODES, MODES>::zeros();
        for (to, state) in given.iter().enumerate() {
            let logs = SVector::from_fn(|from, _| self.modes[from].log_agreement(state));
            let before = normalised(&logs, &transition.before.column(to).into_owned());
            joint.set_column(to, &(before * later.weights[to]));
        }
        let weights: SVector<f64, MODES> = joint.column_sum();
        let modes = std::array::from_fn(|from| {
            if weights[from] < 1e-12 {
                return self.modes[from];
            }
            merged((0..MODES).map(|to| (joint[(from, to)] / weights[from], given[to])))
        });
        Self {
            modes,
            weights: weights / weights.sum(),
        }
    }

    fn state(&self) -> SmoothedState {
        let all = merged((0..MODES).map(|mode| (self.weights[mode], self.modes[mode])));
        SmoothedState {
            position_m: [0, 1, 2].map(|axis| all.mean[axis]),
            velocity_mps: [3, 4, 5].map(|axis| all.mean[axis]),
            covariance_m2: entries_of(&all.covariance, 0),
            velocity_covariance_m2ps2: entries_of(&all.covariance, 3),
            modes: self.weights.into(),
        }
    }
}

/// The product of a matrix and the inverse of a covariance, which may be singular along an axis.
fn gain_of(cross: &Matrix6<f64>, covariance: &Matrix6<f64>) -> Matrix6<f64> {
    let scale = covariance.diagonal().map(|v| 1.0 / v.max(1e-18).sqrt());
    let scaled = Matrix6::from_fn(|i, j| covariance[(i, j)] * scale[i] * scale[j])
        + Matrix6::from_diagonal_element(1e-12);
    let inverse = scaled
        .cholesky()
        .map_or_else(Matrix6::zeros, |cholesky| cholesky.inverse());
    cross * Matrix6::from_fn(|i, j| inverse[(i, j)] * scale[i] * scale[j])
}

/// Smooths what was measured of a target, in the order of time. Returns a state per time; `None` before the first measurement and after the last.
///
/// Errors that the measurements share are not smoothed; covariances are those of independent errors.
pub fn smooth(measured: &[Measured], settings: &SmootherSettings) -> Vec<Option<SmoothedState>> {
    let mut states = vec![None; measured.len()];
    let is_measured = |one: &Measured| one.position.is_some();
    let (Some(first), Some(last)) = (
        measured.iter().position(is_measured),
        measured.iter().rposition(is_measured),
    ) else {
        return states;
    };
    let Some(position) = measured[first].position else {
        return states;
    };
    let mut latest = Mixture::begun(position, settings);
    let mut mixtures = vec![latest];
    let mut transitions = Vec::with_capacity(last - first);
    for pair in measured[first..=last].windows(2) {
        let dt_s = (pair[1].time_s - pair[0].time_s).max(1e-9);
        let (next, transition) = latest.next(pair[1].position, dt_s, settings);
        mixtures.push(next);
        transitions.push(transition);
        latest = next;
    }
    states[last] = Some(latest.state());
    for number in (0..transitions.len()).rev() {
        latest = mixtures[number].smoothed(&transitions[number], &latest);
        states[first + number] = Some(latest.state());
    }
    states
}

/// A change of the velocity that neither a free fall nor anything gradual explains: a throw, a bounce, a catch, a kick.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Contact {
    /// When, in seconds.
    pub time_s: f64,
    /// Where, in metres.
    pub position_m: [f64; 3],
    /// The velocity before, m/s.
    pub velocity_before_mps: [f64; 3],
    /// The velocity after, m/s.
    pub velocity_after_mps: [f64; 3],
}

/// Velocities that change by less are no contact, m/s. Hand-set: a ball that drops from 2 cm.
const LEAST_CHANGE_MPS: f64 = 0.6;

/// ... nor by less than this many standard deviations. Hand-set.
const CHANGE_SIGMAS: f64 = 4.0;

/// The number of times between two states at which a contact is looked for.
const INSTANTS: u32 = 100;

/// A smoothed state with its time.
#[derive(Debug, Clone, Copy)]
struct Timed {
    time_s: f64,
    position_m: Vector3<f64>,
    velocity_mps: Vector3<f64>,
    acceleration_mps2: Vector3<f64>,
    velocity_variance_m2ps2: f64,
}

impl Timed {
    fn of(time_s: f64, state: &SmoothedState, settings: &SmootherSettings) -> Self {
        let accelerations = settings.modes.iter().zip(state.modes);
        let accelerations =
            accelerations.map(|(mode, weight)| weight * Vector3::from(mode.acceleration_mps2));
        let [xx, _, _, yy, _, zz] = state.velocity_covariance_m2ps2;
        Self {
            time_s,
            position_m: state.position_m.into(),
            velocity_mps: state.velocity_mps.into(),
            acceleration_mps2: accelerations.sum(),
            velocity_variance_m2ps2: xx + yy + zz,
        }
    }

    /// Position and velocity at another time.
    fn at(&self, time_s: f64) -> (Vector3<f64>, Vector3<f64>) {
        let since_s = time_s - self.time_s;
        let gained_mps = self.acceleration_mps2 * since_s;
        (
            self.position_m + (self.velocity_mps + 0.5 * gained_mps) * since_s,
            self.velocity_mps + gained_mps,
        )
    }

    /// Whether the velocity changes until another state as it does at a contact.
    fn changes_until(&self, next: &Self, settings: &SmootherSettings) -> bool {
        let dt_s = next.time_s - self.time_s;
        let changed = next.velocity_mps - self.velocity_mps;
        let unexplained = settings.modes.iter().map(|mode| {
            let gained_mps = Vector3::from(mode.acceleration_mps2) * dt_s;
            (changed - gained_mps).norm()
        });
        let unexplained_mps = unexplained.fold(f64::INFINITY, f64::min);
        let variance = self.velocity_variance_m2ps2 + next.velocity_variance_m2ps2;
        unexplained_mps > LEAST_CHANGE_MPS.max(CHANGE_SIGMAS * (variance / 3.0).sqrt())
    }

    /// The contact between this state and a later one: where what was before meets what is after.
    fn contact_until(&self, next: &Self) -> Contact {
        let dt_s = next.time_s - self.time_s;
        let apart = |share: f64| {
            let time_s = self.time_s + share * dt_s;
            (self.at(time_s).0 - next.at(time_s).0).norm()
        };
        let shares = (0..=INSTANTS).map(|instant| f64::from(instant) / f64::from(INSTANTS));
        let share = shares.fold(0.5, |best, share| {
            if apart(share) < apart(best) {
                share
            } else {
                best
            }
        });
        let time_s = self.time_s + share * dt_s;
        let ((before_m, before_mps), (after_m, after_mps)) = (self.at(time_s), next.at(time_s));
        Contact {
            time_s,
            position_m: (0.5 * (before_m + after_m)).into(),
            velocity_before_mps: before_mps.into(),
            velocity_after_mps: after_mps.into(),
        }
    }
}

/// Finds the contacts in a smoothed track. `states` are those of [`smooth`] for these measurements, with the same settings.
pub fn contacts(
    measured: &[Measured],
    states: &[Option<SmoothedState>],
    settings: &SmootherSettings,
) -> Vec<Contact> {
    let timed = measured.iter().zip(states);
    let timed: Vec<Timed> = timed
        .filter_map(|(one, state)| Some(Timed::of(one.time_s, state.as_ref()?, settings)))
        .collect();
    let mut contacts = Vec::new();
    let mut begin: Option<&Timed> = None;
    for pair in timed.windows(2) {
        if pair[0].changes_until(&pair[1], settings) {
            // The change of one contact may be spread over several steps.
            begin = begin.or(Some(&pair[0]));
        } else if let Some(before) = begin.take() {
            contacts.push(before.contact_until(&pair[0]));
        }
    }
    if let (Some(before), Some(last)) = (begin, timed.last()) {
        contacts.push(before.contact_until(last));
    }
    contacts
}

#[cfg(test)]
mod tests;
