//! A Bernoulli particle filter (Ristic, Vo, Vo and Farina 2013, "A tutorial on Bernoulli filters"): the probability
//! that a target exists, and its position. It is independent of images.
//!
//! Particles are positions; each carries the mean and the variance of its velocity given its path
//! (Rao-Blackwellised). A target appears and disappears at constant rates, and one that exists may be relocated.
//! Let r be the probability that it is where the particles moved, e the probability that it exists elsewhere, with
//! uniform density B, and N the prediction of particle i. The prior density is Σᵢ wᵢ·(r·N(x; μᵢ, Pᵢ) + e·B). New
//! positions are drawn from a mixture of predictions and measurement components, and the weights are divided by the
//! density of the whole mixture (Isard and Blake 1998, ICONDENSATION). Components therefore select positions
//! without biasing the posterior. An update draws few particles at first, and again with more if the effective sample
//! size is too small. If few particles agree with the images, a moment-matched proposal replaces the
//! predictions. Far from the predictions only positions at components are evaluated; the target is assumed not to
//! be visible at others. Measurements of other sensors update position and velocity
//! alone ([`BernoulliFilter::measure`]).

mod draw;
mod kinematics;
mod measured;
mod moment_matched;
#[cfg(test)]
mod oracle;
#[cfg(test)]
mod oracle_tests;
mod predicted_density;
mod proposal;
mod tuning;
mod ways;

pub use measured::{MAX_AGO_S, Measured};
pub use proposal::MeasurementComponent;
pub use tuning::ProposalTuning;

use std::sync::OnceLock;

use kinematics::Kinematics;
use proposal::{Proposal, log_add};

use crate::estimate::StateEstimate;
use crate::gaussian::{GaussianStart, check_sigma};
use crate::motion::Motion;
use crate::particle_filter::MAX_PARTICLES;
use crate::particles::Particles;
use crate::weighted::{add_scatter, likeliest, weight_within};
use pardalis_core::Error;
use pardalis_core::rng::{Draws, Stage};

/// Maximum time without an update, seconds; longer times count as this. Derivation: bounds variances, after a time
/// that leaves no information on the position.
const MAX_PENDING_S: f64 = 1e6;
/// The fractional part of the golden ratio. Consecutive multiples fill [0, 1) evenly, so that the copies of a
/// particle are drawn from all parts of the proposal.
const GOLDEN: f64 = 0.618_033_988_749_894_9;

/// Numbers of particles between which a Bernoulli filter chooses in each update. Fewer are faster; the error of the mean because they are
/// random, which is small beside that of most images, grows with the square root.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ParticleRange {
    /// With these an update begins. If too few of them are effective, it draws as many as are needed.
    pub min: usize,
    /// With these it begins while nothing was detected.
    pub max: usize,
}

impl ParticleRange {
    /// Returns the range that has this number of particles in every update.
    pub const fn fixed(count: usize) -> Self {
        Self {
            min: count,
            max: count,
        }
    }

    fn check(self) -> Result<(), Error> {
        if !(1..=MAX_PARTICLES).contains(&self.max) {
            return Err(Error::out_of_range("particles", self.max, "1 to 1000000"));
        }
        if !(1..=self.max).contains(&self.min) {
            let allowed = format!("1 to {}, the number of particles", self.max);
            return Err(Error::out_of_range("min_particles", self.min, &allowed));
        }
        Ok(())
    }
}

/// Settings of a Bernoulli filter.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct BernoulliSettings {
    /// Numbers of particles. With few particles the filter is overconfident if positions are measured much less
    /// precisely than they are predicted.
    pub particles: ParticleRange,
    /// Motion model: constant velocity with white acceleration, or a random walk with diffusion.
    pub motion: Motion,
    /// Appearances per second while there is no target, 1/s.
    pub birth_rate_hz: f64,
    /// Disappearances per second of a target that exists, 1/s.
    pub death_rate_hz: f64,
    /// Relocations per second of a target that exists, 1/s.
    pub relocation_rate_hz: f64,
    /// Density of the positions after appearance or relocation, 1/m³ (1/m² in a plane): one over the volume in which
    /// targets can be.
    pub birth_density: f64,
    /// Standard deviation of the velocity after appearance or relocation, on each axis, m/s.
    pub birth_velocity_sigma_mps: f64,
    /// Velocity jumps per second, such as kicks and bounces, 1/s; at most one between two updates.
    pub velocity_jump_rate_hz: f64,
    /// Standard deviation of the change of velocity in a jump, on each axis, m/s.
    pub velocity_jump_sigma_mps: f64,
    /// Tuned constants of the proposal, for sensitivity studies; they may change in any release.
    pub proposal: ProposalTuning,
}

impl BernoulliSettings {
    /// Returns settings with this motion: 500 particles; appearance, disappearance and relocation once in ten seconds
    /// each, in 100 m³ (m²), at about 1 m/s; no velocity jumps.
    pub const fn of(motion: Motion) -> Self {
        Self {
            particles: ParticleRange::fixed(500),
            motion,
            birth_rate_hz: 0.1,
            death_rate_hz: 0.1,
            relocation_rate_hz: 0.1,
            birth_density: 0.01,
            birth_velocity_sigma_mps: 1.0,
            velocity_jump_rate_hz: 0.0,
            velocity_jump_sigma_mps: 0.0,
            proposal: ProposalTuning::DEFAULT,
        }
    }

    /// Returns an error if settings are out of range.
    fn check(&self) -> Result<(), Error> {
        self.particles.check()?;
        for (name, value) in [
            ("birth_rate_hz", self.birth_rate_hz),
            ("death_rate_hz", self.death_rate_hz),
            ("relocation_rate_hz", self.relocation_rate_hz),
            ("birth_density", self.birth_density),
            ("velocity_jump_rate_hz", self.velocity_jump_rate_hz),
        ] {
            if !(0.0..=1e9).contains(&value) {
                return Err(Error::out_of_range(name, value, "0 to 1e9"));
            }
        }
        check_sigma(
            "birth_velocity_sigma_mps",
            [self.birth_velocity_sigma_mps; 3],
        )?;
        check_sigma("velocity_jump_sigma_mps", [self.velocity_jump_sigma_mps; 3])?;
        self.proposal.check()
    }
}

/// Returns an error for motion models that are not white noise on positions or velocities.
pub fn check_motion(motion: &Motion) -> Result<(), Error> {
    Kinematics::of(motion).map(|_| ())
}

/// A particle at the last update.
#[derive(Debug, Clone, Copy, Default)]
struct Hypothesis {
    position_m: [f64; 3],
    /// Mean velocity given the path.
    velocity_mps: [f64; 3],
    /// Variance of the velocity given the path, on each free axis, m²/s².
    velocity_variance_m2ps2: f64,
}

impl Hypothesis {
    /// Returns the mean position `dt_s` seconds later.
    fn ahead(&self, dt_s: f64) -> [f64; 3] {
        [0, 1, 2].map(|axis| self.position_m[axis] + self.velocity_mps[axis] * dt_s)
    }
}

/// The predicted probabilities of existence.
struct Prior {
    /// The target exists and is where the particles moved.
    located: f64,
    /// It exists elsewhere, because it appeared or was relocated.
    elsewhere: f64,
    /// It does not exist.
    absent: f64,
}

/// A Bernoulli particle filter. Repeated steps do not allocate memory.
#[derive(Debug)]
pub struct BernoulliFilter {
    settings: BernoulliSettings,
    kinematics: Kinematics,
    draws: Draws,
    /// Index of the update or start, part of the counter of the random numbers.
    observation: u32,
    /// The probability that the target exists, at the last update.
    existence: f64,
    /// Time since the last update, seconds. Suffices for the prediction, because white noise accumulates
    /// independently of the steps.
    pending_s: f64,
    hypotheses: Vec<Hypothesis>,
    /// Their positions and velocities, for kernels.
    particles: Particles,
    weights: Vec<f64>,
    proposal: Proposal,
    /// Particles of an update in progress, which replace the others at its end.
    new_hypotheses: Vec<Hypothesis>,
    new_particles: Particles,
    ancestors: Vec<u32>,
    log_ratios: Vec<f32>,
    /// The particle with the greatest log-ratio in the last update; in case of ties the one with the greatest weight.
    likeliest: usize,
    /// The estimate at the predicted time, once it has been asked for; whatever changes the filter forgets it.
    predicted: OnceLock<Option<StateEstimate>>,
}

impl BernoulliFilter {
    /// Creates a filter of a target that does not exist yet.
    ///
    /// Returns an error if settings are out of range or the motion model is not white noise on positions or
    /// velocities.
    pub fn new(settings: BernoulliSettings, draws: Draws) -> Result<Self, Error> {
        settings.check()?;
        let kinematics = Kinematics::of(&settings.motion)?;
        let count = settings.particles.max;
        let particles = Particles::new(count, settings.motion.column_count());
        Ok(Self {
            settings,
            kinematics,
            draws,
            observation: 0,
            existence: 0.0,
            pending_s: 0.0,
            hypotheses: vec![Hypothesis::default(); count],
            particles: particles.clone(),
            weights: vec![1.0 / count as f64; count],
            proposal: Proposal::new(settings.motion.free_axes(), settings.proposal),
            new_hypotheses: vec![Hypothesis::default(); count],
            new_particles: particles,
            ancestors: vec![0; count],
            log_ratios: vec![0.0; count],
            likeliest: 0,
            predicted: OnceLock::new(),
        })
    }

    /// Draws all particles around a start, with new random numbers; with planar motion at its height and without
    /// vertical velocity. `existence` is the probability, 0 to 1, that the target exists.
    pub fn start(&mut self, start: &GaussianStart, existence: f64) -> Result<(), Error> {
        start.check()?;
        if !(0.0..=1.0).contains(&existence) {
            return Err(Error::out_of_range("existence", existence, "0 to 1"));
        }
        self.predicted.take();
        let free_axes = self.settings.motion.free_axes();
        let start = &if self.settings.motion.is_planar() {
            start.in_plane()
        } else {
            *start
        };
        self.observation = self.observation.wrapping_add(1);
        self.existence = existence;
        self.pending_s = 0.0;
        // The velocity variance is common to all axes: the excess of an axis over the smallest is drawn.
        let variances = start.velocity_sigma_mps.map(|sigma| sigma * sigma);
        let free = &variances[..free_axes];
        let least = free.iter().copied().fold(f64::INFINITY, f64::min);
        let count = self.settings.particles.max;
        self.hypotheses.resize(count, Hypothesis::default());
        self.particles.resize(count);
        self.weights.resize(count, 0.0);
        let position_of = start.sampler();
        for (i, hypothesis) in self.hypotheses.iter_mut().enumerate() {
            let [a, b] = [0, 1].map(|draw| {
                let (particle, observation) = (i as u32, self.observation);
                let [x, y, z, _] = self
                    .draws
                    .normals(particle, observation, Stage::Start, draw);
                [x, y, z].map(f64::from)
            });
            *hypothesis = Hypothesis {
                position_m: position_of(a),
                ..Hypothesis::default()
            };
            if self.kinematics.has_velocity() {
                hypothesis.velocity_mps = [0, 1, 2].map(|axis| {
                    start.velocity_mps[axis] + (variances[axis] - least).max(0.0).sqrt() * b[axis]
                });
                hypothesis.velocity_variance_m2ps2 = least;
            }
        }
        write(&self.hypotheses, &mut self.particles);
        self.particles.reset_weights();
        self.likeliest = 0;
        self.weights.fill(1.0 / count as f64);
        Ok(())
    }

    /// Sets how often the target appears and how often it is relocated, 1/s, from the last update on.
    ///
    /// Returns an error if a rate is out of range.
    pub fn set_births(&mut self, birth_rate_hz: f64, relocation_rate_hz: f64) -> Result<(), Error> {
        let settings = BernoulliSettings {
            birth_rate_hz,
            relocation_rate_hz,
            ..self.settings
        };
        settings.check()?;
        self.predicted.take();
        self.settings = settings;
        Ok(())
    }

    /// Reports whether targets have a velocity.
    pub fn has_velocity(&self) -> bool {
        self.kinematics.has_velocity()
    }

    /// Predicts by `dt_s` seconds; does nothing unless that is above 0. Several short steps equal one long step.
    pub fn predict(&mut self, dt_s: f64) {
        if dt_s > 0.0 {
            self.predicted.take();
            self.pending_s = (self.pending_s + dt_s).min(MAX_PENDING_S);
        }
    }

    /// Returns the probability that the target exists, at any position.
    pub fn existence(&self) -> f64 {
        let prior = self.prior();
        (prior.located + prior.elsewhere).min(1.0)
    }

    /// Returns the probability that the target exists and is where the particles predict it. Right after an update,
    /// this is [`BernoulliFilter::existence`]; later it excludes appearances and relocations since.
    pub fn located(&self) -> f64 {
        self.prior().located
    }

    /// Solves the Markov chain of the two states with constant rates over the time since the last update.
    fn prior(&self) -> Prior {
        let settings = &self.settings;
        let (born, dead) = (settings.birth_rate_hz, settings.death_rate_hz);
        let fallen = |rate_hz: f64| libm::exp(-rate_hz * self.pending_s);
        let both = born + dead;
        let settled = if both > 0.0 { born / both } else { 0.0 };
        let exists = settled + (self.existence - settled) * fallen(both);
        let located = self.existence * fallen(dead + settings.relocation_rate_hz);
        Prior {
            located,
            elsewhere: (exists - located).max(0.0),
            absent: 1.0 - exists.max(located).min(1.0),
        }
    }

    /// Draws new particles from the prediction and the components and weights them. `log_ratios` receives the
    /// particles and writes ln p(images | target at the particle) − ln p(images | no target) for each. It is called
    /// again if particles are drawn again, and never if the target does not exist and there is no component. NaN
    /// counts as impossible.
    ///
    /// If all particles are impossible, the target does not exist; a target that certainly exists remains as
    /// predicted. At times without images, predict without an update. `max_log_ratio` limits the log-ratio, in nats,
    /// by which the existence probability increases, for likelihoods that discriminate positions better than
    /// existence.
    pub fn update(
        &mut self,
        components: &[MeasurementComponent],
        max_log_ratio: f64,
        mut log_ratios: impl FnMut(&Particles, &mut [f32]),
    ) {
        self.predicted.take();
        self.observation = self.observation.wrapping_add(1);
        let prior = self.prior();
        let exists = prior.located + prior.elsewhere;
        let elsewhere_share = if exists > 0.0 {
            prior.elsewhere / exists
        } else {
            0.0
        };
        self.proposal.condition_on(components, elsewhere_share);
        let is_nowhere = prior.located == 0.0 && (self.proposal.is_empty() || exists == 0.0);
        let log_exists = if is_nowhere {
            f64::NEG_INFINITY
        } else {
            self.draw_and_weight(&prior, &mut log_ratios)
        };
        if log_exists == f64::NEG_INFINITY {
            if prior.absent > 0.0 {
                self.existence = 0.0;
                self.pending_s = 0.0;
            }
            return;
        }
        let log_exists = log_exists.min(libm::log(exists) + max_log_ratio);
        let log_absent = libm::log(prior.absent);
        self.existence = libm::exp(log_exists - log_add(log_exists, log_absent)).min(1.0);
        self.pending_s = 0.0;
        self.take_new();
    }

    /// Draws and weights new particles: few at first, and others where these do not suffice. Returns the logarithm of the sum of
    /// their weights; -∞ if all are impossible.
    fn draw_and_weight(
        &mut self,
        prior: &Prior,
        log_ratios: &mut impl FnMut(&Particles, &mut [f32]),
    ) -> f64 {
        let ParticleRange { min, max } = self.settings.particles;
        // Without components, it is unknown where the target will be seen again, and with it how many particles suffice.
        let first = if self.proposal.is_empty() { max } else { min };
        let log_exists = self.draw(first, prior, log_ratios);
        // The moment-matched particles estimate the position better, the first draw the existence.
        if self.agrees_too_little(prior) && self.draw_moment_matched(prior) {
            log_ratios(&self.new_particles, &mut self.log_ratios);
            if self.weight_new() == f64::NEG_INFINITY {
                // All are impossible. The first draw had possible ones: repeat it with the same random numbers.
                self.draw(first, prior, log_ratios);
            }
            return log_exists;
        }
        let effective = effective(
            self.new_particles
                .log_weights
                .iter()
                .map(|log| libm::exp(*log)),
        );
        let wanted = self.settings.proposal.effective_share * first as f64;
        if effective >= wanted || first == max {
            return log_exists;
        }
        // None are effective if all are impossible.
        let needed = (wanted / effective * first as f64).ceil().min(max as f64);
        self.draw(needed as usize, prior, log_ratios)
    }

    /// Draws and weights this number of new particles. Returns the logarithm of the sum of their weights; -∞ if all are impossible.
    fn draw(
        &mut self,
        count: usize,
        prior: &Prior,
        log_ratios: &mut impl FnMut(&Particles, &mut [f32]),
    ) -> f64 {
        self.resize_new(count);
        self.draw_new(prior);
        log_ratios(&self.new_particles, &mut self.log_ratios);
        self.weight_new()
    }

    /// Makes room for this number of new particles. Their contents are meaningless.
    fn resize_new(&mut self, count: usize) {
        self.new_hypotheses.resize(count, Hypothesis::default());
        self.new_particles.resize(count);
        self.ancestors.resize(count, 0);
        self.log_ratios.resize(count, 0.0);
    }

    /// Replaces the particles by the new ones, whose weights are normalised.
    fn take_new(&mut self) {
        self.likeliest = likeliest(&self.log_ratios, &self.new_particles.log_weights);
        std::mem::swap(&mut self.hypotheses, &mut self.new_hypotheses);
        std::mem::swap(&mut self.particles, &mut self.new_particles);
        self.weights.resize(self.particles.count(), 0.0);
        for (weight, log_weight) in self.weights.iter_mut().zip(&self.particles.log_weights) {
            *weight = libm::exp(*log_weight);
        }
    }

    /// Leaves out the particles of the last update that are not kept, given their positions in metres: the target is not there. Its existence loses the share of
    /// their weight. Call it after [`BernoulliFilter::update`]. Does nothing if none would be kept.
    pub fn keep(&mut self, is_kept: impl Fn([f64; 3]) -> bool) {
        let kept = |hypothesis: &Hypothesis| is_kept(hypothesis.position_m);
        let share: f64 = (self.hypotheses.iter().zip(&self.weights))
            .filter(|(hypothesis, _)| kept(hypothesis))
            .map(|(_, weight)| weight)
            .sum();
        if share == 0.0 {
            return;
        }
        self.predicted.take();
        for (hypothesis, weight) in self.hypotheses.iter().zip(&mut self.weights) {
            *weight = if kept(hypothesis) {
                *weight / share
            } else {
                0.0
            };
        }
        let log_weights = self.particles.log_weights.iter_mut();
        log_weights
            .zip(&self.weights)
            .for_each(|(log_weight, weight)| *log_weight = libm::log(*weight));
        self.existence *= share.min(1.0);
        self.likeliest = likeliest(&self.log_ratios, &self.particles.log_weights);
    }

    /// Returns the particles at the last update, with the columns of the motion model. Velocities are means given the
    /// path.
    pub fn particles(&self) -> &Particles {
        &self.particles
    }

    /// Returns the weights, which sum to one.
    pub fn weights(&self) -> &[f64] {
        &self.weights
    }

    /// Returns the effective sample size, 1/Σw².
    fn effective_sample_size(&self) -> f64 {
        effective(self.weights.iter().copied())
    }

    /// Estimates the target where the particles predict it, `ahead_s` seconds after the predicted time, without
    /// changing the filter. Right after [`BernoulliFilter::predict`], and 0 s ahead, this is the mean and
    /// covariances of the predicted mixture without births. `None` if the target does not exist.
    pub fn estimate(&self, ahead_s: f64) -> Option<StateEstimate> {
        if ahead_s == 0.0 {
            *self.predicted.get_or_init(|| self.estimate_ahead(0.0))
        } else {
            self.estimate_ahead(ahead_s)
        }
    }

    fn estimate_ahead(&self, ahead_s: f64) -> Option<StateEstimate> {
        if self.located() == 0.0 {
            return None;
        }
        let dt_s = self.pending_s + ahead_s;
        let (mut position_m, mut velocity_mps) = ([0.0; 3], [0.0; 3]);
        // What the particles do not show, on each free axis.
        let jumped = self.ways(dt_s).jumped;
        let excess = |of: &dyn Fn(Kinematics) -> f64| {
            jumped.as_ref().map_or(0.0, |jumped| {
                jumped.chance * (of(jumped.kinematics) - of(self.kinematics))
            })
        };
        let mut spread_m2 = excess(&|kinematics| kinematics.variance_m2(0.0, dt_s));
        let mut spread_m2ps2 = excess(&|kinematics| kinematics.velocity_variance_m2ps2(0.0, dt_s));
        for (hypothesis, w) in self.hypotheses.iter().zip(&self.weights) {
            let ahead_m = hypothesis.ahead(dt_s);
            for axis in 0..3 {
                position_m[axis] += w * ahead_m[axis];
                velocity_mps[axis] += w * hypothesis.velocity_mps[axis];
            }
            let variance = hypothesis.velocity_variance_m2ps2;
            spread_m2 += w * self.kinematics.variance_m2(variance, dt_s);
            spread_m2ps2 += w * self.kinematics.velocity_variance_m2ps2(variance, dt_s);
        }
        let mut covariance_m2 = self.on_free_axes(spread_m2);
        add_scatter(self.places_m(dt_s), position_m, &mut covariance_m2);
        let has_velocity = self.kinematics.has_velocity();
        let velocity_covariance_m2ps2 = has_velocity.then(|| {
            let mut covariance_m2ps2 = self.on_free_axes(spread_m2ps2);
            let velocities_mps = self.hypotheses.iter().map(|h| h.velocity_mps);
            let weighted = velocities_mps.zip(self.weights.iter().copied());
            add_scatter(weighted, velocity_mps, &mut covariance_m2ps2);
            covariance_m2ps2
        });
        Some(StateEstimate {
            position_m,
            velocity_mps: has_velocity.then_some(velocity_mps),
            velocity_covariance_m2ps2,
            covariance_m2,
            best_position_m: self.hypotheses[self.likeliest].ahead(dt_s),
            effective_sample_size: self.effective_sample_size(),
        })
    }

    /// Returns the covariance (xx, xy, xz, yy, yz, zz) with this variance on each free axis.
    fn on_free_axes(&self, variance: f64) -> [f64; 6] {
        let mut covariance = [0.0; 6];
        for diagonal in [0, 3, 5].into_iter().take(self.settings.motion.free_axes()) {
            covariance[diagonal] = variance;
        }
        covariance
    }

    /// Returns the share of the weight within `distance_m` of a point (metres), with each particle at its mean
    /// prediction.
    pub fn weight_within(&self, point_m: [f64; 3], distance_m: f64) -> f64 {
        weight_within(self.places_m(self.pending_s), point_m, distance_m)
    }

    /// Returns the mean prediction of each particle after `dt_s` seconds, and its weight.
    fn places_m(&self, dt_s: f64) -> impl Iterator<Item = ([f64; 3], f64)> {
        let weighted = self.hypotheses.iter().zip(&self.weights);
        weighted.map(move |(hypothesis, &weight)| (hypothesis.ahead(dt_s), weight))
    }
}

/// Returns the effective sample size of weights that sum to one, 1/Σw²; 0 if all are 0.
fn effective(weights: impl Iterator<Item = f64>) -> f64 {
    let squares: f64 = weights.map(|w| w * w).sum();
    if squares > 0.0 { 1.0 / squares } else { 0.0 }
}

/// Writes positions and velocities into the columns of the particles.
fn write(hypotheses: &[Hypothesis], particles: &mut Particles) {
    // A random walk has no columns for velocities.
    for (order, axes) in particles.columns_mut().chunks_exact_mut(3).enumerate() {
        for (axis, column) in axes.iter_mut().enumerate() {
            for (value, hypothesis) in column.iter_mut().zip(hypotheses) {
                let state = [hypothesis.position_m, hypothesis.velocity_mps][order];
                *value = state[axis] as f32;
            }
        }
    }
}
