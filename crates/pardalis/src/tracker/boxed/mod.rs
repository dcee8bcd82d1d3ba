//! A body that another program detects: boxes in images in, a position with its uncertainty out. Images and colours are not needed.
//!
//! A detector misses the body now and then and reports others: each box is the body's, somebody else's or clutter. The likelihood of all boxes of an image, given where the body is, is
//! that of a Bernoulli filter (Ristic, Vo, Vo and Farina 2013, "A tutorial on Bernoulli filters", eq. 28):
//! 1 − p + p·Σ g(box | position)/λc(box), with the probability of detection p, λ false boxes per image and their density c.

mod body_box;
mod fit;
mod sight;
#[cfg(test)]
mod tests;

use std::ops::Range;

use nalgebra::{Matrix3, Vector3};

use super::candidate::{Candidate, Origin, Verdict};
use super::detected::{LookAlikes, Visibility, assigned_nats};
use super::existence::ExistenceSettings;
use super::image_box::CameraBoxes;
use super::member::{Change, Known, LEAST_EXISTENCE, Member};
use super::settings::{BoxedSettings, DetectorSettings};
use super::track::{Instant, Track, mean_log_ratio};
use super::{BodyMeasurement, CameraId, Estimate, TrackState};
use crate::tuning::ExistenceTuning;
use crate::view::View;
use body_box::BodyBox;
use fit::Body;
use pardalis_core::Error;
use pardalis_core::rng::Draws;
use pardalis_filter::Particles;
use pardalis_filter::bernoulli::{BernoulliFilter, BernoulliSettings, MeasurementComponent};
use pardalis_filter::gaussian::GaussianStart;
use sight::{Fit, Sight, clipped, share_within, sigma_px};

/// By how much a particle outside of the target's region is less likely, nats: it is impossible, but should all be outside, one must remain.
const OUTSIDE_NATS: f32 = 50.0;
/// Rays through boxes of one body pass each other by less than this, diameters. Hand-set.
const MEETING_DIAMETERS: f64 = 1.0;
/// The most squared standard deviations a side that boxes may leave for a body of that form. Hand-set.
const MEETING_SQUARES: f64 = 12.0;
/// Who may be new to a crowd, but less likely than this, is nobody in a frame without a box. Hand-set: one box among clutter is less, two in a row are more.
const DOUBTFUL_EXISTENCE: f64 = 0.9;
/// Before the first frames a body may have appeared for this long, seconds. Hand-set: a frame or two, so that no single box is believed.
const FIRST_S: f64 = 0.05;
/// A box that is less likely a body's by this because of others is theirs, nats. Hand-set.
const TAKEN_NATS: f64 = 3.0;
/// Bodies appear only where their box is at least this large, pixels. Hand-set: detectors find nothing smaller.
const LEAST_PX: f64 = 8.0;
/// Neighbouring frames share this part of the variance of boxes. Hand-set: a detector's errors vary little as long as what it sees does.
const SHARED_SHARE: f64 = 0.5;

/// A body that is tracked by boxes.
pub(super) struct BoxedTarget {
    pub(super) track: Track,
    /// The number of the target whose boxes are its own.
    target: usize,
    start: Option<GaussianStart>,
    body: Body,
    detector: DetectorSettings,
    existence: ExistenceSettings,
    tuning: ExistenceTuning,
    filter: BernoulliFilter,
    /// How far from a camera a body may appear, metres; it does with the density of one in a cube (a square on the ground) with sides of that length.
    reach_m: f64,
    birth_density: f64,
    /// One per camera, as the following.
    visibilities: Vec<Option<Visibility>>,
    log_ratios: Vec<Vec<f32>>,
    /// The latest position that boxes measure.
    found: Option<Fit>,
    /// How far an error of the size moves it, metres.
    drift_m: Vector3<f64>,
    /// Closer to the estimate than this, metres, is right for its confidence: one diameter, or twice the standard deviation of what boxes tell if that is more.
    near_m: f64,
    member: Option<Member>,
    /// What became of each box of the latest frames.
    candidates: Vec<Candidate>,
    buffers: Buffers,
}

/// Memory that steps use again.
#[derive(Default)]
struct Buffers {
    /// The boxes of an instant, ...
    sights: Vec<Sight>,
    /// ... whose time in seconds it is.
    time_s: Option<f64>,
    /// Positions that boxes of several cameras measure.
    meetings: Vec<Meeting>,
    /// The numbers of boxes, those of each meeting after those of the one before.
    met: Vec<usize>,
    /// The numbers of the body's own boxes.
    own: Vec<usize>,
    components: Vec<MeasurementComponent>,
}

/// Where rays through boxes of several cameras meet.
struct Meeting {
    fit: Fit,
    /// Where the numbers of its boxes are.
    met: Range<usize>,
}

impl BoxedTarget {
    /// A body whose boxes are those of the target with this number.
    pub(super) fn new(
        settings: &BoxedSettings,
        target: usize,
        draws: Draws,
        views: &[View],
    ) -> Result<Self, Error> {
        settings.existence.check()?;
        settings.detector.check()?;
        if let Some(start) = &settings.start {
            start.check()?;
        }
        let (shape, motion, existence) = (settings.shape, settings.motion, settings.existence);
        let tuning = ExistenceTuning::DEFAULT;
        let body = Body {
            outline: BodyBox::new(&shape),
            diameter_m: shape.diameter_m(),
            ground_z_m: motion.is_planar().then_some(existence.ground_z_m),
        };
        let reaches_m = views.iter().filter_map(|view| body.reach_m(view, LEAST_PX));
        let reach_m = reaches_m.fold(shape.diameter_m(), f64::max);
        let birth_density = libm::pow(reach_m, if motion.is_planar() { -2.0 } else { -3.0 });
        let mut filter = BernoulliSettings::of(motion);
        filter.particle_count = settings.particle_count;
        filter.birth_rate_hz = existence.birth_rate_hz;
        filter.death_rate_hz = existence.death_rate_hz;
        filter.relocation_rate_hz = existence.relocation_rate_hz;
        filter.birth_density = birth_density;
        filter.birth_velocity_sigma_mps = tuning.birth_velocity_sigma_mps;
        filter.velocity_jump_rate_hz = existence.velocity_jump_rate_hz;
        filter.velocity_jump_sigma_mps = existence.velocity_jump_sigma_mps;
        Ok(Self {
            track: Track::new(views.len()),
            target,
            start: settings.start,
            body,
            detector: settings.detector,
            existence,
            tuning,
            filter: BernoulliFilter::new(filter, draws)?,
            reach_m,
            birth_density,
            visibilities: vec![None; views.len()],
            log_ratios: vec![Vec::new(); views.len()],
            found: None,
            drift_m: Vector3::zeros(),
            near_m: shape.diameter_m(),
            member: None,
            candidates: Vec::new(),
            buffers: Buffers::default(),
        })
    }

    pub(super) fn target(&self) -> usize {
        self.target
    }

    pub(super) fn start(&self) -> Option<&GaussianStart> {
        self.start.as_ref()
    }

    pub(super) fn particles(&self) -> &Particles {
        self.filter.particles()
    }

    pub(super) fn filter(&self) -> &BernoulliFilter {
        &self.filter
    }

    /// Whether the boxes of both are the same.
    pub(super) fn looks_like(&self, other: &Self) -> bool {
        self.target == other.target
    }

    /// Predicts to the time of the next frames, or starts.
    pub(super) fn predict(&mut self, time_s: f64, dt_s: f64) {
        if let Some((start, since_s)) = self.track.take_reinitialization() {
            self.begin(&start, 1.0);
            self.filter.predict((time_s - since_s).max(0.0));
        } else if self.track.has_started() {
            self.filter.predict(dt_s);
        } else if let Some(start) = self.start {
            self.begin(&start, 1.0);
        } else {
            self.filter.predict(FIRST_S);
        }
        self.track.set_started();
    }

    /// Updates what was predicted with the boxes of one instant.
    pub(super) fn observe(&mut self, instant: &Instant, look_alikes: &LookAlikes) {
        self.found = None;
        self.candidates.clear();
        let own = |boxes: &&CameraBoxes| boxes.target == self.target;
        if instant.boxes.iter().any(|boxes| own(&boxes)) {
            self.see(instant);
            self.assign(look_alikes);
            self.judge(instant.views);
            self.propose(instant.views);
            self.update(instant);
            self.find(instant.views);
        }
        let was_known = self.track.is_known();
        let confidence = self.confidence();
        let tuning = &self.tuning;
        let least = [tuning.found_confidence, tuning.lost_confidence];
        self.track
            .decide((self.filter.existence(), confidence), least, instant.time_s);
        self.conclude();
        let is_lost = was_known && self.track.state() == TrackState::Lost;
        if is_lost && self.member.is_none() {
            // It is found as at first. Among particles that are everywhere, none may be where it is.
            self.begin(&GaussianStart::default(), 0.0);
        }
    }

    /// Locates the body by these boxes alone. It must have been reset before.
    pub(super) fn locate(&mut self, instant: &Instant, look_alikes: &LookAlikes) -> Estimate {
        self.predict(instant.time_s, 0.0);
        // It may have appeared long ago, and there is no second image.
        self.filter.predict(self.tuning.time_before_start_s);
        self.observe(instant, look_alikes);
        self.estimate(0.0)
    }

    /// Takes the boxes of an instant, with the positions that they measure. Members of a crowd have the same ones.
    fn see(&mut self, instant: &Instant) {
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

    /// Notes which boxes may be another's.
    fn assign(&mut self, look_alikes: &LookAlikes) {
        for sight in &mut self.buffers.sights {
            sight.assign(0.0);
            let Some(fit) = &sight.fit else { continue };
            let place_m = fit.position_m.into();
            let others = look_alikes.densities(place_m, &fit.covariance_m2);
            if others == [0.0; 2] {
                continue;
            }
            let density = self.filter.predicted_density(place_m, &fit.covariance_m2);
            let own = self.filter.located() * density;
            // The density of clutter in the world, 1/m³ (1/m² on the ground).
            let log_gain = sight.log_peak(fit.squares) + self.body.log_volume(&fit.covariance_m2);
            let clutter = libm::exp(sight.log_odds - log_gain);
            let likeness = libm::log(self.detector.detection_probability) + sight.log_odds;
            sight.assign(assigned_nats(likeness, clutter, own, others));
        }
    }

    /// Notes what speaks against each box.
    fn judge(&mut self, views: &[View]) {
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
    fn conclude(&mut self) {
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

    /// What became of each box of the latest frames.
    pub(super) fn candidates(&self) -> &[Candidate] {
        &self.candidates
    }

    pub(super) fn forget_candidates(&mut self) {
        self.candidates.clear();
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
    fn propose(&mut self, views: &[View]) {
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
                let [xx, xy, xz, yy, yz, zz] = component.covariance_m2;
                let covariance_m2 = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz);
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

    /// Updates existence and position.
    fn update(&mut self, instant: &Instant) {
        let (views, time_s) = (instant.views, instant.time_s);
        let rates = &self.existence.occlusion;
        let cameras = || {
            let own = instant
                .boxes
                .iter()
                .filter(|boxes| boxes.target == self.target);
            own.map(|boxes| boxes.camera)
        };
        for camera in cameras() {
            let visibility = &mut self.visibilities[camera];
            let visibility = visibility.get_or_insert(Visibility::new(rates, time_s));
            visibility.predict(rates, time_s);
        }
        let Self {
            body,
            detector,
            existence,
            filter,
            visibilities,
            log_ratios,
            buffers,
            ..
        } = self;
        let sights = &buffers.sights;
        filter.update(&buffers.components, f64::INFINITY, |particles, out| {
            out.fill(0.0);
            let [x, y, z] = particles.positions_m();
            let places = x.iter().zip(y).zip(z);
            let places = places.map(|((&x, &y), &z)| [x, y, z].map(f64::from));
            for boxes in instant.boxes {
                if boxes.target != self.target {
                    continue;
                }
                let view = &views[boxes.camera];
                let of_camera = &mut log_ratios[boxes.camera];
                of_camera.clear();
                of_camera.extend(places.clone().map(|position_m| {
                    let seen = sights.iter().filter(|sight| sight.camera == boxes.camera);
                    log_ratio((&body.outline, view), position_m, seen, detector) as f32
                }));
                if let Some(visibility) = &visibilities[boxes.camera] {
                    for (sum, &log_ratio) in out.iter_mut().zip(&*of_camera) {
                        *sum += visibility.mixture_log_ratio(log_ratio);
                    }
                }
            }
            for (sum, position_m) in out.iter_mut().zip(places) {
                if !existence.region.contains(position_m) {
                    *sum -= OUTSIDE_NATS;
                }
            }
        });
        for boxes in instant.boxes {
            if boxes.target == self.target
                && let Some(visibility) = &mut self.visibilities[boxes.camera]
            {
                let log_ratios = &self.log_ratios[boxes.camera];
                let seen = visibility.update(log_ratios, self.filter.weights(), 1.0);
                self.track.note_observation(boxes.camera, time_s, seen);
            }
        }
    }

    /// Finds the boxes that are the body's, and where they put it.
    fn find(&mut self, views: &[View]) {
        let Buffers { sights, own, .. } = &mut self.buffers;
        own.clear();
        let Some(known) = self.filter.estimate(0.0) else {
            return;
        };
        for (camera, view) in views.iter().enumerate() {
            let outline = self.body.outline.sides_px(view, known.position_m, 1.0);
            let Some(outline) = outline.map(|sides| clipped(sides, view.size())) else {
                continue;
            };
            let likeness = |number: usize| {
                let sight: &Sight = &sights[number];
                sight.ratio(outline, sigma_px(outline, &self.detector))
            };
            let of_camera = (0..sights.len()).filter(|number| sights[*number].camera == camera);
            let likely = of_camera.map(|number| (number, likeness(number)));
            let likely = likely.filter(|(_, ratio)| *ratio > 1.0);
            let best = likely.reduce(|best, next| if next.1 > best.1 { next } else { best });
            own.extend(best.map(|(number, _)| number));
        }
        let fit = if own.is_empty() {
            None
        } else {
            let own = own.iter().map(|number| &sights[*number]);
            self.body.fit(views, own, known.position_m.into())
        };
        if let Some(fit) = fit {
            self.drift_m = fit.drift_m;
            let greatest_m2 = fit.covariance_m2.symmetric_eigenvalues().max();
            self.near_m = (2.0 * libm::sqrt(greatest_m2)).max(self.body.diameter_m);
        }
        self.found = fit;
    }

    /// What the latest boxes say of the body by themselves; `None` if there was none of it.
    pub(super) fn measurement(&self) -> Option<BodyMeasurement> {
        let fit = self.found.as_ref()?;
        let covariance_m2 = upper(&fit.covariance_m2);
        let mut shared_m2 = covariance_m2.map(|v| SHARED_SHARE * v);
        self.add_shared(&mut shared_m2);
        Some(BodyMeasurement {
            position_m: fit.position_m.into(),
            covariance_m2,
            shared_m2,
        })
    }

    /// Adds to a covariance of positions (xx, xy, xz, yy, yz, zz in m²) that of an error of the size.
    fn add_shared(&self, covariance_m2: &mut [f64; 6]) {
        let off_m = self.detector.size_tolerance * self.drift_m;
        let of_size = upper(&(off_m * off_m.transpose()));
        for (sum, more) in covariance_m2.iter_mut().zip(of_size) {
            *sum += more;
        }
    }

    /// Estimates the body `ahead_s` seconds after the latest frames; nothing changes.
    pub(super) fn estimate(&self, ahead_s: f64) -> Estimate {
        let is_known = self.track.is_known();
        let mut kinematics = self.filter.estimate(ahead_s).filter(|_| is_known);
        if let Some(known) = &mut kinematics {
            self.add_shared(&mut known.covariance_m2);
        }
        let confidence = if is_known {
            self.confidence_ahead(ahead_s)
        } else {
            // The probability that the body exists and is visible.
            self.filter.existence() * self.track.greatest_visibility()
        };
        Estimate {
            state: self.track.state(),
            kinematics,
            heading_rad: None,
            heading_sigma_rad: None,
            radius: None,
            confidence,
        }
    }

    /// The probability that the body exists and lies within one diameter of the estimate.
    pub(super) fn confidence(&self) -> f64 {
        self.confidence_ahead(0.0)
    }

    fn confidence_ahead(&self, ahead_s: f64) -> f64 {
        let known = self.filter.estimate(ahead_s);
        let near = known.map_or(0.0, |known| {
            self.filter.weight_within(known.position_m, self.near_m)
        });
        self.filter.existence() * near
    }

    /// The mean log-likelihood ratio of the boxes in a camera's latest frame over the posterior, in nats.
    pub(super) fn log_likelihood_ratio(&self, camera: usize) -> f64 {
        mean_log_ratio(&self.log_ratios[camera], self.filter.weights(), 0.0)
    }

    /// Sets the filter to a start, with this probability of existence.
    fn begin(&mut self, start: &GaussianStart, existence: f64) {
        self.filter
            .start(start, existence)
            .expect("starts are checked before");
    }

    /// Forgets all boxes and the start, as if the body had never been seen.
    pub(super) fn reset(&mut self) {
        self.begin(&GaussianStart::default(), 0.0);
        self.track.reset();
        self.visibilities.fill(None);
        self.log_ratios.iter_mut().for_each(Vec::clear);
        self.found = None;
        self.drift_m = Vector3::zeros();
        self.near_m = self.body.diameter_m;
        self.start = None;
        self.buffers.time_s = None;
        self.candidates.clear();
        if let Some(member) = &mut self.member {
            *member = Member::default();
            self.set_births(
                self.existence.birth_rate_hz,
                self.existence.relocation_rate_hz,
            );
        }
    }

    /// Makes it the place of a member of a crowd.
    pub(super) fn join_crowd(&mut self) {
        self.member = Some(Member::default());
    }

    /// The number of the member of the crowd.
    pub(super) fn number(&self) -> Option<u32> {
        self.member?.number()
    }

    /// Whether there is nobody, nor probably anybody.
    pub(super) fn is_free(&self) -> bool {
        self.member.is_some()
            && self.number().is_none()
            && self.filter.existence() < LEAST_EXISTENCE
    }

    /// Takes the boxes, and what they measure, from another place of the same crowd.
    pub(super) fn take_boxes(&mut self, other: &mut Self) {
        std::mem::swap(&mut self.buffers, &mut other.buffers);
    }

    /// Updates who it is after it has seen the boxes of an instant.
    pub(super) fn update_member(&mut self, next_number: &mut u32, (views, time_s): (&[View], f64)) {
        let known = Known {
            state: self.track.state(),
            position_m: self.filter.estimate(0.0).map(|known| known.position_m),
            existence: self.filter.existence(),
        };
        let Some(member) = &mut self.member else {
            return;
        };
        match member.update(&known, next_number, (views, time_s)) {
            Change::None => {
                let is_new = member.number().is_none() && known.existence > 0.0;
                if is_new && self.found.is_none() && known.existence < DOUBTFUL_EXISTENCE {
                    self.forget();
                }
            }
            Change::Found => self.set_births(0.0, 0.0),
            Change::Gone => self.forget(),
        }
    }

    /// Becomes nobody; the boxes of the instant are as before.
    fn forget(&mut self) {
        let time_s = self.buffers.time_s;
        self.reset();
        self.buffers.time_s = time_s;
        self.track.set_started();
    }

    /// Somebody who is known does not appear anew elsewhere: that would be another member.
    fn set_births(&mut self, birth_rate_hz: f64, relocation_rate_hz: f64) {
        self.filter
            .set_births(birth_rate_hz, relocation_rate_hz)
            .expect("rates are checked before");
    }
}

/// The log-likelihood ratio of the boxes in one camera's image, given that a body is at a position (metres), against no body.
fn log_ratio<'s>(
    (outline, view): (&BodyBox, &View),
    position_m: [f64; 3],
    sights: impl Iterator<Item = &'s Sight>,
    detector: &DetectorSettings,
) -> f64 {
    let Some(sides_px) = outline.sides_px(view, position_m, 1.0) else {
        return 0.0;
    };
    let seen = detection_probability(view, sides_px, detector);
    if seen == 0.0 {
        return 0.0;
    }
    let body_px = clipped(sides_px, view.size());
    let sigma_px = sigma_px(body_px, detector);
    let ratios = sights.map(|sight| sight.ratio(body_px, sigma_px));
    libm::log(1.0 - seen + seen * ratios.sum::<f64>())
}

/// The probability that a body with this box (pixels) is detected: less if most of it is out of the image, none if its middle is masked.
fn detection_probability(view: &View, sides_px: [f64; 4], detector: &DetectorSettings) -> f64 {
    let share = share_within(sides_px, view.size());
    let [u0, v0, u1, v1] = clipped(sides_px, view.size());
    let middle = [0.5 * (u0 + u1), 0.5 * (v0 + v1)].map(|v| v as f32);
    if share > 0.0 && view.holds_point(middle) {
        detector.detection_probability * (2.0 * share).min(1.0)
    } else {
        0.0
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

/// The upper triangle: xx, xy, xz, yy, yz, zz.
fn upper(matrix: &Matrix3<f64>) -> [f64; 6] {
    [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)].map(|at| matrix[at])
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
