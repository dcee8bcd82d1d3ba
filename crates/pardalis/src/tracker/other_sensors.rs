//! What other sensors measure of the targets of a tracker.

use super::measurements::{MeasurementCounts, Measurements, ObservedMeasurement};
use super::target::Target;
use super::target_tracker::TargetTracker;
use super::{TargetId, Tracker};
use pardalis_core::Error;
use pardalis_filter::Measurement;

impl Tracker {
    /// Takes what another sensor measures of a target: a position, a velocity, a range or a bearing, at a time of its own.
    ///
    /// It is taken into account with the next frame set at its time or after it, [`FrameSet::without_frames`](super::FrameSet::without_frames) included, in the order of time. Of what is older than the latest frame
    /// set, positions, ranges and bearings of the last 0.1 s are used, too.
    ///
    /// A measurement says where the target is, and not whether it exists: cameras find it and decide that it is lost. As long as it is occluded, measurements keep it. While it is
    /// not known, a position with all coordinates says where to search, and others are not used. Outliers are not used either.
    ///
    /// Returns an error if the target is unknown, has several bodies or published cues, or has no velocity that could be measured.
    ///
    /// ```
    /// # use pardalis::camera::{Pinhole, Pose};
    /// # use pardalis::shape::{Shape, Sphere, SphereOutline};
    /// # use pardalis::tracker::BoxedSettings;
    /// # use pardalis::{FrameSet, Tracker, View};
    /// use pardalis::tracker::{Measurement, ObservedMeasurement};
    ///
    /// # let lens = Pinhole::new([500.0; 2], [159.5, 119.5], &[])?;
    /// # let mut setup = Tracker::builder();
    /// # setup.camera(View::new(lens, Pose::identity(), (320, 240), None)?);
    /// # let ball = setup.target(BoxedSettings::new(Shape::Sphere(Sphere::new(0.1, SphereOutline::Tangent)?)));
    /// # let mut tracker = setup.build()?;
    /// let range = Measurement::range(0.02, [0.0, 0.0, 1.0], 3.2, 0.02)?;
    /// assert_eq!(tracker.observe_measurement(ball, &range)?, ObservedMeasurement::Waiting);
    /// tracker.observe(&FrameSet::without_frames(0.04)?)?;
    /// // Nobody has been found that it could be about.
    /// assert_eq!(tracker.measurement_counts(ball)?.without_target, 1);
    /// # Ok::<(), pardalis::Error>(())
    /// ```
    pub fn observe_measurement(
        &mut self,
        target: TargetId,
        measurement: &Measurement,
    ) -> Result<ObservedMeasurement, Error> {
        let Target { bodies, crowd, .. } = self.target(target)?;
        let (bodies, is_crowd) = (bodies.clone(), crowd.is_some());
        let latest_s = self.time_s;
        let [body] = &mut self.bodies[bodies] else {
            return Err(not_measured(target));
        };
        let has_velocity = body.has_velocity();
        let Some(measurements) = body.measurements_mut().filter(|_| !is_crowd) else {
            return Err(not_measured(target));
        };
        if measurement.is_of_velocity() && !has_velocity {
            return Err(Error::refused(
                "the motion model of the target has no velocity that could be measured",
                "use constant velocity, or leave out measurements of the velocity",
            ));
        }
        measurements.push(measurement, latest_s)
    }

    /// Returns what became of the measurements of a target by other sensors.
    ///
    /// Returns an error if the target is unknown.
    pub fn measurement_counts(&self, target: TargetId) -> Result<MeasurementCounts, Error> {
        let body = self.bodies_of(target)?.first();
        let measurements = body.and_then(TargetTracker::measurements);
        Ok(measurements.map(Measurements::counts).unwrap_or_default())
    }

    /// Tells bodies that other sensors measure how uncertain their positions are because of the poses of platforms.
    pub(super) fn tell_platforms(&mut self) {
        if self.carriers.is_empty() {
            return;
        }
        for number in 0..self.bodies.len() {
            let body = &self.bodies[number];
            let is_measured = body.measurements().is_some_and(Measurements::are_waiting);
            let Some(position_m) = body.position_m().filter(|_| is_measured) else {
                continue;
            };
            let mut platforms_m2 = [0.0; 6];
            self.add_platforms(position_m, &mut platforms_m2, body.track());
            if let Some(measurements) = self.bodies[number].measurements_mut() {
                measurements.platforms_m2 = platforms_m2;
            }
        }
    }
}

/// The error for a target that other sensors cannot measure.
fn not_measured(target: TargetId) -> Error {
    let allowed = "a target of one body that is searched for, by its edges or by a detector: not landmarks, a crowd or the published cues";
    Error::out_of_range("target", target, allowed)
}
