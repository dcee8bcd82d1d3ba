//! A second proposal, used if few particles agree with the images. The particles of an occluded target spread until
//! they are farther apart than the precision of an image, so that none of them predicts the position at which the
//! target reappears. The predictions of all particles are then replaced by three Gaussians with their moments: of targets that are
//! lively, of calm ones, and of those with a velocity jump (a Gaussian sum particle filter: Kotecha and Djurić 2003).

use nalgebra::{Matrix3, Vector3};

use super::proposal::log_add;
use super::ways::Way;
use super::{BernoulliFilter, GOLDEN, Hypothesis, Prior, write};
use pardalis_core::rng::Stage;

/// The moment-matched prediction of particles that move in one way.
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
    /// Whether the target is calm after the step.
    is_calm: bool,
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
            is_calm: self.is_calm,
        }
    }
}

/// Returns the first prediction up to which the probabilities sum to more than `uniform`, else the last that is possible.
fn chosen(
    predicted: &[Option<Predicted>],
    mut chance: impl FnMut(&Predicted) -> f64,
    uniform: f64,
) -> Option<&Predicted> {
    let mut sum = 0.0;
    let mut possible = predicted.iter().flatten();
    let last = possible.clone().next_back();
    let found = possible.find(|predicted| {
        sum += chance(predicted);
        uniform < sum
    });
    found.or(last)
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
        let ways = ways.each_ref();
        let predicted = [
            self.predicted(ways.map(|ways| ways.steady(false))),
            self.predicted(ways.map(|ways| ways.steady(true))),
            self.predicted(ways.map(|ways| &ways.jumped)),
        ];
        if predicted.iter().all(Option::is_none) {
            return false;
        }
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
                let from = chosen(&predicted, |one| libm::exp(one.log_chance), which);
                from.map_or([f64::NAN; 3], |from| from.draw(normals))
            };
            let densities = predicted.iter().flatten();
            let densities = densities.map(|one| one.log_density(position_m));
            let log_predicted = densities.fold(f64::NEG_INFINITY, log_add);
            let log_prior = log_add(log_located + log_predicted, log_elsewhere);
            let log_proposal = log_add(
                libm::log(births) + self.proposal.log_birth_density(position_m),
                libm::log(1.0 - births) + log_predicted,
            );
            self.new_particles.log_weights[i] = log_prior - log_proposal - libm::log(count as f64);
            self.new_hypotheses[i] = if elsewhere < libm::exp(log_elsewhere - log_prior) {
                self.born_at(position_m)
            } else {
                let share =
                    |one: &Predicted| libm::exp(one.log_density(position_m) - log_predicted);
                let from = chosen(&predicted, share, from);
                from.map_or_else(|| self.born_at(position_m), |from| from.at(position_m))
            };
        }
        write(&self.new_hypotheses, &mut self.new_particles);
        true
    }

    /// Computes the moments of the predictions of particles that move in one way, which is given for lively ones and for calm ones. `None` if it is impossible.
    fn predicted(&self, ways: [&Way; 2]) -> Option<Predicted> {
        let dt_s = self.pending_s;
        let free_axes = self.settings.motion.free_axes();
        let hypotheses = self.hypotheses.iter().zip(&self.weights);
        let [lively, calm] = ways.map(|way| way.chance);
        let chance = lively + self.calm_chance() * (calm - lively);
        if chance <= 0.0 {
            return None;
        }
        let weighted = || {
            hypotheses.clone().map(|(before, weight)| {
                let way = ways[usize::from(before.is_calm)];
                (before, weight * (way.chance / chance), way.kinematics)
            })
        };
        let (mut mean_m, mut velocity_mps) = (Vector3::zeros(), Vector3::zeros());
        for (before, weight, _) in weighted() {
            mean_m += Vector3::from(before.ahead(dt_s)) * weight;
            velocity_mps += Vector3::from(before.velocity_mps) * weight;
        }
        let (mut xx, mut vx, mut vv) = (Matrix3::zeros(), Matrix3::zeros(), Matrix3::zeros());
        for (before, weight, kinematics) in weighted() {
            let x = Vector3::from(before.ahead(dt_s)) - mean_m;
            let v = Vector3::from(before.velocity_mps) - velocity_mps;
            let step = kinematics.step(before.velocity_variance_m2ps2, dt_s);
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
            log_chance: libm::log(chance),
            mean_m,
            factor_m: drawn_m,
            whitening,
            log_height: -log_volume,
            velocity_mps,
            gain_hz,
            velocity_variance_m2ps2: (rest.trace() / free_axes as f64).max(0.0),
            is_calm: ways[0].is_calm,
        })
    }
}
