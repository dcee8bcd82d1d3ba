//! A body that another program detects: boxes in images in, a position with its uncertainty out. Images and colours are not needed.

mod member;
mod proposal;
mod update;

use std::ops::Range;

use nalgebra::{Matrix3, Vector3};

use super::box_model::{Body, Fit, Sight};
use super::candidate::Candidate;
use super::detected::{LookAlikes, Visibility};
use super::existence::ExistenceSettings;
use super::image_box::CameraBoxes;
use super::measurements::{Measurements, Standing};
use super::member::Member;
use super::settings::{BoxedSettings, DetectorSettings};
use super::track::{Instant, Track, mean_log_ratio};
use super::{BodyMeasurement, Estimate, TrackState};
use crate::tuning::ExistenceTuning;
use crate::view::View;
use pardalis_core::Error;
use pardalis_core::rng::Draws;
use pardalis_filter::Particles;
use pardalis_filter::bernoulli::{BernoulliFilter, BernoulliSettings, MeasurementComponent};
use pardalis_filter::gaussian::GaussianStart;

/// Before the first frames a body may have appeared for this long, seconds. Hand-set: a frame or two, so that no single box is believed.
const FIRST_S: f64 = 0.05;
/// Bodies appear only where their box is at least this large, pixels. Hand-set: detectors find nothing smaller.
const LEAST_PX: f64 = 8.0;
/// Neighbouring frames share this part of the variance of boxes. Hand-set: a detector's errors vary little as long as what it sees does.
const SHARED_SHARE: f64 = 0.5;

/// A body that is tracked by boxes.
pub(super) struct BoxedTarget {
    pub(super) track: Track,
    /// What other sensors measure.
    pub(super) others: Measurements,
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
    /// Of each box of the instant, how much likelier it is this body's than clutter, times the probability that the body exists and is detected; empty where there is nobody.
    claims: Vec<f64>,
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
        let ground_z_m = motion.is_planar().then_some(existence.ground_z_m);
        let body = Body::new(&shape, ground_z_m);
        let reaches_m = views.iter().filter_map(|view| body.reach_m(view, LEAST_PX));
        let reach_m = reaches_m.fold(shape.diameter_m(), f64::max);
        let birth_density = libm::pow(reach_m, if motion.is_planar() { -2.0 } else { -3.0 });
        let mut filter = BernoulliSettings::of(motion);
        filter.particles = settings.particles;
        filter.birth_rate_hz = existence.birth_rate_hz;
        filter.death_rate_hz = existence.death_rate_hz;
        filter.relocation_rate_hz = existence.relocation_rate_hz;
        filter.birth_density = birth_density;
        filter.birth_velocity_sigma_mps = tuning.birth_velocity_sigma_mps;
        filter.velocity_jump_rate_hz = existence.velocity_jump_rate_hz;
        filter.velocity_jump_sigma_mps = existence.velocity_jump_sigma_mps;
        Ok(Self {
            track: Track::new(views.len()),
            others: Measurements::default(),
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
            claims: Vec::new(),
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

    /// Whether the boxes of both are the same.
    pub(super) fn looks_like(&self, other: &Self) -> bool {
        self.target == other.target
    }

    /// Predicts to the time of the next frames, or starts.
    pub(super) fn predict(&mut self, time_s: f64, dt_s: f64) {
        if let Some((start, since_s)) = self.track.take_reinitialization() {
            self.begin(&start, 1.0);
            self.advance(time_s, (time_s - since_s).max(0.0));
        } else if self.track.has_started() {
            self.advance(time_s, dt_s);
        } else if let Some(start) = self.start {
            self.begin(&start, 1.0);
            self.advance(time_s, 0.0);
        } else {
            self.filter.predict(FIRST_S);
            self.advance(time_s, 0.0);
        }
        self.track.set_started();
    }

    /// Predicts by `dt_s` seconds to a time in seconds, with what other sensors measured meanwhile.
    fn advance(&mut self, time_s: f64, dt_s: f64) {
        let mut shared_m2 = [0.0; 6];
        self.add_shared(&mut shared_m2);
        let standing = Standing {
            is_known: self.track.is_known(),
            shared_m2,
            ground_z_m: self.body.ground_z_m,
            birth_velocity_sigma_mps: self.tuning.birth_velocity_sigma_mps,
        };
        self.others
            .advance(&mut self.filter, (time_s, dt_s), &standing);
    }

    /// Whether its motion model has a velocity.
    pub(super) fn has_velocity(&self) -> bool {
        self.filter.has_velocity()
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
            self.claim_boxes(instant.views);
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

    /// What became of each box of the latest frames.
    pub(super) fn candidates(&self) -> &[Candidate] {
        &self.candidates
    }

    pub(super) fn forget_candidates(&mut self) {
        self.candidates.clear();
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

    /// The probability that the body exists and lies as near to the estimate as boxes can tell.
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
        self.others.clear();
        self.start = None;
        self.buffers.time_s = None;
        self.candidates.clear();
        self.claims.clear();
        if let Some(member) = &mut self.member {
            *member = Member::default();
            self.set_births(
                self.existence.birth_rate_hz,
                self.existence.relocation_rate_hz,
            );
        }
    }
}

/// The upper triangle: xx, xy, xz, yy, yz, zz.
fn upper(matrix: &Matrix3<f64>) -> [f64; 6] {
    [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)].map(|at| matrix[at])
}
