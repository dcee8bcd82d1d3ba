//! The difference cue: changes in a region from one image to the next (Campos 2009, section 3.3). A moving
//! target stands out from a static scene even if that has the same colours.

use rayon::prelude::*;

use super::patch::{Patch, PatchSettings, squared_distance};
use crate::Frame;
use crate::frame::{PixelFormat, with_pixels};
use crate::shape::Shape;
use crate::view::PreparedFrame;
use pardalis_core::Error;
use pardalis_core::simd::Level;

/// The difference cue of one target: compares the histogram of absolute grey differences with a uniform one.
/// Only for static cameras.
#[derive(Debug)]
pub(super) struct DifferenceCue {
    patch: Patch,
    /// Log-likelihood of a region without any change, the lowest possible.
    still: f64,
    /// The bin of every pixel's difference, row by row.
    differences: Vec<u8>,
}

impl DifferenceCue {
    pub(super) fn new(settings: PatchSettings, shape: &Shape, level: Level) -> Result<Self, Error> {
        settings.check()?;
        let bins = settings.bins.count();
        let uniform = vec![1.0 / bins as f64; bins];
        let mut unchanged = vec![0.0; bins];
        unchanged[0] = 1.0;
        Ok(Self {
            still: settings.log_likelihood(squared_distance(&unchanged, &uniform)),
            patch: Patch::new(settings, shape, &[uniform], level)?,
            differences: Vec::new(),
        })
    }

    pub(super) fn background_log_likelihood(&self) -> f64 {
        self.still
    }

    /// Adds one camera's log-likelihood of each particle. For the camera's first frame it is the same for
    /// all.
    pub(super) fn add_camera(
        &mut self,
        prepared: &PreparedFrame,
        positions: [&[f32]; 3],
        out: &mut [f32],
    ) {
        let Some(before) = prepared.before() else {
            let still = self.still as f32;
            for out in out {
                *out += still;
            }
            return;
        };
        let frame = prepared.frame();
        let width = frame.width();
        let shift = 8 - self.patch.settings().bins.count().ilog2();
        self.differences.resize(width * frame.height(), 0);
        with_pixels!(before, components => {
            write_rows(&mut self.differences, width, |x, y, _| grey(before, components(x, y)));
        });
        with_pixels!(frame, components => {
            write_rows(&mut self.differences, width, |x, y, before| {
                grey(frame, components(x, y)).abs_diff(before) >> shift
            });
        });
        let differences = &self.differences;
        self.patch.add(prepared.view(), positions, out, |x, y| {
            [differences[y * width + x]]
        });
    }
}

/// Returns the mean of red, green and blue; for YUV, Y.
#[inline(always)]
fn grey(frame: &Frame, [a, b, c]: [u8; 3]) -> u8 {
    match frame.format() {
        PixelFormat::Rgb8 => ((u16::from(a) + u16::from(b) + u16::from(c)) / 3) as u8,
        _ => a,
    }
}

/// Replaces each pixel with the result of `of` for its position (x, y) and value.
fn write_rows(pixels: &mut [u8], width: usize, of: impl Fn(usize, usize, u8) -> u8 + Sync) {
    pixels
        .par_chunks_mut(width)
        .enumerate()
        .for_each(|(y, row)| {
            for (x, pixel) in row.iter_mut().enumerate() {
                *pixel = of(x, y, *pixel);
            }
        });
}
