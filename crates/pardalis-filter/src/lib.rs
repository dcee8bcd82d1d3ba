//! Particle filters that know nothing about images.
//!
//! A filter proposes particles with a [motion model](motion), weights them by a [`Likelihood`], estimates and
//! [resamples](resample). [`ParticleFilter`](particle_filter::Filter) tracks a target that is known to exist, from a
//! [Gaussian start](gaussian); [`bernoulli`] also estimates whether it exists, with each particle's velocity marginalised.
//!
//! # Conventions
//!
//! Positions are in metres, velocities in metres per second, times in seconds. Covariances list xx, xy, xz, yy, yz, zz. Every random number is a function of
//! seed, target, particle and observation, so that results do not depend on the number of threads.

pub mod bernoulli;
pub mod estimate;
pub mod gaussian;
mod likelihood;
pub mod motion;
pub mod particle_filter;
mod particles;
pub mod resample;
pub mod weighted;

pub use estimate::StateEstimate;
pub use likelihood::Likelihood;
pub use pardalis_core::Error;
pub use particles::Particles;
