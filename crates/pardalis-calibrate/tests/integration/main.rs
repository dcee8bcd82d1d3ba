//! Integration tests of calibration, in one executable.

mod calibrate;
mod clocks;
mod plane_corners;
mod rig;
