//! 3D tracking of coloured objects with particle filters, through any camera.

pub mod color;
mod error;
pub mod frame;

pub use error::Error;
pub use frame::{Frame, PixelFormat};
