//! The update with a measurement of another sensor: a Kalman update of the particles' moments.
//!
//! Such a measurement says little about most of the state: a range, nothing across. If particles were weighted by it, their scatter across would be lost by and by. The
//! prediction of position and velocity is therefore taken for Gaussian (Kotecha and Djurić 2003, "Gaussian particle filtering"), and the particles are moved so that they have
//! the mean and the covariance of the Kalman filter, which is extended to second order where the measurement is not linear.

use nalgebra::{Matrix3, Matrix3x6, Matrix6, Vector3, Vector6};

use super::{BernoulliFilter, Hypothesis, write};
use crate::estimate::covariance_matrix;
use crate::gaussian::GaussianStart;
use crate::measurement::Measurement;
use crate::resample;
use pardalis_core::rng::Stage;

/// The squared Mahalanobis distances beyond which a measurement of one, two and three numbers is an outlier. Derivation: the 99.9 % quantiles of chi-square.
const GATES: [f64; 3] = [10.828, 13.816, 16.266];

/// How old a measurement may be, seconds. Hand-set: by then a thrown body is where its velocity leads to a few centimetres.
pub const MAX_AGO_S: f64 = 0.1;

/// Times this close are the same, seconds. Derivation: rounding of times of years.
const SAME_TIME_S: f64 = 1e-6;

/// What became of a measurement.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Measured {
    /// It was used.
    Used,
    /// It is an outlier, and was not used: it is further from the prediction than one in a thousand.
    Rejected,
    /// It is too old, and was not used.
    Late,
    /// There is no target that it could be compared with.
    NoTarget,
}

/// Mean and covariance of position and velocity.
struct Moments {
    mean: Vector6<f64>,
    covariance: Matrix6<f64>,
}

impl Moments {
    fn position_m(&self) -> Vector3<f64> {
        self.mean.fixed_rows::<3>(0).into()
    }

    fn velocity_mps(&self) -> Vector3<f64> {
        self.mean.fixed_rows::<3>(3).into()
    }

    fn position_m2(&self) -> Matrix3<f64> {
        self.covariance.fixed_view::<3, 3>(0, 0).into()
    }

    /// Returns the regression of the velocity on the position, 1/s, and its covariance given the position.
    fn velocity_given_position(&self) -> Option<(Matrix3<f64>, Matrix3<f64>)> {
        let both: Matrix3<f64> = self.covariance.fixed_view::<3, 3>(3, 0).into();
        let own: Matrix3<f64> = self.covariance.fixed_view::<3, 3>(3, 3).into();
        let gain_hz = both * self.position_m2().cholesky()?.inverse();
        Some((gain_hz, own - gain_hz * both.transpose()))
    }
}

/// How the particles move to the moments after a measurement.
struct Transport {
    before: Moments,
    after: Moments,
    /// The regressions of the velocity on the position.
    gains_hz: [Matrix3<f64>; 2],
    /// By how much the variance of the velocity given the position falls on each axis at least, ...
    kept: f64,
    /// ... and its sampler of what is left beyond that.
    excess: GaussianStart,
}

impl Transport {
    fn new(before: Moments, after: Moments, free: &Matrix3<f64>) -> Option<Self> {
        let (gain_before, velocity_before) = before.velocity_given_position()?;
        let (gain_after, velocity_after) = after.velocity_given_position()?;
        let held = Matrix3::identity() - free;
        let whitening = (velocity_before + held)
            .cholesky()
            .and_then(|factor| factor.l().try_inverse());
        let kept = whitening.map_or(1.0, |whitening| {
            let share = whitening * (velocity_after + held) * whitening.transpose();
            share.symmetric_eigenvalues().min().clamp(0.0, 1.0)
        });
        let excess = velocity_after - kept * velocity_before;
        Some(Self {
            before,
            after,
            gains_hz: [gain_before, gain_after],
            kept,
            excess: GaussianStart {
                covariance_m2: entries(&(free * excess * free)),
                ..GaussianStart::default()
            },
        })
    }
}

fn entries(matrix: &Matrix3<f64>) -> [f64; 6] {
    [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)].map(|at| matrix[at])
}

impl BernoulliFilter {
    /// Updates position and velocity with a measurement of another sensor, made `ago_s` seconds, at least 0, before the predicted time. The time of the measurement itself
    /// is not looked at.
    ///
    /// `shared_m2` (xx, xy, xz, yy, yz, zz in m²) is the covariance of what else the predicted position may be off, such as errors that all images share; it widens the gate.
    ///
    /// Outliers change nothing. The measurement says where the target is if it exists, and not whether it does: existence stays as predicted.
    ///
    /// Of the past are at most measurements of the last [`MAX_AGO_S`], and none of velocities. How the target may have accelerated since then is taken for another error of the
    /// measurement, as if the images had said nothing of it.
    pub fn measure(
        &mut self,
        measurement: &Measurement,
        ago_s: f64,
        shared_m2: [f64; 6],
    ) -> Measured {
        if self.located() == 0.0 {
            return Measured::NoTarget;
        }
        let ago_s = if ago_s > SAME_TIME_S { ago_s } else { 0.0 };
        if ago_s > MAX_AGO_S || measurement.is_of_velocity() && ago_s > 0.0 {
            return Measured::Late;
        }
        self.predicted.take();
        let is_planar = self.settings.motion.is_planar();
        let free = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, f64::from(!is_planar)));
        let measurement = if is_planar {
            measurement.in_plane()
        } else {
            *measurement
        };
        let before = self.moments(&free);
        let after = self.conditioned(&before, (&measurement, ago_s), &shared_m2, &free);
        let Some(transport) = after.and_then(|after| Transport::new(before, after, &free)) else {
            return Measured::Rejected;
        };
        self.observation = self.observation.wrapping_add(1);
        self.draw_predicted();
        self.normalise_new();
        self.transport(&transport, &free);
        self.existence = self.existence();
        self.pending_s = 0.0;
        self.log_ratios.fill(0.0);
        self.take_new();
        Measured::Used
    }

    /// The moments of the prediction. An axis along which the target does not move has the variance 1 and no covariance.
    fn moments(&self, free: &Matrix3<f64>) -> Moments {
        let dt_s = self.pending_s;
        let state = |hypothesis: &Hypothesis| {
            let [x, y, z] = hypothesis.ahead(dt_s);
            let [u, v, w] = hypothesis.velocity_mps;
            Vector6::new(x, y, z, u, v, w)
        };
        let particles = || self.hypotheses.iter().zip(&self.weights);
        let mean: Vector6<f64> = particles().map(|(h, &weight)| weight * state(h)).sum();
        let mut covariance = Matrix6::zeros();
        let [mut place_m2, mut both, mut velocity_m2ps2] = [0.0; 3];
        // Moments of a mixture are those of its mean noise, since they are linear in it.
        let noise = self.kinematics.noise();
        let excess = self.ways(dt_s).jumped.map_or(0.0, |jumped| {
            jumped.chance * (jumped.kinematics.noise() - noise)
        });
        let kinematics = self.kinematics.with_noise(noise + excess);
        for (hypothesis, &weight) in particles() {
            let off = state(hypothesis) - mean;
            covariance += weight * off * off.transpose();
            let step = kinematics.step(hypothesis.velocity_variance_m2ps2, dt_s);
            let own_m2 = weight * step.variance_m2;
            place_m2 += own_m2;
            both += step.gain_hz * own_m2;
            velocity_m2ps2 += step.gain_hz.powi(2) * own_m2 + weight * step.velocity_variance_m2ps2;
        }
        let held = Matrix3::identity() - free;
        for (at, variance) in [
            ((0, 0), place_m2),
            ((0, 3), both),
            ((3, 0), both),
            ((3, 3), velocity_m2ps2),
        ] {
            let mut block = covariance.fixed_view_mut::<3, 3>(at.0, at.1);
            let moved = block.clone_owned() + variance * free;
            block.copy_from(&(free * moved * free));
            if at == (0, 0) {
                block += held;
            }
        }
        Moments { mean, covariance }
    }

    /// Conditions the prediction on a measurement made some seconds before; `None` if that is an outlier.
    fn conditioned(
        &self,
        before: &Moments,
        (measurement, ago_s): (&Measurement, f64),
        shared_m2: &[f64; 6],
        free: &Matrix3<f64>,
    ) -> Option<Moments> {
        let velocity_mps = before.velocity_mps();
        let then_m = before.position_m() - ago_s * velocity_mps;
        let innovation = measurement.innovation(&then_m, &velocity_mps);
        let by_position = innovation.by_position * free;
        let by_velocity = (innovation.by_velocity - ago_s * innovation.by_position) * free;
        let mut by = Matrix3x6::zeros();
        by.fixed_view_mut::<3, 3>(0, 0).copy_from(&by_position);
        by.fixed_view_mut::<3, 3>(0, 3).copy_from(&by_velocity);
        let spread_m2 = (free * before.position_m2()).symmetric_eigenvalues().max();
        let (bend, bends) = measurement.bend(&then_m, spread_m2);
        let off = innovation.off - bend;
        // The target may have accelerated since.
        let moved_m2 = self.kinematics.variance_m2(0.0, ago_s);
        let noise = measurement.noise() + bends + moved_m2 * by_position * by_position.transpose();
        let expected: Matrix3<f64> = by * before.covariance * by.transpose() + noise;
        let shared = covariance_matrix(*shared_m2);
        let allowed = expected + by_position * shared * by_position.transpose();
        let gate = GATES[measurement.dimensions().clamp(1, GATES.len()) - 1];
        let squared = off.dot(&allowed.cholesky()?.solve(&off));
        if !(squared <= gate) {
            return None;
        }
        let gain = before.covariance * by.transpose() * expected.cholesky()?.inverse();
        // Joseph form: positive semidefinite in spite of rounding.
        let rest = Matrix6::identity() - gain * by;
        let after = rest * before.covariance * rest.transpose() + gain * noise * gain.transpose();
        Some(Moments {
            mean: before.mean + gain * off,
            covariance: 0.5 * (after + after.transpose()),
        })
    }

    /// Draws each new particle from the prediction of an old one.
    fn draw_predicted(&mut self) {
        let (draws, observation, dt_s) = (self.draws, self.observation, self.pending_s);
        let free_axes = self.settings.motion.free_axes();
        let count = self.weights.len();
        self.resize_new(count);
        let tuning = self.settings.proposal;
        let is_depleted = self.effective_sample_size() <= tuning.resample_below * count as f64;
        if is_depleted {
            let uniform = |_| draws.uniform(0, observation, Stage::Resampling);
            resample::systematic(&self.weights, uniform, &mut self.ancestors);
        }
        let ways = self.ways(dt_s);
        for i in 0..count {
            let (ancestor, log_weight) = if is_depleted {
                (self.ancestors[i] as usize, -libm::log(count as f64))
            } else {
                (i, libm::log(self.weights[i]))
            };
            let before = &self.hypotheses[ancestor];
            let way = ways.of_particle(i);
            let step = way.kinematics.step(before.velocity_variance_m2ps2, dt_s);
            let normals = draws.normals(i as u32, observation, Stage::Motion, 0);
            let mut position_m = before.ahead(dt_s);
            let mut velocity_mps = before.velocity_mps;
            for axis in 0..free_axes {
                let moved_m = step.variance_m2.sqrt() * f64::from(normals[axis]);
                position_m[axis] += moved_m;
                velocity_mps[axis] += step.gain_hz * moved_m;
            }
            self.new_hypotheses[i] = Hypothesis {
                position_m,
                velocity_mps,
                velocity_variance_m2ps2: step.velocity_variance_m2ps2,
            };
            self.new_particles.log_weights[i] = log_weight + way.log_correction;
        }
    }

    /// Moves the new particles so that they have the moments after a measurement.
    fn transport(&mut self, transport: &Transport, free: &Matrix3<f64>) {
        let Transport {
            before,
            after,
            gains_hz: [gain_before, gain_after],
            kept,
            excess,
        } = transport;
        let weighted = || {
            let log_weights = self.new_particles.log_weights.iter();
            let hypotheses = self.new_hypotheses.iter();
            hypotheses.zip(log_weights.map(|log| libm::exp(*log)))
        };
        // The particles drawn have these moments, and not quite those of the prediction.
        let (mut mean_m, mut velocity_mps) = (Vector3::zeros(), Vector3::zeros());
        for (hypothesis, weight) in weighted() {
            mean_m += weight * Vector3::from(hypothesis.position_m);
            velocity_mps += weight * Vector3::from(hypothesis.velocity_mps);
        }
        let mut drawn_m2 = Matrix3::identity() - free;
        for (hypothesis, weight) in weighted() {
            let off = free * (Vector3::from(hypothesis.position_m) - mean_m);
            drawn_m2 += weight * off * off.transpose();
        }
        let drawn = drawn_m2
            .cholesky()
            .or_else(|| before.position_m2().cholesky());
        let whitening = drawn.and_then(|factor| factor.l().try_inverse());
        let factor = after.position_m2().cholesky().map(|factor| factor.l());
        let (Some(whitening), Some(factor)) = (whitening, factor) else {
            return;
        };
        let scale = factor * whitening;
        let sampler = excess.sampler();
        let has_excess = excess.covariance_m2 != [0.0; 6];
        let (draws, observation) = (self.draws, self.observation);
        for (i, hypothesis) in self.new_hypotheses.iter_mut().enumerate() {
            let off_m = free * (Vector3::from(hypothesis.position_m) - mean_m);
            let moved_m = free * scale * off_m;
            let own = Vector3::from(hypothesis.velocity_mps) - velocity_mps - gain_before * off_m;
            let mut velocity = after.velocity_mps() + gain_after * moved_m + kept.sqrt() * own;
            if has_excess {
                let normals = draws.normals(i as u32, observation, Stage::Motion, 1);
                let [x, y, z, _] = normals.map(f64::from);
                velocity += Vector3::from(sampler([x, y, z]));
            }
            let place_m = after.position_m() + moved_m;
            *hypothesis = Hypothesis {
                // Rounding does not move what stays at its height.
                position_m: [0, 1, 2].map(|axis| {
                    let is_free = free[(axis, axis)] > 0.0;
                    [hypothesis.position_m, place_m.into()][usize::from(is_free)][axis]
                }),
                velocity_mps: (free * velocity).into(),
                velocity_variance_m2ps2: kept * hypothesis.velocity_variance_m2ps2,
            };
        }
        write(&self.new_hypotheses, &mut self.new_particles);
    }
}
