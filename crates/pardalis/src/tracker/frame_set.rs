//! The frames of one instant.

use super::CameraId;
use crate::Frame;
use crate::frame::check_time;
use pardalis_core::Error;

/// The frames of one instant, at most one per camera, and the time of the instant, which is that of the frames.
///
/// ```
/// use pardalis::color::YuvEncoding;
/// use pardalis::{CameraId, Frame, FrameSet, PixelFormat};
///
/// let frame = |time_s| Frame::new(PixelFormat::Rgb8, YuvEncoding::default(), 2, 1, vec![0; 6], time_s);
/// let [left, right] = [CameraId::new(0), CameraId::new(1)];
/// let set = FrameSet::new([(left, frame(0.04)?), (right, frame(0.04)?)])?;
/// assert_eq!(set.time_s(), 0.04);
/// // One camera has one frame per instant.
/// assert!(FrameSet::new([(left, frame(0.04)?), (left, frame(0.04)?)]).is_err());
/// # Ok::<(), pardalis::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct FrameSet {
    time_s: f64,
    frames: Vec<(usize, Frame)>,
}

impl FrameSet {
    /// Maximum difference of the times of frames of one instant, in seconds. At 10 m/s a target moves 1 cm in it.
    pub const MAX_SPREAD_S: f64 = 1e-3;

    /// Creates the set of these frames, each with its camera. The time of the set is that of the latest frame.
    ///
    /// Returns an error if there is no frame, a camera has two frames, or the times differ by more than
    /// [`FrameSet::MAX_SPREAD_S`].
    pub fn new(frames: impl IntoIterator<Item = (CameraId, Frame)>) -> Result<Self, Error> {
        let frames: Vec<(usize, Frame)> = frames
            .into_iter()
            .map(|(camera, frame)| (camera.index(), frame))
            .collect();
        for (number, (camera, _)) in frames.iter().enumerate() {
            if frames[..number].iter().any(|(other, _)| other == camera) {
                let allowed = "cameras that have one frame in the set";
                return Err(Error::out_of_range("camera", camera, allowed));
            }
        }
        let times_s = || frames.iter().map(|(_, frame)| frame.time_s());
        let (Some(first_s), Some(time_s)) =
            (times_s().reduce(f64::min), times_s().reduce(f64::max))
        else {
            return Err(Error::Empty {
                what: "the set of frames".to_owned(),
                remedy: "give one, or use FrameSet::without_frames to let time pass".to_owned(),
            });
        };
        if time_s - first_s > Self::MAX_SPREAD_S {
            let allowed =
                format!("at most 0.001 s after {first_s}, the time of another frame of the set");
            return Err(Error::out_of_range("time_s", time_s, &allowed));
        }
        Ok(Self { time_s, frames })
    }

    /// Creates the set of a single frame.
    pub fn of(camera: CameraId, frame: Frame) -> Self {
        Self {
            time_s: frame.time_s(),
            frames: vec![(camera.index(), frame)],
        }
    }

    /// Creates a set without frames, which only advances the time. Returns an error unless the time, in seconds, is
    /// a number within ±1e12.
    pub fn without_frames(time_s: f64) -> Result<Self, Error> {
        check_time(time_s)?;
        Ok(Self {
            time_s,
            frames: Vec::new(),
        })
    }

    /// Removes the frames for which `keep` returns `false`, such as frozen images. The time does not change.
    pub fn retain(&mut self, mut keep: impl FnMut(CameraId, &Frame) -> bool) {
        self.frames
            .retain(|(camera, frame)| keep(CameraId::new(*camera), frame));
    }

    /// Returns the time of the instant in seconds, finite.
    pub fn time_s(&self) -> f64 {
        self.time_s
    }

    /// Returns the frames with their cameras.
    pub fn frames(&self) -> impl ExactSizeIterator<Item = (CameraId, &Frame)> {
        let frames = self.frames.iter();
        frames.map(|(camera, frame)| (CameraId::new(*camera), frame))
    }

    /// Returns the frames with the indices of their cameras, as cues expect them.
    pub(super) fn numbered(&self) -> &[(usize, Frame)] {
        &self.frames
    }
}
