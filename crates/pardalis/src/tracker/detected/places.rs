//! Whether a target is found, and where: at one of the detections, and not between two that look alike.

use nalgebra::{Matrix3, Vector3};

use super::DetectedTarget;
use super::association::AssociatedDetection;
use crate::tracker::TrackState;
use crate::tracker::candidate::{Candidate, Verdict};
use crate::tracker::track::Instant;
use pardalis_filter::bernoulli::MeasurementComponent;
use pardalis_filter::estimate::covariance_matrix;

/// Where a detection is, and how much of the weight of the particles is there.
#[derive(Debug, Clone, Copy)]
pub(super) struct Place {
    /// Position in the world, metres.
    position_m: Vector3<f64>,
    covariance_m2: Matrix3<f64>,
    information: Matrix3<f64>,
    share: f64,
    is_kept: bool,
}

impl Place {
    fn of(component: &MeasurementComponent) -> Option<Self> {
        let covariance_m2 = covariance_matrix(component.covariance_m2);
        Some(Self {
            position_m: component.position_m.into(),
            covariance_m2,
            information: covariance_m2.try_inverse()?,
            share: 0.0,
            is_kept: false,
        })
    }

    fn is_distinct_from(&self, other: &Self, sigmas: f64) -> bool {
        let off_m = self.position_m - other.position_m;
        let both_m2 = self.covariance_m2 + other.covariance_m2;
        let information = both_m2.try_inverse();
        information.is_some_and(|information| off_m.dot(&(information * off_m)) > sigmas * sigmas)
    }
}

/// How far a position is from the ray on which another is seen from a viewpoint, all in metres.
fn across_m(position_m: Vector3<f64>, other_m: Vector3<f64>, viewpoint_m: Vector3<f64>) -> f64 {
    let to_other_m = other_m - viewpoint_m;
    to_other_m.cross(&(position_m - viewpoint_m)).norm() / to_other_m.norm()
}

/// The number of the place from which a position (metres) is fewest standard deviations away.
fn nearest(places: &[Place], position_m: [f64; 3]) -> usize {
    let squares = places.iter().map(|place| {
        let off_m = Vector3::from(position_m) - place.position_m;
        off_m.dot(&(place.information * off_m))
    });
    let least = squares
        .enumerate()
        .reduce(|a, b| if b.1 < a.1 { b } else { a });
    least.map_or(0, |(number, _)| number)
}

/// Whether one of two positions is seen elsewhere than the other by any camera: farther across than `same_m`, all in metres. In one direction there are several
/// distances, or several outlines, of one target.
fn is_elsewhere(instant: &Instant, [one_m, other_m]: [Vector3<f64>; 2], same_m: f64) -> bool {
    let mut cameras = instant.frames.iter().map(|(camera, _)| *camera);
    cameras.any(|camera| {
        let viewpoint_m = instant.views[camera].viewpoint_m();
        across_m(one_m, other_m, viewpoint_m) > same_m
    })
}

impl DetectedTarget {
    /// The distance across up to which two detections may be of one target, metres.
    fn same_place_m(&self) -> f64 {
        self.tuning.existence.same_place_diameters * self.diameter_m()
    }

    /// Notes which candidate is the target, given its number among those associated. Others against which nothing speaks are its rivals if they are seen elsewhere; without a
    /// target they are one another's.
    pub(super) fn conclude(
        &self,
        instant: &Instant,
        associated: &[AssociatedDetection],
        target: Option<usize>,
        candidates: &mut [Candidate],
    ) {
        let is_tracking = self.track.state() == TrackState::Tracking;
        let target = target.filter(|_| is_tracking);
        let target = target.map(|target| {
            let detection = &self.detector.detections()[associated[target].detection];
            detection.candidate()
        });
        if let Some(target) = target {
            candidates[target].verdict = Verdict::Target;
        }
        let is_open = |candidate: &Candidate| candidate.verdict == Verdict::Unconfirmed;
        let Some(first) = target.or_else(|| candidates.iter().position(is_open)) else {
            return;
        };
        let Some(first_m) = candidates[first].position_m.map(Vector3::from) else {
            return;
        };
        let same_m = self.same_place_m();
        let mut has_rival = false;
        for (number, candidate) in candidates.iter_mut().enumerate() {
            if number == first || !is_open(candidate) {
                continue;
            }
            let is_rival = candidate.position_m.is_some_and(|position_m| {
                is_elsewhere(instant, [position_m.into(), first_m], same_m)
            });
            candidate.verdict = if is_rival {
                Verdict::Rival
            } else {
                Verdict::SamePlace
            };
            has_rival |= is_rival;
        }
        if has_rival && target.is_none() {
            candidates[first].verdict = Verdict::Rival;
        }
    }

    /// Returns whether the target, if it exists, is at one of the detections rather than at any of them. Leaves out the particles elsewhere then: the mean of all is
    /// between the detections.
    pub(super) fn is_at_one_place(
        &mut self,
        instant: &Instant,
        associated: &[AssociatedDetection],
    ) -> bool {
        let tuning = &self.tuning.existence;
        let same_m = self.same_place_m();
        let places = &mut self.buffers.places;
        places.clear();
        places.extend(
            associated
                .iter()
                .filter_map(|found| Place::of(&found.component)),
        );
        if places.len() < 2 {
            return true;
        }
        let particles = self.filter.particles();
        for (particle, weight) in self.filter.weights().iter().enumerate() {
            let place = nearest(places, particles.position_m(particle));
            places[place].share += weight;
        }
        let likeliest = places.iter().copied();
        let likeliest = likeliest.reduce(|a, b| if b.share > a.share { b } else { a });
        let Some(likeliest) = likeliest else {
            return true;
        };
        let mut share = 0.0;
        for place in places.iter_mut() {
            let both_m = [place.position_m, likeliest.position_m];
            let is_elsewhere = is_elsewhere(instant, both_m, same_m);
            place.is_kept =
                !(is_elsewhere && place.is_distinct_from(&likeliest, tuning.same_place_sigmas));
            if place.is_kept {
                share += place.share;
            }
        }
        let is_at_one = share >= tuning.found_share;
        if is_at_one {
            self.filter
                .keep(|position_m| places[nearest(places, position_m)].is_kept);
        }
        is_at_one
    }

    /// The number of the detection that is the target: the first at the estimate.
    pub(super) fn at_estimate(&self, associated: &[AssociatedDetection]) -> Option<usize> {
        let here = Vector3::from(self.filter.estimate(0.0)?.position_m);
        let near_m = self.tuning.existence.near_diameters * self.diameter_m();
        associated
            .iter()
            .position(|found| (here - Vector3::from(found.component.position_m)).norm() < near_m)
    }

    /// Derives the track's state from existence, visibility and confidence. One that may be at several places is not found.
    pub(super) fn decide(&mut self, is_found: bool, time_s: f64) {
        let tuning = &self.tuning.existence;
        let least = [tuning.found_confidence, tuning.lost_confidence];
        let confidence = if is_found { self.confidence() } else { 0.0 };
        let decisive = (self.filter.existence(), confidence);
        self.track.decide(decisive, least, time_s);
    }
}
