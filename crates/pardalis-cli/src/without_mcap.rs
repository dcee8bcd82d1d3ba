//! In place of `mcap/` in programs that are built without it: nothing can be read.

use std::path::Path;

use anyhow::Result;
use pardalis::PixelFormat;
use pardalis_camera::CalibratedCamera;
use pardalis_camera::formats::Lens;
use pardalis_scene::FrameRange;

use crate::output::Shown;
use crate::user_error::user_error;

/// Why nothing can be read or written, and what to do.
pub(crate) const MISSING: &str = "this program was built without MCAP; build it with `cargo build --release --features mcap`, or install the Python package, which has it";

pub(crate) struct TimedImage {
    pub(crate) bytes: Vec<u8>,
    pub(crate) time_s: f64,
    pub(crate) arrival_s: f64,
}

pub(crate) type NextImage = Result<TimedImage>;

/// No images.
pub(crate) enum Images {}

impl Images {
    pub(crate) fn open(path: &Path, _: Option<&str>, _: FrameRange) -> Result<Self> {
        Err(user_error!("{}: {MISSING}", path.shown()))
    }

    pub(crate) fn format(&self) -> ((usize, usize), PixelFormat) {
        match *self {}
    }

    pub(crate) fn frame_count(&self) -> Option<usize> {
        match *self {}
    }

    pub(crate) fn span_s(&self) -> Option<(f64, f64)> {
        match *self {}
    }

    pub(crate) fn name(&self) -> String {
        match *self {}
    }
}

impl Iterator for Images {
    type Item = Result<NextImage>;

    fn next(&mut self) -> Option<Self::Item> {
        match *self {}
    }
}

pub(crate) fn is_cut_off(_: &Path) -> bool {
    false
}

pub(crate) fn image_topics(path: &Path) -> Result<Vec<(String, String)>, String> {
    Err(format!("{}: {MISSING}", path.shown()))
}

pub(crate) fn calibrations(
    path: &Path,
    _: Option<Lens>,
) -> Result<(Vec<CalibratedCamera>, Vec<String>), String> {
    Err(format!("{}: {MISSING}", path.shown()))
}
