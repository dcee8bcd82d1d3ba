//! Tracking: frame sets in, estimates out, for any number of cameras and targets.
//!
//! There are three ways to track a target, with separate types ([`BodySettings`]): *detected* targets are found by the
//! tracker itself, *initialised* ones are tracked by the published cues from a given start, and *boxed* ones are found by another program.

mod box_model;
mod boxed;
mod builder;
mod camera_agreement;
mod candidate;
mod carriers;
mod crowd;
mod detected;
mod estimate;
mod existence;
mod frame_set;
mod groups;
mod ids;
mod image_box;
mod initialized;
mod landmarks;
mod measurements;
mod member;
mod other_sensors;
mod settings;
mod shown_colors;
mod statistics;
mod target;
mod target_tracker;
mod track;

pub use builder::TrackerBuilder;
pub use camera_agreement::{CameraAgreement, CameraErrorCause, LikelyError};
pub use candidate::{Candidate, Origin, Verdict};
use detected::LookAlikes;
pub use estimate::{BodyMeasurement, Estimate, Member, RadiusEstimate, TrackState};
pub use existence::{ExistenceSettings, OcclusionRates, Region};
pub use frame_set::FrameSet;
pub use ids::{CameraId, PlatformId, TargetId};
pub use image_box::ImageBox;
pub use measurements::{MeasurementCounts, ObservedMeasurement};
pub use pardalis_filter::Measurement;
pub use settings::{
    BodySettings, BoxedSettings, DetectedSettings, DetectorSettings, InitializedSettings,
    SizeTolerance, TargetSettings,
};
pub use target::{Contribution, VISIBLE_NATS};

use carriers::Carriers;
use crowd::Crowd;
use groups::{groups, split};
use statistics::ImageStatistics;
use target::Target;
use target_tracker::TargetTracker;
use track::{Instant, Track};

use crate::frame::check_time;
use crate::platform::{Increment, ObservedMotion, Platform, StampedPose};
use crate::start::{PixelStart, Start};
use crate::tuning::AgreementTuning;
use crate::view::View;
use pardalis_core::Error;
use pardalis_core::rng::Draws;
use pardalis_core::simd::Level;
use pardalis_filter::Particles;
use pardalis_filter::gaussian::{GaussianStart, MAX_START};

/// The outcome of [`Tracker::observe`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Observed {
    /// The frame set was used.
    Used,
    /// The frame set was ignored because it has the time of the previous one.
    Repeated,
}

/// Number of bits for the target in the number of a random stream; those above count its landmarks.
const LANDMARK_BITS: u32 = 16;

/// Tracks targets through cameras.
pub struct Tracker {
    views: Vec<View>,
    carriers: Carriers,
    /// The bodies of all targets.
    bodies: Vec<TargetTracker>,
    targets: Vec<Target>,
    /// The indices of all bodies, grouped by appearance.
    groups: Vec<Vec<usize>>,
    /// One per camera.
    statistics: Vec<ImageStatistics>,
    time_s: Option<f64>,
}

impl Tracker {
    /// Creates a tracker with kernels for the given instruction set, for tests and benchmarks. Otherwise use
    /// [`Tracker::builder`].
    ///
    /// Returns an error if settings are out of range, a target has no bodies, or a start lies outside its camera's
    /// image.
    #[doc(hidden)]
    pub fn new(
        views: Vec<View>,
        targets: impl IntoIterator<Item = impl Into<TargetSettings>>,
        seed: u32,
        level: Level,
    ) -> Result<Self, Error> {
        let mut bodies: Vec<TargetTracker> = Vec::new();
        let mut target = |(number, settings): (usize, TargetSettings)| {
            let count = settings.bodies.len();
            if count == 0 {
                return Err(Error::Empty {
                    what: "the list of a target's bodies".to_owned(),
                    remedy: "give one, or several landmarks".to_owned(),
                });
            }
            if let Some(pair @ [front, rear]) = settings.heading
                && (front >= count || rear >= count || front == rear)
            {
                let allowed = format!("two numbers of landmarks below {count}");
                let value = format!("{pair:?}");
                return Err(Error::out_of_range("heading", value, &allowed));
            }
            let has_detector = |body: &BodySettings| match body {
                BodySettings::Detected(body) => body.detector.is_some(),
                BodySettings::Initialized(_) | BodySettings::Boxed(_) => false,
            };
            if count > 1 && settings.bodies.iter().any(has_detector) {
                let allowed = "a target of one body: boxes beside colours do not say which landmark or member of a crowd they are";
                return Err(Error::out_of_range("detector", "Some", allowed));
            }
            let first = bodies.len();
            for (landmark, body) in settings.bodies.iter().enumerate() {
                let stream = number + (landmark << LANDMARK_BITS);
                let draws = Draws::new(seed, stream as u32);
                let mut body = TargetTracker::new(body, number, draws, &views, level)?;
                body.stagger_searches(bodies.len());
                if settings.is_crowd {
                    body.join_crowd();
                }
                bodies.push(body);
            }
            Ok(Target {
                bodies: first..bodies.len(),
                heading: settings.heading,
                crowd: settings.is_crowd.then(|| Crowd::of(first)),
                contributions: vec![Contribution::default(); views.len()],
            })
        };
        let targets = targets
            .into_iter()
            .map(Into::into)
            .enumerate()
            .map(&mut target)
            .collect::<Result<_, Error>>()?;
        Ok(Self {
            statistics: views.iter().map(|_| ImageStatistics::new(level)).collect(),
            views,
            carriers: Carriers::default(),
            groups: groups(&bodies),
            bodies,
            targets,
            time_s: None,
        })
    }

    /// Returns the cameras.
    pub fn views(&self) -> &[View] {
        &self.views
    }

    /// Returns the number of targets.
    pub fn target_count(&self) -> usize {
        self.targets.len()
    }

    /// Returns the targets.
    pub fn targets(&self) -> impl ExactSizeIterator<Item = TargetId> + use<> {
        (0..self.targets.len()).map(TargetId::new)
    }

    /// Returns the start of each body of a target; `None` for a body that the tracker detects without a start.
    pub fn starts(&self, target: TargetId) -> Result<impl Iterator<Item = Option<Start>>, Error> {
        let bodies = self.bodies_of(target)?.iter();
        Ok(bodies.map(TargetTracker::start))
    }

    /// Returns the time of the latest frame set in seconds.
    pub fn time_s(&self) -> Option<f64> {
        self.time_s
    }

    /// Returns the particles of each body of a target that has started.
    pub fn particles(&self, target: TargetId) -> Result<impl Iterator<Item = &Particles>, Error> {
        let bodies = self.bodies_of(target)?.iter();
        let started = bodies.filter(|body| body.track().has_started());
        Ok(started.map(TargetTracker::particles))
    }

    /// Returns for each body of a target what was examined in the latest frames, and what ruled it out: why the target was not found. Initialised targets
    /// have no candidates.
    ///
    /// Whole images are searched unless the target is certainly where it was predicted, so that its candidate is then the only one.
    pub fn candidates(
        &self,
        target: TargetId,
    ) -> Result<impl Iterator<Item = &[Candidate]>, Error> {
        let bodies = self.bodies_of(target)?.iter();
        Ok(bodies.map(TargetTracker::candidates))
    }

    /// Returns for each body of a target what the latest frames say of it by themselves: the detection that was taken for it. `None` if there was none, and for
    /// initialised bodies, which are not detected.
    ///
    /// [`smoother::smooth`](pardalis_filter::smoother::smooth) makes a track of them that takes into account what follows.
    pub fn measurements(
        &self,
        target: TargetId,
    ) -> Result<impl Iterator<Item = Option<BodyMeasurement>>, Error> {
        let bodies = self.bodies_of(target)?.iter();
        Ok(bodies.map(|body| {
            let mut measurement = body.measurement()?;
            let BodyMeasurement {
                position_m,
                shared_m2,
                ..
            } = &mut measurement;
            self.add_platforms(*position_m, shared_m2, body.track());
            Some(measurement)
        }))
    }

    /// Returns the contribution of each camera to a target so far.
    pub fn contributions(&self, target: TargetId) -> Result<&[Contribution], Error> {
        Ok(&self.target(target)?.contributions)
    }

    /// Returns for each camera how far it agrees with the others on where the detected targets are, and which error of its pose, focal length or clock
    /// explains it if it does not.
    pub fn camera_agreement(&self) -> Vec<CameraAgreement> {
        let detected = || self.bodies.iter().filter_map(TargetTracker::detected);
        // What the cameras say is about them, whichever the target: the first one's constants hold.
        let tuning = detected()
            .next()
            .map(detected::DetectedTarget::agreement_tuning);
        let sums = detected().flat_map(|target| target.comparisons().enumerate());
        camera_agreement::agreements(
            self.views.len(),
            sums,
            tuning.unwrap_or(&AgreementTuning::DEFAULT),
        )
    }

    /// Takes the pose of a platform at a time, which may be later than that of the next frames: between poses, the platform moves at constant rates.
    ///
    /// Returns an error if the platform is unknown, the time is not finite, or the pose is not.
    pub fn observe_pose(
        &mut self,
        platform: PlatformId,
        pose: &StampedPose,
    ) -> Result<ObservedMotion, Error> {
        self.carriers.platform_mut(platform)?.observe_pose(pose)
    }

    /// Takes an increment of a platform's odometry. The world is the platform's frame at the first one, unless a pose was observed before.
    ///
    /// Returns an error if the platform is unknown, or times or motion of the increment are not finite or out of order.
    pub fn observe_increment(
        &mut self,
        platform: PlatformId,
        increment: &Increment,
    ) -> Result<ObservedMotion, Error> {
        let platform = self.carriers.platform_mut(platform)?;
        platform.observe_increment(increment)
    }

    /// Returns a platform.
    ///
    /// Returns an error if it is unknown.
    pub fn platform(&self, platform: PlatformId) -> Result<&Platform, Error> {
        self.carriers.platform(platform)
    }

    /// Returns the number of frame sets at whose time a platform had no pose near enough, so that frames of its cameras were not used.
    ///
    /// Returns an error if the platform is unknown.
    pub fn frames_without_pose(&self, platform: PlatformId) -> Result<usize, Error> {
        self.carriers.unplaced(platform)
    }

    /// Updates all targets with the frames of one instant. A set without frames only advances the time. A set with
    /// the time of the previous one is ignored. So are frames of cameras on a platform of which no pose near that time is known.
    ///
    /// Returns an error, without any change, if the set is older than the previous one, a camera is unknown, or an
    /// image does not have its camera's size.
    pub fn observe(&mut self, set: &FrameSet) -> Result<Observed, Error> {
        let time_s = set.time_s();
        self.check(set)?;
        let dt_s = self.time_s.map_or(0.0, |before_s| time_s - before_s);
        if dt_s < 0.0 {
            let before_s = time_s - dt_s;
            let allowed = format!("at or after {before_s}, the time of the latest frame set");
            return Err(Error::out_of_range("time_s", time_s, &allowed));
        }
        if self.time_s.is_some() && dt_s == 0.0 {
            return Ok(Observed::Repeated);
        }
        let placed = self.place_cameras(set);
        let set = placed.as_ref().unwrap_or(set);
        let frames = set.numbered();
        self.prepare(set);
        self.tell_platforms();
        for group in 0..self.groups.len() {
            self.step(group, set, dt_s);
        }
        for target in &mut self.targets {
            target.add_contributions(&self.bodies[target.bodies.clone()], &self.views, set);
        }
        if self.bodies.iter().any(TargetTracker::compares_frames) {
            for (camera, frame) in frames {
                self.views[*camera].keep(frame.clone());
            }
        }
        self.time_s = Some(time_s);
        Ok(Observed::Used)
    }

    /// Moves cameras on platforms to their poses at the time of the set. If a platform's pose jumped, moves the estimates of targets along with it. Returns the set without
    /// the frames of cameras whose pose is unknown, if there are any.
    fn place_cameras(&mut self, set: &FrameSet) -> Option<FrameSet> {
        if self.carriers.is_empty() {
            return None;
        }
        let time_s = set.time_s();
        let cameras = self.views.len();
        if let Some(before_s) = self.time_s
            && let Some(now_from_before) = self.carriers.jumped(cameras, before_s, time_s)
        {
            for body in &mut self.bodies {
                body.move_world(&now_from_before, before_s);
            }
        }
        self.carriers.place(&mut self.views, time_s);
        let is_placed = |camera: usize| self.carriers.is_placed(camera);
        let frames = set.numbered().iter().map(|(camera, _)| *camera);
        let mut cameras = frames.chain(set.boxes().iter().map(|boxes| boxes.camera));
        if cameras.all(is_placed) {
            return None;
        }
        let mut placed = set.clone();
        placed.retain_cameras(is_placed);
        Some(placed)
    }

    /// Performs one step for bodies that look alike, in descending order of confidence: each takes into account the
    /// detections claimed by those before it. Nobody new is looked for in a crowd once nobody was found.
    fn step(&mut self, group: usize, set: &FrameSet, dt_s: f64) {
        let order = &mut self.groups[group];
        for &number in &*order {
            let body = &mut self.bodies[number];
            if !body.is_free() {
                body.predict(set.time_s(), dt_s);
            } else if self.time_s.is_some() {
                // Whoever is found from now on was not there before.
                body.track_mut().set_started();
            }
        }
        // Members of a crowd before whoever may be new to it.
        let known = |number: usize| self.bodies[number].number().is_some();
        let rank = |number: usize| self.bodies[number].rank();
        order.sort_unstable_by(|&a, &b| {
            let by_rank = rank(b).total_cmp(&rank(a)).then(a.cmp(&b));
            known(b).cmp(&known(a)).then(by_rank)
        });
        let instant = Instant {
            views: &self.views,
            frames: set.numbered(),
            boxes: set.boxes(),
            time_s: set.time_s(),
        };
        for &number in &*order {
            let mut targets = self.targets.iter_mut();
            let target = targets.find(|target| target.bodies.contains(&number));
            if let Some(crowd) = target.and_then(|target| target.crowd.as_mut()) {
                crowd.lend_search(&mut self.bodies, number);
                self.bodies[number].claim_predicted(&instant);
            }
        }
        let mut is_complete = false;
        for &number in &*order {
            let is_free = self.bodies[number].is_free();
            if is_free && is_complete {
                self.bodies[number].forget_candidates();
                continue;
            }
            let mut targets = self.targets.iter_mut();
            let target = targets.find(|target| target.bodies.contains(&number));
            let target = target.expect("every body belongs to a target");
            if let Some(crowd) = &mut target.crowd {
                crowd.lend_search(&mut self.bodies, number);
            }
            let (body, others) = split(&mut self.bodies, number);
            if is_free {
                body.predict(set.time_s(), dt_s);
            } else if target.crowd.is_none() {
                let landmarks = target.bodies.clone();
                body.set_other_landmarks(landmarks.filter_map(|i| others.get(i)?.position_m()));
            }
            let (updated, predicted) = others.around(order);
            let look_alikes = LookAlikes {
                detected: &|number| others.get(number)?.detected(),
                claim: &|body, number| others.get(body).map_or(0.0, |other| other.claim(number)),
                updated,
                predicted,
            };
            body.observe(&instant, &mut self.statistics, &look_alikes);
            if let Some(crowd) = &mut target.crowd {
                is_complete |= is_free && body.is_free();
                crowd.update_member(body, &instant);
            }
        }
    }

    /// Starts a target again at its next frames, for example from another robot's estimate
    /// ([`GaussianStart::from_estimate`], [`GaussianStart::moved`]). `time_s` is the time of that estimate in
    /// seconds; the tracker predicts from it to the next frames.
    ///
    /// Returns an error if the target is unknown or has several landmarks, the start is invalid, or the time is not
    /// finite.
    pub fn reinitialize(
        &mut self,
        target: TargetId,
        start: &GaussianStart,
        time_s: f64,
    ) -> Result<(), Error> {
        start.check()?;
        check_time(time_s)?;
        let bodies = self.target(target)?.bodies.clone();
        let [body] = &mut self.bodies[bodies] else {
            let allowed = "a target with one body: one position does not determine those of several landmarks, or of a crowd";
            return Err(Error::out_of_range("target", target, allowed));
        };
        body.track_mut().reinitialize(start, time_s);
        Ok(())
    }

    /// Locates every target in the frames of one instant, independently of earlier frames and without velocities
    /// (thesis 6.1.3).
    ///
    /// The particles of an initialised target are drawn around the mean of the start, then around the mean of the
    /// posterior, once for each standard deviation in `passes_sigma_m` (metres), such as [`PASSES_SIGMA_M`]. From a
    /// pixel, the start is first searched for along its ray. `starts` has one entry per body, target by target and
    /// landmark by landmark; detected targets ignore it.
    ///
    /// The result stays until the next frames, also in [`Tracker::particles`].
    ///
    /// Returns an error, without any change, if starts or passes are invalid, or frames are, as for
    /// [`Tracker::observe`].
    pub fn locate(
        &mut self,
        set: &FrameSet,
        starts: &[Option<Start>],
        passes_sigma_m: &[f64],
    ) -> Result<Vec<Estimate>, Error> {
        let count = self.bodies.len();
        if starts.len() != count {
            let allowed = format!("{count}, one per body");
            return Err(Error::out_of_range("starts", starts.len(), &allowed));
        }
        for (body, start) in self.bodies.iter().zip(starts) {
            body.check_start(start.as_ref(), &self.views)?;
        }
        check_passes(passes_sigma_m)?;
        self.check(set)?;
        self.prepare(set);
        self.time_s = Some(set.time_s());
        self.bodies.iter_mut().for_each(TargetTracker::reset);
        for target in &mut self.targets {
            target.crowd = target.crowd.map(|_| Crowd::of(target.bodies.start));
        }
        for group in &mut self.groups {
            group.sort_unstable();
        }
        let instant = Instant {
            views: &self.views,
            frames: set.numbered(),
            boxes: set.boxes(),
            time_s: set.time_s(),
        };
        let mut located = Vec::new();
        let mut complete = None;
        for (number, start) in starts.iter().enumerate() {
            let target = self.targets.iter_mut();
            let target = target.enumerate().find(|(_, t)| t.bodies.contains(&number));
            let (target, Target { crowd, .. }) = target.expect("every body belongs to a target");
            if complete == Some(target) {
                located.push(self.bodies[number].estimate(0.0));
                continue;
            }
            if let Some(crowd) = crowd {
                crowd.lend_search(&mut self.bodies, number);
            }
            let (body, others) = split(&mut self.bodies, number);
            let group = self.groups.iter().find(|group| group.contains(&number));
            let (updated, predicted) = others.around(group.expect("every body belongs to a group"));
            let look_alikes = LookAlikes {
                detected: &|number| others.get(number)?.detected(),
                claim: &|body, number| others.get(body).map_or(0.0, |other| other.claim(number)),
                updated,
                predicted,
            };
            let start = (start.as_ref(), passes_sigma_m);
            located.push(body.locate(&instant, &mut self.statistics, start, &look_alikes));
            if body.is_free() {
                complete = Some(target);
            }
            if let Some(crowd) = crowd {
                crowd.update_member(body, &instant);
            }
        }
        let estimate = |target: &Target| {
            let of_bodies = located[target.bodies.clone()].iter();
            target.combined(of_bodies.copied())
        };
        Ok(self.targets.iter().map(estimate).collect())
    }

    fn target(&self, target: TargetId) -> Result<&Target, Error> {
        target.check(self.targets.len())?;
        Ok(&self.targets[target.index()])
    }

    fn bodies_of(&self, target: TargetId) -> Result<&[TargetTracker], Error> {
        Ok(&self.bodies[self.target(target)?.bodies.clone()])
    }

    /// Returns an error if a frame's camera is unknown or has images of another size.
    fn check(&self, set: &FrameSet) -> Result<(), Error> {
        for (camera, frame) in set.frames() {
            camera.check(self.views.len())?;
            self.views[camera.index()].check(frame)?;
        }
        for boxes in set.boxes() {
            CameraId::new(boxes.camera).check(self.views.len())?;
            let target = self.target(TargetId::new(boxes.target))?;
            let takes_boxes = |body: &TargetTracker| match body {
                TargetTracker::Boxed(_) => true,
                TargetTracker::Detected(body) => body.has_boxes(),
                TargetTracker::Initialized(_) => false,
            };
            if !self.bodies[target.bodies.clone()].iter().all(takes_boxes) {
                let allowed = "a target with a detector";
                return Err(Error::out_of_range("target", boxes.target, allowed));
            }
        }
        Ok(())
    }

    /// Prepares the look-up tables that the targets need for these frames.
    fn prepare(&mut self, set: &FrameSet) {
        for (camera, frame) in set.numbered() {
            self.views[*camera].set_later_s(frame.time_s() - set.time_s());
            self.statistics[*camera].clear();
            for body in &self.bodies {
                body.prepare(&mut self.views[*camera], frame);
            }
        }
    }

    /// Predicts a target at a time in seconds, at or after the latest frames, without changing the tracker; of a crowd, the member with the greatest confidence.
    ///
    /// Returns an error if the target is unknown or the time is not finite.
    pub fn estimate_at(&self, target: TargetId, time_s: f64) -> Result<Estimate, Error> {
        let estimates = self.estimates(target, time_s)?;
        Ok(self.target(target)?.combined(estimates))
    }

    /// Returns the members of a crowd with their numbers and their estimates, predicted at a time in seconds, at or after the latest frames; nobody for other targets. Numbers
    /// count from 1 in the order in which members were found, and are never used again. A member that is [lost](TrackState::Lost) keeps its number for up to three seconds, in
    /// case it comes back.
    ///
    /// Returns an error if the target is unknown or the time is not finite.
    pub fn members_at(
        &self,
        target: TargetId,
        time_s: f64,
    ) -> Result<impl Iterator<Item = Member>, Error> {
        let bodies = self.bodies_of(target)?.iter().enumerate();
        let numbers = bodies.map(|(body, tracker)| (body, tracker.number()));
        let estimates = numbers.zip(self.estimates(target, time_s)?);
        Ok(estimates.filter_map(|((body, number), estimate)| {
            let number = number?;
            Some(Member {
                number,
                body,
                estimate,
            })
        }))
    }

    /// Returns the estimate of a target at the time of the latest frame set, as [`Tracker::estimate_at`] does.
    ///
    /// Returns an error if the target is unknown.
    pub fn estimate(&self, target: TargetId) -> Result<Estimate, Error> {
        self.estimate_at(target, self.time_s.unwrap_or(0.0))
    }

    /// Predicts each body of a target, as [`Tracker::estimate_at`] does for the target.
    pub fn bodies_at(&self, target: TargetId, time_s: f64) -> Result<Vec<Estimate>, Error> {
        Ok(self.estimates(target, time_s)?.collect())
    }

    fn estimates(
        &self,
        target: TargetId,
        time_s: f64,
    ) -> Result<impl ExactSizeIterator<Item = Estimate>, Error> {
        check_time(time_s)?;
        let ahead_s = self.time_s.map_or(0.0, |before_s| time_s - before_s);
        let bodies = self.bodies_of(target)?.iter();
        Ok(bodies.map(move |body| {
            let mut estimate = body.estimate(ahead_s);
            if let Some(known) = &mut estimate.kinematics {
                self.add_platforms(known.position_m, &mut known.covariance_m2, body.track());
            }
            estimate
        }))
    }
}

impl Tracker {
    /// Adds to a covariance what the poses of the platforms leave uncertain whose cameras see the body.
    fn add_platforms(&self, position_m: [f64; 3], covariance_m2: &mut [f64; 6], track: &Track) {
        if self.carriers.is_empty() {
            return;
        }
        let sees = |camera: &usize| track.sees(*camera);
        let all = 0..self.views.len();
        let added_m2 = if all.clone().any(|camera| sees(&camera)) {
            let cameras = all.filter(sees);
            self.carriers.covariance_m2(position_m, cameras)
        } else {
            self.carriers.covariance_m2(position_m, all)
        };
        let added_m2 = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)].map(|at| added_m2[at]);
        for (sum, added) in covariance_m2.iter_mut().zip(added_m2) {
            *sum += added;
        }
    }
}

/// The standard deviations of the three passes over a single image, in metres, as published (thesis 6.1.3).
pub const PASSES_SIGMA_M: [f64; 3] = [0.1, 0.07, 0.04];

/// Returns an error for standard deviations that [`Tracker::locate`] does not accept.
pub fn check_passes(passes_sigma_m: &[f64]) -> Result<(), Error> {
    let allowed = "one or more numbers of metres, above 0 and at most 1e6";
    let is_valid = |sigma: &f64| *sigma > 0.0 && *sigma <= MAX_START;
    if !passes_sigma_m.is_empty() && passes_sigma_m.iter().all(is_valid) {
        return Ok(());
    }
    let value = format!("{passes_sigma_m:?}");
    Err(Error::out_of_range("passes_sigma_m", value, allowed))
}

/// Returns an error if the start is not in a pixel of one of these cameras.
fn check_pixel(start: &PixelStart, views: &[View]) -> Result<(), Error> {
    start.check()?;
    let view = views.get(start.camera);
    let camera = || {
        Error::out_of_range(
            "camera",
            start.camera,
            "the number of a camera of the tracker",
        )
    };
    start.check_in(view.ok_or_else(camera)?)
}
