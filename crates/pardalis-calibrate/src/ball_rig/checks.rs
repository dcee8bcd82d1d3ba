//! What a rig that is calibrated with a ball requires of the data, and the errors that say what is missing.

use super::super::CalibrationError;
use super::super::temporal::MIN_DETECTIONS;
use super::super::temporal::path::Observation;
use super::start::Link;
use super::{BallRigCalibration, Place, Rig};

/// Number of standard deviations of distances by size up to which the places of two cameras agree at first.
pub(super) const AGREEING_SIGMAS: f64 = 4.0;

/// Least share of the frames that two cameras share in which they agree.
const LEAST_SUPPORT: f64 = 0.15;

/// Largest standard deviation of a rotation, in radians: 1 degree.
const MAX_TURN_SIGMA_RAD: f64 = 0.0175;

/// Largest standard deviation of a position, as a share of the distance from the ball.
const MAX_POSITION_SIGMA: f64 = 0.03;

/// Largest standard deviation of an offset, in frames.
const MAX_OFFSET_SIGMA: f64 = 0.25;

/// A path is a plane if its least width falls below this share of its length.
const FLAT: f64 = 0.1;

/// A path is a line if its width falls below this share of its length. Its own noise then pretends to determine how cameras are turned
/// about the line.
const NARROW: f64 = 0.05;

/// Reports whether the paths of two cameras match.
pub(super) fn is_linked(link: &Link) -> bool {
    link.support >= (LEAST_SUPPORT * link.common as f64).max(0.5 * MIN_DETECTIONS as f64)
}

pub(super) fn no_common_path() -> CalibrationError {
    CalibrationError::new(
        "the cameras do not see one path of the ball",
        "wave the ball where two or more cameras see it at the same times, and check its radius and the models of the cameras",
    )
}

impl Rig<'_> {
    fn name(&self, camera: usize) -> &str {
        self.recording.cameras[camera].name
    }

    /// Error for cameras whose paths match that of no camera that has been placed.
    pub(super) fn unlinked(
        &self,
        places: &[Option<Place>],
        best: Option<(usize, Link)>,
    ) -> CalibrationError {
        let of = |wanted: bool| {
            let cameras = places.iter().enumerate();
            let names = cameras
                .filter(|(_, place)| place.is_some() == wanted)
                .map(|(camera, _)| self.name(camera));
            names.collect::<Vec<_>>().join(", ")
        };
        let (placed, open) = (of(true), of(false));
        match best {
            Some((camera, link)) if link.common >= MIN_DETECTIONS => CalibrationError::new(
                format!(
                    "the path of the ball in {} matches that in no other camera ({placed}), for any pose and offset: they agree in at most {:.0} of {} frames",
                    self.name(camera),
                    link.support,
                    link.common
                ),
                "check the models of the cameras and their time stamps, allow larger offsets (max-offset-s), wave the ball in all directions rather than along a line, and remove other things of its colours",
            ),
            _ => CalibrationError::new(
                format!(
                    "{open} and {placed} never see the ball at the same times, so that nothing connects them"
                ),
                format!(
                    "wave the ball where one of {open} and one of {placed} see it at the same time, for a few seconds, or leave {open} out"
                ),
            ),
        }
    }

    pub(super) fn border(&self, camera: usize, max_offset_s: f64) -> CalibrationError {
        CalibrationError::new(
            format!(
                "the best time offset of {} lies at the border of the search range of {max_offset_s} s, or there is none",
                self.name(camera)
            ),
            "allow larger offsets (max-offset-s), or wave the ball faster and less evenly",
        )
    }

    pub(super) fn check_border(
        &self,
        calibration: &BallRigCalibration,
        max_offset_s: f64,
    ) -> Result<(), CalibrationError> {
        let mut cameras = calibration.cameras.iter();
        match cameras.position(|camera| camera.offset_s.abs() > max_offset_s) {
            Some(camera) => Err(self.border(camera, max_offset_s)),
            None => Ok(()),
        }
    }

    /// Requires that every camera agrees with the others in most of its detections near the path.
    pub(super) fn check_agreement(
        &self,
        matched: &[Observation],
        inlier: &[bool],
    ) -> Result<(), CalibrationError> {
        for camera in 0..self.recording.cameras.len() {
            let own = matched.iter().zip(inlier);
            let own = own.filter(|(seen, _)| seen.camera == camera);
            let agreeing = own.clone().filter(|(_, used)| **used).count();
            let all = own.count();
            if agreeing < MIN_DETECTIONS || 2 * agreeing < all {
                return Err(CalibrationError::new(
                    format!(
                        "{} agrees with the other cameras on the ball's path in {agreeing} of {all} frames",
                        self.name(camera)
                    ),
                    "check the model of its lens, wave the ball for longer where other cameras see it, too, and remove other things of its colours",
                ));
            }
        }
        Ok(())
    }

    /// Requires that the data determine all poses and offsets.
    pub(super) fn check_determined(
        &self,
        calibration: &BallRigCalibration,
    ) -> Result<(), CalibrationError> {
        let [length_m, width_m, depth_m] = calibration.widths_m;
        if width_m < NARROW * length_m {
            return Err(CalibrationError::new(
                format!(
                    "the ball moved along a line, {length_m:.3} m long and {width_m:.3} m wide (standard deviations), about which the cameras may be turned"
                ),
                "wave the ball in all directions",
            ));
        }
        let shape = if depth_m < FLAT * length_m {
            "the ball moved in a plane; wave it in all directions, also towards the cameras and away from them"
        } else {
            "wave the ball for longer, nearer to the cameras and over more of what they share"
        };
        for (number, camera) in calibration.cameras.iter().enumerate().skip(1) {
            let at = camera.world_from_camera.translation.vector;
            let far = calibration.path_m.iter();
            let far = far.map(|(_, place)| (nalgebra::Vector3::from(*place) - at).norm());
            let distance_m = far.sum::<f64>() / calibration.path_m.len() as f64;
            let is_determined = camera.turn_sigma_rad <= MAX_TURN_SIGMA_RAD
                && camera.position_sigma_m <= MAX_POSITION_SIGMA * distance_m;
            if !is_determined {
                return Err(CalibrationError::new(
                    format!(
                        "the data do not determine the pose of {}: its standard deviations would be {:.1} degrees and {:.3} m",
                        self.name(number),
                        camera.turn_sigma_rad.to_degrees(),
                        camera.position_sigma_m
                    ),
                    shape,
                ));
            }
            if !(camera.offset_sigma_s <= MAX_OFFSET_SIGMA * self.recording.intervals_s[number]) {
                return Err(CalibrationError::new(
                    format!(
                        "the data do not determine the time offset of {}: its standard deviation would be {:.1} ms",
                        self.name(number),
                        1e3 * camera.offset_sigma_s
                    ),
                    "wave the ball faster, to and fro in all directions",
                ));
            }
        }
        Ok(())
    }
}
