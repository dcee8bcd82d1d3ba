//! The sample files of both tests of calibration files.

use std::fs;
use std::path::{Path, PathBuf};

use pardalis_camera::formats::Lens;

/// The sample files, with the lens if the file does not state it.
pub(crate) const SAMPLES: [(&str, Option<Lens>); 24] = [
    ("basalt.json", None),
    ("kalibr-chain.yaml", None),
    ("kalibr-imu.yaml", None),
    ("ocamcalib-catadioptric.txt", None),
    ("ocamcalib-fisheye.txt", None),
    ("opencv-fisheye-bare.xml", Some(Lens::Fisheye)),
    ("opencv-fisheye.yml", None),
    ("opencv-left-intrinsics.yml", None),
    ("opencv-omnidir.xml", None),
    ("opencv-omnidir.yml", None),
    ("opencv-pinhole12.yml", None),
    ("opencv-pinhole14.json", None),
    ("opencv-pinhole4.yml", Some(Lens::Pinhole)),
    ("opencv-pinhole5.yml", None),
    ("opencv-pinhole8.xml", None),
    ("opencv-pose.yml", None),
    ("opencv-stereo-intrinsics.yml", None),
    ("opencv-stereo.yml", None),
    ("pardalis.toml", None),
    ("ros-equidistant.yaml", None),
    ("ros-message.yaml", None),
    ("ros-plumb_bob.yaml", None),
    ("ros-rational_polynomial.yaml", None),
    ("sequence-cameras.json", None),
];

/// Returns the folder of the samples.
pub(crate) fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/calibration_files")
}

/// Returns the text of a sample.
pub(crate) fn sample(name: &str) -> String {
    fs::read_to_string(folder().join(name)).unwrap()
}
