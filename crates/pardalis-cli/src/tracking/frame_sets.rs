//! The frames of several cameras, put in time order.

use anyhow::Result;
use pardalis::Frame;

use crate::source::Source;

/// Frames closer in time than this belong to one set, in seconds: triggered cameras whose time stamps were rounded.
const SAME_INSTANT_S: f64 = 1e-6;

/// The frames of one instant.
pub(crate) struct FrameSet {
    /// The latest time stamp, in seconds.
    pub(crate) time_s: f64,
    /// Each frame with its camera's number.
    pub(crate) frames: Vec<(usize, Frame)>,
}

/// Merges the frames of all cameras; cameras need not run at one rate.
pub(crate) struct FrameSets<'a> {
    sources: &'a mut [Source],
    /// The next frame of each source, once it is fetched.
    next: Vec<Option<Frame>>,
}

impl<'a> FrameSets<'a> {
    /// Takes frames from these sources.
    pub(crate) fn new(sources: &'a mut [Source]) -> Self {
        let next = sources.iter().map(|_| None).collect();
        Self { sources, next }
    }
}

impl Iterator for FrameSets<'_> {
    type Item = Result<FrameSet>;

    fn next(&mut self) -> Option<Self::Item> {
        for (next, source) in self.next.iter_mut().zip(&mut *self.sources) {
            if next.is_none() {
                match source.next().transpose() {
                    Ok(frame) => *next = frame,
                    Err(error) => return Some(Err(error)),
                }
            }
        }
        let first = self
            .next
            .iter()
            .flatten()
            .map(Frame::time_s)
            .min_by(f64::total_cmp)?;
        let mut set = FrameSet {
            time_s: first,
            frames: Vec::new(),
        };
        for (camera, next) in self.next.iter_mut().enumerate() {
            if let Some(frame) = next.take_if(|frame| frame.time_s() <= first + SAME_INSTANT_S) {
                set.time_s = set.time_s.max(frame.time_s());
                set.frames.push((camera, frame));
            }
        }
        Some(Ok(set))
    }
}
