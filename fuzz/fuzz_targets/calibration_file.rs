//! Any text as a calibration file: cameras or a fault, never a panic; and what is read and written again is read as the same cameras.
#![no_main]

use libfuzzer_sys::fuzz_target;
use pardalis_camera::formats::Lens;
use pardalis_scene::calibration::{read, read_toml, write_toml};

fuzz_target!(|text: &str| {
    for lens in [None, Some(Lens::Pinhole), Some(Lens::Fisheye)] {
        match read(text, lens) {
            Ok(cameras) => {
                let again = read_toml(&write_toml(&cameras)).expect("our own file");
                assert_eq!(again.len(), cameras.len());
                for (again, camera) in again.iter().zip(&cameras) {
                    assert_eq!(again.camera.parameters(), camera.camera.parameters());
                }
            }
            Err(error) => assert!(error.to_string().starts_with("line ")),
        }
    }
});
