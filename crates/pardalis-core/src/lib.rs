//! What the Pardalis crates share: the error type, arithmetic, random numbers and instruction sets.
//!
//! This crate is not a public interface: its contents change without notice. Use `pardalis`, `pardalis-camera` or `pardalis-filter`,
//! which re-export [`Error`].

pub mod error;
pub mod real;
pub mod rng;
pub mod simd;

pub use error::Error;
