//! Integration tests of the tracker and its kernels, in one executable.

mod boxed;
mod boxes_beside;
mod challenge;
mod common;
mod contradictions;
mod crowd;
mod determinism;
mod frame_sets;
mod hidden;
mod kernels;
mod known;
mod locate;
mod locate_absent;
mod locate_bias;
mod merged;
mod moving;
mod no_io;
mod other_sensors;
mod rectify;
mod rolling_shutter;
mod seek;
mod size;
mod spread;
mod streaks;
mod velocity;
