//! What changed from one image to the next, in a region (Campos 2009, section 3.3): a target that moves stands out from all that is still, though it
//! have the same colours.

use rayon::prelude::*;

use super::patch::{Patch, PatchSettings, squared_distance};
use crate::Frame;
use crate::frame::{PixelFormat, with_pixels};
use crate::shape::Shape;
use crate::view::PreparedFrame;
use pardalis_core::Error;
use pardalis_core::simd::Level;

/// The difference cue of one target: the histogram of absolute differences of grey against a uniform one. Only for cameras that stand still.
#[derive(Debug)]
pub(super) struct DifferenceCue {
    patch: Patch,
    /// The log-likelihood of what does not change at all: least of all.
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

    /// Adds what one camera says of each particle; with its first frame, the same of all.
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

/// The mean of red, green and blue; of YUV, Y.
#[inline(always)]
fn grey(frame: &Frame, [a, b, c]: [u8; 3]) -> u8 {
    match frame.format() {
        PixelFormat::Rgb8 => ((u16::from(a) + u16::from(b) + u16::from(c)) / 3) as u8,
        _ => a,
    }
}

/// Replaces each pixel by what becomes of it at its place (x, y).
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
