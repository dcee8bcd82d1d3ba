//! Tracking: frame sets in, estimates out, for any number of cameras and targets.
//!
//! A target is tracked in one of two ways, which the types keep apart ([`BodySettings`]): *detected*, where the tracker finds it itself, or *initialised*, where the published cues track it
//! from a given start.

mod builder;
mod detected;
mod frame_set;
mod groups;
mod ids;
mod initialized;
mod landmarks;
mod settings;
mod statistics;
mod target_tracker;
mod track;

pub use builder::TrackerBuilder;
pub use detected::{ExistenceSettings, OcclusionRates};
pub use frame_set::FrameSet;
pub use ids::{CameraId, TargetId};
pub use settings::{BodySettings, DetectedSettings, InitializedSettings, TargetSettings};

use std::ops::Range;

use groups::{groups, split};
use statistics::ImageStatistics;
use target_tracker::TargetTracker;
use track::Instant;

use crate::frame::check_time;
use crate::start::{PixelStart, Start};
use crate::view::View;
use pardalis_core::Error;
use pardalis_core::rng::Draws;
use pardalis_core::simd::Level;
use pardalis_filter::Particles;
use pardalis_filter::estimate::StateEstimate;
use pardalis_filter::gaussian::{GaussianStart, MAX_START};

/// The state of a target's track.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TrackState {
    /// Not started yet.
    Searching,
    /// Visible in one camera at least.
    Tracking,
    /// Visible in no camera's latest frame (occluded, out of view or masked): the estimate is predicted by the motion model alone.
    Occluded,
    /// It was tracked, and it is not known any more where it is: there is no estimate.
    Lost,
}

impl TrackState {
    /// All states.
    pub const ALL: [Self; 4] = [Self::Searching, Self::Tracking, Self::Occluded, Self::Lost];

    /// Its name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Searching => "searching",
            Self::Tracking => "tracking",
            Self::Occluded => "occluded",
            Self::Lost => "lost",
        }
    }
}

/// The estimate of one target at one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    /// The track's state.
    pub state: TrackState,
    /// Position, velocity and covariance; `None` unless tracking or occluded.
    pub kinematics: Option<StateEstimate>,
    /// The direction from the rear landmark to the front one, counterclockwise from x, in radians within ±π, if the target has such.
    pub heading_rad: Option<f64>,
    /// With a position: the probability, by the filter's own account, that the target is there and within one diameter of it. Without: for detected targets the
    /// probability that the target exists and is visible, else 0.
    pub confidence: f64,
}

/// What became of a frame set.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Observed {
    /// It was used.
    Used,
    /// It has the time of the set before: nothing new, so that it was not used again.
    Repeated,
}

/// What one camera has contributed to one target so far.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Contribution {
    /// Frames that were used.
    pub frames: usize,
    /// Frames that show the target at its posterior position: their log-likelihood ratio is above [`SEEN_NATS`].
    pub seen_frames: usize,
    /// The sum over all frames of the log-likelihood ratio against background, each the mean over the posterior, in nats.
    pub log_likelihood_ratio: f64,
}

/// The log-likelihood ratio, in nats, above which a camera's frame shows the target. Hand-set.
pub const SEEN_NATS: f64 = 1.0;

/// The random numbers of landmarks differ by the bits above these of their target's number.
const LANDMARK_BITS: u32 = 16;

struct Target {
    /// The numbers of its one body, or of its landmarks.
    bodies: Range<usize>,
    /// Its front and its rear landmark.
    heading: Option<[usize; 2]>,
    /// One per camera.
    contributions: Vec<Contribution>,
}

/// Tracks targets through cameras.
pub struct Tracker {
    views: Vec<View>,
    /// Those of all targets.
    bodies: Vec<TargetTracker>,
    targets: Vec<Target>,
    /// The numbers of all bodies, those that look alike together.
    groups: Vec<Vec<usize>>,
    /// One per camera.
    statistics: Vec<ImageStatistics>,
    time_s: Option<f64>,
}

impl Tracker {
    /// Creates a tracker whose kernels use an instruction set of the caller's choice, for tests and benchmarks. Use [`Tracker::builder`].
    ///
    /// Errors: settings out of range, a target without bodies, a start outside its camera's image.
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
            let first = bodies.len();
            for (landmark, body) in settings.bodies.iter().enumerate() {
                let stream = number + (landmark << LANDMARK_BITS);
                let draws = Draws::new(seed, stream as u32);
                bodies.push(TargetTracker::new(body, draws, &views, level)?);
            }
            Ok(Target {
                bodies: first..bodies.len(),
                heading: settings.heading,
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
            statistics: views.iter().map(|_| ImageStatistics::default()).collect(),
            views,
            groups: groups(&bodies),
            bodies,
            targets,
            time_s: None,
        })
    }

    /// The cameras.
    pub fn views(&self) -> &[View] {
        &self.views
    }

    /// The number of targets.
    pub fn target_count(&self) -> usize {
        self.targets.len()
    }

    /// The targets.
    pub fn targets(&self) -> impl ExactSizeIterator<Item = TargetId> + use<> {
        (0..self.targets.len()).map(TargetId::new)
    }

    /// Where each body of a target starts; `None` for a body that the tracker detects without a start.
    pub fn starts(&self, target: TargetId) -> Result<impl Iterator<Item = Option<Start>>, Error> {
        let bodies = self.bodies_of(target)?.iter();
        Ok(bodies.map(TargetTracker::start))
    }

    /// The time of the latest frame set, in seconds.
    pub fn time_s(&self) -> Option<f64> {
        self.time_s
    }

    /// The particles of a target's bodies that have started.
    pub fn particles(&self, target: TargetId) -> Result<impl Iterator<Item = &Particles>, Error> {
        let bodies = self.bodies_of(target)?.iter();
        let started = bodies.filter(|body| body.track().has_started());
        Ok(started.map(TargetTracker::particles))
    }

    /// What each camera has contributed to a target so far.
    pub fn contributions(&self, target: TargetId) -> Result<&[Contribution], Error> {
        Ok(&self.target(target)?.contributions)
    }

    /// Uses the frames of one instant; without frames, time passes and no more. A set with the time of the one before is not used again.
    ///
    /// Errors, after which nothing has changed: the set's time lies before that of the latest set, a camera is unknown, or an image does not have its
    /// camera's size.
    pub fn observe(&mut self, set: &FrameSet) -> Result<Observed, Error> {
        let (frames, time_s) = (set.numbered(), set.time_s());
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
        self.prepare(set);
        for group in 0..self.groups.len() {
            self.step(group, set, dt_s);
        }
        for target in &mut self.targets {
            target.add_contributions(&self.bodies[target.bodies.clone()], set);
        }
        if self.bodies.iter().any(TargetTracker::compares_frames) {
            for (camera, frame) in frames {
                self.views[*camera].keep(frame.clone());
            }
        }
        self.time_s = Some(time_s);
        Ok(Observed::Used)
    }

    /// One step of bodies that look alike, those with the greatest confidence first, so that others look for what these leave.
    fn step(&mut self, group: usize, set: &FrameSet, dt_s: f64) {
        let order = &mut self.groups[group];
        for &number in &*order {
            self.bodies[number].predict(set.time_s(), dt_s);
        }
        let rank = |number: usize| self.bodies[number].rank();
        order.sort_unstable_by(|&a, &b| rank(b).total_cmp(&rank(a)).then(a.cmp(&b)));
        let instant = Instant {
            views: &self.views,
            frames: set.numbered(),
            time_s: set.time_s(),
        };
        for &number in &*order {
            let (body, others) = split(&mut self.bodies, number);
            let target = self.targets.iter().find(|t| t.bodies.contains(&number));
            let landmarks = target.into_iter().flat_map(|target| target.bodies.clone());
            body.set_other_landmarks(landmarks.filter_map(|i| others.get(i)?.position_m()));
            body.observe(&instant, &mut self.statistics, &others.look_alikes(order));
        }
    }

    /// Starts a target again with its next frames, from another robot's estimate for example ([`GaussianStart::from_estimate`],
    /// [`GaussianStart::moved`]). `time_s` is the time of that estimate in seconds; what has passed since then is predicted.
    ///
    /// Errors: an unknown target, one with several landmarks, a faulty start, a time that is not finite.
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
            let allowed = "a target of one body: a position does not say where landmarks are";
            return Err(Error::out_of_range("target", target, allowed));
        };
        body.track_mut().reinitialize(start, time_s);
        Ok(())
    }

    /// Locates every target in the frames of one instant, by these frames alone: no time passes, velocities play no role (thesis 6.1.3).
    ///
    /// The particles of an initialised target are drawn around the start's mean, then around the mean of their posterior, and so on, once for each standard
    /// deviation of `passes_sigma_m` (metres), such as [`PASSES_SIGMA_M`]. A start in a pixel is first searched for along its ray. There is one start per
    /// body, target by target and landmark by landmark; detected targets need none, and ignore it.
    ///
    /// What is found holds until the next frames, also for [`Tracker::particles`]. Errors, after which nothing has changed: faulty frames as for
    /// [`Tracker::observe`], faulty starts or passes.
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
        for group in &mut self.groups {
            group.sort_unstable();
        }
        let instant = Instant {
            views: &self.views,
            frames: set.numbered(),
            time_s: set.time_s(),
        };
        let mut located = Vec::new();
        for (number, start) in starts.iter().enumerate() {
            let (body, others) = split(&mut self.bodies, number);
            let group = self.groups.iter().find(|group| group.contains(&number));
            let look_alikes = others.look_alikes(group.expect("every body is of a group"));
            let start = (start.as_ref(), passes_sigma_m);
            located.push(body.locate(&instant, &mut self.statistics, start, &look_alikes));
        }
        let estimate = |target: &Target| {
            let of_bodies = located[target.bodies.clone()].iter();
            landmarks::combined(of_bodies.copied(), target.heading)
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

    /// Returns an error for frames of unknown cameras, or not of their camera's size.
    fn check(&self, set: &FrameSet) -> Result<(), Error> {
        for (camera, frame) in set.frames() {
            camera.check(self.views.len())?;
            self.views[camera.index()].check(frame)?;
        }
        Ok(())
    }

    /// Makes sure that the frames can be looked up for every target.
    fn prepare(&mut self, set: &FrameSet) {
        for (camera, frame) in set.numbered() {
            self.statistics[*camera].clear();
            for body in &self.bodies {
                body.prepare(&mut self.views[*camera], frame);
            }
        }
    }

    /// Estimates a target at a time in seconds, at or after the latest frames; nothing changes.
    ///
    /// Errors: an unknown target, a time that is not finite.
    pub fn estimate_at(&self, target: TargetId, time_s: f64) -> Result<Estimate, Error> {
        let heading = self.target(target)?.heading;
        Ok(landmarks::combined(
            self.estimates(target, time_s)?,
            heading,
        ))
    }

    /// Returns the estimate of a target at the time of the latest frame set.
    ///
    /// Errors: an unknown target.
    pub fn estimate(&self, target: TargetId) -> Result<Estimate, Error> {
        self.estimate_at(target, self.time_s.unwrap_or(0.0))
    }

    /// The same for each of its bodies.
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
        Ok(bodies.map(move |body| body.estimate(ahead_s)))
    }
}

/// The standard deviations around the start, in metres, of the three passes with which single images were published (thesis 6.1.3).
pub const PASSES_SIGMA_M: [f64; 3] = [0.1, 0.07, 0.04];

/// Returns an error for standard deviations that [`Tracker::locate`] cannot draw by.
pub fn check_passes(passes_sigma_m: &[f64]) -> Result<(), Error> {
    let allowed = "one or more numbers of metres, above 0 and at most 1e6";
    let fine = |sigma: &f64| *sigma > 0.0 && *sigma <= MAX_START;
    if !passes_sigma_m.is_empty() && passes_sigma_m.iter().all(fine) {
        return Ok(());
    }
    let value = format!("{passes_sigma_m:?}");
    Err(Error::out_of_range("passes_sigma_m", value, allowed))
}

/// Returns an error for a start that is no pixel of these cameras.
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

impl Target {
    /// Adds what each camera contributed to its bodies, once all have started.
    fn add_contributions(&mut self, bodies: &[TargetTracker], set: &FrameSet) {
        if bodies.iter().any(|body| !body.track().has_started()) {
            return;
        }
        for &(camera, _) in set.numbered() {
            let of_bodies = || bodies.iter().map(|body| body.log_likelihood_ratio(camera));
            let contribution = &mut self.contributions[camera];
            contribution.frames += 1;
            contribution.seen_frames += usize::from(of_bodies().all(|nats| nats > SEEN_NATS));
            contribution.log_likelihood_ratio += of_bodies().sum::<f64>();
        }
    }
}
