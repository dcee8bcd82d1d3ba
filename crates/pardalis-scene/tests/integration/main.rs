//! Integration tests of scene, world and calibration files, in one executable.

mod calibration_file_errors;
mod calibration_files;
mod guide;
mod reference;
mod samples;
mod scene_plane;
mod scene_text;
