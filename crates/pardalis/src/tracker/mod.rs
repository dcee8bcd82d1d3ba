//! Tracking: frames in, estimates out, for any number of cameras and targets.

mod body;
mod follower;
mod groups;
mod landmarks;
mod seeker;

pub use seeker::{ExistenceSettings, OcclusionRates};

use std::ops::Range;

use follower::Follower;
use groups::{apart, groups};
use seeker::Seeker;

use crate::Frame;
use crate::color::ColorModel;
use crate::frame::MAX_TIME_S;
use crate::likelihood::CueSettings;
use crate::shape::Shape;
use crate::start::{PixelStart, Start};
use crate::view::View;
use pardalis_core::Error;
use pardalis_core::rng::Draws;
use pardalis_core::simd::Level;
use pardalis_filter::Particles;
use pardalis_filter::estimate::StateEstimate;
use pardalis_filter::gaussian::{GaussianStart, MAX_START};
use pardalis_filter::particle_filter::FilterSettings;

/// What a target is and how it is tracked: a body, or several landmarks of one, each of which is tracked on its own (Campos 2009, section 4).
#[derive(Debug, Clone)]
pub struct TargetSettings {
    /// The body or the landmarks; their middle is the target's position.
    pub bodies: Vec<BodySettings>,
    /// The numbers of the landmarks in front and behind, where the target has a heading.
    pub heading: Option<[usize; 2]>,
}

impl From<BodySettings> for TargetSettings {
    fn from(body: BodySettings) -> Self {
        Self {
            bodies: vec![body],
            heading: None,
        }
    }
}

/// What a body or landmark is and how it is tracked.
#[derive(Debug, Clone)]
pub struct BodySettings {
    /// Its shape.
    pub shape: Shape,
    /// Its colours; cues that know theirs do without.
    pub colors: Option<ColorModel>,
    /// How it is compared with the images: one cue or several.
    pub cues: Vec<CueSettings>,
    /// Its filter.
    pub filter: FilterSettings,
    /// Where its particles start.
    pub start: Start,
    /// How it comes, goes and hides, where it is sought by the edge cue.
    pub existence: ExistenceSettings,
}

/// What the tracker knows of a target's whereabouts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TrackState {
    /// Not started yet.
    Searching,
    /// Seen by a camera at least.
    Tracking,
    /// In no camera's last frame is any particle more likely than pure background (out of view or masked, say): the motion model alone
    /// carries the estimate.
    Occluded,
    /// Every particle is impossible: there is no estimate.
    Lost,
}

impl TrackState {
    /// All there are.
    pub const ALL: [Self; 4] = [Self::Searching, Self::Tracking, Self::Occluded, Self::Lost];

    /// The word for it in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Searching => "searching",
            Self::Tracking => "tracking",
            Self::Occluded => "occluded",
            Self::Lost => "lost",
        }
    }
}

/// What is known of one target at one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    /// Whether there is a state.
    pub state: TrackState,
    /// Position, velocity, covariance; only while tracking or occluded.
    pub kinematics: Option<StateEstimate>,
    /// From the rear landmark to the front one, counterclockwise from x, in radians within ±π, where the target has such.
    pub heading_rad: Option<f64>,
    /// While there is a state: the share of the particles' weight within one diameter of the position, the filter's own belief
    /// that the target is there.
    pub confidence: f64,
}

/// What became of the frames of one instant.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Observed {
    /// They were used.
    Used,
    /// They have the time stamp of the frames before and tell nothing new: they were not weighed a second time.
    Repeated,
    /// They are older than the frames before and were left out.
    Late,
}

/// What one camera told of one target so far.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Contribution {
    /// Frames that were weighed.
    pub frames: usize,
    /// Frames that showed the target where the filter, after them, believes it to be: their evidence was above [`SEEN_NATS`].
    pub seen_frames: usize,
    /// The evidence of all frames added up: how many nats more likely each frame was, in the mean over the posterior, than pure background.
    pub evidence_nats: f64,
}

/// Evidence, in nats, above which a camera's frame counts as showing the target.
pub const SEEN_NATS: f64 = 1.0;

/// Random numbers of landmarks are told apart by the bits above these of their target's number.
const LANDMARK_BITS: u32 = 16;

struct Target {
    /// Its one body, or its landmarks: their numbers among all.
    bodies: Range<usize>,
    /// Its front and its rear landmark.
    heading: Option<[usize; 2]>,
    /// One a camera.
    contributions: Vec<Contribution>,
}

/// Tracks targets through cameras.
pub struct Tracker {
    views: Vec<View>,
    /// Of all targets.
    bodies: Vec<Follower>,
    targets: Vec<Target>,
    /// The numbers of all bodies, those together that look the same.
    groups: Vec<Vec<usize>>,
    time_s: Option<f64>,
}

impl Tracker {
    /// A tracker of these targets through these cameras. The same seed and frames give the same estimates, whatever the number of threads.
    pub fn new(
        views: Vec<View>,
        targets: impl IntoIterator<Item = impl Into<TargetSettings>>,
        seed: u32,
        level: Level,
    ) -> Result<Self, Error> {
        let mut bodies: Vec<Follower> = Vec::new();
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
                bodies.push(Follower::new(body, draws, &views, level)?);
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

    /// Where each body of a target starts.
    pub fn starts(&self, target: usize) -> impl Iterator<Item = &Start> {
        self.bodies_of(target).iter().map(Follower::start)
    }

    /// The time of the last frames, in seconds.
    pub fn time_s(&self) -> Option<f64> {
        self.time_s
    }

    /// The particles of a target's bodies that have started.
    pub fn particles(&self, target: usize) -> impl Iterator<Item = &Particles> {
        let bodies = self.bodies_of(target).iter();
        bodies
            .filter(|body| body.started())
            .map(Follower::particles)
    }

    /// What each camera told of a target so far.
    pub fn contributions(&self, target: usize) -> &[Contribution] {
        &self.targets[target].contributions
    }

    /// Takes the frames of one instant, each with its camera's number; without frames, time passes and no more. Fails only on an image whose size is not its camera's; nothing
    /// has changed then.
    pub fn observe(&mut self, frames: &[(usize, Frame)], time_s: f64) -> Result<Observed, Error> {
        let dt_s = self.time_s.map_or(0.0, |before| time_s - before);
        if dt_s < 0.0 {
            return Ok(Observed::Late);
        }
        if self.time_s.is_some() && dt_s == 0.0 {
            return Ok(Observed::Repeated);
        }
        self.prepare(frames)?;
        for group in 0..self.groups.len() {
            self.step(group, frames, (time_s, dt_s));
        }
        for target in &mut self.targets {
            target.note(&self.bodies[target.bodies.clone()], frames);
        }
        if self.bodies.iter().any(Follower::compares_frames) {
            for (camera, frame) in frames {
                self.views[*camera].keep(frame.clone());
            }
        }
        self.time_s = Some(time_s);
        Ok(Observed::Used)
    }

    /// One step of bodies that look the same: those of whom more is known first, so that others look for what these leave.
    fn step(&mut self, group: usize, frames: &[(usize, Frame)], (time_s, dt_s): (f64, f64)) {
        let order = &mut self.groups[group];
        for &number in &*order {
            self.bodies[number].predict(time_s, dt_s);
        }
        let belief = |number: usize| self.bodies[number].seeker().map_or(0.0, Seeker::belief);
        order.sort_by(|&a, &b| belief(b).total_cmp(&belief(a)).then(a.cmp(&b)));
        for &number in &*order {
            let (body, others) = apart(&mut self.bodies, number);
            let target = self.targets.iter().find(|t| t.bodies.contains(&number));
            let landmarks = target.into_iter().flat_map(|target| target.bodies.clone());
            body.know_others(landmarks.filter_map(|number| others.get(number)?.place_m()));
            let alike = others.alike(order);
            body.observe(&self.views, frames, (time_s, dt_s), &alike);
        }
    }

    /// Starts a target anew with its next frames, whatever becomes of it until then: from another robot's estimate, say
    /// ([`GaussianStart::from_estimate`], [`GaussianStart::moved`]). `time_s` is the time of that estimate; what has passed since then is predicted.
    pub fn hand_over(
        &mut self,
        target: usize,
        start: &GaussianStart,
        time_s: f64,
    ) -> Result<(), Error> {
        start.check()?;
        if !(time_s.abs() <= MAX_TIME_S) {
            return Err(Error::out_of_range("time_s", time_s, "-1e12 to 1e12"));
        }
        let count = self.targets.len();
        let Some(found) = self.targets.get(target) else {
            let allowed = format!("the number of a target, below {count}");
            return Err(Error::out_of_range("target", target, &allowed));
        };
        let [body] = &mut self.bodies[found.bodies.clone()] else {
            let allowed =
                "a target of one body; where its landmarks are, its position does not say";
            return Err(Error::out_of_range("target", target, allowed));
        };
        body.hand_over(start, time_s);
        Ok(())
    }

    /// Locates every target in the frames of one instant, each with its camera's number, by these frames alone: no time passes, velocities
    /// play no role (thesis 6.1.3). The particles are drawn around the start's mean, then around the mean of what the frames make of them, and so
    /// on, once for each standard deviation of `passes_sigma_m` (metres), such as [`PASSES_SIGMA_M`]. A start in a pixel is first searched for
    /// along its ray. There is one start a body: target by target, and landmark by landmark.
    ///
    /// What is found holds until the next frames, also for [`Tracker::particles`]; where no particle is more likely than background, nothing is.
    /// Fails on an image whose size is not its camera's and on faulty starts or passes; nothing has changed then.
    pub fn locate(
        &mut self,
        frames: &[(usize, Frame)],
        time_s: f64,
        starts: &[Start],
        passes_sigma_m: &[f64],
    ) -> Result<Vec<Estimate>, Error> {
        let count = self.bodies.len();
        if starts.len() != count {
            let allowed = format!("{count}, one a body");
            return Err(Error::out_of_range("starts", starts.len(), &allowed));
        }
        for start in starts {
            match start {
                Start::Gaussian(start) => start.check()?,
                Start::Pixel(start) => check_pixel(start, &self.views)?,
                Start::Anywhere => {}
            }
        }
        check_passes(passes_sigma_m)?;
        self.prepare(frames)?;
        self.time_s = Some(time_s);
        self.bodies.iter_mut().for_each(Follower::forget);
        for group in &mut self.groups {
            group.sort_unstable();
        }
        let mut located = Vec::new();
        for (number, start) in starts.iter().enumerate() {
            let (body, others) = apart(&mut self.bodies, number);
            let group = self.groups.iter().find(|group| group.contains(&number));
            let alike = others.alike(group.expect("every body is of a group"));
            let start = (start, passes_sigma_m);
            located.push(body.locate(&self.views, frames, time_s, start, &alike));
        }
        let estimate = |target: &Target| {
            let of_bodies = located[target.bodies.clone()].iter();
            landmarks::combined(of_bodies.copied(), target.heading)
        };
        Ok(self.targets.iter().map(estimate).collect())
    }

    fn bodies_of(&self, target: usize) -> &[Follower] {
        &self.bodies[self.targets[target].bodies.clone()]
    }

    /// Makes sure that the frames can be looked up for every target.
    fn prepare(&mut self, frames: &[(usize, Frame)]) -> Result<(), Error> {
        for (camera, frame) in frames {
            self.views[*camera].check(frame)?;
        }
        for (camera, frame) in frames {
            for body in &self.bodies {
                body.prepare(&mut self.views[*camera], frame);
            }
        }
        Ok(())
    }

    /// What is known of a target at this time, at or after the last frames; nothing changes.
    pub fn estimate_at(&self, target: usize, time_s: f64) -> Estimate {
        let heading = self.targets[target].heading;
        landmarks::combined(self.estimates(target, time_s), heading)
    }

    /// The same of each of its bodies.
    pub fn bodies_at(&self, target: usize, time_s: f64) -> Vec<Estimate> {
        self.estimates(target, time_s).collect()
    }

    fn estimates(&self, target: usize, time_s: f64) -> impl ExactSizeIterator<Item = Estimate> {
        let ahead_s = self.time_s.map_or(0.0, |before| time_s - before);
        let bodies = self.bodies_of(target).iter();
        bodies.map(move |body| body.estimate(ahead_s))
    }
}

/// The standard deviations around the start, in metres, of the three passes with which single images were published (thesis 6.1.3).
pub const PASSES_SIGMA_M: [f64; 3] = [0.1, 0.07, 0.04];

/// Refuses standard deviations that [`Tracker::locate`] cannot draw by.
pub fn check_passes(passes_sigma_m: &[f64]) -> Result<(), Error> {
    let allowed = "one or more numbers of metres, above 0 and at most 1e6";
    let fine = |sigma: &f64| *sigma > 0.0 && *sigma <= MAX_START;
    if !passes_sigma_m.is_empty() && passes_sigma_m.iter().all(fine) {
        return Ok(());
    }
    let value = format!("{passes_sigma_m:?}");
    Err(Error::out_of_range("passes_sigma_m", value, allowed))
}

/// Refuses a start that is no pixel of these cameras.
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
    /// Notes what each camera told of its bodies.
    fn note(&mut self, bodies: &[Follower], frames: &[(usize, Frame)]) {
        if bodies.iter().any(|body| !body.started()) {
            return;
        }
        for &(camera, _) in frames {
            let of_bodies = || bodies.iter().map(|body| body.evidence_nats(camera));
            let contribution = &mut self.contributions[camera];
            contribution.frames += 1;
            contribution.seen_frames += usize::from(of_bodies().all(|nats| nats > SEEN_NATS));
            contribution.evidence_nats += of_bodies().sum::<f64>();
        }
    }
}
