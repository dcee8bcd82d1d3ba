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

pub mod color;
mod color_space;
pub mod detect;
pub mod frame;
pub mod likelihood;
pub mod rectify;
pub mod reference;
pub mod shape;
pub mod start;
pub mod tracker;
pub mod view;

pub use frame::{Frame, PixelFormat};
pub use pardalis_core::Error;
pub use tracker::{CameraId, Estimate, FrameSet, TargetId, Tracker};
