//! Particle filters for targets in 3D, independent of images.
//!
//! A particle filter represents the distribution of a target's state by weighted samples, the
//! *particles*. In each step it moves them with a [motion model](motion), weights them by the
//! [`Likelihood`] of the new observation, estimates the state and [resamples](resample). This crate
//! offers two filters:
//!
//! - [`ParticleFilter`] for a target that is known to exist. It starts from a
//!   [Gaussian prior](gaussian::GaussianStart).
//! - [`BernoulliFilter`](bernoulli::BernoulliFilter), which also estimates the probability that the
//!   target exists. It marginalises the velocity of each particle (Rao-Blackwellisation).
//!
//! [Modes](modes), or ways to move, give better velocities. The [smoother] improves the track of a recording once it is over, and [flight] predicts when and where a thrown body crosses a plane.
//!
//! # Example
//!
//! Estimate the position of a ball from noisy measurements:
//!
//! ```
//! use pardalis_filter::gaussian::{GaussianStart, diagonal_m2};
//! use pardalis_filter::particle_filter::FilterSettings;
//! use pardalis_filter::{Draws, Error, Level, Likelihood, ParticleFilter, Particles};
//!
//! /// A measured position, in metres, with a standard deviation of 5 cm per axis.
//! struct Measurement([f64; 3]);
//!
//! impl Likelihood for Measurement {
//!     fn log_likelihoods(&mut self, particles: &Particles, out: &mut [f32]) {
//!         for (i, out) in out.iter_mut().enumerate() {
//!             let position = particles.position_m(i);
//!             let square: f64 = (0..3).map(|k| (position[k] - self.0[k]).powi(2)).sum();
//!             *out = (-0.5 * square / 0.05_f64.powi(2)) as f32;
//!         }
//!     }
//! }
//!
//! let mut settings = FilterSettings::default();
//! settings.resample_below = 0.5;
//! let start = GaussianStart {
//!     position_m: [0.0, 0.0, 1.0],
//!     covariance_m2: diagonal_m2([0.2; 3]),
//!     velocity_sigma_mps: [1.0; 3],
//!     ..GaussianStart::default()
//! };
//! let mut filter = ParticleFilter::new(settings, &start, Draws::new(1, 0), Level::best())?;
//! for step in 1..=25 {
//!     filter.predict(0.04);
//!     filter.update(&mut Measurement([0.04 * f64::from(step), 0.0, 1.0]));
//! }
//! let estimate = filter.estimate(0.0);
//! assert!((estimate.position_m[0] - 1.0).abs() < 0.1);
//! assert!(estimate.covariance_m2[0].sqrt() < 0.05);
//! # Ok::<(), Error>(())
//! ```
//!
//! # Units and frames
//!
//! Positions are in metres and velocities in metres per second, both in the world frame, whose z axis
//! points up. Times are in seconds. A covariance is listed as xx, xy, xz, yy, yz, zz. Particles are
//! stored in single precision, estimates are computed in double precision.
//!
//! # Reproducibility
//!
//! Each random number is a function of the seed and the indices of target, particle and observation.
//! Results therefore do not depend on the number of threads, nor on the instruction set.
//!
//! # Modules
//!
//! - [`particle_filter`]: the filter of a target that exists.
//! - [`bernoulli`]: the filter that also estimates existence.
//! - [`motion`]: random walk, constant velocity and constant acceleration, in space or in a plane.
//! - [`Measurement`]: what other sensors than cameras measure.
//! - [`gaussian`]: Gaussian priors, and their transformation between world frames.
//! - [`resample`]: multinomial, stratified, systematic and residual resampling.
//! - [`estimate`]: the result of a filter.
//! - [`modes`]: ways to move, and how fast a target moves.
//! - [`smoother`]: smoothing of recordings, and contacts.
//! - [`flight`]: free flight, and where it leads.

pub mod bernoulli;
pub mod estimate;
pub mod flight;
pub mod gaussian;
mod likelihood;
mod measurement;
pub mod modes;
pub mod motion;
pub mod particle_filter;
mod particles;
pub mod resample;
pub mod smoother;
mod weighted;

pub use estimate::StateEstimate;
pub use likelihood::Likelihood;
pub use measurement::Measurement;
pub use pardalis_core::Error;
pub use pardalis_core::rng::Draws;
pub use pardalis_core::simd::Level;
pub use particle_filter::ParticleFilter;
pub use particles::Particles;
