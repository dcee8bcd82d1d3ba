//! Particle filter of one target that is known to exist: predict, update, estimate and resample.

use crate::Likelihood;
use crate::StateEstimate;
use crate::gaussian::GaussianStart;
use crate::motion::{Motion, taylor};
use crate::particles::Particles;
use crate::resample::Resampling;
use crate::weighted::{add_scatter, heaviest, weight_within};
use pardalis_core::Error;
use pardalis_core::rng::{Draws, Stage};
use pardalis_core::simd::Level;

/// Largest number of particles of a filter.
pub const MAX_PARTICLES: usize = 1_000_000;

/// Settings of a particle filter.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct FilterSettings {
    /// The number of particles.
    pub particle_count: usize,
    /// Motion model.
    pub motion: Motion,
    /// Scheme that selects surviving particles.
    pub resampling: Resampling,
    /// The filter resamples when the effective sample size is at most this share of the number of
    /// particles. At 1 it resamples in every step, as the published trackers do.
    pub resample_below: f64,
}

impl Default for FilterSettings {
    /// 2000 particles with the default motion, resampled systematically at every step.
    fn default() -> Self {
        Self {
            particle_count: 2000,
            motion: Motion::DEFAULT,
            resampling: Resampling::Systematic,
            resample_below: 1.0,
        }
    }
}

impl FilterSettings {
    /// Checks the settings.
    fn check(&self) -> Result<(), Error> {
        if !(1..=MAX_PARTICLES).contains(&self.particle_count) {
            return Err(Error::out_of_range(
                "particles",
                self.particle_count,
                "1 to 1000000",
            ));
        }
        if !(self.resample_below > 0.0 && self.resample_below <= 1.0) {
            return Err(Error::out_of_range(
                "resample_below",
                self.resample_below,
                "above 0 and at most 1",
            ));
        }
        Ok(())
    }
}

/// Outcome of [`ParticleFilter::update`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Update {
    /// The weights now represent the posterior.
    Weighted,
    /// Every particle is impossible; the weights are unchanged.
    AllImpossible,
}

/// A particle filter. Repeated steps do not allocate memory.
#[derive(Debug)]
pub struct ParticleFilter {
    settings: FilterSettings,
    draws: Draws,
    level: Level,
    /// Index of the current observation, part of the counter of the random numbers.
    observation: u32,
    particles: Particles,
    /// Normalised weights: the exponentials of the log-weights.
    weights: Vec<f64>,
    /// Buffer in which resampling gathers survivors before it is swapped with `particles`.
    survivors: Particles,
    ancestors: Vec<u32>,
    cumulative: Vec<f64>,
    log_likelihoods: Vec<f32>,
}

impl ParticleFilter {
    /// Creates a filter and draws its particles from `start`.
    pub fn new(
        settings: FilterSettings,
        start: &GaussianStart,
        draws: Draws,
        level: Level,
    ) -> Result<Self, Error> {
        settings.check()?;
        start.check()?;
        let count = settings.particle_count;
        let columns = settings.motion.column_count();
        let mut filter = Self {
            settings,
            draws,
            level,
            observation: 0,
            particles: Particles::new(count, columns),
            weights: vec![1.0 / count as f64; count],
            survivors: Particles::new(count, columns),
            ancestors: vec![0; count],
            cumulative: vec![0.0; count],
            log_likelihoods: vec![0.0; count],
        };
        filter.restart(start);
        Ok(filter)
    }

    /// Redraws all particles from `start` with the random numbers of the current observation. In a
    /// plane, they start at its height without vertical velocity. Accelerations start at zero.
    pub fn restart(&mut self, start: &GaussianStart) {
        let start = &if self.settings.motion.is_planar() {
            start.in_plane()
        } else {
            *start
        };
        let has_velocity = self.settings.motion.orders() > 1;
        let position_of = start.sampler();
        for accelerations in self.particles.columns_mut().iter_mut().skip(6) {
            accelerations.fill(0.0);
        }
        for i in 0..self.particles.count() {
            let particle = i as u32;
            let [a, b] = [0, 1].map(|draw| {
                let [x, y, z, _] =
                    self.draws
                        .normals(particle, self.observation, Stage::Start, draw);
                [x, y, z].map(f64::from)
            });
            let columns = self.particles.columns_mut();
            for (axis, position_m) in position_of(a).into_iter().enumerate() {
                columns[axis][i] = position_m as f32;
            }
            if has_velocity {
                for axis in 0..3 {
                    columns[3 + axis][i] = (start.velocity_mps[axis]
                        + start.velocity_sigma_mps[axis] * b[axis])
                        as f32;
                }
            }
        }
        self.particles.reset_weights();
        self.weights.fill(1.0 / self.particles.count() as f64);
    }

    /// Redraws all particles from `start` as in [`ParticleFilter::restart`], but as a new
    /// observation and thus with fresh random numbers.
    pub fn start_over(&mut self, start: &GaussianStart) {
        self.observation += 1;
        self.restart(start);
    }

    /// Returns the index of the current observation, part of the counter of the random numbers.
    pub fn observation(&self) -> u32 {
        self.observation
    }

    /// Returns the motion model.
    pub fn motion(&self) -> &Motion {
        &self.settings.motion
    }

    /// Returns the particles.
    pub fn particles(&self) -> &Particles {
        &self.particles
    }

    /// Returns the weights, which sum to one.
    pub fn weights(&self) -> &[f64] {
        &self.weights
    }

    /// Returns the largest log-likelihood of the last update.
    pub fn best_log_likelihood(&self) -> f32 {
        self.log_likelihoods
            .iter()
            .copied()
            .fold(f32::NEG_INFINITY, f32::max)
    }

    /// Moves the particles to the time of the next observation, `dt_s` seconds later. Resamples
    /// first if the effective sample size is low.
    ///
    /// Resampling happens here and not after the update, so that estimates use the full weighted
    /// sample.
    pub fn predict(&mut self, dt_s: f64) {
        if self.effective_sample_size() <= self.settings.resample_below * self.weights.len() as f64
        {
            self.resample();
        }
        self.observation += 1;
        if dt_s > 0.0 {
            self.settings.motion.propagate(
                &mut self.particles,
                dt_s,
                self.draws,
                self.observation,
                self.level,
            );
        }
    }

    /// Multiplies the weights by the likelihoods and normalises them.
    pub fn update(&mut self, likelihood: &mut impl Likelihood) -> Update {
        likelihood.log_likelihoods(&self.particles, &mut self.log_likelihoods);
        let sum = |log_weight: f64, log_likelihood: f32| {
            let sum = log_weight + f64::from(log_likelihood);
            if sum.is_nan() { f64::NEG_INFINITY } else { sum }
        };
        let log_weights = &mut self.particles.log_weights;
        let mut max = f64::NEG_INFINITY;
        for (&log_weight, &log_likelihood) in log_weights.iter().zip(&self.log_likelihoods) {
            max = max.max(sum(log_weight, log_likelihood));
        }
        if !max.is_finite() {
            return Update::AllImpossible;
        }
        let mut total = 0.0;
        let updated = log_weights
            .iter_mut()
            .zip(&self.log_likelihoods)
            .zip(&mut self.weights);
        for ((log_weight, &log_likelihood), weight) in updated {
            *log_weight = sum(*log_weight, log_likelihood) - max;
            *weight = libm::exp(*log_weight);
            total += *weight;
        }
        let log_total = libm::log(total);
        for (log_weight, weight) in log_weights.iter_mut().zip(&mut self.weights) {
            *log_weight -= log_total;
            *weight /= total;
        }
        Update::Weighted
    }

    /// Returns the effective sample size, 1/Σw².
    pub fn effective_sample_size(&self) -> f64 {
        1.0 / self.weights.iter().map(|w| w * w).sum::<f64>()
    }

    /// Repositions the particles by survivors of equal weight.
    fn resample(&mut self) {
        let (draws, observation) = (self.draws, self.observation);
        self.settings.resampling.draw(
            &self.weights,
            |i| draws.uniform(i as u32, observation, Stage::Resampling),
            &mut self.ancestors,
            &mut self.cumulative,
        );
        for (to, from) in self
            .survivors
            .columns_mut()
            .iter_mut()
            .zip(self.particles.columns())
        {
            for (value, &ancestor) in to.iter_mut().zip(&self.ancestors) {
                *value = from[ancestor as usize];
            }
        }
        std::mem::swap(&mut self.particles, &mut self.survivors);
        self.particles.reset_weights();
        self.weights.fill(1.0 / self.particles.count() as f64);
    }

    /// Returns the means, covariances and best particle extrapolated to `ahead_s` seconds after the
    /// last observation. The filter itself does not change.
    pub fn estimate(&self, ahead_s: f64) -> StateEstimate {
        let columns = self.particles.columns();
        let orders = self.settings.motion.orders();
        let taylor = taylor(ahead_s);
        // Extrapolates the position (order 0) or one of its derivatives.
        let predicted = |order: usize, axis: usize, i: usize| {
            let terms = (order..orders).zip(taylor);
            terms.fold(0.0, |sum, (later, factor)| {
                sum + f64::from(columns[3 * later + axis][i]) * factor
            })
        };
        let position = |axis, i| predicted(0, axis, i);
        let has_velocity = orders > 1;
        let (mut position_m, mut velocity_mps) = ([0.0; 3], [0.0; 3]);
        for (i, w) in self.weights.iter().enumerate() {
            for axis in 0..3 {
                position_m[axis] += w * position(axis, i);
            }
            if has_velocity {
                for axis in 0..3 {
                    velocity_mps[axis] += w * predicted(1, axis, i);
                }
            }
        }
        let mut covariance_m2 = [0.0; 6];
        let positions = self.weights.iter().enumerate();
        let positions = positions.map(|(i, &w)| ([0, 1, 2].map(|axis| position(axis, i)), w));
        add_scatter(positions, position_m, &mut covariance_m2);
        let motion = &self.settings.motion;
        add_noise(
            motion,
            motion.position_variance_m2(ahead_s),
            &mut covariance_m2,
        );
        let velocity_covariance_m2ps2 = has_velocity.then(|| {
            let mut covariance_m2ps2 = [0.0; 6];
            let velocities = self.weights.iter().enumerate();
            let velocities =
                velocities.map(|(i, &w)| ([0, 1, 2].map(|axis| predicted(1, axis, i)), w));
            add_scatter(velocities, velocity_mps, &mut covariance_m2ps2);
            let noise_m2ps2 = motion.velocity_variance_m2ps2(ahead_s);
            add_noise(motion, noise_m2ps2, &mut covariance_m2ps2);
            covariance_m2ps2
        });
        let best = heaviest(&self.weights);
        StateEstimate {
            position_m,
            velocity_mps: has_velocity.then_some(velocity_mps),
            velocity_covariance_m2ps2,
            covariance_m2,
            best_position_m: [0, 1, 2].map(|axis| position(axis, best)),
            effective_sample_size: self.effective_sample_size(),
        }
    }

    /// Returns the share of the weight within `distance_m` of a point: the probability that the
    /// filter assigns to that region.
    pub fn weight_within(&self, point_m: [f64; 3], distance_m: f64) -> f64 {
        let [x, y, z] = self.particles.positions_m();
        let position_m = |i: usize| [x[i], y[i], z[i]].map(f64::from);
        let positions = self.weights.iter().enumerate();
        weight_within(
            positions.map(|(i, &w)| (position_m(i), w)),
            point_m,
            distance_m,
        )
    }
}

/// Adds a variance to a covariance (xx, xy, xz, yy, yz, zz) on each axis along which the target can move.
fn add_noise(motion: &Motion, variance: f64, covariance: &mut [f64; 6]) {
    for diagonal in [0, 3, 5].into_iter().take(motion.free_axes()) {
        covariance[diagonal] += variance;
    }
}
