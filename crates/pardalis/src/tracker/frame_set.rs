//! The frames of one instant.

use super::image_box::{CameraBoxes, ImageBox};
use super::{CameraId, TargetId};
use crate::Frame;
use crate::frame::check_time;
use pardalis_core::Error;

/// The frames of one instant, at most one per camera, and the time of the instant, which is that of the latest frame.
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
    boxes: Vec<CameraBoxes>,
}

impl FrameSet {
    /// Maximum difference of the times of frames of one instant, in seconds: cameras without a common trigger that happen to look at once, or whose frames are stamped when they arrive. Detected targets in
    /// motion are looked for where they were at the time of each frame. Hand-set: what frames of one instant differ by on their way through networks and operating systems.
    pub const MAX_SPREAD_S: f64 = 4e-3;

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
            let allowed = format!(
                "at most {} s after {first_s}, the time of another frame of the set",
                Self::MAX_SPREAD_S
            );
            return Err(Error::out_of_range("time_s", time_s, &allowed));
        }
        Ok(Self {
            time_s,
            frames,
            boxes: Vec::new(),
        })
    }

    /// Creates the set of a single frame.
    pub fn of(camera: CameraId, frame: Frame) -> Self {
        Self {
            time_s: frame.time_s(),
            frames: vec![(camera.index(), frame)],
            boxes: Vec::new(),
        }
    }

    /// Creates a set without frames, which only advances the time. Returns an error unless the time, in seconds, is
    /// a number within ±1e12.
    pub fn without_frames(time_s: f64) -> Result<Self, Error> {
        check_time(time_s)?;
        Ok(Self {
            time_s,
            frames: Vec::new(),
            boxes: Vec::new(),
        })
    }

    /// Adds what a detector found of a target that has one ([`BoxedSettings`](super::BoxedSettings), [`DetectedSettings::detector`](super::DetectedSettings::detector)) in a camera's image of this instant, whose frame may be in the set, too, or not: nothing, one box, or several of which
    /// one is the target's. Of a crowd, each may be a member's. An empty list says that the detector looked at the image and found nothing; without a list it did not look.
    ///
    /// ```
    /// use pardalis::tracker::ImageBox;
    /// use pardalis::{CameraId, FrameSet, TargetId};
    ///
    /// let found = vec![ImageBox::new([100.0, 80.0, 140.0, 120.0])?.with_score(0.8)?];
    /// let set = FrameSet::without_frames(0.04)?.with_boxes(CameraId::new(0), TargetId::new(0), found)?;
    /// assert_eq!(set.time_s(), 0.04);
    /// # Ok::<(), pardalis::Error>(())
    /// ```
    ///
    /// Returns an error if there are boxes of that target and camera already.
    pub fn with_boxes(
        mut self,
        camera: CameraId,
        target: TargetId,
        boxes: Vec<ImageBox>,
    ) -> Result<Self, Error> {
        let (camera, target) = (camera.index(), target.index());
        let mut others = self.boxes.iter();
        if others.any(|other| (other.camera, other.target) == (camera, target)) {
            let allowed = "cameras that have one list of boxes of a target in the set";
            return Err(Error::out_of_range("camera", camera, allowed));
        }
        self.boxes.push(CameraBoxes {
            camera,
            target,
            boxes,
        });
        Ok(self)
    }

    /// Removes the frames for which `keep` returns `false`, such as frozen images, and the boxes in them. The time does not change.
    pub fn retain(&mut self, mut keep: impl FnMut(CameraId, &Frame) -> bool) {
        let boxes = &mut self.boxes;
        self.frames.retain(|(camera, frame)| {
            let is_kept = keep(CameraId::new(*camera), frame);
            if !is_kept {
                boxes.retain(|boxes| boxes.camera != *camera);
            }
            is_kept
        });
    }

    /// Removes the frames and boxes of the cameras whose number is refused.
    pub(super) fn retain_cameras(&mut self, keep: impl Fn(usize) -> bool) {
        self.frames.retain(|(camera, _)| keep(*camera));
        self.boxes.retain(|boxes| keep(boxes.camera));
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

    /// Returns what detectors found.
    pub(super) fn boxes(&self) -> &[CameraBoxes] {
        &self.boxes
    }
}
