//! Motion modes: a target rolls or rests, somebody moves it, it flies freely, or something hits it.
//!
//! A mixture of Kalman filters estimates the mode of each step and the velocity from measured positions. Two modes in succession
//! are one hypothesis, and those that end in the same mode are merged (generalised pseudo-Bayes estimator of second order, Bar-Shalom, Li and Kirubarajan 2001, section 11.6.5).
//! While the velocity hardly changes, it is thus known far better than by a model that allows for any acceleration. [`ModeFilter`] goes frame by frame; the [smoother](crate::smoother)
//! looks back over a recording.

use nalgebra::{Matrix3, Matrix6, Matrix6x3, SMatrix, SVector, Vector3, Vector6};

use crate::estimate::covariance_matrix;
use crate::gaussian::GaussianStart;

/// The number of ways to move.
const WAYS: usize = 3;

/// Hypotheses on a step between two times: a way to move, a hit at any moment of the step, or a hit at its end. After the latter, nothing has been seen of the new velocity yet.
pub(crate) const MODES: usize = WAYS + 2;

/// The mode of a hit at any moment of a step, and that of a hit at its end.
const HITS: [usize; 2] = [WAYS, WAYS + 1];

/// Acceleration of a free fall, m/s². Air and spin are part of the noise.
pub const GRAVITY_MPS2: f64 = 9.81;

/// A way to move.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Way {
    /// Constant acceleration, m/s².
    pub acceleration_mps2: [f64; 3],
    /// Spectral density of the rest of the acceleration, m²/s³.
    pub density_m2ps3: f64,
    /// How often the target begins to move in another way, per second.
    pub leave_hz: f64,
    /// Relative probability that the target changes to this way when it leaves another.
    pub share: f64,
}

/// How a target may move.
#[derive(Debug, Clone, PartialEq)]
pub struct ModeSettings {
    /// The ways to move: rolling or at rest, moved by somebody, and in free flight.
    pub ways: [Way; WAYS],
    /// How often something hits the target: its velocity jumps. Per second.
    pub hit_rate_hz: f64,
    /// Standard deviation of such a jump on each axis, m/s.
    pub hit_sigma_mps: f64,
    /// Standard deviation of the velocity before the first measurement, m/s.
    pub velocity_sigma_mps: f64,
    /// Whether the target stays on a level plane: nothing moves it up or down.
    pub is_planar: bool,
}

impl Default for ModeSettings {
    /// With z upwards. Tuned by hand for balls, from one on a desk to one that is thrown through a hall.
    fn default() -> Self {
        let way = |fall_mps2: f64, density_m2ps3, leave_hz| Way {
            acceleration_mps2: [0.0, 0.0, -fall_mps2],
            density_m2ps3,
            leave_hz,
            share: 1.0,
        };
        Self {
            ways: [
                way(0.0, 0.3, 0.5),
                way(0.0, 5.0, 2.0),
                way(GRAVITY_MPS2, 0.05, 0.5),
            ],
            hit_rate_hz: 0.2,
            hit_sigma_mps: 3.0,
            velocity_sigma_mps: 5.0,
            is_planar: false,
        }
    }
}

impl ModeSettings {
    /// The default for a target that stays on a plane: it does not fly.
    pub fn planar() -> Self {
        let mut settings = Self {
            is_planar: true,
            ..Self::default()
        };
        settings.ways[2].share = 0.0;
        settings
    }

    /// The number of axes, from the first one on, along which something may change the velocity.
    fn free_axes(&self) -> usize {
        if self.is_planar { 2 } else { 3 }
    }

    /// The share of each mode in a target of which nothing is known.
    fn shares(&self) -> SVector<f64, MODES> {
        let shares = SVector::<f64, MODES>::from_fn(|mode, _| {
            self.ways.get(mode).map_or(0.0, |way| way.share)
        });
        shares / shares.sum()
    }

    /// The probabilities of the modes (columns) after a time, given those before (rows).
    fn transition(&self, dt_s: f64) -> SMatrix<f64, MODES, MODES> {
        let hit = -libm::expm1(-self.hit_rate_hz * dt_s);
        let shares = self.shares();
        let mut matrix = SMatrix::zeros();
        for from in 0..MODES {
            // Whatever was hit goes on in any way.
            let others = 1.0 - shares[from];
            let stay = match self.ways.get(from) {
                Some(way) if others > 0.0 => libm::exp(-way.leave_hz * dt_s),
                Some(_) => 1.0,
                None => 0.0,
            };
            for to in 0..WAYS {
                let chance = if to == from {
                    stay
                } else {
                    (1.0 - stay) * shares[to] / others.max(f64::MIN_POSITIVE)
                };
                matrix[(from, to)] = (1.0 - hit) * chance;
            }
            for to in HITS {
                matrix[(from, to)] = 0.5 * hit;
            }
        }
        matrix
    }
}

/// One measured position, such as that of a detection. Not the [`Measurement`](crate::Measurement) of another sensor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measured {
    /// The time in seconds. Times must not decrease.
    pub time_s: f64,
    /// Position in metres and its covariance (xx, xy, xz, yy, yz, zz in m²); `None` if the target was not measured.
    pub position: Option<([f64; 3], [f64; 6])>,
}

/// The estimated position and velocity at one time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ModeState {
    /// Position in metres.
    pub position_m: [f64; 3],
    /// Velocity in m/s.
    pub velocity_mps: [f64; 3],
    /// Covariance of the position (xx, xy, xz, yy, yz, zz) in m².
    pub covariance_m2: [f64; 6],
    /// Covariance of the velocity (xx, xy, xz, yy, yz, zz) in m²/s².
    pub velocity_covariance_m2ps2: [f64; 6],
    /// The probability of each way to move, in the order of [`ModeSettings::ways`], and last that of a hit since the time before.
    pub modes: [f64; WAYS + 1],
}

/// A Gaussian of position and velocity.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Gaussian {
    pub(crate) mean: Vector6<f64>,
    pub(crate) covariance: Matrix6<f64>,
}

/// One Gaussian per mode, and the modes' probabilities.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Mixture {
    pub(crate) modes: [Gaussian; MODES],
    pub(crate) weights: SVector<f64, MODES>,
}

/// What led from one mixture to the next.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Transition {
    /// The prediction for each mode before (first index) and after.
    pub(crate) predicted: [[Gaussian; MODES]; MODES],
    /// The probability of each mode before (row) and after (column), without what was measured after.
    pub(crate) chances: SMatrix<f64, MODES, MODES>,
    pub(crate) dt_s: f64,
}

fn entries_of(matrix: &Matrix6<f64>, at: usize) -> [f64; 6] {
    [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)].map(|(i, j)| matrix[(at + i, at + j)])
}

/// Merges Gaussians with weights that sum to one.
pub(crate) fn merged(parts: impl Iterator<Item = (f64, Gaussian)> + Clone) -> Gaussian {
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
pub(crate) fn transition_of(dt_s: f64) -> Matrix6<f64> {
    let mut matrix = Matrix6::identity();
    for axis in 0..3 {
        matrix[(axis, axis + 3)] = dt_s;
    }
    matrix
}

impl Gaussian {
    /// Moves on for a time in one way, with noise along the first axes.
    pub(crate) fn moved(&self, way: &Way, free_axes: usize, dt_s: f64) -> Self {
        let transition = transition_of(dt_s);
        let acceleration = Vector3::from(way.acceleration_mps2);
        let mut mean = transition * self.mean;
        let mut covariance = transition * self.covariance * transition.transpose();
        let density = way.density_m2ps3;
        for axis in 0..free_axes {
            mean[axis] += 0.5 * acceleration[axis] * dt_s * dt_s;
            mean[axis + 3] += acceleration[axis] * dt_s;
            covariance[(axis, axis)] += density * dt_s.powi(3) / 3.0;
            covariance[(axis, axis + 3)] += density * dt_s * dt_s / 2.0;
            covariance[(axis + 3, axis)] += density * dt_s * dt_s / 2.0;
            covariance[(axis + 3, axis + 3)] += density * dt_s;
        }
        Self { mean, covariance }
    }

    /// Moves on from one mode to another.
    fn predicted(&self, (from, to): (usize, usize), settings: &ModeSettings, dt_s: f64) -> Self {
        let free_axes = settings.free_axes();
        if to < WAYS {
            return self.moved(&settings.ways[to], free_axes, dt_s);
        }
        // Until it is hit it moves as before, which is not known if it was hit before, too.
        let way = settings.ways.get(from).unwrap_or(&settings.ways[0]);
        let mut state = self.moved(way, free_axes, dt_s);
        let variance = settings.hit_sigma_mps.powi(2);
        for axis in 0..free_axes {
            state.covariance[(axis + 3, axis + 3)] += variance;
            if to == HITS[0] {
                // The hit is at a moment that is uniformly distributed.
                state.covariance[(axis, axis)] += variance * dt_s * dt_s / 3.0;
                state.covariance[(axis, axis + 3)] += variance * dt_s / 2.0;
                state.covariance[(axis + 3, axis)] += variance * dt_s / 2.0;
            }
        }
        state
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
}

/// Modes of less weight than this do not count.
pub(crate) const NO_WEIGHT: f64 = 1e-12;

/// Turns logarithms into weights that sum to one, times factors.
pub(crate) fn normalized<const ROWS: usize, const COLUMNS: usize>(
    logs: &SMatrix<f64, ROWS, COLUMNS>,
    factors: &SMatrix<f64, ROWS, COLUMNS>,
) -> SMatrix<f64, ROWS, COLUMNS> {
    let possible = logs
        .iter()
        .zip(factors)
        .filter(|(_, factor)| **factor > 0.0);
    let most = possible.fold(f64::NEG_INFINITY, |most, (log, _)| most.max(*log));
    if most == f64::NEG_INFINITY {
        return *factors / factors.sum().max(f64::MIN_POSITIVE);
    }
    let weights = logs.zip_map(factors, |log, factor| {
        if factor > 0.0 {
            factor * libm::exp(log - most)
        } else {
            0.0
        }
    });
    let sum: f64 = weights.sum();
    weights / sum
}

impl Mixture {
    /// The mixture of a target of which this is known.
    pub(crate) fn begun(start: &GaussianStart, settings: &ModeSettings) -> Self {
        let mut state = Gaussian {
            mean: Vector6::zeros(),
            covariance: Matrix6::zeros(),
        };
        for axis in 0..3 {
            state.mean[axis] = start.position_m[axis];
        }
        for axis in 0..settings.free_axes() {
            state.mean[axis + 3] = start.velocity_mps[axis];
            let velocity_variance = start.velocity_sigma_mps[axis].powi(2);
            state.covariance[(axis + 3, axis + 3)] = velocity_variance;
        }
        let of_position = covariance_matrix(start.covariance_m2);
        let mut block = state.covariance.fixed_view_mut::<3, 3>(0, 0);
        block.copy_from(&of_position);
        Self {
            modes: [state; MODES],
            weights: settings.shares(),
        }
    }

    /// The mixture at the first measurement.
    pub(crate) fn measured(
        (position_m, covariance_m2): ([f64; 3], [f64; 6]),
        settings: &ModeSettings,
    ) -> Self {
        let start = GaussianStart {
            position_m,
            covariance_m2,
            velocity_mps: [0.0; 3],
            velocity_sigma_mps: [settings.velocity_sigma_mps; 3],
        };
        Self::begun(&start, settings)
    }

    /// Moves the mixture on, and updates it with what was measured then. The hypotheses of a mode are merged once their step has been measured: what a hit would explain badly is
    /// then gone.
    pub(crate) fn next(
        &self,
        measured: Option<([f64; 3], [f64; 6])>,
        dt_s: f64,
        settings: &ModeSettings,
    ) -> (Self, Transition) {
        let transition = settings.transition(dt_s);
        let chances = SMatrix::from_fn(|from, to| self.weights[from] * transition[(from, to)]);
        let predicted: [[Gaussian; MODES]; MODES] = std::array::from_fn(|from| {
            std::array::from_fn(|to| self.modes[from].predicted((from, to), settings, dt_s))
        });
        let mut updated = predicted;
        let mut weights: SMatrix<f64, MODES, MODES> = chances;
        if let Some((position_m, covariance_m2)) = measured {
            let covariance_m2 = covariance_matrix(covariance_m2);
            let mut logs = SMatrix::zeros();
            for (from, states) in updated.iter_mut().enumerate() {
                for (to, state) in states.iter_mut().enumerate() {
                    (*state, logs[(from, to)]) = state.updated(position_m, &covariance_m2);
                }
            }
            weights = normalized(&logs, &chances);
        }
        let of_modes: SVector<f64, MODES> = weights.row_sum().transpose();
        let modes = std::array::from_fn(|to| {
            if of_modes[to] < NO_WEIGHT {
                return predicted[to][to];
            }
            merged((0..MODES).map(|from| (weights[(from, to)] / of_modes[to], updated[from][to])))
        });
        let next = Self {
            modes,
            weights: of_modes / of_modes.sum(),
        };
        let transition = Transition {
            predicted,
            chances,
            dt_s,
        };
        (next, transition)
    }

    pub(crate) fn state(&self) -> ModeState {
        let all = merged((0..MODES).map(|mode| (self.weights[mode], self.modes[mode])));
        ModeState {
            position_m: [0, 1, 2].map(|axis| all.mean[axis]),
            velocity_mps: [3, 4, 5].map(|axis| all.mean[axis]),
            covariance_m2: entries_of(&all.covariance, 0),
            velocity_covariance_m2ps2: entries_of(&all.covariance, 3),
            modes: [
                self.weights[0],
                self.weights[1],
                self.weights[2],
                HITS.map(|hit| self.weights[hit]).iter().sum(),
            ],
        }
    }
}

/// Steps are at least this long, seconds: covariances stay positive.
pub(crate) const LEAST_STEP_S: f64 = 1e-9;

/// Finds out frame by frame in which way a target moves, and how fast.
///
/// ```
/// use pardalis_filter::modes::{ModeFilter, ModeSettings};
///
/// // A ball rolls at 1 m/s along x; its positions are measured with a standard deviation of 1 cm.
/// let mut filter = ModeFilter::new(ModeSettings::default());
/// for frame in 0..25 {
///     let time_s = 0.04 * f64::from(frame);
///     let covariance_m2 = [1e-4, 0.0, 0.0, 1e-4, 0.0, 1e-4];
///     filter.observe(time_s, ([time_s, 0.0, 0.11], covariance_m2));
/// }
/// let state = filter.estimate(0.96).unwrap();
/// assert!((state.velocity_mps[0] - 1.0).abs() < 0.01);
/// assert!(state.velocity_covariance_m2ps2[0].sqrt() < 0.3);
/// // It most likely rolls, rather than being moved, flying or having been hit.
/// assert!(state.modes[0] > 0.5);
/// ```
#[derive(Debug, Clone)]
pub struct ModeFilter {
    settings: ModeSettings,
    /// What is known, and since when, in seconds.
    latest: Option<(f64, Mixture)>,
}

impl ModeFilter {
    /// A filter that knows nothing yet. At least one way to move must have a share.
    pub fn new(settings: ModeSettings) -> Self {
        Self {
            settings,
            latest: None,
        }
    }

    /// Forgets everything.
    pub fn reset(&mut self) {
        self.latest = None;
    }

    /// Forgets everything, and begins with what is known at a time in seconds.
    pub fn begin(&mut self, time_s: f64, start: &GaussianStart) {
        self.latest = Some((time_s, Mixture::begun(start, &self.settings)));
    }

    /// Takes a position in metres and its covariance (xx, xy, xz, yy, yz, zz in m²), measured at a time in seconds. Times must not decrease.
    pub fn observe(&mut self, time_s: f64, position: ([f64; 3], [f64; 6])) {
        let next = match &self.latest {
            Some((before_s, mixture)) => {
                let dt_s = (time_s - before_s).max(LEAST_STEP_S);
                mixture.next(Some(position), dt_s, &self.settings).0
            }
            None => Mixture::measured(position, &self.settings),
        };
        self.latest = Some((time_s, next));
    }

    /// The state at a time in seconds, the latest or later; `None` before [`begin`](Self::begin) or the first measured position.
    ///
    /// After the latest measurement the target is taken to go on in the same way. What may hit it meanwhile makes its velocity less certain, and does not change it.
    pub fn estimate(&self, time_s: f64) -> Option<ModeState> {
        let (latest_s, mixture) = self.latest.as_ref()?;
        let dt_s = time_s - latest_s;
        if dt_s <= 0.0 {
            return Some(mixture.state());
        }
        // The second moments of hits at random times.
        let of_hits_m2ps3 = self.settings.hit_rate_hz * self.settings.hit_sigma_mps.powi(2);
        let mut ahead = *mixture;
        for (mode, state) in ahead.modes.iter_mut().enumerate() {
            let mut way = *self.settings.ways.get(mode).unwrap_or(&AFTER_A_HIT);
            way.density_m2ps3 += of_hits_m2ps3;
            *state = state.moved(&way, self.settings.free_axes(), dt_s);
        }
        Some(ahead.state())
    }
}

/// How a target is taken to go on that has just been hit, until it is seen: as one that somebody moves.
const AFTER_A_HIT: Way = Way {
    acceleration_mps2: [0.0; 3],
    density_m2ps3: 5.0,
    leave_hz: 0.0,
    share: 0.0,
};

#[cfg(test)]
mod tests;
