//! Integration tests of calibration, in one executable.

mod calibrate;
mod plane_corners;
mod rig;
mod temporal;
