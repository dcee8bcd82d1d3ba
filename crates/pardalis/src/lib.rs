//! 3D tracking of coloured objects with particle filters, through any camera.
//!
//! From camera images it tells, frame after frame, where a coloured object is in 3D, how fast it moves and how sure that is. The
//! modules, in the order in which data flows (and in which they read best):
//!
//! [`frame`] → [`color`] → [`camera`], [`rig`], [`view`] → [`shape`], [`motion`] → [`particles`], [`resample`], [`gaussian`], [`filter`], [`bernoulli`] →
//! [`likelihood`] → [`start`], [`tracker`] → [`score`]
//!
//! [`simulate`] makes images with exact truth.
//! [`detect`] finds a target's colours in an image without knowing where they are; [`calibrate`] makes cameras, poses and clocks of what was seen, [`plane`] the plane that a camera sees.
//! [`config`] turns the text of a scene file into checked settings, [`interchange`] reads and writes other programs' calibrations. [`rng`], [`real`] and [`simd`] serve the kernels.
//!
//! # Conventions
//!
//! Metres, seconds, radians, pixels. `a_from_b` maps coordinates in frame b to frame a. Camera frame: x right, y down, z along the optical axis.
//! Pixel centres lie at integer coordinates. The library opens no files, reads no clock and prints nothing; every random
//! number is a function of seed, target, particle and observation.

pub mod bernoulli;
pub mod calibrate;
pub mod camera;
pub mod color;
pub mod config;
pub mod detect;
mod error;
pub mod filter;
pub mod frame;
pub mod gaussian;
pub mod interchange;
pub mod likelihood;
pub mod motion;
pub mod particles;
pub mod plane;
pub mod real;
pub mod reference;
pub mod resample;
pub mod rig;
pub mod rng;
pub mod score;
pub mod shape;
pub mod simd;
pub mod simulate;
pub mod start;
pub mod tracker;
pub mod view;
mod weighted;

pub use error::Error;
pub use frame::{Frame, PixelFormat};
pub use tracker::{Estimate, Tracker};
