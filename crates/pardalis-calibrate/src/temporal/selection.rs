//! Selection of the target among the detections of each image.

use super::path::{Observation, Path};
use super::{Detection, DetectionFrame, Recording, TimedCamera, median};

/// Largest number of control points. Longer recordings are cut: the cost grows with the cube of this number,
/// the accuracy hardly.
const MAX_CONTROLS: usize = 400;

/// Distance from the predicted position, in pixels, beyond which a detection is another object (if it also exceeds
/// the diameter of the target's image).
const MATCH_PX: f64 = 5.0;

/// A detection belongs to the background if more than this share of the frames contain one of similar size at
/// its position.
const STILL_SHARE: f64 = 0.5;
/// Tolerance of that position, in pixels.
const STILL_PX: f64 = 1.5;
/// Number of frames that this test samples.
const STILL_FRAMES: usize = 200;

/// A detection is of another object, or of a target that is partly covered, if its distance by size differs from
/// that of the path by more than this share, relative to what is typical of the camera's detections.
const SIZE_TOLERANCE: f64 = 0.15;

/// Largest distance, in frames, at which the detections of two cameras count as simultaneous.
const SHARED_FRAMES: f64 = 1.5;

/// Returns a camera's frames with the detections that may be the target: those that do not belong to the
/// background. Repeated frames are dropped.
pub(crate) fn candidates(camera: &TimedCamera) -> Vec<DetectionFrame> {
    let step = camera.frames.len().div_ceil(STILL_FRAMES).max(1);
    let sample: Vec<&DetectionFrame> = camera.frames.iter().step_by(step).collect();
    let is_scenery = |detection: &&Detection| {
        let same = |other: &Detection| {
            let moved = [0, 1].map(|i| other.pixel[i] - detection.pixel[i]);
            let grown = other.radius_px / detection.radius_px;
            libm::hypot(moved[0], moved[1]) <= STILL_PX && (0.85..=1.18).contains(&grown)
        };
        let with_it = sample
            .iter()
            .filter(|frame| frame.detections.iter().any(same));
        with_it.count() as f64 > STILL_SHARE * sample.len() as f64
    };
    let mut last_s = f64::NEG_INFINITY;
    let mut kept = Vec::new();
    for frame in &camera.frames {
        if frame.time_s <= last_s {
            continue;
        }
        last_s = frame.time_s;
        let detections = frame.detections.iter();
        kept.push(DetectionFrame {
            time_s: frame.time_s,
            detections: detections
                .filter(|found| !is_scenery(found))
                .copied()
                .collect(),
        });
    }
    kept
}

impl Recording<'_> {
    /// Returns all detections, camera by camera in order of frames.
    pub(crate) fn observations(&self) -> Vec<Observation> {
        let mut observations = Vec::new();
        for (camera, frames) in self.candidates.iter().enumerate() {
            for (number, frame) in frames.iter().enumerate() {
                let detections = frame.detections.iter();
                observations
                    .extend(detections.map(|found| self.observation((camera, number), found)));
            }
        }
        observations
    }

    pub(crate) fn observation(
        &self,
        (camera, frame): (usize, usize),
        found: &Detection,
    ) -> Observation {
        let view = self.views[camera];
        let below_middle = found.pixel[1] - 0.5 * (view.size().1 as f64 - 1.0);
        Observation {
            camera,
            frame,
            time_s: self.candidates[camera][frame].time_s + view.line_delay_s() * below_middle,
            pixel: found.pixel,
            radius_px: found.radius_px,
            distance_m: found.distance_m,
        }
    }

    /// Limits long recordings to the interval with the most motion in the images.
    pub(super) fn fastest_stretch(
        &self,
        mut observations: Vec<Observation>,
        offsets_s: &[f64],
    ) -> Vec<Observation> {
        let moved = |pair: &[Observation]| {
            let [du, dv] = [0, 1].map(|i| pair[1].pixel[i] - pair[0].pixel[i]);
            // A jump to another object is not motion.
            let px = libm::hypot(du, dv).min(50.0);
            let same = pair[0].camera == pair[1].camera;
            (
                pair[1].time_s + offsets_s[pair[1].camera],
                if same { px } else { 0.0 },
            )
        };
        let mut motion: Vec<(f64, f64)> = observations.windows(2).map(moved).collect();
        motion.sort_by(|a, b| a.0.total_cmp(&b.0));
        let stretch_s = MAX_CONTROLS as f64 * self.control_interval_s();
        let (mut first, mut sum) = (0, 0.0);
        let mut best = (f64::NEG_INFINITY, f64::NEG_INFINITY);
        for &(time_s, px) in &motion {
            sum += px;
            while motion[first].0 < time_s - stretch_s {
                sum -= motion[first].1;
                first += 1;
            }
            if sum > best.0 {
                best = (sum, time_s);
            }
        }
        observations.retain(|observation| {
            let time_s = observation.time_s + offsets_s[observation.camera];
            (best.1 - stretch_s..=best.1).contains(&time_s)
        });
        observations
    }

    /// Returns the detection of every frame that is most likely the target on this path.
    pub(super) fn matched(&self, path: &Path, offsets_s: &[f64]) -> Vec<Observation> {
        let mut all = Vec::new();
        for (camera, frames) in self.candidates.iter().enumerate() {
            let view = self.views[camera];
            let nearest = |(number, frame): (usize, &DetectionFrame)| {
                let center = path.position_m(frame.time_s + offsets_s[camera])?;
                let center = view.camera_from_world() * center;
                let at_px = view.camera().project(center.into())?;
                let off_px = |found: &Detection| {
                    libm::hypot(found.pixel[0] - at_px[0], found.pixel[1] - at_px[1])
                };
                let detections = frame.detections.iter();
                let found = detections.min_by(|a, b| off_px(a).total_cmp(&off_px(b)))?;
                let is_near = off_px(found) <= (2.0 * found.radius_px).max(MATCH_PX);
                let log_size = libm::log(found.distance_m / center.coords.norm());
                is_near.then(|| (self.observation((camera, number), found), log_size))
            };
            let found: Vec<(Observation, f64)> =
                frames.iter().enumerate().filter_map(nearest).collect();
            let mut log_sizes: Vec<f64> = found.iter().map(|(_, log_size)| *log_size).collect();
            let typical = median(&mut log_sizes).unwrap_or(0.0);
            let is_typical = |log_size: f64| (log_size - typical).abs() <= SIZE_TOLERANCE;
            let whole = found.iter().filter(|(_, log_size)| is_typical(*log_size));
            all.extend(whole.map(|(observation, _)| *observation));
        }
        all
    }

    /// Returns the observations made while another camera also saw the target; the others carry no
    /// information on time offsets.
    pub(crate) fn simultaneous(
        &self,
        observations: &[Observation],
        offsets_s: &[f64],
    ) -> Vec<Observation> {
        let time_s = |observation: &Observation| observation.time_s + offsets_s[observation.camera];
        let mut order: Vec<(f64, usize)> =
            observations.iter().map(|s| (time_s(s), s.camera)).collect();
        order.sort_by(|a, b| a.0.total_cmp(&b.0));
        let is_simultaneous = |observation: &&Observation| {
            let reach_s = SHARED_FRAMES * self.intervals_s[observation.camera];
            let first = order.partition_point(|(at_s, _)| *at_s < time_s(observation) - reach_s);
            let near = order[first..].iter();
            near.take_while(|(at_s, _)| *at_s <= time_s(observation) + reach_s)
                .any(|(_, camera)| *camera != observation.camera)
        };
        observations
            .iter()
            .filter(is_simultaneous)
            .copied()
            .collect()
    }
}
