//! Drawing and weighting of new particles from predictions and measurement components.

use super::proposal::{Prediction, log_add};
use super::{BernoulliFilter, GOLDEN, Hypothesis, Prior, write};
use crate::resample;
use pardalis_core::rng::Stage;

impl BernoulliFilter {
    /// Draws as many new particles as there is room for. Their log-weights are the logarithm of prior density, including existence, over proposal
    /// density.
    pub(super) fn draw_new(&mut self, prior: &Prior) {
        let (draws, observation) = (self.draws, self.observation);
        let dt_s = self.pending_s;
        let free_axes = self.settings.motion.free_axes();
        let (old_count, count) = (self.weights.len(), self.new_hypotheses.len());
        let resample_below = self.settings.proposal.resample_below;
        let is_depleted =
            count != old_count || self.effective_sample_size() <= resample_below * old_count as f64;
        if is_depleted {
            let uniform = |_| draws.uniform(0, observation, Stage::Resampling);
            resample::systematic(&self.weights, uniform, &mut self.ancestors);
        }
        let log_located = libm::log(prior.located);
        let log_elsewhere = if self.proposal.is_empty() {
            f64::NEG_INFINITY
        } else {
            libm::log(prior.elsewhere) + libm::log(self.settings.birth_density)
        };
        let height_m = self.proposal.height_m();
        let ways = self.ways(dt_s);
        let log_even_weight = -libm::log(count as f64);
        let offset = draws.uniform(count as u32, observation, Stage::Proposal);
        for i in 0..count {
            let (ancestor, log_weight) = if is_depleted {
                (self.ancestors[i] as usize, log_even_weight)
            } else {
                (i, libm::log(self.weights[i]))
            };
            let before = &self.hypotheses[ancestor];
            let way = ways.of_particle(i);
            let step = way.kinematics.step(before.velocity_variance_m2ps2, dt_s);
            let mut prediction = Prediction {
                mean_m: before.ahead(dt_s),
                variance_m2: step.variance_m2,
            };
            if let (true, Some(height_m)) = (free_axes == 2, height_m) {
                prediction.mean_m[2] = height_m;
            }
            let particle = i as u32;
            let [x, y, z, _] = draws.normals(particle, observation, Stage::Motion, 0);
            let normals = [x, y, z].map(f64::from);
            let share = (offset + i as f64 * GOLDEN).fract();
            let (position_m, log_proposal) = self.proposal.draw(&prediction, share, normals);

            let log_continued = log_located + prediction.log_density(position_m, free_axes);
            let log_prior = log_add(log_continued, log_elsewhere);
            self.new_particles.log_weights[i] =
                log_weight + way.log_correction + log_prior - log_proposal;

            let chance = libm::exp(log_elsewhere - log_prior);
            let was_elsewhere = draws.uniform(particle, observation, Stage::Proposal) < chance;
            self.new_hypotheses[i] = if was_elsewhere {
                self.born_at(position_m)
            } else {
                let mut velocity_mps = before.velocity_mps;
                for axis in 0..free_axes {
                    velocity_mps[axis] +=
                        step.gain_hz * (position_m[axis] - prediction.mean_m[axis]);
                }
                Hypothesis {
                    position_m,
                    velocity_mps,
                    velocity_variance_m2ps2: step.velocity_variance_m2ps2,
                }
            };
        }
        write(&self.new_hypotheses, &mut self.new_particles);
    }

    /// Returns a target that appeared or was relocated at a position.
    pub(super) fn born_at(&self, position_m: [f64; 3]) -> Hypothesis {
        let mut born = Hypothesis {
            position_m,
            ..Hypothesis::default()
        };
        if self.kinematics.has_velocity() {
            born.velocity_variance_m2ps2 = self.settings.birth_velocity_sigma_mps.powi(2);
        }
        born
    }

    /// Multiplies the new weights by the likelihood ratios and normalises them. Returns the logarithm of their sum;
    /// -∞ if all are impossible.
    pub(super) fn weight_new(&mut self) -> f64 {
        let log_weights = &mut self.new_particles.log_weights;
        for (log_weight, &log_ratio) in log_weights.iter_mut().zip(&self.log_ratios) {
            // With +∞, weights could not be compared.
            *log_weight += f64::from(log_ratio.min(f32::MAX));
            if log_ratio.is_nan() {
                *log_weight = f64::NEG_INFINITY;
            }
        }
        self.normalise_new()
    }

    /// Normalises the new weights; those that are no numbers are impossible. Returns the logarithm of their sum; -∞ if all are impossible.
    pub(super) fn normalise_new(&mut self) -> f64 {
        let log_weights = &mut self.new_particles.log_weights;
        let mut greatest = f64::NEG_INFINITY;
        for log_weight in log_weights.iter_mut() {
            if log_weight.is_nan() {
                *log_weight = f64::NEG_INFINITY;
            }
            greatest = greatest.max(*log_weight);
        }
        if greatest == f64::NEG_INFINITY {
            return greatest;
        }
        let terms = log_weights.iter().map(|log| libm::exp(log - greatest));
        let log_sum = libm::log(terms.sum());
        for log_weight in log_weights {
            *log_weight = *log_weight - greatest - log_sum;
        }
        greatest + log_sum
    }
}
