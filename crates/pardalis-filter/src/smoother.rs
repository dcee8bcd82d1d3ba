//! Smoothing: the best estimate at each time from measurements before *and* after it.
//!
//! The mixture of [modes](crate::modes) runs forwards. A backward pass (Rauch, Tung and Striebel 1965; for pairs of modes Kim 1994) then gives each state what the later measurements
//! say of it.

use nalgebra::{Matrix6, SMatrix, SVector, Vector3};

use crate::modes::{
    Gaussian, LEAST_STEP_S, MODES, Measured, Mixture, ModeSettings, ModeState, NO_WEIGHT,
    Transition, merged, normalized, transition_of,
};

impl Gaussian {
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

impl Mixture {
    /// The mixture given what the next one says, which includes all later measurements.
    fn smoothed(&self, transition: &Transition, later: &Self) -> Self {
        let matrix = transition_of(transition.dt_s);
        // The state now, given the modes now (first index) and after.
        let mut given = [self.modes; MODES];
        let mut joint = SMatrix::<f64, MODES, MODES>::zeros();
        for (to, after) in later.modes.iter().enumerate() {
            if later.weights[to] < NO_WEIGHT {
                continue;
            }
            let mut logs = SVector::<f64, MODES>::zeros();
            for (from, here) in self.modes.iter().enumerate() {
                let predicted = &transition.predicted[from][to];
                let cross = here.covariance * matrix.transpose();
                let gain = gain_of(&cross, &predicted.covariance);
                let covariance = here.covariance
                    + gain * (after.covariance - predicted.covariance) * gain.transpose();
                given[from][to] = Gaussian {
                    mean: here.mean + gain * (after.mean - predicted.mean),
                    covariance: 0.5 * (covariance + covariance.transpose()),
                };
                logs[from] = predicted.log_agreement(after);
            }
            let before = normalized(&logs, &transition.chances.column(to).into_owned());
            joint.set_column(to, &(before * later.weights[to]));
        }
        let weights: SVector<f64, MODES> = joint.column_sum();
        let modes = std::array::from_fn(|from| {
            if weights[from] < NO_WEIGHT {
                return self.modes[from];
            }
            merged((0..MODES).map(|to| (joint[(from, to)] / weights[from], given[from][to])))
        });
        Self {
            modes,
            weights: weights / weights.sum(),
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
/// Assumes that the errors of the measurements are independent. Add the covariance of errors that they share to each result.
pub fn smooth(measured: &[Measured], settings: &ModeSettings) -> Vec<Option<ModeState>> {
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
    let mut latest = Mixture::measured(position, settings);
    let mut mixtures = vec![latest];
    let mut transitions = Vec::with_capacity(last - first);
    for pair in measured[first..=last].windows(2) {
        let dt_s = (pair[1].time_s - pair[0].time_s).max(LEAST_STEP_S);
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

/// The most states in a row, so close to a contact that it is open whether they are before or after it, over which one is looked for. Hand-set.
const MOST_OPEN: usize = 3;

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
    fn of(time_s: f64, state: &ModeState, settings: &ModeSettings) -> Self {
        let mut acceleration_mps2 = Vector3::zeros();
        for (way, weight) in settings.ways.iter().zip(state.modes) {
            acceleration_mps2 += weight * Vector3::from(way.acceleration_mps2);
        }
        let of_ways: f64 = state.modes[..settings.ways.len()].iter().sum();
        if of_ways > 0.0 {
            acceleration_mps2 /= of_ways;
        }
        let [xx, _, _, yy, _, zz] = state.velocity_covariance_m2ps2;
        Self {
            time_s,
            position_m: state.position_m.into(),
            velocity_mps: state.velocity_mps.into(),
            acceleration_mps2,
            velocity_variance_m2ps2: xx + yy + zz,
        }
    }

    /// Whether its velocity is so uncertain that a contact may be hidden in it, as right beside one: it may be that before or after.
    fn is_open(&self) -> bool {
        CHANGE_SIGMAS * (self.velocity_variance_m2ps2 / 3.0).sqrt() > LEAST_CHANGE_MPS
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
    fn changes_until(&self, next: &Self, settings: &ModeSettings) -> bool {
        let dt_s = next.time_s - self.time_s;
        let changed = next.velocity_mps - self.velocity_mps;
        let unexplained = settings.ways.iter().map(|way| {
            let gained_mps = Vector3::from(way.acceleration_mps2) * dt_s;
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

/// Leaves out the few states between certain ones of which it is open whether they are before or after a contact.
fn without_open(states: &[Timed]) -> Vec<Timed> {
    let mut kept: Vec<Timed> = Vec::with_capacity(states.len());
    for group in states.chunk_by(|a, b| a.is_open() == b.is_open()) {
        let is_first = kept.is_empty();
        let is_last =
            group.last().map(|state| state.time_s) == states.last().map(|last| last.time_s);
        let is_between = !is_first && !is_last;
        if !(group[0].is_open() && group.len() <= MOST_OPEN && is_between) {
            kept.extend_from_slice(group);
        }
    }
    kept
}

/// Finds the contacts in a smoothed track: changes of the velocity of at least 0.6 m/s and four standard deviations. `states` are those of [`smooth`] for these measurements, with the same settings.
pub fn contacts(
    measured: &[Measured],
    states: &[Option<ModeState>],
    settings: &ModeSettings,
) -> Vec<Contact> {
    let timed = measured.iter().zip(states);
    let timed: Vec<Timed> = timed
        .filter_map(|(one, state)| Some(Timed::of(one.time_s, state.as_ref()?, settings)))
        .collect();
    let timed = without_open(&timed);
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
