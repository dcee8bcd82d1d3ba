//! Tracks coloured objects in 3D with particle filters, through any camera.
//!
//! From the images of one or more calibrated cameras the [`Tracker`] computes, frame by frame, where a ball, a robot or a flat target is,
//! how fast it moves, how certain that is, and whether it is occluded or lost.
//!
//! # Example
//!
//! One labelled image teaches the colours of the target. The tracker then detects the target itself, without a start.
//!
//! ```
#![doc = include_str!("../examples/one_camera.rs")]
//! ```
//!
//! Further examples are in the folder `examples` of the crate: two cameras, a floor seen by an uncalibrated camera (`plane`), a
//! mirror, a lens model of your own (`custom_camera`) and a stream of YUV frames.
//!
//! # Two ways to track a target
//!
//! - [`DetectedSettings`](tracker::DetectedSettings), the default: the tracker detects the target by its colours and its outline, tracks it with
//!   a Bernoulli filter, and reports when it is occluded or lost.
//! - [`InitializedSettings`](tracker::InitializedSettings): the published methods (Taiana 2007, Barrera 2005, Campos 2009) track the target with a
//!   particle filter from a given start.
//!
//! # Modules
//!
//! In the order in which data flows: [`frame`], [`color`], [`camera`], [`view`], [`shape`], [`detect`], [`likelihood`], [`start`], [`filter`],
//! [`tracker`]. [`rectify`] computes maps of a plane. [`tuning`] holds the tuned constants of detected targets, for sensitivity studies.
//!
//! Calibration, simulation, evaluation and scene files are crates of their own: `pardalis-calibrate`, `pardalis-simulate`,
//! `pardalis-evaluate` and `pardalis-scene`.
//!
//! # Units and frames
//!
//! Metres, seconds, radians and pixels; names end with the unit (`radius_m`). `a_from_b` maps coordinates in frame b to frame a. Camera
//! frame: x right, y down, z along the optical axis. Pixel centres lie at integer coordinates.
//!
//! # Determinism
//!
//! The library opens no files, reads no clock and prints nothing. Every random number is a function of seed, target, particle and
//! observation: the same build, frames and seed give the same estimates for any number of threads.

mod background;
pub mod color;
mod color_space;
pub mod detect;
pub mod frame;
pub mod likelihood;
pub mod platform;
pub mod rectify;
#[doc(hidden)]
#[allow(clippy::disallowed_methods)] // Plain mathematics, to compare with.
pub mod reference;
mod rolling_shutter;
pub mod shape;
pub mod start;
pub mod tracker;
pub mod tuning;
pub mod view;

pub use frame::{Frame, PixelFormat};
pub use pardalis_camera as camera;
pub use pardalis_core::Error;
pub use pardalis_filter as filter;
pub use tracker::{CameraId, Estimate, FrameSet, TargetId, Tracker};
pub use view::View;
