//! Step 2, data association: how likely each detection is the target, rather than something that looks like it, by its outline, its colours and its position.

use nalgebra::{Matrix3, Vector3};

use super::DetectedTarget;
use super::look_alikes::LookAlikes;
use crate::color::PixelKind;
use crate::likelihood::edge::{Detection, EdgeFrame, Widening};
use crate::tracker::candidate::{Candidate, Origin, Verdict};
use pardalis_filter::bernoulli::MeasurementComponent;
use pardalis_filter::estimate::covariance_matrix;

/// What data association makes of one detection.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct AssociatedDetection {
    /// The detection's number among those of this instant.
    pub(super) detection: usize,
    /// The Gaussian that it contributes to the filter's proposal.
    pub(super) component: MeasurementComponent,
    /// By how much it is likelier the target than one thing of clutter, wherever it is, in nats.
    pub(super) likeness: f64,
    /// The same, if nothing else looks like the target.
    alone: f64,
    /// The log-ratio by which it speaks for the target's existence, in nats.
    pub(super) existence_log_ratio: f64,
    /// What each camera adds to the edge cue's log-likelihood ratio at this detection, in nats, so that it compares with clutter.
    pub(super) log_ratio_offset: f32,
    /// How its likelihood is widened, if it is.
    pub(super) widened: Option<Widening>,
}

impl DetectedTarget {
    /// Associates the detections with the target. Of look-alikes that are not found yet the first takes its likeliest detection and leaves the others
    /// to those after it. Notes in each candidate what speaks most against it.
    pub(super) fn associate(
        &self,
        (frames, detections): (&[EdgeFrame], &[Detection]),
        look_alikes: &LookAlikes,
        associated: &mut Vec<AssociatedDetection>,
        candidates: &mut [Candidate],
    ) {
        associated.clear();
        for (number, detection) in detections.iter().enumerate() {
            let candidate = &mut candidates[detection.candidate()];
            let by_boxes = self.boxes.as_ref();
            let by_boxes = by_boxes.map_or(0.0, |boxes| boxes.nats(frames, detection.position_m()));
            let found = (number, detection, by_boxes);
            associated.extend(self.associate_one(found, look_alikes, candidate));
        }
        self.leave_out_sights(frames, detections, associated, candidates);
        if !self.track.is_known()
            && look_alikes.leaves_some_to_others()
            && let Some(likeliest) = self.likeliest(associated)
        {
            associated.swap(0, likeliest);
            for other in associated.drain(1..) {
                candidates[detections[other.detection].candidate()].verdict = Verdict::LookAlike;
            }
        }
    }

    /// Leaves out detections in some cameras that are a detection in more of them, seen by the former alone: in the same directions, where a wrong size puts them.
    fn leave_out_sights(
        &self,
        frames: &[EdgeFrame],
        detections: &[Detection],
        associated: &mut Vec<AssociatedDetection>,
        candidates: &mut [Candidate],
    ) {
        if self.size.known().sigma == 0.0 {
            return;
        }
        let is_likely = |found: &AssociatedDetection| found.existence_log_ratio > 0.0;
        let is_sight = |part: &Detection, whole: &Detection| {
            let is_same_way = |camera: usize| {
                let frame = frames.iter().find(|frame| frame.camera() == camera);
                frame.is_some_and(|frame| self.are_same_way(frame.viewpoint_m(), part, whole))
            };
            part.camera_count() < whole.camera_count()
                && part
                    .cameras()
                    .all(|camera| whole.cameras().any(|c| c == camera))
                && part.cameras().all(is_same_way)
        };
        let mut number = 0;
        while number < associated.len() {
            let part = &detections[associated[number].detection];
            let mut likely = associated.iter().filter(|found| is_likely(found));
            if likely.any(|found| is_sight(part, &detections[found.detection])) {
                candidates[part.candidate()].verdict = Verdict::SamePlace;
                associated.remove(number);
            } else {
                number += 1;
            }
        }
    }

    /// Whether two detections are the same way from a viewpoint in the world, metres: nearer to each other than two distinct ones at their distance are.
    fn are_same_way(&self, viewpoint_m: Vector3<f64>, part: &Detection, whole: &Detection) -> bool {
        let [to_part, to_whole] =
            [part, whole].map(|found| Vector3::from(found.position_m()) - viewpoint_m);
        let across_m = to_part.cross(&to_whole).norm() / to_part.norm();
        let diameter_m = whole.scale() * self.shape.diameter_m();
        to_part.dot(&to_whole) > 0.0
            && across_m < self.tuning.detection.distinct_diameters * diameter_m
    }

    /// Compares a detection with clutter: things of the target's colours and form, uniformly distributed, a known number per frame. The sharper a
    /// detection, the less likely clutter is just there. `by_boxes` is what the boxes of another program's detector say for it, in nats. `None` if its
    /// covariance is singular, or it moves and its outline says too little.
    fn associate_one(
        &self,
        (number, detection, by_boxes): (usize, &Detection, f64),
        look_alikes: &LookAlikes,
        candidate: &mut Candidate,
    ) -> Option<AssociatedDetection> {
        let tuning = &self.tuning.association;
        let position_m = detection.position_m();
        let widest_m = tuning.max_sigma_diameters * self.diameter_m();
        let mut information =
            detection.information() + Matrix3::from_diagonal_element(widest_m.powi(-2));
        if self.is_planar {
            for axis in 0..3 {
                information[(axis, 2)] = 0.0;
                information[(2, axis)] = 0.0;
            }
            information[(2, 2)] = 1.0;
        }
        let covariance_m2 = information.cholesky()?.inverse();
        let log_volume = self.log_volume(&covariance_m2);
        let cameras = detection.camera_count() as f64;
        let log_ratio = detection.log_likelihood_ratio();
        let of_color = self.color_log_ratio(detection);
        let stray = self.stray_nats(position_m);
        let by_color = of_color - stray;
        let judged = detection.judged_log_ratio();
        let is_moving = matches!(candidate.origin, Origin::Motion(..));
        if is_moving && judged < tuning.min_moving_nats {
            candidate.verdict = Verdict::OtherOutline;
            return None;
        }
        let by_outline = (judged / cameras / tuning.log_ratio_scale - tuning.clutter_nats)
            .min(tuning.max_log_ratio);
        let covered = tuning.occluded_color_nats * (1.0 - detection.visible_share());
        let region = self.existence.region;
        let outside = 0.5 * region.squared_sigmas(position_m, &information);
        let is_new_streak = detection.is_streak() && candidate.origin != Origin::Prediction;
        let streak = if detection.is_streak() && self.contradicts_streak(detection, is_moving) {
            f64::from(self.tuning.existence.missed_nats)
        } else if is_new_streak && !is_moving {
            tuning.new_streak_nats
        } else {
            0.0
        };
        let by_size = self.size.known().log_density(detection.log_scale());
        let faint = (tuning.clear_contrast - detection.contrast())
            / (tuning.clear_contrast - tuning.faint_contrast);
        let faint = tuning.faint_nats * faint.clamp(0.0, 1.0);
        let seen = by_outline - covered + by_color + by_size - outside - streak - faint;
        let likeness = seen + by_boxes;
        let contradiction = detection.contradiction_nats() / cameras / tuning.log_ratio_scale;
        let clutter_density = self.clutter_density();
        let tracked_density = self.filter.predicted_density(position_m, &covariance_m2);
        let own = self.filter.located() * tracked_density;
        let densities = look_alikes.densities(position_m, &covariance_m2);
        let assigned = assigned_nats(likeness, clutter_density, own, densities);
        let log_weight = likeness - libm::log(clutter_density) - assigned;
        let if_covered = by_color.min(0.0) - contradiction + by_boxes.min(0.0);
        // What a detector leaves out again and again may look again and again like the target: only the former speaks then.
        let existing = by_boxes + if by_boxes < 0.0 { seen.min(0.0) } else { seen };
        // Rays of few cameras may meet by chance where each shows something else, or with a camera whose pose is wrong.
        let confirmed = tuning.coincidence_nats * (cameras - 3.0).max(0.0);
        let mut existence_log_ratio =
            self.existence_log_ratio(tracked_density, existing + confirmed, if_covered) - assigned;
        if is_new_streak {
            existence_log_ratio = existence_log_ratio.min(tuning.max_new_streak_nats);
        }
        candidate.color_nats = Some(of_color);
        candidate.verdict = if existence_log_ratio > 0.0 {
            Verdict::Unconfirmed
        } else {
            let against = [
                (by_outline - streak, Verdict::OtherOutline),
                (-covered, Verdict::Covered),
                (-faint, Verdict::NoEdges),
                (of_color, Verdict::OtherColor),
                (-outside, Verdict::OutsideRegion),
                (by_size, Verdict::OtherOutline),
                (by_boxes, Verdict::NoBox),
                (-stray, Verdict::Stray),
                (-assigned, Verdict::LookAlike),
            ];
            let most = against
                .into_iter()
                .reduce(|a, b| if b.0 < a.0 { b } else { a });
            most.map_or(Verdict::Unconfirmed, |(_, verdict)| verdict)
        };
        Some(AssociatedDetection {
            detection: number,
            component: MeasurementComponent {
                position_m,
                covariance_m2: [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)]
                    .map(|at| covariance_m2[at]),
                log_weight,
            },
            likeness: likeness - assigned,
            alone: likeness,
            existence_log_ratio,
            log_ratio_offset: ((log_weight - log_volume - log_ratio) / cameras) as f32,
            widened: None,
        })
    }

    /// Returns whether a streak is longer than the way from where the target was before: what moves while the shutter is open moves between the frames too. If the target
    /// surely exists, a streak that was found because it moves must be no longer than the predicted way: it may be the part of an outline at rest that something
    /// else leaves visible.
    fn contradicts_streak(&self, detection: &Detection, is_moving: bool) -> bool {
        let tuning = &self.tuning;
        let existence = self.filter.existence();
        if existence < tuning.detection.min_predicted_existence {
            return false;
        }
        let Some(predicted) = self.filter.estimate(0.0) else {
            return false;
        };
        let velocity_mps = Vector3::from(predicted.velocity_mps.unwrap_or_default());
        let predicted_m = self.since_s * velocity_mps;
        let way_m = if is_moving && existence > tuning.detection.sure_existence {
            predicted_m.norm()
        } else {
            let before_m = Vector3::from(predicted.position_m) - predicted_m;
            (Vector3::from(detection.position_m()) - before_m).norm()
        };
        let length_m = Vector3::from(detection.displacement_m()).norm();
        way_m < tuning.association.min_way_share * length_m
    }

    /// The log-ratio by which a detection speaks for the target's existence, given the predicted density of the target there, its likeness and the same if the target is covered, both in nats. What has been tracked
    /// may be clutter and then is there again: that it stayed where it was does not make it the target, nor is it clutter because part of it is occluded.
    fn existence_log_ratio(&self, tracked_density: f64, likeness: f64, covered: f64) -> f64 {
        let clutter_density = self.clutter_density();
        let other_density = clutter_density + tracked_density;
        let as_new = likeness + libm::log(self.birth_density / other_density);
        let as_tracked = likeness.max(covered) + libm::log(tracked_density / other_density);
        as_new.max(as_tracked)
    }

    /// The number of the detection that most likely is the target: by where it was predicted, or else by what speaks for it most.
    fn likeliest(&self, associated: &[AssociatedDetection]) -> Option<usize> {
        let score = |associated: &AssociatedDetection| {
            let component = &associated.component;
            let covariance_m2 = covariance_matrix(component.covariance_m2);
            let predicted = self.density(component.position_m, &covariance_m2) + self.birth_density;
            component.log_weight + libm::log(predicted)
        };
        let scores = associated.iter().map(score).enumerate();
        // Of two equal ones the first.
        let best = scores.reduce(|best, next| if next.1 > best.1 { next } else { best });
        best.map(|(number, _)| number)
    }

    /// ln √|2πΣ| of a covariance Σ, in m³, or in m² on the ground.
    fn log_volume(&self, covariance_m2: &Matrix3<f64>) -> f64 {
        let (axes, determinant) = if self.is_planar {
            (2.0, covariance_m2.fixed_view::<2, 2>(0, 0).determinant())
        } else {
            (3.0, covariance_m2.determinant())
        };
        0.5 * (axes * libm::log(std::f64::consts::TAU) + libm::log(determinant))
    }

    /// The log-likelihood ratio of a detection's mean colour, in the camera in which it is least.
    fn color_log_ratio(&self, detection: &Detection) -> f64 {
        let uses_color = self.edge.settings().color_evidence;
        let Some(known) = self.colors.body().filter(|_| uses_color) else {
            return 0.0;
        };
        let corrected = |(camera, color): (usize, [f32; 3])| {
            let correction = self.adaptations[camera].correction(PixelKind::FULL_RANGE_YUV);
            correction.color(color)
        };
        // Members of a crowd are before one another. The rim, and what it contains of the surroundings, tells outlines that reach over two of them.
        let least = if self.member.is_some() {
            let of_rims = detection.rim_colors().map(corrected);
            of_rims
                .map(|color| known.log_ratio_without_grey(color))
                .reduce(f64::min)
        } else {
            let of_bodies = detection.body_colors().map(corrected);
            of_bodies
                .map(|color| known.log_ratio(color))
                .reduce(f64::min)
        };
        least.unwrap_or(0.0)
    }

    /// The density of clutter, 1/m³ (1/m² on the ground).
    fn clutter_density(&self) -> f64 {
        self.clutter() * self.birth_density
    }

    /// The number of things of clutter per frame.
    fn clutter(&self) -> f64 {
        self.tuning.association.clutter_per_frame + self.clutter_seen
    }

    /// The most that the latest frames can say, in nats, for what is seen where the target is tracked being the target, and not one of the things of clutter before or beside it.
    /// Without a detection there, the likeliest one counts. Infinite while the target is followed without interruption since it was clearly seen; for one that is yet to be found, which other
    /// tests decide; and for members of crowds, around which everything looks like them.
    pub(super) fn seen_nats(
        &mut self,
        associated: &[AssociatedDetection],
        target: Option<usize>,
    ) -> f64 {
        if !self.track.is_known() || self.member.is_some() {
            self.is_clear = false;
            return f64::INFINITY;
        }
        let detections = self.detector.detections();
        // Each camera would have to see something else there.
        let nats = |found: &AssociatedDetection| {
            let cameras = detections[found.detection].camera_count() as f64;
            found.alone + cameras * self.tuning.association.coincidence_nats
        };
        let of_target = target.map(|number| nats(&associated[number]));
        let likeliest = || {
            associated
                .iter()
                .map(nats)
                .fold(f64::NEG_INFINITY, f64::max)
        };
        let most = of_target.unwrap_or_else(likeliest) - libm::log(self.clutter());
        self.is_clear = of_target.is_some() && (self.is_clear || most >= 0.0);
        if self.is_clear { f64::INFINITY } else { most }
    }

    /// Updates how much clutter is seen with the detections of a search, given which of them is the target. Without one, one of them may be the target.
    pub(super) fn note_clutter(
        &mut self,
        associated: &[AssociatedDetection],
        target: Option<usize>,
    ) {
        let tuning = &self.tuning.association;
        let least = libm::log(tuning.clutter_per_frame);
        let is_clutter = |(number, found): &(usize, &AssociatedDetection)| {
            Some(*number) != target && found.likeness > least
        };
        let others = associated.iter().enumerate().filter(is_clutter).count();
        let clutter = others.saturating_sub(usize::from(target.is_none()));
        self.clutter_seen += tuning.clutter_rate * (clutter as f64 - self.clutter_seen);
    }

    /// By how many nats a detection is less likely a landmark because it is far from the target's other landmarks.
    fn stray_nats(&self, position_m: [f64; 3]) -> f64 {
        let here = Vector3::from(position_m);
        let tuning = &self.tuning.association;
        let reach_m = tuning.landmark_reach_diameters * self.shape.diameter_m();
        let is_far = |other: &[f64; 3]| (here - Vector3::from(*other)).norm() > reach_m;
        if self.other_landmarks_m.iter().any(is_far) {
            tuning.stray_landmark_nats
        } else {
            0.0
        }
    }
}

/// By how many nats a detection with this log-likelihood ratio against clutter is less likely the target's because it may be a look-alike's, given the densities there of
/// clutter, of the target itself, and of updated and predicted look-alikes. Those that were updated with this instant's frames have been assigned theirs; among those that
/// were not, and this one, it is likelier the one's that was predicted there.
pub(in crate::tracker) fn assigned_nats(
    likeness: f64,
    clutter: f64,
    own: f64,
    [updated, predicted]: [f64; 2],
) -> f64 {
    let ratio = libm::exp(likeness);
    libm::log1p(ratio * updated / clutter)
        + libm::log1p(ratio * predicted / (clutter + ratio * own))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reference::{Rivals, association_log_weight};

    #[test]
    fn log_weights_are_the_oracles() {
        for likeness in [-12.0, -1.0, 0.5, 14.0] {
            for densities in [[0.0, 0.0], [40.0, 0.0], [0.0, 3.0], [0.2, 700.0]] {
                let [updated, predicted] = densities;
                let rivals = Rivals {
                    clutter: 1e-4,
                    own: 25.0,
                    updated,
                    predicted,
                };
                let assigned = assigned_nats(likeness, 1e-4, 25.0, densities);
                let found = likeness - libm::log(1e-4) - assigned;
                let expected = association_log_weight(likeness, &rivals);
                assert!((found - expected).abs() < 1e-9, "{found} {expected}");
            }
        }
    }
}
