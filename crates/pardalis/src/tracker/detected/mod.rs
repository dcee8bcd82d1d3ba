//! A body that the tracker detects itself: found, tracked, lost and found again.
//!
//! One observation takes five steps, each in the file of its name, that hand immutable values to one another: [`detection`] in the frames, data [`association`], the
//! Bernoulli [`update`], [`visibility`] and [`adaptation`].

mod adaptation;
mod agreement;
mod association;
mod boxes;
mod candidates;
mod challenge;
mod detection;
mod estimate;
mod exposures;
mod heading;
mod look_alikes;
mod measurement;
mod member;
mod other_sensors;
mod places;
mod reach;
mod shortfall;
mod size;
mod streaks;
#[cfg(test)]
mod tests;
mod untriggered;
mod update;
mod velocity;
mod visibility;

pub(super) use association::assigned_nats;
pub(super) use look_alikes::LookAlikes;
pub(super) use visibility::Visibility;

use nalgebra::Vector3;

use super::camera_agreement::ComparisonSums;
use super::candidate::Candidate;
use super::existence::ExistenceSettings;
use super::measurements::Measurements;
use super::member::Member;
use super::settings::DetectedSettings;
use super::statistics::ImageStatistics;
use super::track::{Instant, Track, mean_log_ratio};
use super::{Estimate, TrackState};
use crate::Frame;
use crate::color::{ColorModel, PixelKind};
use crate::likelihood::edge::{Detection, EdgeCue, EdgeFrame, EdgeFrameContext, Outlines};
use crate::shape::Shape;
use crate::tuning::{AgreementTuning, Tuning};
use crate::view::View;
use adaptation::{Adaptation, Certain};
use agreement::Agreement;
use association::AssociatedDetection;
use boxes::Boxes;
use challenge::{Challenge, Sighting, Winner};
use detection::{Detector, Outline, Prediction};
use exposures::Exposures;
use heading::Heading;
use pardalis_core::Error;
use pardalis_core::rng::Draws;
use pardalis_core::simd::Level;
use pardalis_filter::Particles;
use pardalis_filter::bernoulli::{BernoulliFilter, BernoulliSettings, MeasurementComponent};
use pardalis_filter::gaussian::GaussianStart;
use pardalis_filter::modes::ModeFilter;
use places::Place;
use shortfall::Shortfall;
use size::Size;
use untriggered::Sights;
use update::{Measurement, update};
use velocity::mode_filter;

/// A body that the tracker detects itself.
pub(super) struct DetectedTarget {
    pub(super) track: Track,
    /// What other sensors measure.
    pub(super) others: Measurements,
    start: Option<GaussianStart>,
    shape: Shape,
    is_planar: bool,
    colors: ColorModel,
    existence: ExistenceSettings,
    tuning: Tuning,
    /// Targets appear with this density, 1/m³ (1/m² on the ground).
    birth_density: f64,
    edge: EdgeCue,
    filter: BernoulliFilter,
    /// How the target moves; `None` if velocities are those of the filter.
    modes: Option<ModeFilter>,
    detector: Detector,
    /// Those of another program, if there is one.
    boxes: Option<Boxes>,
    /// One per camera, as the following.
    images: Vec<CameraImage>,
    adaptations: Vec<Adaptation>,
    visibilities: Vec<Option<Visibility>>,
    /// The log-likelihood ratio of each camera's latest frame, per particle.
    log_ratios: Vec<Vec<f32>>,
    size: Size,
    /// `None` for bodies that do not turn.
    heading: Option<Heading>,
    agreement: Agreement,
    challenge: Challenge,
    /// The latest detection of the target.
    detected: Option<MeasurementComponent>,
    /// Where the latest frames by themselves put it, metres, if that is not where it was detected.
    measured_m: Option<[f64; 3]>,
    /// How certain the size of its outline is.
    outline: Outline,
    /// Whether its outline falls short of the usual one.
    shortfall: Shortfall,
    /// Whether it has been followed without interruption since it was clearly seen.
    is_clear: bool,
    sights: Sights,
    /// Where the other landmarks of the target are known to be, metres.
    other_landmarks_m: Vec<[f64; 3]>,
    /// What was examined in the latest frames.
    candidates: Vec<Candidate>,
    buffers: Buffers,
    /// The time of the latest frames, seconds.
    time_s: f64,
    /// The time from the frames before to the latest, seconds.
    since_s: f64,
    /// The running mean of the clutter in a search of whole images.
    clutter_seen: f64,
    /// The member of a crowd that it is.
    member: Option<Member>,
}

/// What the images of one camera say of the target's colours and of look-alikes, at the latest instant.
#[derive(Debug, Clone, Default)]
struct CameraImage {
    /// The colour posterior of each bin.
    posterior: Vec<f64>,
    look_alikes: Outlines,
}

/// Memory that steps use again.
struct Buffers {
    frames: Vec<EdgeFrame<'static>>,
    associated: Vec<AssociatedDetection>,
    components: Vec<MeasurementComponent>,
    places: Vec<Place>,
}

/// Empties a vector of frames; its memory serves frames of another lifetime.
fn emptied<'b>(mut frames: Vec<EdgeFrame>) -> Vec<EdgeFrame<'b>> {
    frames.clear();
    // Collecting a vector's own iterator keeps its memory.
    frames.into_iter().map_while(|_| None).collect()
}

impl DetectedTarget {
    pub(super) fn new(
        settings: &DetectedSettings,
        target: usize,
        draws: Draws,
        views: &[View],
        level: Level,
    ) -> Result<Self, Error> {
        settings.existence.check()?;
        settings.tuning.check()?;
        if let Some(detector) = &settings.detector {
            detector.check()?;
        }
        if let Some(start) = &settings.start {
            start.check()?;
        }
        let (shape, motion, existence) = (settings.shape, settings.motion, settings.existence);
        let is_planar = motion.is_planar();
        let tuning = settings.tuning;
        let extent_m = tuning.existence.birth_diameters * shape.diameter_m();
        let birth_density = libm::pow(extent_m, if is_planar { -2.0 } else { -3.0 });
        let mut filter = BernoulliSettings::of(motion);
        filter.particles = settings.particles;
        filter.birth_rate_hz = existence.birth_rate_hz;
        filter.death_rate_hz = existence.death_rate_hz;
        filter.relocation_rate_hz = existence.relocation_rate_hz;
        filter.birth_density = birth_density;
        filter.birth_velocity_sigma_mps = tuning.existence.birth_velocity_sigma_mps;
        filter.velocity_jump_rate_hz = existence.velocity_jump_rate_hz;
        filter.velocity_jump_sigma_mps = existence.velocity_jump_sigma_mps;
        filter.proposal = tuning.proposal;
        let filter = BernoulliFilter::new(filter, draws)?;
        let ground_z_m = is_planar.then_some(existence.ground_z_m);
        let size = settings.size_prior(views.len())?;
        let period_rad = shape.turn_period_rad().filter(|_| settings.turns);
        Ok(Self {
            track: Track::new(views.len()),
            others: Measurements::default(),
            start: settings.start,
            shape,
            is_planar,
            edge: EdgeCue::new(
                (settings.edge, tuning.edge),
                (shape, settings.turns),
                &settings.colors,
                (views.len(), level),
            )?,
            colors: settings.colors.clone(),
            existence,
            modes: mode_filter(
                &existence,
                is_planar,
                tuning.existence.birth_velocity_sigma_mps,
            ),
            tuning,
            birth_density,
            filter,
            detector: Detector::new(
                (shape, period_rad),
                ground_z_m,
                (views.len(), settings.edge.correspondence_lines),
                (&tuning, level),
            ),
            boxes: settings
                .detector
                .map(|detector| Boxes::new(detector, target, (&shape, ground_z_m))),
            images: vec![CameraImage::default(); views.len()],
            adaptations: vec![Adaptation::default(); views.len()],
            visibilities: vec![None; views.len()],
            log_ratios: vec![Vec::new(); views.len()],
            size: Size::new(size),
            heading: period_rad.map(Heading::new),
            agreement: Agreement::new(views, &tuning.agreement),
            challenge: Challenge::default(),
            detected: None,
            measured_m: None,
            outline: Outline::default(),
            shortfall: Shortfall::default(),
            is_clear: false,
            sights: Sights::new(views.len()),
            time_s: 0.0,
            since_s: 0.0,
            clutter_seen: 0.0,
            member: None,
            other_landmarks_m: Vec::new(),
            // The prediction, what moves and, for each camera, its blobs and the largest that is left out; only where rays of several cameras meet may there be more.
            candidates: Vec::with_capacity(
                1 + exposures::BLOBS + views.len() * (tuning.blobs.max_blobs + 1),
            ),
            buffers: Buffers {
                frames: Vec::with_capacity(views.len()),
                associated: Vec::with_capacity(tuning.detection.max_detections),
                components: Vec::with_capacity(tuning.detection.max_detections),
                places: Vec::with_capacity(tuning.detection.max_detections),
            },
        })
    }

    /// Makes sure that a frame of the view can be looked up.
    pub(super) fn prepare(&self, view: &mut View, frame: &Frame) {
        let kind = PixelKind::of(frame);
        view.prepare(kind, self.edge.palette());
        if let Some(ranges) = self.edge.ranges() {
            view.prepare_ranges(kind, ranges);
        }
    }

    /// Whether another program's boxes are taken into account.
    pub(super) fn has_boxes(&self) -> bool {
        self.boxes.is_some()
    }

    pub(super) fn start(&self) -> Option<&GaussianStart> {
        self.start.as_ref()
    }

    /// What was examined in the latest frames.
    pub(super) fn candidates(&self) -> &[Candidate] {
        &self.candidates
    }

    /// Staggers its searches of whole images with those of other bodies, given its number among them.
    pub(super) fn stagger_searches(&mut self, number: usize) {
        self.detector.stagger_searches(number);
    }

    pub(super) fn forget_candidates(&mut self) {
        self.candidates.clear();
    }

    pub(super) fn particles(&self) -> &Particles {
        self.filter.particles()
    }

    /// Sets where the other landmarks of the target are, metres.
    pub(super) fn set_other_landmarks(&mut self, others_m: impl Iterator<Item = [f64; 3]>) {
        self.other_landmarks_m.clear();
        self.other_landmarks_m.extend(others_m);
    }

    /// Predicts to the time of the next frames, or starts.
    pub(super) fn predict(&mut self, time_s: f64, dt_s: f64) {
        (self.time_s, self.since_s) = (time_s, dt_s);
        if let Some(heading) = &mut self.heading {
            heading.predict(dt_s, &self.tuning.heading);
        }
        if let Some((start, start_s)) = self.track.take_reinitialization() {
            self.begin(&start, 1.0);
            self.begin_velocity(start_s, &start);
            self.advance(time_s, (time_s - start_s).max(0.0));
        } else if self.track.has_started() {
            self.advance(time_s, dt_s);
        } else if let Some(start) = self.start {
            self.begin(&start, 1.0);
            self.begin_velocity(time_s, &start);
            self.advance(time_s, 0.0);
        } else {
            self.filter
                .predict(self.tuning.existence.time_before_start_s);
            self.advance(time_s, 0.0);
        }
        self.track.set_started();
    }

    fn prediction(&self) -> Prediction {
        Prediction {
            estimate: self.filter.estimate(0.0),
            existence: self.filter.existence(),
            since_s: self.since_s,
            size: self.size.known(),
            yaw: self
                .heading
                .and_then(|heading| heading.prior(&self.tuning.heading)),
            is_challenged: self.challenge.is_open(),
            is_confined: self.number().is_some(),
        }
    }

    /// Updates what was predicted with the frames of one instant.
    pub(super) fn observe(
        &mut self,
        instant: &Instant,
        statistics: &mut [ImageStatistics],
        look_alikes: &LookAlikes,
    ) {
        let time_s = instant.time_s;
        self.prepare_images(instant, statistics, look_alikes);
        let mut associated = std::mem::take(&mut self.buffers.associated);
        let mut candidates = std::mem::take(&mut self.candidates);
        let mut frames = emptied(std::mem::take(&mut self.buffers.frames));
        let colors = (self.edge.palette(), self.edge.ranges());
        let known = self.certain_motion(time_s);
        let skews_s = instant
            .frames
            .iter()
            .map(|(camera, _)| instant.views[*camera].skew_s());
        let skew_s = skews_s.filter(|_| known.is_none()).fold(0.0, f64::max);
        frames.extend(instant.frames.iter().map(|(camera, frame)| {
            let view = &instant.views[*camera];
            let (image, adaptation) = (&self.images[*camera], &self.adaptations[*camera]);
            let context = EdgeFrameContext {
                colors,
                posterior: &image.posterior,
                min_posterior: self.tuning.blobs.min_posterior,
                correction: adaptation.correction(PixelKind::of(frame)),
                surrounding: adaptation.surrounding(),
                look_alikes: &image.look_alikes,
                motion: known.and_then(|(position_m, velocity_mps)| {
                    view.row_motion(position_m, velocity_mps)
                }),
                offset_sigma_px: self.agreement.sigma_px(*camera),
            };
            EdgeFrame::new(*camera, view.prepared(frame), context)
        }));

        let predicted = self.prediction();
        let edge = (&mut self.edge, &frames[..]);
        let boxes = self.boxes.as_ref();
        self.detector
            .detect(edge, &predicted, boxes, &mut candidates);
        let detections = self.detector.detections();

        self.associate(
            (&frames, detections),
            look_alikes,
            &mut associated,
            &mut candidates,
        );

        let cameras = frames.iter().map(EdgeFrame::camera);
        self.widen(cameras.clone(), time_s, &mut associated);
        let detections = self.detector.detections();
        let rates = &self.existence.occlusion;
        Visibility::predict_in(&mut self.visibilities, cameras, rates, time_s);
        let measurement = Measurement {
            frames: &frames,
            detections,
            associated: &associated,
            visibilities: &self.visibilities,
            region: self.existence.region,
            missed: -self.tuning.existence.missed_nats,
        };
        update(
            &mut self.filter,
            &mut self.edge,
            &measurement,
            &mut self.log_ratios,
            &mut self.buffers.components,
        );

        self.buffers.frames = emptied(frames);
        let is_found = self.track.is_known() || self.is_at_one_place(instant, &associated);
        let number = self.at_estimate(&associated);
        let target = number.map(|number| &associated[number]);
        self.take(target, &predicted, time_s);
        let seen_nats = self.seen_nats(&associated, number);
        let detections = self.detector.detections();
        for &(camera, _) in instant.frames {
            let detection = target.map(|target| &detections[target.detection]);
            let visible_share = detection.and_then(|found| found.visible_share_in(camera));
            if let Some(visibility) = &mut self.visibilities[camera] {
                let seen = visibility.update(
                    (&self.log_ratios[camera], self.filter.weights()),
                    visible_share.unwrap_or(1.0),
                    seen_nats as f32,
                );
                self.track.note_observation(camera, time_s, seen);
            }
        }
        let found = target.map(|target| target.detection);
        let was_known = self.track.is_known();
        self.decide(is_found, time_s);
        self.follow_velocity(time_s, was_known, skew_s);
        if let Some(found) = found {
            self.turn_to(found);
        }
        let winner = self.challenge(&associated, number, time_s);
        self.conclude(instant, &associated, winner.or(number), &mut candidates);
        if self.detector.has_searched() && self.member.is_none() {
            self.note_clutter(&associated, number);
        }
        self.candidates = candidates;

        self.adapt(instant, statistics, &associated);
        self.buffers.associated = associated;
    }

    /// Locates the target in these frames alone. It must have been reset before.
    pub(super) fn locate(
        &mut self,
        instant: &Instant,
        statistics: &mut [ImageStatistics],
        look_alikes: &LookAlikes,
    ) -> Estimate {
        self.predict(instant.time_s, 0.0);
        // A track may be misled by them for a long time, and finds the ball in another frame, where it is by itself.
        self.detector.candidates.with_circles = true;
        self.observe(instant, statistics, look_alikes);
        self.detector.candidates.with_circles = false;
        self.estimate(0.0)
    }

    /// The position (metres) and velocity (m/s) that are predicted for a time in seconds, of a target that is known.
    fn certain_motion(&self, time_s: f64) -> Option<([f64; 3], [f64; 3])> {
        let mut known = self
            .filter
            .estimate(0.0)
            .filter(|_| self.track.is_known())?;
        self.set_velocity(&mut known, time_s);
        Some((known.position_m, known.velocity_mps?))
    }

    /// Prepares the colour posterior, the outlines of look-alikes and what another program found in each camera's image.
    fn prepare_images(
        &mut self,
        instant: &Instant,
        statistics: &mut [ImageStatistics],
        look_alikes: &LookAlikes,
    ) {
        if let Some(boxes) = &mut self.boxes {
            boxes.see(instant);
        }
        for (camera, frame) in instant.frames {
            let prepared = instant.views[*camera].prepared(frame);
            let correction = self.adaptations[*camera].correction(PixelKind::of(frame));
            let counts =
                statistics[*camera].bin_counts(&prepared, self.edge.palette(), &correction);
            let image = &mut self.images[*camera];
            counts.color_posterior(&self.colors, &mut image.posterior);
            image.look_alikes.clear();
        }
        for (place, is_found) in look_alikes.places() {
            for (camera, _) in instant.frames {
                let outlines = &mut self.images[*camera].look_alikes;
                self.edge
                    .add_look_alike(&instant.views[*camera], place, is_found, outlines);
            }
        }
    }

    /// Adapts to the frames, given the detection that is the target if that is certain.
    fn adapt(
        &mut self,
        instant: &Instant,
        statistics: &mut [ImageStatistics],
        associated: &[AssociatedDetection],
    ) {
        let mut adaptations = std::mem::take(&mut self.adaptations);
        let mut agreement = std::mem::take(&mut self.agreement);
        let certain = Certain {
            detection: self.certain_detection(associated),
            colors: &self.colors,
            settings: self.edge.settings(),
            tuning: &self.tuning.adaptation,
            time_s: instant.time_s,
        };
        for (camera, frame) in instant.frames {
            let frame = (&instant.views[*camera], frame);
            let statistics = &mut statistics[*camera];
            adaptations[*camera].adapt(*camera, frame, statistics, &certain);
        }
        let unoccluded = certain
            .detection
            .filter(|detection| detection.least_visible_share() >= certain.tuning.unoccluded_share);
        if let Some(detection) = certain.detection {
            let detection = (detection, certain.tuning.unoccluded_share);
            agreement.update(detection, instant.time_s, &self.tuning.agreement);
        }
        let evidence = unoccluded.and_then(Detection::size).copied();
        self.adaptations = adaptations;
        self.agreement = agreement;
        if let Some(evidence) = evidence {
            let shared_sigma_px = self.edge.settings().shared_sigma_px;
            self.size
                .update(&evidence, shared_sigma_px, &self.tuning.size);
        }
    }

    /// The tuned constants of the agreement of cameras.
    pub(super) fn agreement_tuning(&self) -> &AgreementTuning {
        &self.tuning.agreement
    }

    /// How far the cameras agree on the target, one per camera.
    pub(super) fn comparisons(&self) -> impl Iterator<Item = &ComparisonSums> {
        self.agreement.sums()
    }

    /// The target's diameter as it is known now, metres.
    fn diameter_m(&self) -> f64 {
        self.size.known().scale() * self.shape.diameter_m()
    }

    /// Compares what is tracked with what else may be the target, over time. If that wins, it is tracked from now on; returns its number among those associated.
    fn challenge(
        &mut self,
        associated: &[AssociatedDetection],
        target: Option<usize>,
        time_s: f64,
    ) -> Option<usize> {
        // Whatever else looks like a member of a crowd is another.
        if !self.track.is_known() || self.member.is_some() {
            self.challenge.reset();
            return None;
        }
        let detections = self.detector.detections();
        let sighting = |number: usize| {
            let found = &associated[number];
            let cameras = detections[found.detection].camera_count();
            Sighting::new(number, &found.component, (found.likeness, cameras))
        };
        let is_visible = self.track.is_visible(time_s);
        let of_target = target.map(sighting);
        self.challenge.note_target(of_target.as_ref(), is_visible);
        let here = Vector3::from(self.filter.estimate(0.0)?.position_m);
        let diameter_m = self.diameter_m();
        let is_other = |seen: &Sighting| (seen.position_m - here).norm() > diameter_m;
        let others = (0..associated.len())
            .filter(|number| associated[*number].existence_log_ratio > 0.0)
            .map(sighting)
            .filter(is_other);
        if !self.detector.has_searched() {
            return None;
        }
        let Winner {
            number,
            velocity_mps,
        } = self.challenge.note_others(others, time_s, diameter_m)?;
        let component = associated[number].component;
        let start = GaussianStart {
            position_m: component.position_m,
            covariance_m2: component.covariance_m2,
            velocity_mps: velocity_mps.into(),
            velocity_sigma_mps: [self.tuning.existence.birth_velocity_sigma_mps; 3],
        };
        self.begin(&start, self.filter.existence());
        self.begin_velocity(time_s, &start);
        self.detected = Some(component);
        self.measured_m = None;
        let detection = &self.detector.detections()[associated[number].detection];
        self.outline = Outline::of(detection, &self.tuning.detection);
        self.shortfall = Shortfall::default();
        self.sights.begin();
        if let Some(heading) = &mut self.heading {
            heading.reset();
        }
        self.turn_to(associated[number].detection);
        self.adaptations.fill(Adaptation::default());
        Some(number)
    }

    /// The detection at the estimate, if the target is certainly there.
    fn certain_detection(&self, associated: &[AssociatedDetection]) -> Option<&Detection> {
        let tuning = &self.tuning.adaptation;
        let is_tracking = self.track.state() == TrackState::Tracking;
        if !(is_tracking && self.confidence() >= tuning.certain_confidence) {
            return None;
        }
        let here = Vector3::from(self.filter.estimate(0.0)?.position_m);
        let near_m = tuning.certain_diameters * self.diameter_m();
        let detections = self.detector.detections();
        let mut found = associated.iter().map(|found| &detections[found.detection]);
        found.find(|found| (here - Vector3::from(found.position_m())).norm() < near_m)
    }

    /// Sets the filter to a start, with this probability of existence.
    fn begin(&mut self, start: &GaussianStart, existence: f64) {
        self.filter
            .start(start, existence)
            .expect("starts are checked before");
    }

    /// Forgets all frames and the start, as if the target had never been seen.
    pub(super) fn reset(&mut self) {
        self.begin(&GaussianStart::default(), 0.0);
        self.track.reset();
        self.visibilities.fill(None);
        self.adaptations.fill(Adaptation::default());
        self.size.reset();
        if let Some(heading) = &mut self.heading {
            heading.reset();
        }
        self.agreement.reset(&self.tuning.agreement);
        self.challenge.reset();
        if let Some(modes) = &mut self.modes {
            modes.reset();
        }
        self.outline = Outline::default();
        self.shortfall = Shortfall::default();
        self.sights.reset();
        self.others.clear();
        self.start = None;
        self.detector.exposures = Exposures::default();
        self.clutter_seen = 0.0;
        self.leave_crowd();
        self.candidates.clear();
    }

    /// The mean log-likelihood ratio of a camera's latest frame over the posterior, in nats.
    pub(super) fn log_likelihood_ratio(&self, camera: usize) -> f64 {
        mean_log_ratio(&self.log_ratios[camera], self.filter.weights(), 0.0)
    }
}
