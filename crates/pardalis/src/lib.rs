//! 3D tracking of coloured objects with particle filters, through any camera.

pub mod camera;
pub mod color;
mod error;
pub mod filter;
pub mod frame;
pub mod likelihood;
pub mod motion;
pub mod particles;
pub mod real;
pub mod reference;
pub mod resample;
pub mod rig;
pub mod rng;
pub mod shape;
pub mod simd;
pub mod start;
pub mod tracker;
pub mod view;

pub use error::Error;
pub use frame::{Frame, PixelFormat};
pub use tracker::{Estimate, Tracker};
