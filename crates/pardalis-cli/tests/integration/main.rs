//! Integration tests of the program, in one executable.

mod bad_input;
mod bad_scene;
mod calibrate;
mod calibrate_rig;
mod calibrate_time;
mod calibration;
mod camera;
mod check;
mod common;
mod crossing;
mod crowd;
mod demo;
mod detections;
mod devices;
mod evaluate;
mod explain;
mod faults;
mod foreign_scenes;
mod full_disk;
mod init;
mod learn;
mod likelihood;
mod limits;
mod live;
mod live_faults;
mod locate;
mod measure;
mod more_is_better;
mod motion_jpeg;
mod moving;
mod odd_files;
mod particles;
mod plane;
mod rectify;
mod report;
mod rig;
mod send;
mod simulate;
mod smooth;
#[cfg(feature = "studio")]
mod studio;
mod track;
mod track_plane;
mod turning;
#[cfg(feature = "studio")]
mod watch;
