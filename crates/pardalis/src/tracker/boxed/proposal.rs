//! What each box may be, and where boxes put the body: alone, and where rays of several cameras meet.

use nalgebra::Vector3;

use super::{BoxedTarget, Buffers, Meeting, upper};
use crate::tracker::box_model::{Body, Fit, Sight, clipped, sigma_px};
use crate::tracker::candidate::{Candidate, Origin, Verdict};
use crate::tracker::detected::{LookAlikes, assigned_nats};
use crate::tracker::track::Instant;
use crate::tracker::{CameraId, TrackState};
use crate::view::View;
use pardalis_filter::bernoulli::MeasurementComponent;
use pardalis_filter::estimate::covariance_matrix;

/// Rays through boxes of one body pass each other by less than this, diameters. Hand-set.
const MEETING_DIAMETERS: f64 = 1.0;
/// The most squared standard deviations a side that boxes may leave for a body of that form. Hand-set.
const MEETING_SQUARES: f64 = 12.0;
/// A box that is less likely a body's by this because of others is theirs, nats. Hand-set.
const TAKEN_NATS: f64 = 3.0;
/// By how many particles a body's claims are computed. Hand-set: enough for the mean of a likelihood over its position.
const CLAIMING_PARTICLES: usize = 100;

impl BoxedTarget {
    /// Takes the boxes of an instant, with the positions that they measure. Members of a crowd have the same ones.
    pub(super) fn see(&mut self, instant: &Instant) {
        let Buffers {
            sights,
            time_s,
            meetings,
            met,
            ..
        } = &mut self.buffers;
        if *time_s == Some(instant.time_s) {
            return;
        }
        *time_s = Some(instant.time_s);
        sights.clear();
        let views = instant.views;
        for boxes in instant.boxes {
            if boxes.target == self.target {
                let view = &views[boxes.camera];
                let sights_of = boxes.boxes.iter();
                let sights_of = sights_of
                    .filter_map(|found| Sight::new(boxes.camera, view, found, &self.detector));
                sights.extend(sights_of);
            }
        }
        for sight in &mut *sights {
            sight.fit = self.body.fit_one(views, sight);
        }
        meet(&self.body, views, sights, (meetings, met));
    }

    /// Notes what a member of a crowd claims of an instant's boxes before any of them is updated.
    pub(in crate::tracker) fn claim_predicted(&mut self, instant: &Instant) {
        self.claims.clear();
        if !self.is_free() {
            self.see(instant);
            self.claim_boxes(instant.views);
        }
    }

    /// Notes what the body claims of each box: the mean over its particles of the density of the box's sides, as in the update, so that what speaks for one member speaks for no other.
    pub(super) fn claim_boxes(&mut self, views: &[View]) {
        let Buffers { sights, .. } = &mut self.buffers;
        for sight in sights.iter_mut() {
            sight.assign(0.0);
        }
        self.claims.clear();
        self.claims.resize(sights.len(), 0.0);
        let particles = self.filter.particles();
        let [x, y, z] = particles.positions_m();
        let stride = (particles.count() / CLAIMING_PARTICLES).max(1);
        let all = self.filter.weights().iter().enumerate().step_by(stride);
        let total: f64 = all.clone().map(|(_, weight)| weight).sum();
        // Nobody, or all weight on particles that are left out.
        if total <= 0.0 {
            return;
        }
        for (i, weight) in all {
            let position_m = [x[i], y[i], z[i]].map(f64::from);
            let share =
                weight / total * self.filter.located() * self.detector.detection_probability;
            for (camera, view) in views.iter().enumerate() {
                let of_camera = |(_, sight): &(usize, &Sight)| sight.camera == camera;
                let mut of_camera = sights.iter().enumerate().filter(of_camera).peekable();
                if of_camera.peek().is_none() {
                    continue;
                }
                let Some(sides_px) = self.body.outline.sides_px(view, position_m, 1.0) else {
                    continue;
                };
                let body_px = clipped(sides_px, view.size());
                let sigma_px = sigma_px(body_px, &self.detector);
                for (number, sight) in of_camera {
                    self.claims[number] += share * sight.ratio(body_px, sigma_px);
                }
            }
        }
    }

    /// What it claims of the box with this number.
    pub(in crate::tracker) fn claim(&self, number: usize) -> f64 {
        self.claims.get(number).copied().unwrap_or(0.0)
    }

    /// Notes which boxes may be another's.
    pub(super) fn assign(&mut self, look_alikes: &LookAlikes) {
        for (number, sight) in self.buffers.sights.iter_mut().enumerate() {
            let own = self.claims.get(number).copied().unwrap_or(0.0);
            sight.assign(assigned_nats(0.0, 1.0, own, look_alikes.claims(number)));
        }
    }

    /// Notes what speaks against each box.
    pub(super) fn judge(&mut self, views: &[View]) {
        for sight in &self.buffers.sights {
            let origin = Origin::Box(CameraId::new(sight.camera), sight.blob());
            let verdict = match &sight.fit {
                None if self.body.ground_z_m.is_some() => Verdict::OffGround,
                None => Verdict::TooFar,
                Some(fit) if !is_like(fit, 1) => Verdict::OtherOutline,
                Some(fit) if !self.existence.region.contains(fit.position_m.into()) => {
                    Verdict::OutsideRegion
                }
                Some(_) if sight.assigned() > TAKEN_NATS => Verdict::LookAlike,
                Some(fit) if !self.is_possible(views, sight, fit) => Verdict::TooFar,
                Some(_) => Verdict::Unconfirmed,
            };
            let mut candidate = Candidate::new(origin, verdict);
            candidate.position_m = sight.fit.map(|fit| fit.position_m.into());
            self.candidates.push(candidate);
        }
    }

    /// Notes which boxes are the body's, once it is tracked. Others against which nothing speaks are its rivals; without a target, they are one another's.
    pub(super) fn conclude(&mut self) {
        let is_tracking = self.track.state() == TrackState::Tracking;
        let is_open = |candidate: &&Candidate| candidate.verdict == Verdict::Unconfirmed;
        let has_rivals = self.candidates.iter().filter(is_open).count() > 1;
        for (number, candidate) in self.candidates.iter_mut().enumerate() {
            if is_tracking && self.buffers.own.contains(&number) {
                candidate.verdict = Verdict::Target;
            } else if (is_tracking || has_rivals) && candidate.verdict == Verdict::Unconfirmed {
                candidate.verdict = Verdict::Rival;
            }
        }
    }

    /// Whether a body may appear where a box puts it, or is expected there.
    fn is_possible(&self, views: &[View], sight: &Sight, fit: &Fit) -> bool {
        let from_m = views[sight.camera].world_from_camera().translation.vector;
        let may_appear = is_like(fit, 1) && (fit.position_m - from_m).norm() < self.reach_m;
        may_appear || {
            let place_m = fit.position_m.into();
            let density = self.filter.predicted_density(place_m, &fit.covariance_m2);
            self.filter.located() * density > self.birth_density
        }
    }

    /// Proposes the positions that boxes measure, alone and together, if a body may appear there or is expected.
    pub(super) fn propose(&mut self, views: &[View]) {
        let mut components = std::mem::take(&mut self.buffers.components);
        let Buffers {
            sights,
            meetings,
            met,
            ..
        } = &self.buffers;
        components.clear();
        let alone = sights.iter().filter_map(|sight| {
            let fit = sight
                .fit
                .filter(|fit| self.is_possible(views, sight, fit))?;
            let log_weight = sight.log_peak(fit.squares) + self.body.log_volume(&fit.covariance_m2);
            Some(component(&fit, log_weight))
        });
        components.extend(alone);
        components.extend(meetings.iter().map(|meeting| {
            let sights = meeting.met.clone().map(|at| &sights[met[at]]);
            let fit = &meeting.fit;
            let peaks: f64 = sights.map(|sight| sight.log_peak(0.0)).sum();
            let log_weight = peaks - 0.5 * fit.squares + self.body.log_volume(&fit.covariance_m2);
            component(fit, log_weight)
        }));
        // Who may be new to a crowd takes one place, and leaves the others to others.
        if self.member.is_some() && self.number().is_none() {
            let likeliness = |component: &MeasurementComponent| {
                let covariance_m2 = covariance_matrix(component.covariance_m2);
                let density = self.filter.located()
                    * self
                        .filter
                        .predicted_density(component.position_m, &covariance_m2);
                component.log_weight + libm::log(density + self.birth_density)
            };
            let all = components.iter().map(likeliness).enumerate();
            // Of two equal ones the first.
            let best = all.reduce(|best, next| if next.1 > best.1 { next } else { best });
            if let Some((best, _)) = best {
                components.swap(0, best);
                components.truncate(1);
            }
        }
        self.buffers.components = components;
    }
}

/// Whether a fit leaves so little of this number of boxes that they have the body's form.
fn is_like(fit: &Fit, boxes: usize) -> bool {
    fit.squares < MEETING_SQUARES * 4.0 * boxes as f64
}

fn component(fit: &Fit, log_weight: f64) -> MeasurementComponent {
    MeasurementComponent {
        position_m: fit.position_m.into(),
        covariance_m2: upper(&fit.covariance_m2),
        log_weight,
    }
}

/// Finds where rays through boxes of several cameras meet: each box of the first camera of a meeting with the nearest of every other.
fn meet(
    body: &Body,
    views: &[View],
    sights: &[Sight],
    (meetings, met): (&mut Vec<Meeting>, &mut Vec<usize>),
) {
    meetings.clear();
    met.clear();
    let ray = |number: usize| {
        let sight: &Sight = &sights[number];
        sight.ray(&views[sight.camera])
    };
    for number in 0..sights.len() {
        let camera = sights[number].camera;
        let Some((origin, direction)) = ray(number) else {
            continue;
        };
        let first = met.len();
        met.push(number);
        let mut along_m = 0.0;
        for other_camera in camera + 1..views.len() {
            let others = (0..sights.len()).filter(|other| sights[*other].camera == other_camera);
            let gaps = others.filter_map(|other| {
                let (other_origin, other_direction) = ray(other)?;
                let between = other_origin - origin;
                let normal = direction.cross(&other_direction);
                let (along, gap_m) = if normal.norm_squared() > 1e-12 {
                    let along =
                        between.cross(&other_direction).dot(&normal) / normal.norm_squared();
                    (along, between.dot(&normal).abs() / normal.norm())
                } else {
                    return None;
                };
                (along > 0.0 && gap_m < MEETING_DIAMETERS * body.diameter_m)
                    .then_some((other, along, gap_m))
            });
            let nearest = gaps.reduce(|best, next| if next.2 < best.2 { next } else { best });
            if let Some((other, along, _)) = nearest {
                met.push(other);
                along_m += along;
            }
        }
        let count = met.len() - first;
        let fit = (count > 1).then(|| {
            let mean_m = along_m / (count - 1) as f64;
            let middle_m = (origin + mean_m * direction).coords;
            let start_m = middle_m - Vector3::new(0.0, 0.0, body.outline.middle_m());
            body.fit(
                views,
                met[first..].iter().map(|number| &sights[*number]),
                start_m,
            )
        });
        match fit.flatten() {
            Some(fit) if is_like(&fit, count) => {
                meetings.push(Meeting {
                    fit,
                    met: first..met.len(),
                });
            }
            _ => met.truncate(first),
        }
    }
}
