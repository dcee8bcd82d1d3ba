//! Internals that the Pardalis crates share.
//!
//! This crate is not a public interface: its contents may change in any release. Depend on
//! `pardalis`, `pardalis-camera` or `pardalis-filter`, which re-export what they need of
//! it, such as [`Error`].
//!
//! - [`error`]: the error type of all library crates.
//! - [`real`]: arithmetic that is generic over the precision, and dual numbers for derivatives.
//! - [`rng`]: counter-based random numbers, independent of the number of threads.
//! - [`simd`]: kernels compiled for several instruction sets.
//! - [`srgb`]: sRGB as linear light.
//! - [`tuned!`]: structs of tuned constants.
//!
//! ```
//! use pardalis_core::rng::{Draws, Stage};
//!
//! // A random number depends on its purpose alone, not on the order of the calls.
//! let draws = Draws::new(42, 0);
//! let later = draws.uniform(7, 1, Stage::Resampling);
//! let earlier = draws.uniform(3, 0, Stage::Resampling);
//! assert_eq!(later, Draws::new(42, 0).uniform(7, 1, Stage::Resampling));
//! assert_ne!(later, earlier);
//! ```

pub mod error;
pub mod real;
pub mod rng;
pub mod simd;
pub mod srgb;
mod tuning;

pub use error::Error;
