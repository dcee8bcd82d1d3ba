//! The heading of a body that turns: its yaw over time, and which of its equal sides is the front.
//!
//! Yaw and rate of turn have a Kalman filter of their own, beside that of the position: given an outline, the two hardly depend on each other. Outlines tell the yaw only up to the angle after
//! which the shape looks the same, and those of shapes that are almost round hardly that. The front is where the body moves to first, and it mostly faces where it moves.

use std::f64::consts::TAU;

use super::{DetectedTarget, TrackState};
use crate::likelihood::edge::{FormEvidence, YawPrior};
use crate::shape::Stance;
use crate::tuning::HeadingTuning;

/// A yaw with this standard deviation, radians, is unknown. Hand-set.
const UNKNOWN_RAD: f64 = 1.0;

/// The course of a body whose standard deviation is at least this, radians, says nothing. Hand-set.
const COURSE_RAD: f64 = 0.5;

/// Up to this many standard deviations from its heading a body moves ahead. Hand-set.
const SAME_WAY_SIGMAS: f64 = 3.0;

/// The direction in which a body faces.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Heading {
    /// The least angle after which the shape looks the same, radians.
    period_rad: f64,
    turn: Option<Turn>,
    /// The sum of the ways travelled, in diameters, in the frame of the body.
    travelled: [f64; 2],
    /// Whether it is known which side is the front: that at the yaw.
    is_front_known: bool,
    /// The velocity noted before the latest, diameters per second.
    before: Option<[f64; 2]>,
}

/// A Gaussian of yaw and rate of turn.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Turn {
    /// Radians.
    yaw_rad: f64,
    rate_radps: f64,
    /// Their covariance: of the yaw in rad², of both, and of the rate.
    covariance: [f64; 3],
}

impl Turn {
    fn begun(yaw_rad: f64, variance: f64, tuning: &HeadingTuning) -> Self {
        Self {
            yaw_rad,
            rate_radps: 0.0,
            covariance: [variance, 0.0, tuning.max_rate_radps.powi(2)],
        }
    }

    /// Adds a measurement that is off by this angle, with this variance in rad².
    fn update(&mut self, off_rad: f64, variance: f64) {
        let [of_yaw, of_both, of_rate] = self.covariance;
        let sum = of_yaw + variance;
        self.yaw_rad += of_yaw / sum * off_rad;
        self.rate_radps += of_both / sum * off_rad;
        self.covariance = [
            of_yaw * variance / sum,
            of_both * variance / sum,
            of_rate - of_both * of_both / sum,
        ];
    }

    fn ahead(&self, ahead_s: f64, tuning: &HeadingTuning) -> Self {
        let [of_yaw, of_both, of_rate] = self.covariance;
        let noise = tuning.turn_noise;
        Self {
            yaw_rad: self.yaw_rad + ahead_s * self.rate_radps,
            covariance: [
                of_yaw + ahead_s * (2.0 * of_both + ahead_s * (of_rate + ahead_s * noise / 3.0)),
                of_both + ahead_s * (of_rate + 0.5 * ahead_s * noise),
                of_rate + ahead_s * noise,
            ],
            ..*self
        }
    }
}

impl Heading {
    /// The heading of a shape that looks the same after turns by this angle.
    pub(super) fn new(period_rad: f64) -> Self {
        Self {
            period_rad,
            turn: None,
            travelled: [0.0; 2],
            is_front_known: false,
            before: None,
        }
    }

    /// Forgets all frames.
    pub(super) fn reset(&mut self) {
        *self = Self::new(self.period_rad);
    }

    /// Predicts to the time of the next frames.
    pub(super) fn predict(&mut self, dt_s: f64, tuning: &HeadingTuning) {
        self.turn = self.turn.map(|turn| turn.ahead(dt_s, tuning));
        if let Some(turn) = &mut self.turn {
            // Angles stay small for ever, and with them the errors of single precision.
            turn.yaw_rad = wrapped(turn.yaw_rad, TAU);
            if turn.covariance[0] >= UNKNOWN_RAD * UNKNOWN_RAD {
                self.reset();
            }
        }
    }

    /// The prior of the yaw in the next frames; `None` if it may be any.
    pub(super) fn prior(&self, tuning: &HeadingTuning) -> Option<YawPrior> {
        // From more directions the outline may be nearer to another one.
        let most = (0.5 * tuning.search_step_rad.min(0.5 * self.period_rad)).powi(2);
        let turn = self.turn.filter(|turn| turn.covariance[0] < most)?;
        Some(YawPrior {
            yaw_rad: turn.yaw_rad,
            sigma_rad: turn.covariance[0].sqrt().max(tuning.min_sigma_rad),
        })
    }

    /// Adds what the frames of one instant say. Errors that a whole outline shares have this standard deviation in pixels.
    pub(super) fn update(
        &mut self,
        evidence: &FormEvidence,
        shared_sigma_px: f64,
        tuning: &HeadingTuning,
    ) {
        let shared_rad = shared_sigma_px / evidence.px_per_unit;
        let variance = 1.0 / evidence.information + shared_rad * shared_rad;
        let apart_px = 0.25 * self.period_rad * evidence.px_per_unit;
        if !(variance < self.uniform_variance() && apart_px >= tuning.min_apart_px) {
            return;
        }
        let Some(turn) = &mut self.turn else {
            self.turn = Some(Turn::begun(evidence.form, variance, tuning));
            return;
        };
        let off = wrapped(evidence.form - turn.yaw_rad, self.period_rad);
        let sum = turn.covariance[0] + variance;
        if off * off > tuning.max_sigmas.powi(2) * sum {
            // It has turned faster than bodies do, or was mistaken before.
            *turn = Turn::begun(turn.yaw_rad + off, variance, tuning);
        } else {
            turn.update(off, variance);
        }
    }

    /// Adds how the body moves: its velocity along the world's x and y axes, in diameters per second, over this time.
    ///
    /// The course is that of two frames: the position moves to and fro with the yaw of an outline that looks alike in two directions.
    pub(super) fn note_motion(&mut self, velocity: [f64; 2], since_s: f64, tuning: &HeadingTuning) {
        let before = self.before.replace(velocity).unwrap_or(velocity);
        let [x, y] = [0, 1].map(|axis| 0.5 * (before[axis] + velocity[axis]));
        let speed = libm::hypot(x, y);
        let course_rad = libm::atan2(y, x);
        let variance = tuning.course_sigma_rad.powi(2) + (tuning.velocity_sigma / speed).powi(2);
        let is_moving = variance < COURSE_RAD * COURSE_RAD;
        let Some(turn) = &mut self.turn else {
            if is_moving {
                self.turn = Some(Turn::begun(course_rad, variance, tuning));
                self.is_front_known = true;
            }
            return;
        };
        if self.is_front_known {
            let off = wrapped(course_rad - turn.yaw_rad, TAU);
            let sum = turn.covariance[0] + variance;
            // It may also move sideways or backwards.
            if is_moving && off * off < SAME_WAY_SIGMAS * SAME_WAY_SIGMAS * sum {
                turn.update(off, variance);
            }
            return;
        }
        let turn = *turn;
        let (sin, cos) = libm::sincos(turn.yaw_rad);
        self.travelled[0] += since_s * (cos * x + sin * y);
        self.travelled[1] += since_s * (cos * y - sin * x);
        let (front, share) = self.likeliest_front(tuning);
        if share >= tuning.likely_front_share {
            let turned_rad = front as f64 * self.period_rad;
            let yaw_rad = turn.yaw_rad + turned_rad;
            self.turn = Some(Turn { yaw_rad, ..turn });
            let (sin, cos) = libm::sincos(turned_rad);
            let [ahead, left] = self.travelled;
            self.travelled = [cos * ahead + sin * left, cos * left - sin * ahead];
            self.is_front_known = share >= tuning.front_share;
        }
    }

    /// The number of sides that may be the front.
    fn sides(&self) -> usize {
        (TAU / self.period_rad).round() as usize
    }

    /// The logarithm of the likelihood that a side is the front, by the way travelled.
    fn log_likelihood(&self, side: usize, tuning: &HeadingTuning) -> f64 {
        let (sin, cos) = libm::sincos(side as f64 * self.period_rad);
        tuning.front_nats * (cos * self.travelled[0] + sin * self.travelled[1])
    }

    /// The side that most likely is the front, counted from the yaw, and the probability that it is.
    fn likeliest_front(&self, tuning: &HeadingTuning) -> (usize, f64) {
        let of = |side| self.log_likelihood(side, tuning);
        let better = |a, b| if of(b) > of(a) { b } else { a };
        let front = (0..self.sides()).fold(0, better);
        let sum: f64 = (0..self.sides())
            .map(|side| libm::exp(of(side) - of(front)))
            .sum();
        (front, 1.0 / sum)
    }

    /// The heading `ahead_s` seconds after the latest frames, within ±π, and its standard deviation, radians. As long as it is not known which side is the front, it is that of
    /// any one of them until another is likely, and the deviation tells so.
    pub(super) fn estimate(&self, ahead_s: f64, tuning: &HeadingTuning) -> Option<[f64; 2]> {
        let turn = self.turn?.ahead(ahead_s, tuning);
        if self.is_front_known {
            return Some([wrapped(turn.yaw_rad, TAU), turn.covariance[0].sqrt()]);
        }
        let (front, share) = self.likeliest_front(tuning);
        let best = self.log_likelihood(front, tuning);
        let of_front: f64 = (0..self.sides())
            .map(|side| {
                let turned_rad = wrapped(side as f64 * self.period_rad, TAU);
                let probability = share * libm::exp(self.log_likelihood(side, tuning) - best);
                probability * turned_rad * turned_rad
            })
            .sum();
        let sigma_rad = (turn.covariance[0] + of_front).sqrt();
        Some([wrapped(turn.yaw_rad, TAU), sigma_rad])
    }

    /// The yaw of the outline, radians; 0 if it is unknown.
    fn yaw_rad(&self) -> f64 {
        self.turn.map_or(0.0, |turn| turn.yaw_rad)
    }

    /// The variance of a yaw of which nothing is known, rad²: that of a uniform distribution.
    fn uniform_variance(&self) -> f64 {
        self.period_rad * self.period_rad / 12.0
    }
}

impl DetectedTarget {
    /// Follows the heading of a body that turns, given the number of its detection, unless something hides part of it.
    pub(super) fn turn_to(&mut self, detection: usize) {
        let confidence = self.confidence();
        let Some(heading) = &mut self.heading else {
            return;
        };
        let detection = &self.detector.detections()[detection];
        let certain = &self.tuning.adaptation;
        if self.track.state() != TrackState::Tracking
            || confidence < certain.certain_confidence
            || detection.least_visible_share() < certain.unoccluded_share
        {
            return;
        }
        let tuning = &self.tuning.heading;
        if let Some(evidence) = detection.yaw() {
            let shared_sigma_px = self.edge.settings().shared_sigma_px;
            heading.update(evidence, shared_sigma_px, tuning);
        }
        let known = self.filter.estimate(0.0).filter(|_| self.track.is_known());
        if let Some([vx, vy, _]) = known.and_then(|known| known.velocity_mps) {
            let velocity = [vx, vy].map(|v| v / self.shape.diameter_m());
            heading.note_motion(velocity, self.since_s, tuning);
        }
    }

    /// Its stance as it is known now.
    pub(super) fn stance(&self) -> Stance {
        Stance {
            scale: self.size.known().scale(),
            yaw_rad: self.heading.map_or(0.0, |heading| heading.yaw_rad()),
        }
    }
}

/// Wraps an angle to within half a period of zero.
fn wrapped(angle_rad: f64, period_rad: f64) -> f64 {
    angle_rad - period_rad * (angle_rad / period_rad).round()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    const TUNING: HeadingTuning = HeadingTuning::DEFAULT;

    fn evidence(form: f64) -> FormEvidence {
        FormEvidence {
            form,
            information: 1e4,
            px_per_unit: 30.0,
        }
    }

    /// A body that turns at this rate for four seconds, seen 25 times a second up to its symmetry.
    fn turning(rate_radps: f64, period_rad: f64, moves: f64) -> Heading {
        let mut heading = Heading::new(period_rad);
        for frame in 0..100 {
            let yaw_rad = 0.3 + rate_radps * 0.04 * f64::from(frame);
            heading.predict(0.04, &TUNING);
            heading.update(&evidence(wrapped(yaw_rad, period_rad)), 0.15, &TUNING);
            let (sin, cos) = libm::sincos(yaw_rad);
            heading.note_motion([moves * cos / 0.04, moves * sin / 0.04], 0.04, &TUNING);
        }
        heading
    }

    #[test]
    fn headings_are_followed_around_and_the_front_is_where_the_body_moves_to() {
        for period_rad in [PI, PI / 2.0, PI / 4.0] {
            for rate_radps in [-2.5, 0.0, 0.7] {
                for (moves, turned) in [(0.1, 0.0), (-0.1, PI)] {
                    let heading = turning(rate_radps, period_rad, moves);
                    let expected = wrapped(0.3 + rate_radps * 3.96 + turned, TAU);
                    let [heading_rad, sigma_rad] = heading.estimate(0.0, &TUNING).unwrap();
                    let off = wrapped(heading_rad - expected, TAU);
                    assert!(
                        off.abs() < 0.01,
                        "{rate_radps}: {heading_rad} for {expected}"
                    );
                    assert!(sigma_rad < 0.02, "{sigma_rad}");
                    let [later, _] = heading.estimate(0.2, &TUNING).unwrap();
                    let ahead = wrapped(later - expected - 0.2 * rate_radps, TAU);
                    assert!(ahead.abs() < 0.02, "{ahead}");
                }
            }
        }
    }

    #[test]
    fn a_body_that_stays_has_a_yaw_but_no_known_front() {
        let heading = turning(0.5, PI, 0.0);
        let [heading_rad, sigma_rad] = heading.estimate(0.0, &TUNING).unwrap();
        let off = wrapped(heading_rad - 0.3 - 0.5 * 3.96, PI);
        assert!(off.abs() < 0.01, "{heading_rad}");
        // Half of the time the front is on the other side.
        assert!(
            (sigma_rad - PI / 2.0_f64.sqrt()).abs() < 0.01,
            "{sigma_rad}"
        );
    }

    #[test]
    fn yaws_that_frames_do_not_tell_stay_unknown_and_old_ones_are_forgotten() {
        let mut heading = Heading::new(PI / 4.0);
        let vague = FormEvidence {
            information: 5.0,
            ..evidence(0.2)
        };
        heading.update(&vague, 0.15, &TUNING);
        assert_eq!(heading.estimate(0.0, &TUNING), None);
        heading.update(&evidence(0.2), 0.15, &TUNING);
        assert_eq!(heading.prior(&TUNING).unwrap().yaw_rad, 0.2);
        let mut later = heading;
        later.predict(0.2, &TUNING);
        assert_eq!(later.prior(&TUNING), None);
        assert!(later.estimate(0.0, &TUNING).is_some());
        heading.predict(10.0, &TUNING);
        assert_eq!(heading, Heading::new(PI / 4.0));
    }

    #[test]
    fn a_body_that_is_almost_round_faces_where_it_moves() {
        let mut heading = Heading::new(PI / 4.0);
        for frame in 0..100 {
            let course_rad = 0.5 * 0.04 * f64::from(frame);
            heading.predict(0.04, &TUNING);
            let hardly = FormEvidence {
                px_per_unit: 3.0,
                ..evidence(course_rad + 0.3)
            };
            heading.update(&hardly, 0.15, &TUNING);
            let (sin, cos) = libm::sincos(course_rad);
            heading.note_motion([2.0 * cos, 2.0 * sin], 0.04, &TUNING);
        }
        let [heading_rad, sigma_rad] = heading.estimate(0.0, &TUNING).unwrap();
        assert!((heading_rad - 0.5 * 3.96).abs() < 0.03, "{heading_rad}");
        assert!((0.05..0.2).contains(&sigma_rad), "{sigma_rad}");
        // Backwards.
        heading.note_motion([2.0, -2.0], 0.04, &TUNING);
        let [unchanged_rad, _] = heading.estimate(0.0, &TUNING).unwrap();
        assert_eq!(unchanged_rad, heading_rad);
    }

    #[test]
    fn a_velocity_that_changes_to_and_fro_draws_no_heading_aside() {
        let mut heading = Heading::new(PI / 4.0);
        let hardly = FormEvidence {
            px_per_unit: 3.0,
            ..evidence(0.0)
        };
        for frame in 0..60 {
            heading.predict(0.05, &TUNING);
            heading.update(&hardly, 0.15, &TUNING);
            // At first it moves steadily, 0.6 rad beside x.
            let aside_rad = match frame {
                0..20 => -0.6,
                _ if frame % 2 == 0 => 0.45,
                _ => -0.45,
            };
            let (sin, cos) = libm::sincos(aside_rad);
            heading.note_motion([1.6 * cos, 1.6 * sin], 0.05, &TUNING);
        }
        let [heading_rad, _] = heading.estimate(0.0, &TUNING).unwrap();
        assert!(heading_rad.abs() < 0.1, "{heading_rad}");
    }

    #[test]
    fn a_turn_that_no_body_makes_begins_anew() {
        let mut heading = turning(0.0, PI, 0.1);
        heading.predict(0.04, &TUNING);
        heading.update(&evidence(0.3 + 1.2), 0.15, &TUNING);
        let [heading_rad, _] = heading.estimate(0.0, &TUNING).unwrap();
        assert!((heading_rad - 1.5).abs() < 1e-9, "{heading_rad}");
    }
}
