//! 3D tracking of coloured objects with particle filters, through any camera.

pub mod color;
mod error;
pub mod frame;
pub mod real;
pub mod rng;
pub mod score;
pub mod simd;

pub use error::Error;
pub use frame::{Frame, PixelFormat};
