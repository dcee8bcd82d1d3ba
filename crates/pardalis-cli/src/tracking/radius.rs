//! The radii of balls that were estimated, compared with the scene.

use anyhow::Result;
use pardalis::shape::Shape;
use pardalis::tracker::{RadiusEstimate, SizeTolerance};
use pardalis::{TargetId, Tracker};
use pardalis_scene::{BodyConfig, Scene};

/// A radius that differs from the scene's by more standard deviations contradicts it, unless it is within the tolerance. Hand-set: as in statistics.
const CONTRADICTING_SIGMAS: f64 = 3.0;

/// The radius of one ball of a scene, estimated by its cameras.
pub(crate) struct EstimatedRadius<'a> {
    /// The key of the ball in the scene.
    pub(crate) key: String,
    body: &'a BodyConfig,
    /// The estimate after the last frames.
    pub(crate) estimate: RadiusEstimate,
}

impl<'a> EstimatedRadius<'a> {
    /// Returns those of a target; none of a crowd, in whose rows each member has its own.
    pub(crate) fn of(scene: &'a Scene, tracker: &Tracker, number: usize) -> Result<Vec<Self>> {
        let target = &scene.targets[number];
        let now_s = tracker.time_s().unwrap_or(0.0);
        let estimates = tracker.bodies_at(TargetId::new(number), now_s)?;
        let of_body = |(body, estimate): (&'a BodyConfig, pardalis::Estimate)| {
            let key = if target.bodies.len() > 1 {
                format!("targets.{}.landmarks.{}", target.name, body.name)
            } else {
                format!("targets.{}", target.name)
            };
            Some(Self {
                key,
                body,
                estimate: estimate.radius?,
            })
        };
        Ok(target
            .bodies
            .iter()
            .zip(estimates)
            .filter(|_| target.crowd.is_none())
            .filter_map(of_body)
            .collect())
    }

    /// Returns the scene's radius in metres, if the estimate contradicts it.
    pub(crate) fn contradicted_m(&self) -> Option<f64> {
        let (Shape::Sphere(ball), SizeTolerance::Share(share)) = (&self.body.shape, self.body.size)
        else {
            return None;
        };
        let off_m = (self.estimate.radius_m - ball.radius_m).abs();
        let is_far = off_m > CONTRADICTING_SIGMAS * self.estimate.sigma_m;
        (is_far && off_m > share * ball.radius_m).then_some(ball.radius_m)
    }
}

impl std::fmt::Display for EstimatedRadius<'_> {
    /// Writes the radius with its standard deviation, in millimetres.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let [radius_mm, sigma_mm] =
            [self.estimate.radius_m, self.estimate.sigma_m].map(|m| 1000.0 * m);
        // The standard deviation has two digits.
        let decimals = (1.0 - libm::log10(sigma_mm).floor()).clamp(0.0, 6.0) as usize;
        write!(f, "{radius_mm:.decimals$} ± {sigma_mm:.decimals$} mm")
    }
}
