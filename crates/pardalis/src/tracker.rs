//! Tracking: frames in, estimates out, for any number of cameras and targets.

use crate::color::ColorModel;
use crate::filter::{Filter, FilterSettings, StateEstimate, Update};
use crate::frame::MAX_TIME_S;
use crate::gaussian::{GaussianStart, MAX_START, diagonal_m2};
use crate::likelihood::{CueSettings, Cues};
use crate::rng::Draws;
use crate::shape::Shape;
use crate::simd::Level;
use crate::start::{PixelStart, Start};
use crate::view::View;
use crate::{Error, Frame};

/// What a target is and how it is tracked.
#[derive(Debug, Clone)]
pub struct TargetSettings {
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

/// How long a camera's last word on whether a particle is seen holds, in seconds, while other cameras go on without it.
const WORD_HOLDS_S: f64 = 0.5;

/// A camera's last word on a target.
#[derive(Debug, Clone, Copy)]
struct Word {
    time_s: f64,
    /// Whether any particle was more likely than pure background.
    sees: bool,
}

struct Target {
    shape: Shape,
    cues: Cues,
    start: Start,
    draws: Draws,
    filter: Filter,
    /// Whether it has seen its first frames.
    started: bool,
    /// Where it starts anew with its next frames, and the time in seconds for which that holds.
    handed_over: Option<(GaussianStart, f64)>,
    state: TrackState,
    /// One a camera.
    contributions: Vec<Contribution>,
    words: Vec<Option<Word>>,
}

/// Tracks targets through cameras.
pub struct Tracker {
    views: Vec<View>,
    targets: Vec<Target>,
    time_s: Option<f64>,
}

impl Tracker {
    /// A tracker of these targets through these cameras. The same seed and frames give the same estimates, whatever the number of threads.
    pub fn new(
        views: Vec<View>,
        targets: Vec<TargetSettings>,
        seed: u32,
        level: Level,
    ) -> Result<Self, Error> {
        let targets = targets
            .into_iter()
            .enumerate()
            .map(|(number, settings)| {
                let draws = Draws::new(seed, number as u32);
                let start = match &settings.start {
                    Start::Gaussian(start) => *start,
                    Start::Pixel(start) => {
                        check_pixel(start, &views)?;
                        // Known with the first frame; until then the particles lie at the origin.
                        GaussianStart::default()
                    }
                };
                Ok(Target {
                    shape: settings.shape,
                    cues: Cues::new(
                        &settings.cues,
                        settings.shape,
                        settings.colors.as_ref(),
                        level,
                    )?,
                    filter: Filter::new(settings.filter, &start, draws, level)?,
                    start: settings.start,
                    draws,
                    started: false,
                    handed_over: None,
                    state: TrackState::Searching,
                    contributions: vec![Contribution::default(); views.len()],
                    words: vec![None; views.len()],
                })
            })
            .collect::<Result<_, Error>>()?;
        Ok(Self {
            views,
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

    /// Where a target starts.
    pub fn start(&self, target: usize) -> &Start {
        &self.targets[target].start
    }

    /// The time of the last frames, in seconds.
    pub fn time_s(&self) -> Option<f64> {
        self.time_s
    }

    /// The filter of a target, once it has started.
    pub fn filter(&self, target: usize) -> Option<&Filter> {
        let target = &self.targets[target];
        target.started.then_some(&target.filter)
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
        for target in &mut self.targets {
            target.observe(&self.views, frames, time_s, dt_s);
        }
        self.time_s = Some(time_s);
        Ok(Observed::Used)
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
        let Some(found) = self.targets.get_mut(target) else {
            let allowed = format!("the number of a target, below {count}");
            return Err(Error::out_of_range("target", target, &allowed));
        };
        found.handed_over = Some((*start, time_s));
        Ok(())
    }

    /// Locates every target in the frames of one instant, each with its camera's number, by these frames alone: no time passes, velocities
    /// play no role (thesis 6.1.3). The particles are drawn around the start's mean, then around the mean of what the frames make of them, and so
    /// on, once for each standard deviation of `passes_sigma_m` (metres), such as [`PASSES_SIGMA_M`]. A start in a pixel is first searched for
    /// along its ray. There is one start a target.
    ///
    /// What is found holds until the next frames, also for [`Tracker::filter`]; where no particle is more likely than background, nothing is.
    /// Fails on an image whose size is not its camera's and on faulty starts or passes; nothing has changed then.
    pub fn locate(
        &mut self,
        frames: &[(usize, Frame)],
        time_s: f64,
        starts: &[Start],
        passes_sigma_m: &[f64],
    ) -> Result<Vec<Estimate>, Error> {
        if starts.len() != self.targets.len() {
            let allowed = format!("{}, one a target", self.targets.len());
            return Err(Error::out_of_range("starts", starts.len(), &allowed));
        }
        for start in starts {
            match start {
                Start::Gaussian(start) => start.check()?,
                Start::Pixel(start) => check_pixel(start, &self.views)?,
            }
        }
        check_passes(passes_sigma_m)?;
        self.prepare(frames)?;
        self.time_s = Some(time_s);
        let located = |(target, start): (&mut Target, &Start)| {
            let kinematics = target.locate(&self.views, frames, time_s, start, passes_sigma_m);
            Estimate {
                state: target.state,
                kinematics,
                confidence: kinematics.map_or(0.0, |k| target.confidence(&k)),
            }
        };
        Ok(self.targets.iter_mut().zip(starts).map(located).collect())
    }

    /// Makes sure that the frames can be looked up for every target.
    fn prepare(&mut self, frames: &[(usize, Frame)]) -> Result<(), Error> {
        for (camera, frame) in frames {
            self.views[*camera].check(frame)?;
        }
        for (camera, frame) in frames {
            for target in &self.targets {
                target.cues.prepare(&mut self.views[*camera], frame);
            }
        }
        Ok(())
    }

    /// What is known of a target at this time, at or after the last frames; nothing changes.
    pub fn estimate_at(&self, target: usize, time_s: f64) -> Estimate {
        let target = &self.targets[target];
        let state = target.state;
        let ahead_s = self.time_s.map_or(0.0, |before| time_s - before);
        match state {
            TrackState::Tracking | TrackState::Occluded => {
                let kinematics = target.filter.estimate(ahead_s);
                Estimate {
                    state,
                    kinematics: Some(kinematics),
                    confidence: target.confidence(&kinematics),
                }
            }
            TrackState::Searching | TrackState::Lost => Estimate {
                state,
                kinematics: None,
                confidence: 0.0,
            },
        }
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
    /// One step: predict, or start with the first frames, then weigh.
    fn observe(&mut self, views: &[View], frames: &[(usize, Frame)], time_s: f64, dt_s: f64) {
        if let Some((start, since_s)) = self.handed_over.take() {
            self.filter.start_over(&start);
            if time_s > since_s {
                self.filter.predict(time_s - since_s);
            }
        } else if self.started {
            self.filter.predict(dt_s);
        } else if let Start::Pixel(start) = self.start {
            let Some(found) = self.search(views, frames, &start) else {
                return;
            };
            self.filter.restart(&found);
        }
        self.weigh(views, frames, time_s);
        self.count_contributions(frames);
    }

    /// Looks along the ray of a pixel; nothing where its camera has no frame yet.
    fn search(
        &mut self,
        views: &[View],
        frames: &[(usize, Frame)],
        start: &PixelStart,
    ) -> Option<GaussianStart> {
        frames.iter().find(|(camera, _)| *camera == start.camera)?;
        Some(start.search(
            &views[start.camera],
            &mut self.cues.of(views, frames),
            self.filter.motion().is_planar(),
            self.draws,
            self.filter.observation(),
        ))
    }

    /// Weighs the particles by the frames and says what that tells.
    fn weigh(&mut self, views: &[View], frames: &[(usize, Frame)], time_s: f64) {
        self.started = true;
        let update = self.filter.update(&mut self.cues.of(views, frames));
        for &(camera, _) in frames {
            let of_camera = self.cues.log_likelihoods_of(camera);
            let best = of_camera.iter().copied().fold(f32::NEG_INFINITY, f32::max);
            let background = self.cues.background_log_likelihood(camera);
            self.words[camera] = Some(Word {
                time_s,
                sees: f64::from(best) > background + 1e-3,
            });
        }
        let sees = |word: &Word| word.sees && time_s - word.time_s <= WORD_HOLDS_S;
        self.state = match update {
            Update::AllImpossible => TrackState::Lost,
            Update::Weighted if self.words.iter().flatten().any(sees) => TrackState::Tracking,
            Update::Weighted => TrackState::Occluded,
        };
    }

    /// Adds up what each camera told, once the particles are weighed.
    fn count_contributions(&mut self, frames: &[(usize, Frame)]) {
        for &(camera, _) in frames {
            let of_camera = self.cues.log_likelihoods_of(camera);
            let background = self.cues.background_log_likelihood(camera);
            let evidence_nats: f64 = of_camera
                .iter()
                .zip(self.filter.weights())
                // Impossible particles have no weight.
                .filter(|&(_, &weight)| weight > 0.0)
                .map(|(&log, weight)| weight * (f64::from(log) - background))
                .sum();
            let contribution = &mut self.contributions[camera];
            contribution.frames += 1;
            contribution.seen_frames += usize::from(evidence_nats > SEEN_NATS);
            contribution.evidence_nats += evidence_nats;
        }
    }

    /// Where these frames alone say that it is; nothing where they do not show it.
    fn locate(
        &mut self,
        views: &[View],
        frames: &[(usize, Frame)],
        time_s: f64,
        start: &Start,
        passes_sigma_m: &[f64],
    ) -> Option<StateEstimate> {
        self.words.fill(None);
        self.state = TrackState::Searching;
        let mut around_m = match start {
            Start::Gaussian(start) => start.position_m,
            Start::Pixel(start) => self.search(views, frames, start)?.position_m,
        };
        let mut found = None;
        for &sigma_m in passes_sigma_m {
            self.filter.start_over(&GaussianStart {
                position_m: around_m,
                covariance_m2: diagonal_m2([sigma_m; 3]),
                ..GaussianStart::default()
            });
            self.weigh(views, frames, time_s);
            if self.state != TrackState::Tracking {
                return None;
            }
            let estimate = self.filter.estimate(0.0);
            around_m = estimate.position_m;
            found = Some(estimate);
        }
        found.map(|estimate| StateEstimate {
            velocity_mps: None,
            ..estimate
        })
    }

    /// The filter's own belief that the target is where it is estimated.
    fn confidence(&self, estimate: &StateEstimate) -> f64 {
        let diameter_m = self.shape.diameter_m();
        self.filter.weight_within(estimate.position_m, diameter_m)
    }
}
