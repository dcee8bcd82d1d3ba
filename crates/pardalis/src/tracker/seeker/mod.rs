//! A body that is found, followed, lost and found again by what the images say of it: sightings by the edge cue, cameras that see it or not, and a
//! Bernoulli filter for where it is and whether it is there at all.

mod alike;
mod evidence;
mod existence;
mod learning;
mod places;
mod sight;

pub(super) use alike::Alike;
pub use existence::ExistenceSettings;
pub use sight::OcclusionRates;

use nalgebra::{Matrix3, Vector3};

use super::{BodySettings, Estimate, TrackState};
use crate::Frame;
use crate::color::{ColorModel, IlluminationCorrection, PixelKind};
use crate::detect::{COARSE_PX, likeness};
use crate::likelihood::edge::{Around, EdgeCue, EdgeSettings, Look, Sighting};
use crate::shape::Shape;
use crate::start::Start;
use crate::view::View;
use learning::Lighting;
use pardalis_core::Error;
use pardalis_core::rng::Draws;
use pardalis_core::simd::Level;
use pardalis_filter::Particles;
use pardalis_filter::bernoulli::{BernoulliFilter, BernoulliSettings};
use pardalis_filter::estimate::StateEstimate;
use pardalis_filter::gaussian::GaussianStart;
use places::Wanted;
use sight::Sight;

/// Targets appear anywhere in a cube of so many diameters a side.
const BIRTH_DIAMETERS: f64 = 50.0;
/// Standard deviation of the speeds at which targets appear, in m/s on each axis.
const BIRTH_VELOCITY_SIGMA_MPS: f64 = 1.5;
/// ln of the likelihood ratio of a frame in which a target is nowhere near any sighting, though nothing hides it: how often the colours of a target that is
/// there are not recognised.
const MISSED: f32 = -7.0;
/// Before the first frames a target may have appeared for so long, in seconds.
const BEFORE_S: f64 = 2.0;
/// Sightings a frame at most.
const MAX_SIGHTINGS: usize = 6;
/// Sightings below this log ratio are none: any other outline would do as well.
const LEAST_LOG_RATIO: f64 = 0.5;
/// Sightings closer than this, in diameters, are one.
const SAME_DIAMETERS: f64 = 0.25;
/// Frames between looks at whole images while all is well.
const CALM_FRAMES: u32 = 10;
/// A sighting of the predicted target above this log ratio needs no search.
const SURE_LOG_RATIO: f64 = 12.0;
/// How long a camera's last word on whether it sees the target holds while other cameras go on without it, in seconds.
const WORD_HOLDS_S: f64 = 0.5;

/// A target is found from this belief in its place on; how far away it is may be less sure than a diameter.
const NEW_BELIEF: f64 = 0.25;
/// Below this belief in its place, a target is lost.
const LEAST_BELIEF: f64 = 0.01;

/// A body that is sought.
pub(super) struct Seeker {
    shape: Shape,
    colors: ColorModel,
    settings: ExistenceSettings,
    edge: EdgeCue,
    filter: BernoulliFilter,
    pub(super) start: Start,
    /// Whether any frame was looked at.
    pub(super) started: bool,
    pub(super) handed_over: Option<(GaussianStart, f64)>,
    pub(super) state: TrackState,
    is_planar: bool,
    /// 1/m³, or 1/m² on the ground.
    birth_density: f64,
    sights: Vec<Option<Sight>>,
    /// ln of the likelihood ratio of each camera's last frame, one a particle.
    of_cameras: Vec<Vec<f32>>,
    /// What surrounded it when each camera saw it last.
    known_around: Vec<Option<Around>>,
    /// The light in which each camera sees it.
    lighting: Vec<Lighting>,
    /// Frames since whole images were searched.
    calm: u32,
    /// The covariance of the last sighting of it by itself.
    sighting_m2: Option<[f64; 6]>,
    /// Where the other landmarks of its target are known to be, metres.
    pub(super) others_m: Vec<[f64; 3]>,
}

impl Seeker {
    pub(super) fn new(
        settings: &BodySettings,
        edge: EdgeSettings,
        draws: Draws,
        views: &[View],
        level: Level,
    ) -> Result<Self, Error> {
        let colors = settings.colors.clone().ok_or_else(|| Error::Empty {
            what: "the edge cue's colour model".to_owned(),
            remedy: "learn one".to_owned(),
        })?;
        let motion = settings.filter.motion;
        let is_planar = motion.is_planar();
        let extent_m = BIRTH_DIAMETERS * settings.shape.diameter_m();
        let birth_density = libm::pow(extent_m, if is_planar { -2.0 } else { -3.0 });
        let existence = settings.existence;
        let filter = BernoulliFilter::new(
            BernoulliSettings {
                particle_count: settings.filter.particle_count,
                motion,
                birth_rate_hz: existence.birth_rate_hz,
                death_rate_hz: existence.death_rate_hz,
                relocation_rate_hz: existence.relocation_rate_hz,
                birth_density,
                birth_velocity_sigma_mps: BIRTH_VELOCITY_SIGMA_MPS,
                velocity_jump_rate_hz: existence.velocity_jump_rate_hz,
                velocity_jump_sigma_mps: existence.velocity_jump_sigma_mps,
            },
            draws,
        )?;
        Ok(Self {
            shape: settings.shape,
            edge: EdgeCue::new(edge, settings.shape, &colors, level)?,
            colors,
            settings: existence,
            filter,
            start: settings.start,
            started: false,
            handed_over: None,
            state: TrackState::Searching,
            is_planar,
            birth_density,
            sights: vec![None; views.len()],
            of_cameras: vec![Vec::new(); views.len()],
            known_around: vec![None; views.len()],
            lighting: vec![Lighting::default(); views.len()],
            calm: 0,
            sighting_m2: None,
            others_m: Vec::new(),
        })
    }

    /// Makes sure that a frame of the view, of its size, can be looked up.
    pub(super) fn prepare(&self, view: &mut View, frame: &Frame) {
        let kind = PixelKind::of(frame);
        view.prepare(kind, self.edge.palette());
        if let Some(ranges) = self.edge.ranges() {
            view.prepare_ranges(kind, ranges);
        }
    }

    /// The particles.
    pub(super) fn particles(&self) -> &Particles {
        self.filter.particles()
    }

    /// Lets time pass, or starts.
    pub(super) fn predict(&mut self, time_s: f64, dt_s: f64) {
        if let Some((start, since_s)) = self.handed_over.take() {
            self.begin(&start);
            self.filter.predict((time_s - since_s).max(0.0));
        } else if self.started {
            self.filter.predict(dt_s);
        } else if let Start::Gaussian(start) = self.start {
            self.begin(&start);
        } else {
            self.filter.predict(BEFORE_S);
        }
        self.started = true;
    }

    /// Weighs what was predicted by the frames.
    pub(super) fn observe(
        &mut self,
        views: &[View],
        frames: &[(usize, Frame)],
        time_s: f64,
        alike: &Alike,
    ) {
        let likenesses: Vec<(Vec<f64>, IlluminationCorrection)> = frames
            .iter()
            .map(|(camera, frame)| {
                let evidence = views[*camera].evidence(frame);
                let relight = self.lighting[*camera].relight(PixelKind::of(frame));
                let likeness = likeness(&evidence, &self.colors, &relight, COARSE_PX);
                (likeness, relight)
            })
            .collect();
        let colors = (self.edge.palette(), self.edge.ranges());
        let known_around = std::mem::take(&mut self.known_around);
        let mut looks: Vec<Look> = frames
            .iter()
            .zip(&likenesses)
            .map(|((camera, frame), (likeness, relight))| {
                let evidence = views[*camera].evidence(frame);
                Look::new(
                    *camera,
                    evidence,
                    colors,
                    (likeness, *relight),
                    known_around[*camera].as_ref(),
                )
            })
            .collect();
        for place_m in alike.places_m() {
            for look in &mut looks {
                self.edge.show_another(look, place_m);
            }
        }
        let mut sightings = self.sightings(&looks);
        self.update(&looks, &mut sightings, time_s, alike);
        self.conclude(time_s);
        drop(looks);
        self.known_around = known_around;
        self.learn(views, frames, &sightings, time_s);
    }

    /// Knows of no target.
    fn begin_anew(&mut self) {
        let nowhere = GaussianStart::default();
        self.filter
            .start(&nowhere, 0.0)
            .expect("the origin is a place");
    }

    /// Believes in a start.
    fn begin(&mut self, start: &GaussianStart) {
        self.filter
            .start(start, 1.0)
            .expect("starts are checked before");
    }

    /// Where the frames show the target: near where it is predicted, and, where that is wanted, anywhere.
    fn sightings(&mut self, looks: &[Look]) -> Vec<Sighting> {
        let predicted = self.filter.estimate(0.0);
        let predicted = predicted.filter(|_| self.filter.existence() > 0.1);
        let mut sightings = Vec::new();
        if let Some(predicted) = &predicted {
            sightings.extend(self.sighting_near(looks, predicted));
        }
        self.calm += 1;
        let is_sure = sightings
            .first()
            .is_some_and(|found: &Sighting| found.log_ratio > SURE_LOG_RATIO);
        if !is_sure || self.filter.existence() < 0.9 || self.calm >= CALM_FRAMES {
            self.calm = 0;
            let wanted = Wanted {
                shape: self.shape,
                ground_z_m: self.is_planar.then_some(self.settings.ground_z_m),
            };
            for place_m in wanted.places_m(&mut self.edge, looks) {
                let found = self.edge.fit(looks, place_m, None, self.is_planar);
                sightings.extend(found);
            }
        }
        self.told_apart(sightings)
    }

    /// Where the frames show the target near its predicted place.
    fn sighting_near(&mut self, looks: &[Look], predicted: &StateEstimate) -> Option<Sighting> {
        let mean_m = predicted.position_m;
        let information = self.information(predicted.covariance_m2);
        let prior = Some((&Vector3::from(mean_m), &information));
        self.edge.fit(looks, mean_m, prior, self.is_planar)
    }

    /// The inverse of a covariance (xx, xy, xz, yy, yz, zz), no sharper than a hundredth of a diameter.
    fn information(&self, [xx, xy, xz, yy, yz, zz]: [f64; 6]) -> Matrix3<f64> {
        let least = (0.01 * self.shape.diameter_m()).powi(2);
        let covariance = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz)
            + Matrix3::from_diagonal_element(least);
        covariance.try_inverse().unwrap_or_else(Matrix3::zeros)
    }

    /// The likeliest sightings, each place once.
    fn told_apart(&self, mut sightings: Vec<Sighting>) -> Vec<Sighting> {
        sightings.retain(|sighting| sighting.log_ratio > LEAST_LOG_RATIO);
        // A stable sort: of two alike the first stays first.
        sightings.sort_by(|a, b| b.log_ratio.total_cmp(&a.log_ratio));
        let same_m = SAME_DIAMETERS * self.shape.diameter_m();
        let mut kept: Vec<Sighting> = Vec::new();
        for sighting in sightings {
            let here = Vector3::from(sighting.position_m);
            let is_new =
                |other: &Sighting| (here - Vector3::from(other.position_m)).norm() > same_m;
            if kept.len() < MAX_SIGHTINGS && kept.iter().all(is_new) {
                kept.push(sighting);
            }
        }
        kept
    }

    /// Weighs the particles.
    fn update(
        &mut self,
        looks: &[Look],
        sightings: &mut Vec<Sighting>,
        time_s: f64,
        alike: &Alike,
    ) {
        let peaks = self.peaks(sightings, alike);
        let speaks = sightings.iter().map(|sighting| sighting.existence_nats);
        let speaks = speaks.fold(f64::from(MISSED), f64::max);
        let rates = self.settings.occlusion;
        for look in looks {
            let sight = self.sights[look.camera()].get_or_insert(Sight::new(&rates, time_s));
            sight.predict(&rates, time_s);
        }
        let Self {
            edge,
            filter,
            sights,
            of_cameras,
            ..
        } = self;
        // Where a camera does not see it, there may be one all the same: hidden, or out of its image.
        let predicted = filter.estimate(0.0);
        let most_nats = looks.iter().filter_map(|look| {
            let seen = f64::from(sights[look.camera()]?.mixed(speaks as f32));
            let known = predicted.as_ref().map(|known| known.position_m);
            let is_shown = known.is_none_or(|position_m| edge.shows(look, position_m));
            Some(if is_shown { seen } else { seen.max(0.0) })
        });
        let most_nats = most_nats.reduce(f64::max).unwrap_or(f64::INFINITY);
        filter.update(&peaks, most_nats, |particles, out| {
            out.fill(0.0);
            for look in looks {
                let of_camera = &mut of_cameras[look.camera()];
                of_camera.clear();
                of_camera.resize(out.len(), 0.0);
                edge.add_camera(look, sightings, particles.positions_m(), MISSED, of_camera);
                let Some(sight) = &sights[look.camera()] else {
                    continue;
                };
                for (sum, &log_ratio) in out.iter_mut().zip(&*of_camera) {
                    *sum += sight.mixed(log_ratio);
                }
            }
        });
        let known = self.filter.estimate(0.0);
        let near_m = self.shape.diameter_m();
        let is_it = |place_m: [f64; 3]| {
            let here = known.as_ref().map(|known| Vector3::from(known.position_m));
            here.is_some_and(|here| (here - Vector3::from(place_m)).norm() < near_m)
        };
        let peak = peaks.iter().find(|peak| is_it(peak.position_m));
        self.sighting_m2 = peak.map(|peak| peak.covariance_m2);
        let sighting = sightings.iter().find(|s| is_it(s.position_m));
        for look in looks {
            let share = sighting.and_then(|sighting| sighting.seen_share_by(look.camera()));
            self.learn_sight(look.camera(), share.unwrap_or(1.0));
        }
    }

    /// Learns from the particles whether a camera sees the target. What is hidden in part will be hidden, the likelier the more of it is.
    fn learn_sight(&mut self, camera: usize, seen_share: f64) {
        let Some(sight) = &mut self.sights[camera] else {
            return;
        };
        let visible = |(&log_ratio, &weight): (&f32, &f64)| {
            // Of a particle out of the image the frame says nothing.
            let is_shown = log_ratio != 0.0;
            let given = sight.given(log_ratio);
            [weight * given, if is_shown { weight * given } else { 0.0 }]
        };
        let sums = self.of_cameras[camera].iter().zip(self.filter.weights());
        let [given, sees] = sums
            .map(visible)
            .fold([0.0; 2], |[a, b], [c, d]| [a + c, b + d]);
        sight.visible = seen_share * given.clamp(0.0, 1.0);
        sight.sees = sees.clamp(0.0, 1.0);
    }

    /// What all that means.
    fn conclude(&mut self, time_s: f64) {
        let existence = self.filter.existence();
        let is_fresh = |sight: &&Sight| time_s - sight.time_s <= WORD_HOLDS_S;
        let sees = self
            .sights
            .iter()
            .flatten()
            .filter(is_fresh)
            .map(|sight| sight.sees)
            .fold(0.0, f64::max);
        let was_known = matches!(self.state, TrackState::Tracking | TrackState::Occluded);
        let belief = self.belief();
        let least = if was_known { LEAST_BELIEF } else { NEW_BELIEF };
        self.state = if existence >= 0.5 && sees >= 0.5 && belief >= least {
            TrackState::Tracking
        } else if existence >= 0.5 && was_known && belief >= LEAST_BELIEF {
            TrackState::Occluded
        } else if was_known || self.state == TrackState::Lost {
            TrackState::Lost
        } else {
            TrackState::Searching
        };
    }

    /// The probability that the target is there, and within a diameter of the estimate.
    pub(super) fn belief(&self) -> f64 {
        self.belief_ahead(0.0)
    }

    /// The same so many seconds later.
    fn belief_ahead(&self, ahead_s: f64) -> f64 {
        let near = |known: StateEstimate| {
            self.filter
                .weight_within(known.position_m, self.shape.diameter_m())
        };
        let known = self.filter.estimate(ahead_s);
        self.filter.existence() * known.map_or(0.0, near)
    }

    /// As if it had never been seen before.
    pub(super) fn forget(&mut self) {
        self.begin_anew();
        self.started = false;
        self.sights.fill(None);
        self.known_around.fill(None);
        self.lighting.fill(Lighting::default());
        self.state = TrackState::Searching;
        self.handed_over = None;
        self.start = Start::Anywhere;
    }

    /// How many nats more likely than nothing a camera's last frame is, in the mean over the posterior.
    pub(super) fn evidence_nats(&self, camera: usize) -> f64 {
        self.of_cameras[camera]
            .iter()
            .zip(self.filter.weights())
            .filter(|&(_, &weight)| weight > 0.0)
            .map(|(&log_ratio, weight)| weight * f64::from(log_ratio))
            .sum()
    }

    /// What is known so many seconds after the last frames; nothing changes.
    pub(super) fn estimate(&self, ahead_s: f64) -> Estimate {
        let is_known = matches!(self.state, TrackState::Tracking | TrackState::Occluded);
        let mut kinematics = self.filter.estimate(ahead_s).filter(|_| is_known);
        if let (Some(known), Some(sighting_m2)) = (&mut kinematics, self.sighting_m2) {
            // The fewer particles count, the less their scatter tells.
            for (sum, variance) in known.covariance_m2.iter_mut().zip(sighting_m2) {
                *sum += variance / known.effective_sample_size;
            }
        }
        let confidence = if is_known {
            self.belief_ahead(ahead_s)
        } else {
            // That it is in view at all.
            let sees = self.sights.iter().flatten().map(|sight| sight.sees);
            self.filter.existence() * sees.fold(0.0, f64::max)
        };
        Estimate {
            state: self.state,
            kinematics,
            heading_rad: None,
            confidence,
        }
    }
}
