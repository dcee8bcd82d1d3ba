//! Integration tests of calibration, in one executable.

mod ball_rig;
mod boards;
mod calibrate;
mod calibrate_from_boards;
mod mount;
mod plane_corners;
mod rectangles;
mod rig;
mod temporal;
