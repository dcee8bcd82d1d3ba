//! A naive Bernoulli update with plain densities and full covariance matrices, particle by particle, according to the
//! formulas in the documentation of [`super`]. It takes the drawn positions as given and computes everything else:
//! existence, weights, births and velocities.

use nalgebra::{DMatrix, DVector, Matrix2, Matrix3, Vector3};

use super::kinematics::Kinematics;
use super::{BernoulliSettings, Hypothesis, MeasurementComponent, ParticleRange};

/// Variance that every step adds to a position, m².
const STEP_VARIANCE_M2: f64 = 1e-10;

/// By which share rounding alone may change a result if no number is lost in a greater one.
pub(super) const ROUNDING: f64 = 1e-9;

/// Returns the inverse of a covariance. Cholesky's method, because cofactors lose half of the digits of a flat one.
fn inverse(covariance: &DMatrix<f64>) -> DMatrix<f64> {
    covariance.clone().cholesky().unwrap().inverse()
}

/// A Gaussian, possibly not normalised.
struct Gaussian {
    mean: DVector<f64>,
    covariance: DMatrix<f64>,
}

impl Gaussian {
    fn squared(&self, position: &DVector<f64>) -> f64 {
        let off = position - &self.mean;
        let factor = self.covariance.clone().cholesky().unwrap();
        off.dot(&factor.solve(&off))
    }

    fn density(&self, position: &DVector<f64>) -> f64 {
        let covariance = &self.covariance * std::f64::consts::TAU;
        let deviations = covariance.cholesky().unwrap().l().diagonal();
        (-0.5 * self.squared(position)).exp() / deviations.product()
    }

    /// Returns the normalised product of two Gaussians.
    fn product(&self, other: &Self) -> Self {
        let [a, b] = [self, other].map(|g| inverse(&g.covariance));
        let covariance = inverse(&(a + &b));
        let mean = &self.mean + &covariance * b * (&other.mean - &self.mean);
        Self { mean, covariance }
    }
}

/// Returns the effective sample size.
fn effective(weights: &[f64]) -> f64 {
    weights.iter().sum::<f64>().powi(2) / weights.iter().map(|w| w * w).sum::<f64>()
}

/// Returns the probabilities that a target that existed with this probability is where it moved, elsewhere, or absent
/// after `dt_s` seconds, according to a Markov chain with the rates of the settings.
pub(super) fn chances(settings: &BernoulliSettings, existence: f64, dt_s: f64) -> [f64; 3] {
    let (born, dead) = (settings.birth_rate_hz, settings.death_rate_hz);
    let moved = settings.relocation_rate_hz;
    // Columns: from located, from elsewhere, from absent.
    let rates = Matrix3::new(
        -dead - moved,
        0.0,
        0.0, //
        moved,
        -dead,
        born, //
        dead,
        dead,
        -born,
    );
    (exponential(rates * dt_s) * Vector3::new(existence, 0.0, 1.0 - existence)).into()
}

/// Returns the exponential of a matrix: the series of its sixteenth, squared four times, for entries of at most 20.
fn exponential(matrix: Matrix3<f64>) -> Matrix3<f64> {
    let small = matrix / 16.0;
    let (mut term, mut sum) = (Matrix3::identity(), Matrix3::identity());
    for n in 1..=30 {
        term *= small / f64::from(n);
        sum += term;
    }
    (0..4).fold(sum, |power, _| power * power)
}

/// Returns the covariance of position and velocity on one axis after a step.
struct Moved {
    covariance: Matrix2<f64>,
}

impl Moved {
    fn gain_hz(&self) -> f64 {
        self.covariance[(1, 0)] / self.covariance[(0, 0)]
    }

    fn velocity_variance_m2ps2(&self) -> f64 {
        self.covariance[(1, 1)] - self.covariance[(1, 0)].powi(2) / self.covariance[(0, 0)]
    }
}

/// The filter before an update, and its prediction.
pub(super) struct Before<'a> {
    pub(super) settings: BernoulliSettings,
    pub(super) hypotheses: &'a [Hypothesis],
    pub(super) weights: &'a [f64],
    /// The time since the last update, seconds.
    pub(super) dt_s: f64,
    /// The probabilities that the target is located, elsewhere and absent after that time.
    pub(super) chances: [f64; 3],
    pub(super) components: &'a [MeasurementComponent],
}

/// An update of drawn positions before the likelihoods are applied.
pub(super) struct Drawn {
    /// Prior density over proposal density, times the weight of the ancestor.
    pub(super) weights: Vec<f64>,
    pub(super) hypotheses: Vec<Hypothesis>,
    /// By which share rounding alone may change weights and velocities.
    pub(super) rounding: f64,
}

impl Before<'_> {
    fn axes(&self) -> usize {
        self.settings.motion.free_axes()
    }

    fn kinematics(&self) -> Kinematics {
        Kinematics::of(&self.settings.motion).unwrap()
    }

    /// Returns the probability of a velocity jump and the variance that it adds to the velocity, if the target has a
    /// velocity and time passed.
    fn jump(&self) -> Option<(f64, f64)> {
        let is_possible = self.settings.velocity_jump_rate_hz > 0.0 && self.dt_s > 0.0;
        (is_possible && self.kinematics().has_velocity()).then(|| {
            let none = (-self.settings.velocity_jump_rate_hz * self.dt_s).exp();
            (1.0 - none, self.settings.velocity_jump_sigma_mps.powi(2))
        })
    }

    /// Returns a step on one axis, F·P·Fᵀ + Q, with a velocity jump of this variance at a random time.
    fn moved(&self, velocity_variance_m2ps2: f64, jump_m2ps2: f64) -> Moved {
        let t = self.dt_s;
        let added = Matrix2::new(STEP_VARIANCE_M2, 0.0, 0.0, 0.0);
        let covariance = match self.kinematics() {
            Kinematics::Walk { diffusion_m2ps } => Matrix2::new(diffusion_m2ps * t, 0.0, 0.0, 0.0),
            Kinematics::Velocity {
                acceleration_density_m2ps3,
            } => {
                let transition = Matrix2::new(1.0, t, 0.0, 1.0);
                let before = Matrix2::new(0.0, 0.0, 0.0, velocity_variance_m2ps2);
                // A jump at a random time adds the covariance of acceleration noise with its variance per step.
                let noise = Matrix2::new(t * t / 3.0, t / 2.0, t / 2.0, 1.0)
                    * (acceleration_density_m2ps3 * t + jump_m2ps2);
                transition * before * transition.transpose() + noise
            }
        };
        Moved {
            covariance: covariance + added,
        }
    }

    fn vector(&self, position_m: [f64; 3]) -> DVector<f64> {
        DVector::from_column_slice(&position_m[..self.axes()])
    }

    fn scaled(&self, variance: f64) -> DMatrix<f64> {
        DMatrix::identity(self.axes(), self.axes()) * variance
    }

    fn prediction(&self, before: &Hypothesis, moved: &Moved) -> Gaussian {
        let [position, velocity] = [before.position_m, before.velocity_mps].map(|v| self.vector(v));
        Gaussian {
            mean: position + velocity * self.dt_s,
            covariance: self.scaled(moved.covariance[(0, 0)]),
        }
    }

    /// Returns the Gaussian of each component with its weight relative to the best and its share of the births.
    fn components(&self) -> Vec<(Gaussian, f64, f64)> {
        let log_weights = self.components.iter().map(|component| component.log_weight);
        let greatest = log_weights.clone().fold(f64::NEG_INFINITY, f64::max);
        let total: f64 = log_weights.map(|log| (log - greatest).exp()).sum();
        let axes = self.axes();
        let of = |component: &MeasurementComponent| {
            let [xx, xy, xz, yy, yz, zz] = component.covariance_m2;
            let covariance = DMatrix::from_row_slice(3, 3, &[xx, xy, xz, xy, yy, yz, xz, yz, zz]);
            let gaussian = Gaussian {
                mean: self.vector(component.position_m),
                covariance: covariance.view((0, 0), (axes, axes)).into(),
            };
            let weight = (component.log_weight - greatest).exp();
            let even = self.settings.proposal.even_birth_share;
            let share = even / self.components.len() as f64 + (1.0 - even) * weight / total;
            (gaussian, weight, share)
        };
        self.components.iter().map(of).collect()
    }

    /// Returns the density of births at the components, with widened standard deviations.
    fn birth_density(&self, position: &DVector<f64>) -> f64 {
        let of = |(component, _, share): (Gaussian, f64, f64)| {
            let mean = component.mean;
            let widening = self.settings.proposal.birth_widening;
            let covariance = component.covariance * widening.powi(2);
            share * Gaussian { mean, covariance }.density(position)
        };
        self.components().into_iter().map(of).sum()
    }

    /// Returns the density from which the filter draws the position of a particle with this prediction.
    fn proposal_density(&self, position: &DVector<f64>, prediction: &Gaussian) -> f64 {
        let predicted = prediction.density(position);
        let components = self.components();
        if components.is_empty() {
            return predicted;
        }
        let [located, elsewhere, _] = self.chances;
        let tuning = &self.settings.proposal;
        let [least, alone] = [tuning.birth_share, tuning.predicted_share];
        let birth = least + (1.0 - least) * elsewhere / (located + elsewhere);
        // Components within six standard deviations, weighted by their agreement with the prediction.
        let near = components.iter().filter_map(|(component, weight, _)| {
            let both = Gaussian {
                mean: component.mean.clone(),
                covariance: &component.covariance + &prediction.covariance,
            };
            let is_near = both.squared(&prediction.mean) <= 36.0;
            is_near.then(|| (component, weight * both.density(&prediction.mean)))
        });
        let total: f64 = near.clone().map(|(_, agreement)| agreement).sum();
        if total == 0.0 {
            let birth = birth + (1.0 - birth) * (1.0 - alone) / 2.0;
            return birth * self.birth_density(position) + (1.0 - birth) * predicted;
        }
        let products = near.map(|(component, agreement)| {
            agreement / total * prediction.product(component).density(position)
        });
        birth * self.birth_density(position)
            + (1.0 - birth) * ((1.0 - alone) * products.sum::<f64>() + alone * predicted)
    }

    /// Returns the ancestor of each of `count` particles and its weight: those of systematic resampling if there were not as many
    /// before, or if the effective sample size is at most a share of their number.
    fn ancestors(&self, resampling: f64, count: usize) -> Vec<(usize, f64)> {
        let least = self.settings.proposal.resample_below * self.weights.len() as f64;
        if count == self.weights.len() && effective(self.weights) > least {
            return self.weights.iter().copied().enumerate().collect();
        }
        let sum = |weights: &[f64]| weights.iter().sum::<f64>();
        let ancestor = |i: usize| {
            let point = (i as f64 + resampling) / count as f64 * sum(self.weights);
            let is_beyond = |&j: &usize| sum(&self.weights[..=j]) > point;
            let parents = 0..self.weights.len();
            parents.clone().find(is_beyond).unwrap_or(parents.end - 1)
        };
        let share = 1.0 / count as f64;
        (0..count).map(|i| (ancestor(i), share)).collect()
    }

    fn born(&self, position_m: [f64; 3]) -> Hypothesis {
        let has_velocity = self.kinematics().has_velocity();
        let sigma_mps = self.settings.birth_velocity_sigma_mps;
        Hypothesis {
            position_m,
            velocity_mps: [0.0; 3],
            velocity_variance_m2ps2: if has_velocity { sigma_mps.powi(2) } else { 0.0 },
        }
    }

    /// Computes the first draw from these positions. `resampling` is the offset of systematic resampling, `births`
    /// are the uniform numbers that decide whether a target was elsewhere before.
    pub(super) fn first_draw(
        &self,
        positions_m: &[[f64; 3]],
        resampling: f64,
        births: impl Fn(usize) -> f64,
    ) -> Drawn {
        let [located, elsewhere, _] = self.chances;
        let has_births = !self.components.is_empty();
        let ancestors = self.ancestors(resampling, positions_m.len());
        let one_in = self.settings.proposal.jump_one_in;
        let jumping = 1.0 / one_in as f64;
        let (mut weights, mut hypotheses) = (Vec::new(), Vec::new());
        for (i, &position_m) in positions_m.iter().enumerate() {
            let (ancestor, weight) = ancestors[i];
            let before = &self.hypotheses[ancestor];
            // One particle in a few has a jump, regardless of its probability.
            let (jump_m2ps2, correction) = match self.jump() {
                None => (0.0, 1.0),
                Some((chance, variance)) if i % one_in == 0 => (variance, chance / jumping),
                Some((chance, _)) => (0.0, (1.0 - chance) / (1.0 - jumping)),
            };
            let moved = self.moved(before.velocity_variance_m2ps2, jump_m2ps2);
            let prediction = self.prediction(before, &moved);
            let position = self.vector(position_m);
            let continued = located * prediction.density(&position);
            let born = f64::from(has_births) * elsewhere * self.settings.birth_density;
            let prior = continued + born;
            let proposal = self.proposal_density(&position, &prediction);
            weights.push(weight * correction * prior / proposal);
            hypotheses.push(if births(i) < born / prior {
                self.born(position_m)
            } else {
                let mut velocity_mps = before.velocity_mps;
                let off_m = position - prediction.mean;
                for (velocity, off_m) in velocity_mps.iter_mut().zip(&off_m) {
                    *velocity += moved.gain_hz() * off_m;
                }
                Hypothesis {
                    position_m,
                    velocity_mps,
                    velocity_variance_m2ps2: moved.velocity_variance_m2ps2(),
                }
            });
        }
        Drawn {
            weights,
            hypotheses,
            rounding: ROUNDING,
        }
    }

    /// Returns the number of particles of the first draw.
    pub(super) fn first_count(&self) -> usize {
        let ParticleRange { min, max } = self.settings.particles;
        if self.components.is_empty() { max } else { min }
    }

    /// Returns the number of particles with which the first draw is repeated, if too few of these are effective.
    pub(super) fn needed(&self, new_weights: &[f64]) -> Option<usize> {
        let max = self.settings.particles.max;
        let least = self.settings.proposal.effective_share * new_weights.len() as f64;
        // If all are impossible, none is effective.
        let found = effective(new_weights);
        let found = if found.is_nan() { 0.0 } else { found };
        let needed = (least / found * new_weights.len() as f64).ceil() as usize;
        (found < least && new_weights.len() < max).then_some(needed.min(max))
    }

    /// Reports whether the particles of the first draw agree too little with the images: their effective sample
    /// size is less than a small share of their number, and was not before.
    pub(super) fn is_drawn_again(&self, new_weights: &[f64]) -> bool {
        let share = self.settings.proposal.min_effective_share;
        let is_thin = |weights: &[f64]| effective(weights) < share * weights.len() as f64;
        is_thin(new_weights)
            && !is_thin(self.weights)
            && self.chances[0] > 0.0
            && !self.components.is_empty()
    }

    /// Returns the moments of position and velocity over the predictions of all particles, with a velocity jump of
    /// this variance.
    fn moments(&self, jump_m2ps2: f64) -> Moments {
        let axes = self.axes();
        let joint = |before: &Hypothesis| {
            let moved = self.moved(before.velocity_variance_m2ps2, jump_m2ps2);
            let position = self.prediction(before, &moved).mean;
            let velocity = self.vector(before.velocity_mps);
            let mean = DVector::from_iterator(2 * axes, position.iter().chain(&velocity).copied());
            (mean, moved.covariance.kronecker(&self.scaled(1.0)))
        };
        let joints: Vec<_> = self.hypotheses.iter().map(joint).collect();
        let mut mean = DVector::zeros(2 * axes);
        for ((of_particle, _), weight) in joints.iter().zip(self.weights) {
            mean += of_particle * *weight;
        }
        let mut covariance = DMatrix::zeros(2 * axes, 2 * axes);
        for ((of_particle, own), weight) in joints.iter().zip(self.weights) {
            let off = of_particle - &mean;
            covariance += (&off * off.transpose() + own) * *weight;
        }
        let block = |row: usize, column: usize| -> DMatrix<f64> {
            let start = (row * axes, column * axes);
            covariance.view(start, (axes, axes)).into()
        };
        let gain = block(1, 0) * inverse(&block(0, 0));
        let rest = block(1, 1) - &gain * block(0, 1);
        Moments {
            position: Gaussian {
                mean: mean.rows(0, axes).into(),
                covariance: block(0, 0),
            },
            velocity: mean.rows(axes, axes).into(),
            gain,
            velocity_variance_m2ps2: (rest.trace() / axes as f64).max(0.0),
        }
    }

    /// Computes the moment-matched draw from these positions. `uniforms` decide whether a target's velocity jumped,
    /// and whether it was elsewhere before.
    pub(super) fn moment_matched_draw(
        &self,
        positions_m: &[[f64; 3]],
        uniforms: impl Fn(usize) -> [f64; 2],
    ) -> Drawn {
        let [located, elsewhere, _] = self.chances;
        let (chance, jump_m2ps2) = self.jump().unwrap_or_default();
        let [steady, jumped] = [self.moments(0.0), self.moments(jump_m2ps2)];
        let (mut weights, mut hypotheses) = (Vec::new(), Vec::new());
        for (i, &position_m) in positions_m.iter().enumerate() {
            let position = self.vector(position_m);
            let as_steady = (1.0 - chance) * steady.position.density(&position);
            let predicted = as_steady + chance * jumped.position.density(&position);
            let born = elsewhere * self.settings.birth_density;
            let prior = located * predicted + born;
            let births = self.settings.proposal.moment_matched_birth_share;
            let proposal = births * self.birth_density(&position) + (1.0 - births) * predicted;
            weights.push(prior / proposal / positions_m.len() as f64);
            let [jump, birth] = uniforms(i);
            hypotheses.push(if birth < born / prior {
                self.born(position_m)
            } else {
                let has_jumped = jump >= as_steady / predicted;
                if has_jumped { &jumped } else { &steady }.at(position_m, &position)
            });
        }
        Drawn {
            weights,
            hypotheses,
            rounding: steady.rounding().max(jumped.rounding()),
        }
    }
}

/// A Gaussian over position and velocity.
struct Moments {
    position: Gaussian,
    velocity: DVector<f64>,
    /// The regression of the velocity on the position.
    gain: DMatrix<f64>,
    velocity_variance_m2ps2: f64,
}

impl Moments {
    /// Returns by which share rounding alone may change what is computed from them. The covariance of particles that hardly differ across is flat: its condition
    /// number is lost in digits.
    fn rounding(&self) -> f64 {
        let variances = self.position.covariance.symmetric_eigenvalues();
        ROUNDING + 4.0 * f64::EPSILON * variances.max() / variances.min()
    }

    /// Returns the hypothesis at a position.
    fn at(&self, position_m: [f64; 3], position: &DVector<f64>) -> Hypothesis {
        let velocity = &self.velocity + &self.gain * (position - &self.position.mean);
        let mut velocity_mps = [0.0; 3];
        velocity_mps[..velocity.len()].copy_from_slice(velocity.as_slice());
        Hypothesis {
            position_m,
            velocity_mps,
            velocity_variance_m2ps2: self.velocity_variance_m2ps2,
        }
    }
}
