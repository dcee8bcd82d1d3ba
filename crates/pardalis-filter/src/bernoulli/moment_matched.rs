//! A second proposal, used if few particles agree with the images. The particles of an occluded target spread until
//! they are farther apart than the precision of an image, so that none of them predicts the position at which the
//! target reappears. The predictions of all particles are then replaced by two Gaussians with their moments, one
//! with a velocity jump and one without (a Gaussian sum particle filter: Kotecha and Djurić 2003).

use nalgebra::{Matrix3, Vector3};

use super::proposal::log_add;
use super::ways::Way;
use super::{BernoulliFilter, GOLDEN, Hypothesis, Prior, write};
use pardalis_core::rng::Stage;

/// The moment-matched prediction of all particles if they move in one way.
struct Predicted {
    /// The logarithm of the probability of this way.
    log_chance: f64,
    mean_m: Vector3<f64>,
    /// The Cholesky factor of the position's covariance, and its inverse.
    factor_m: Matrix3<f64>,
    whitening: Matrix3<f64>,
    log_height: f64,
    velocity_mps: Vector3<f64>,
    /// The regression of the mean velocity on the position, 1/s, and the variance of the velocity given the
    /// position, on each axis.
    gain_hz: Matrix3<f64>,
    velocity_variance_m2ps2: f64,
}

impl Predicted {
    /// Returns the logarithm of its density times its probability, per m³ (per m² in a plane).
    fn log_density(&self, position_m: [f64; 3]) -> f64 {
        let off = self.whitening * (Vector3::from(position_m) - self.mean_m);
        self.log_chance + self.log_height - 0.5 * off.norm_squared()
    }

    fn draw(&self, normals: [f64; 3]) -> [f64; 3] {
        (self.mean_m + self.factor_m * Vector3::from(normals)).into()
    }

    /// Returns a target at a position, with the velocity predicted for it.
    fn at(&self, position_m: [f64; 3]) -> Hypothesis {
        let off_m = Vector3::from(position_m) - self.mean_m;
        Hypothesis {
            position_m,
            velocity_mps: (self.velocity_mps + self.gain_hz * off_m).into(),
            velocity_variance_m2ps2: self.velocity_variance_m2ps2,
        }
    }
}

impl BernoulliFilter {
    /// Reports whether the effective sample size of the new particles is too small and that of the old ones was not:
    /// otherwise the distribution may have several modes, which moments do not describe.
    pub(super) fn agrees_too_little(&self, prior: &Prior) -> bool {
        let share = self.settings.proposal.min_effective_share;
        let log_weights = self.new_particles.log_weights.iter();
        let squares: f64 = log_weights.map(|log| libm::exp(2.0 * log)).sum();
        let is_thin = squares * share * self.new_particles.count() as f64 > 1.0
            && self.effective_sample_size() > share * self.weights.len() as f64;
        is_thin && prior.located > 0.0 && !self.proposal.is_empty()
    }

    /// Draws as many new particles as allowed from births and from the moment-matched prediction, with log-weights of prior
    /// density over proposal density. Returns `false` if all particles predict the same position; nothing changes then.
    pub(super) fn draw_moment_matched(&mut self, prior: &Prior) -> bool {
        let ways = self.ways(self.pending_s);
        let Some(steady) = self.predicted(&ways.steady) else {
            return false;
        };
        let jumped = ways.jumped.and_then(|jumped| self.predicted(&jumped));
        let count = self.settings.particles.max;
        self.resize_new(count);
        let (draws, observation) = (self.draws, self.observation);
        let log_located = libm::log(prior.located);
        let log_elsewhere = libm::log(prior.elsewhere) + libm::log(self.settings.birth_density);
        let births = self.settings.proposal.moment_matched_birth_share;
        let offset = draws.uniform(count as u32, observation, Stage::Moments);
        for i in 0..count {
            let particle = i as u32;
            let [which, from, elsewhere, _] = draws.uniforms(particle, observation, Stage::Moments);
            let [x, y, z, _] = draws.normals(particle, observation, Stage::Motion, 1);
            let normals = [x, y, z].map(f64::from);
            let position_m = if (offset + i as f64 * GOLDEN).fract() < births {
                self.proposal.draw_birth(which, normals)
            } else {
                let chance = libm::exp(steady.log_chance);
                let from = jumped.as_ref().filter(|_| which >= chance);
                from.unwrap_or(&steady).draw(normals)
            };
            let log_steady = steady.log_density(position_m);
            let log_jumped = jumped.as_ref().map(|jumped| jumped.log_density(position_m));
            let log_predicted = log_jumped.map_or(log_steady, |log| log_add(log_steady, log));
            let log_prior = log_add(log_located + log_predicted, log_elsewhere);
            let log_proposal = log_add(
                libm::log(births) + self.proposal.log_birth_density(position_m),
                libm::log(1.0 - births) + log_predicted,
            );
            self.new_particles.log_weights[i] = log_prior - log_proposal - libm::log(count as f64);
            self.new_hypotheses[i] = if elsewhere < libm::exp(log_elsewhere - log_prior) {
                self.born_at(position_m)
            } else {
                let has_jumped = from >= libm::exp(log_steady - log_predicted);
                let from = jumped.as_ref().filter(|_| has_jumped);
                from.unwrap_or(&steady).at(position_m)
            };
        }
        write(&self.new_hypotheses, &mut self.new_particles);
        true
    }

    /// Computes the moments of the predictions of all particles if they move in one way.
    fn predicted(&self, way: &Way) -> Option<Predicted> {
        let dt_s = self.pending_s;
        let free_axes = self.settings.motion.free_axes();
        let weighted = || self.hypotheses.iter().zip(&self.weights);
        let (mut mean_m, mut velocity_mps) = (Vector3::zeros(), Vector3::zeros());
        for (before, &weight) in weighted() {
            mean_m += Vector3::from(before.ahead(dt_s)) * weight;
            velocity_mps += Vector3::from(before.velocity_mps) * weight;
        }
        let (mut xx, mut vx, mut vv) = (Matrix3::zeros(), Matrix3::zeros(), Matrix3::zeros());
        for (before, &weight) in weighted() {
            let x = Vector3::from(before.ahead(dt_s)) - mean_m;
            let v = Vector3::from(before.velocity_mps) - velocity_mps;
            let step = way.kinematics.step(before.velocity_variance_m2ps2, dt_s);
            let own = Matrix3::identity() * step.variance_m2;
            let velocity_variance =
                step.velocity_variance_m2ps2 + step.gain_hz.powi(2) * step.variance_m2;
            xx += (x * x.transpose() + own) * weight;
            vx += (v * x.transpose() + own * step.gain_hz) * weight;
            vv += (v * v.transpose() + Matrix3::identity() * velocity_variance) * weight;
        }
        if free_axes == 2 {
            // In a plane, the height is that of the components and carries no information.
            for axis in 0..3 {
                for matrix in [&mut xx, &mut vx, &mut vv] {
                    matrix[(axis, 2)] = 0.0;
                    matrix[(2, axis)] = 0.0;
                }
            }
            xx[(2, 2)] = 1.0;
            mean_m.z = self.proposal.height_m().unwrap_or(mean_m.z);
        }
        let factor_m = xx.cholesky()?.l();
        let mut whitening = factor_m.try_inverse()?;
        let gain_hz = vx * whitening.transpose() * whitening;
        let rest = vv - gain_hz * vx.transpose();
        let log_volume = 0.5 * free_axes as f64 * libm::log(std::f64::consts::TAU)
            + libm::log(factor_m.determinant());
        let mut drawn_m = factor_m;
        if free_axes == 2 {
            // Components may differ in height; all heights are equally likely.
            drawn_m[(2, 2)] = 0.0;
            whitening[(2, 2)] = 0.0;
        }
        Some(Predicted {
            log_chance: libm::log(way.chance),
            mean_m,
            factor_m: drawn_m,
            whitening,
            log_height: -log_volume,
            velocity_mps,
            gain_hz,
            velocity_variance_m2ps2: (rest.trace() / free_axes as f64).max(0.0),
        })
    }
}
