//! Clocks of free-running cameras: the constant time between them, from a moving target that they saw.
//!
//! The target's path is a cubic B-spline in time; it is fitted to where all cameras saw the target, together with what must be added to each camera's
//! time stamps (continuous-time calibration, Furgale et al. 2013). A search for the offsets under which the cameras' rays meet best comes first, so that no
//! guess is needed; a robust fit then chooses among the blobs of each image; least squares on those gives the offsets and their standard deviations.

mod path;
mod search;
mod selection;

use nalgebra::Vector3;

use super::least_squares::{Loss, covariance, minimise};
use super::{OUTLIER_SIGMAS, Refusal, check, rms};
use pardalis::detect::Blob;
use pardalis::shape::Shape;
use pardalis::view::View;
use path::{Path, PathFit, Seen};
use search::{RayTrack, meeting_points, pair_offset};
use selection::candidates;

/// Where a camera saw blobs of the target's colours.
#[derive(Debug, Clone, PartialEq)]
pub struct SightedFrame {
    /// The camera's time stamp, in seconds.
    pub time_s: f64,
    /// The blobs, as [`blobs`](pardalis::detect::blobs) gives them; one or none of them is the target.
    pub blobs: Vec<Blob>,
}

/// One camera and what it saw.
#[derive(Debug, Clone)]
pub struct ClockCamera<'a> {
    /// Its name, for people.
    pub name: &'a str,
    /// Where it stands and how it projects.
    pub view: &'a View,
    /// Its frames, in the order of time.
    pub frames: Vec<SightedFrame>,
}

/// Where a camera saw the target, and what the fit makes of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClockSighting {
    /// The camera's time stamp, in seconds.
    pub time_s: f64,
    /// Where the middle of the target was seen.
    pub pixel: [f64; 2],
    /// Observed minus fitted pixel with the clocks as they are; `None` where the path is not seen, or not known.
    pub before_px: Option<[f64; 2]>,
    /// Observed minus fitted pixel with the clocks corrected.
    pub after_px: Option<[f64; 2]>,
    /// Whether it was left out.
    pub outlier: bool,
}

/// What is known of one camera's clock.
#[derive(Debug, Clone, PartialEq)]
pub struct ClockFit {
    /// What must be added to the camera's time stamps to give the first camera's time, in seconds.
    pub offset_s: f64,
    /// Its standard deviation, from the scatter of the residuals; 0 for the first camera.
    pub sigma_s: f64,
    /// Where it saw the target, in the order of time.
    pub sightings: Vec<ClockSighting>,
    /// Root mean square residual with the clocks as they are, without outliers; `None` where the cameras then have no common time.
    pub rms_before_px: Option<f64>,
    /// Root mean square residual with the clocks corrected, without outliers.
    pub rms_after_px: f64,
}

/// The largest offset that can be searched for, in seconds.
pub const MAX_CLOCK_OFFSET_S: f64 = 10.0;

/// Cameras must see the target in so many frames.
const LEAST_SIGHTINGS: usize = 12;

/// Control points of the path for each frame of the second fastest camera.
const CONTROLS_PER_FRAME: f64 = 0.5;

/// What the path's curvature costs, as a share of what it moves in the images.
const STIFFNESS: f64 = 1e-3;

/// From frame to frame, the target's images must move by this many times their noise ...
const LEAST_MOTION: f64 = 2.0;
/// ... on average over so many frames.
const MOTION_FRAMES: usize = 5;

/// How often the correlation of residuals is measured and taken into account.
const CORRELATION_ROUNDS: usize = 4;

/// The offsets of the cameras' clocks against the first camera's, one a camera. Offsets of up to `max_offset_s` (positive, up to
/// [`MAX_CLOCK_OFFSET_S`]) either way are found.
///
/// The shape corrects for what the middle of the target's image is off from the image of its middle. Refused: fewer than two cameras that see the
/// target, one that hardly moves, cameras that never see it together, offsets at the border of what is searched.
pub fn estimate_clocks(
    cameras: &[ClockCamera],
    shape: &Shape,
    max_offset_s: f64,
) -> Result<Vec<ClockFit>, Refusal> {
    if !(max_offset_s > 0.0 && max_offset_s <= MAX_CLOCK_OFFSET_S) {
        return Err(Refusal::new(
            format!("the largest offset to search for is {max_offset_s} s"),
            format!("give more than 0 and at most {MAX_CLOCK_OFFSET_S} s"),
        ));
    }
    if cameras.len() < 2 {
        return Err(Refusal::new(
            "there is one camera only, and clocks are compared",
            "give two or more cameras that see the target at the same times",
        ));
    }
    let candidates: Vec<Vec<SightedFrame>> = cameras.iter().map(candidates).collect();
    check_seen(cameras, &candidates)?;
    let clocks = Clocks {
        cameras,
        views: cameras.iter().map(|camera| camera.view).collect(),
        intervals_s: cameras.iter().map(usual_interval_s).collect(),
        shape,
        candidates,
    };
    clocks.fit(max_offset_s)
}

/// The usual time between two frames of a camera, in seconds.
fn usual_interval_s(camera: &ClockCamera) -> f64 {
    let pairs = camera.frames.windows(2);
    let mut steps: Vec<f64> = pairs
        .map(|pair| pair[1].time_s - pair[0].time_s)
        .filter(|step_s| *step_s > 0.0)
        .collect();
    median(&mut steps).unwrap_or(1.0)
}

/// The value in the middle, or nothing where there are none.
fn median(values: &mut [f64]) -> Option<f64> {
    if values.is_empty() {
        return None;
    }
    let middle = values.len() / 2;
    Some(*values.select_nth_unstable_by(middle, f64::total_cmp).1)
}

/// All cameras must see something that may be the target.
fn check_seen(cameras: &[ClockCamera], candidates: &[Vec<SightedFrame>]) -> Result<(), Refusal> {
    let sees = |frames: &[SightedFrame]| frames.iter().filter(|f| !f.blobs.is_empty()).count();
    let seeing = candidates.iter().filter(|c| sees(c) >= LEAST_SIGHTINGS);
    let only_one = if seeing.count() < 2 {
        ": at most one camera sees the target"
    } else {
        ""
    };
    for (camera, frames) in cameras.iter().zip(candidates) {
        let count = sees(frames);
        if count < LEAST_SIGHTINGS {
            return Err(Refusal::new(
                format!(
                    "{} sees something that moves in the target's colours, whole and clear of the border, in {count} of its {} frames{only_one}",
                    camera.name,
                    frames.len()
                ),
                format!(
                    "move the target to and fro in view of all cameras (at least {LEAST_SIGHTINGS} frames each), learn its colours anew in this light, or leave the camera out"
                ),
            ));
        }
    }
    Ok(())
}

/// All that a fit needs to know.
struct Clocks<'a> {
    cameras: &'a [ClockCamera<'a>],
    views: Vec<&'a View>,
    intervals_s: Vec<f64>,
    shape: &'a Shape,
    /// Of each camera, in the order of time.
    candidates: Vec<Vec<SightedFrame>>,
}

impl Clocks<'_> {
    fn fit(&self, max_offset_s: f64) -> Result<Vec<ClockFit>, Refusal> {
        let largest = self.largest_blobs();
        let rough_s = self.rough_offsets(&largest, max_offset_s)?;
        let seen = self.liveliest(largest, &rough_s);
        let robust = self
            .path_fit(&seen, &rough_s, true)
            .ok_or_else(never_together)?;
        let (robust, _) = minimise(robust, Loss::Cauchy(10.0), 30);
        let (robust, _) = minimise(robust, Loss::Cauchy(2.0), 60);
        // What the target's outline says of the blobs is known only where it is.
        let (path, offsets_s) = (robust.path.clone(), robust.offsets_s.clone());
        let seen = self.shared(&self.matched(&path, &offsets_s), &offsets_s);
        let robust = self
            .path_fit(&seen, &offsets_s, true)
            .ok_or_else(never_together)?;
        let (robust, _) = minimise(robust, Loss::Cauchy(2.0), 60);
        let residuals: Vec<_> = seen.iter().map(|s| robust.residual_px(s)).collect();
        let inlier = check::inliers(&residuals, OUTLIER_SIGMAS);
        self.check_agreement(&seen, &inlier)?;
        let pairs = seen.iter().zip(&inlier);
        let used: Vec<Seen> = pairs.filter(|(_, used)| **used).map(|(s, _)| *s).collect();
        let start = PathFit {
            seen: &used,
            ..robust
        };
        let fitted = refined(start);
        self.check_motion(&fitted)?;
        let sigmas_s = self.sigmas(&fitted)?;
        self.check_border(&fitted.offsets_s, max_offset_s)?;
        let zero = vec![0.0; self.cameras.len()];
        let before = self
            .path_fit(&used, &zero, false)
            .map(|start| minimise(start, Loss::Squares, 60).0);
        let clock = |camera: usize| {
            let own = seen.iter().zip(&inlier);
            let sightings: Vec<ClockSighting> = own
                .filter(|(seen, _)| seen.camera == camera)
                .map(|(seen, used)| ClockSighting {
                    time_s: seen.time_s,
                    pixel: seen.pixel,
                    before_px: before.as_ref().and_then(|fit| fit.residual_px(seen)),
                    after_px: fitted.residual_px(seen),
                    outlier: !used,
                })
                .collect();
            let kept = sightings.iter().filter(|s| !s.outlier);
            ClockFit {
                offset_s: fitted.offsets_s[camera],
                sigma_s: sigmas_s[camera],
                rms_before_px: before
                    .is_some()
                    .then(|| rms(kept.clone().filter_map(|s| s.before_px))),
                rms_after_px: rms(kept.filter_map(|s| s.after_px)),
                sightings,
            }
        };
        Ok((0..self.cameras.len()).map(clock).collect())
    }

    fn tracks(&self, seen: &[Seen]) -> Vec<RayTrack> {
        let track = |(camera, view): (usize, &&View)| {
            let own = seen.iter().filter(|seen| seen.camera == camera);
            RayTrack::new(view, own, self.intervals_s[camera])
        };
        self.views.iter().enumerate().map(track).collect()
    }

    /// Offsets to within a part of a frame: from the first camera on, always by way of the pair of cameras that has most to say.
    fn rough_offsets(&self, seen: &[Seen], max_offset_s: f64) -> Result<Vec<f64>, Refusal> {
        let tracks = self.tracks(seen);
        let mut known: Vec<Option<f64>> = vec![None; tracks.len()];
        known[0] = Some(0.0);
        let mut pairs = Vec::new();
        let mut newest = 0;
        while known.contains(&None) {
            let newest_s = known[newest].unwrap_or_default();
            for (other, _) in known.iter().enumerate().filter(|(_, o)| o.is_none()) {
                // A little beyond, so that a minimum at the border is told from one within.
                let reach_s = max_offset_s + tracks[other].interval_s;
                let range_s = [-reach_s - newest_s, reach_s - newest_s];
                let pair = pair_offset(&tracks[newest], &tracks[other], range_s);
                pairs.extend(pair.map(|pair| (other, newest_s + pair.offset_s, pair)));
            }
            let open = pairs.iter().filter(|(other, ..)| known[*other].is_none());
            let Some(&(other, offset_s, pair)) = open.max_by(|a, b| a.2.gain.total_cmp(&b.2.gain))
            else {
                let unseen = known.iter().position(Option::is_none).unwrap_or_default();
                return Err(Refusal::new(
                    format!(
                        "{} never sees the target at the same times as the other cameras, whatever its clock's offset up to {max_offset_s} s",
                        self.cameras[unseen].name
                    ),
                    "check that its frames belong to this recording and its time stamps are in seconds, allow larger offsets (max-offset-s), or leave it out",
                ));
            };
            if pair.at_border {
                return Err(self.border(other, max_offset_s));
            }
            known[other] = Some(offset_s);
            newest = other;
        }
        Ok(known.into_iter().flatten().collect())
    }

    fn border(&self, camera: usize, max_offset_s: f64) -> Refusal {
        Refusal::new(
            format!(
                "the best offset of {} lies at the border of the {max_offset_s} s that are searched, or there is none",
                self.cameras[camera].name
            ),
            "allow larger offsets (max-offset-s); where that does not help, check the cameras' poses and move the target more",
        )
    }

    fn check_border(&self, offsets_s: &[f64], max_offset_s: f64) -> Result<(), Refusal> {
        match offsets_s.iter().position(|s| s.abs() > max_offset_s) {
            Some(camera) => Err(self.border(camera, max_offset_s)),
            None => Ok(()),
        }
    }

    /// The time between two control points of the path, in seconds.
    fn control_interval_s(&self) -> f64 {
        // It takes two cameras to see where the target is.
        let mut intervals_s = self.intervals_s.clone();
        intervals_s.sort_by(f64::total_cmp);
        intervals_s[1] / CONTROLS_PER_FRAME
    }

    /// A path near what was seen, ready to be fitted; `None` where rays of several cameras meet nowhere.
    fn path_fit<'s>(
        &'s self,
        seen: &'s [Seen],
        offsets_s: &[f64],
        offsets_are_free: bool,
    ) -> Option<PathFit<'s>> {
        let points = meeting_points(&self.tracks(seen), offsets_s);
        if points.is_empty() {
            return None;
        }
        let times = seen.iter().map(|s| s.time_s + offsets_s[s.camera]);
        let (first_s, last_s) = times.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), t| {
            (a.min(t), b.max(t))
        });
        let interval_s = self.control_interval_s();
        // Room for the offsets to move.
        let margin_s = 2.0 * interval_s;
        let path = Path::near(&points, first_s - margin_s, last_s + margin_s, interval_s);
        let mut scales: Vec<f64> = seen
            .iter()
            .filter_map(|seen| {
                let view = self.views[seen.camera];
                let point = path.position_m(seen.time_s + offsets_s[seen.camera])?;
                let point = view.camera_from_world() * point;
                let jacobian = view.camera().project_with_jacobian(point.into())?;
                Some(Vector3::from(jacobian.by_point[0]).norm())
            })
            .collect();
        Some(PathFit {
            views: &self.views,
            seen,
            path,
            offsets_s: offsets_s.to_vec(),
            offsets_are_free,
            intervals_s: &self.intervals_s,
            correlation: 0.0,
            stiffness: STIFFNESS * median(&mut scales)?,
        })
    }

    /// Every camera must agree with the others in most of what it saw.
    fn check_agreement(&self, seen: &[Seen], inlier: &[bool]) -> Result<(), Refusal> {
        for (number, camera) in self.cameras.iter().enumerate() {
            let own = || seen.iter().zip(inlier).filter(|(s, _)| s.camera == number);
            let agreeing = own().filter(|(_, used)| **used).count();
            let candidates = &self.candidates[number];
            let sightings = candidates.iter().filter(|f| !f.blobs.is_empty()).count();
            if agreeing < LEAST_SIGHTINGS || 2 * agreeing < own().count() {
                return Err(Refusal::new(
                    format!(
                        "{} agrees with the other cameras in {agreeing} of the {sightings} frames in which it sees something in the target's colours",
                        camera.name
                    ),
                    "check its pose, by a grid of the world drawn over its image, and whether there are several things of these colours",
                ));
            }
        }
        Ok(())
    }

    /// Where the target's images hardly move, the path would follow their noise, and the clocks that.
    fn check_motion(&self, fitted: &PathFit) -> Result<(), Refusal> {
        for (number, camera) in self.cameras.iter().enumerate() {
            let own: Vec<&Seen> = fitted.seen.iter().filter(|s| s.camera == number).collect();
            let residuals = own.iter().filter_map(|seen| fitted.residual_px(seen));
            let rms_px = rms(residuals);
            let apart = own.iter().zip(own.iter().skip(MOTION_FRAMES));
            let moved_px = rms(apart.map(|(a, b)| {
                let frames = (b.time_s - a.time_s) / self.intervals_s[number];
                [0, 1].map(|i| (b.pixel[i] - a.pixel[i]) / frames)
            }));
            if moved_px < LEAST_MOTION * rms_px {
                return Err(Refusal::new(
                    format!(
                        "the target moves too little in the images of {}: {moved_px:.2} px a frame, while {rms_px:.2} px are noise",
                        camera.name
                    ),
                    "move the target faster, to and fro",
                ));
            }
        }
        Ok(())
    }

    /// The standard deviation of each camera's offset.
    fn sigmas(&self, fitted: &PathFit) -> Result<Vec<f64>, Refusal> {
        let path_unknowns = fitted.path_unknowns();
        let offsets = self.cameras.len() - 1;
        let mut squares = 0.0;
        fitted.visit_seen(&mut |residual, _| {
            squares += residual.map_or(0.0, |[u, v]| u * u + v * v);
        });
        let unknowns = 3 * fitted.controls_seen() + offsets;
        let freedom = (2 * fitted.seen.len()).saturating_sub(unknowns).max(1) as f64;
        let sigma_px = (squares / freedom).sqrt();
        let covariance = covariance(fitted);
        let mut sigmas_s = vec![0.0];
        for camera in 1..=offsets {
            let place = path_unknowns + camera - 1;
            let sigma_s = covariance
                .as_ref()
                .map_or(f64::INFINITY, |c| sigma_px * c[(place, place)].sqrt());
            if !(sigma_s <= 0.25 * self.intervals_s[camera]) {
                return Err(Refusal::new(
                    format!(
                        "what was seen does not tell the clock of {}: its standard deviation would be {:.1} ms",
                        self.cameras[camera].name,
                        1e3 * sigma_s
                    ),
                    "move the target faster, in all directions, for longer, in view of several cameras at once",
                ));
            }
            sigmas_s.push(sigma_s);
        }
        Ok(sigmas_s)
    }
}

/// Least squares, with the correlation of the residuals that comes with it.
fn refined(fit: PathFit) -> PathFit {
    let (mut fitted, _) = minimise(fit, Loss::Squares, 60);
    for _ in 0..CORRELATION_ROUNDS {
        fitted.correlation = fitted.measured_correlation();
        (fitted, _) = minimise(fitted, Loss::Squares, 60);
    }
    fitted
}

fn never_together() -> Refusal {
    Refusal::new(
        "the rays of the cameras meet nowhere",
        "check the cameras' poses, and that they see the target at the same times from different sides and moving: what stands still is taken for scenery",
    )
}
