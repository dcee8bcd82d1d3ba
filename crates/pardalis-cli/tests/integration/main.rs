//! Integration tests of the program, in one executable.

mod bad_input;
mod bad_scene;
mod calibrate;
mod calibrate_time;
mod calibration;
mod camera;
mod common;
mod demo;
mod evaluate;
mod explain;
mod foreign_scenes;
mod init;
mod learn;
mod likelihood;
mod live;
mod locate;
mod measure;
mod more_is_better;
mod particles;
mod plane;
mod rectify;
mod rig;
mod simulate;
mod track;
mod track_plane;
