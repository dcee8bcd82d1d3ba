//! Coarse search for time offsets without an initial guess: the offset under which the rays of two cameras
//! meet best.

use nalgebra::{Point3, Vector3};

use super::path::Observation;
use pardalis::view::View;

/// Largest gap to interpolate across, in typical frame intervals.
const MAX_GAP: f64 = 2.5;

/// Search steps per frame interval.
const STEPS_PER_FRAME: f64 = 4.0;

/// Distance in pixels between two rays beyond which their detections increasingly count as unrelated.
const MISS_PX: f64 = 3.0;

/// The same for the logarithm of the size of an object relative to the target's. The target's is rarely known
/// more exactly than to a few percent.
const SIZE_SIGMA: f64 = 0.3;

/// Smallest number of simultaneous detections that two cameras must share.
const MIN_COMMON: usize = 8;

/// Largest number of a camera's frames that are compared; more would not improve the result.
const MAX_COMPARED: usize = 400;

/// A detection's ray in the world.
#[derive(Debug, Clone, Copy)]
pub(crate) struct TimedRay {
    /// The detection; the earlier one of two between which the ray is interpolated.
    pub(crate) observation: Observation,
    /// Time of the camera's clock, in seconds.
    pub(crate) time_s: f64,
    pub(crate) origin_m: Point3<f64>,
    pub(crate) direction: Vector3<f64>,
    /// Distance of the target by its size, in metres.
    pub(crate) distance_m: f64,
    /// Angle between the target's middle and its outline, in radians.
    pub(crate) radius_rad: f64,
}

impl TimedRay {
    /// Interpolates between the rays of two detections.
    fn between(&self, next: &Self, time_s: f64) -> Self {
        let share = (time_s - self.time_s) / (next.time_s - self.time_s);
        let lerp = |a: f64, b: f64| a + share * (b - a);
        let origins_m = [self, next].map(|ray| ray.origin_m.coords);
        Self {
            observation: self.observation,
            time_s,
            origin_m: origins_m[0].lerp(&origins_m[1], share).into(),
            direction: self.direction.lerp(&next.direction, share).normalize(),
            distance_m: lerp(self.distance_m, next.distance_m),
            radius_rad: lerp(self.radius_rad, next.radius_rad),
        }
    }
}

/// Rays of the detections of one camera, frame by frame in order of time.
#[derive(Debug, Clone)]
pub(crate) struct RayTrack {
    pub(crate) frames: Vec<Vec<TimedRay>>,
    /// Median time between two frames, in seconds.
    pub(crate) interval_s: f64,
    /// Angular size of a pixel, in radians.
    pub(crate) rad_per_px: f64,
    is_size_known: bool,
}

impl RayTrack {
    /// Computes the rays of one camera's detections, which are in order of frames.
    pub(crate) fn new<'a>(
        view: &View,
        observations: impl Iterator<Item = &'a Observation>,
        interval_s: f64,
        is_size_known: bool,
    ) -> Self {
        let pose = view.world_from_camera();
        let mut angles = Vec::new();
        let mut frames: Vec<Vec<TimedRay>> = Vec::new();
        let mut latest = None;
        for observation in observations {
            let [u, v] = observation.pixel;
            let rays = [[u, v], [u + 1.0, v]].map(|pixel| view.camera().unproject(pixel));
            let [Some(ray), Some(beside)] = rays else {
                continue;
            };
            let [a, b] = [ray, beside].map(|ray| Vector3::from(ray.direction));
            let rad_per_px = libm::atan2(a.cross(&b).norm(), a.dot(&b));
            angles.push(rad_per_px);
            let ray = TimedRay {
                observation: *observation,
                time_s: observation.time_s,
                origin_m: pose * Point3::from(ray.origin),
                direction: pose.rotation * a,
                distance_m: observation.distance_m,
                radius_rad: observation.radius_px * rad_per_px,
            };
            if latest == Some(observation.frame)
                && let Some(rays) = frames.last_mut()
            {
                rays.push(ray);
            } else {
                latest = Some(observation.frame);
                frames.push(vec![ray]);
            }
        }
        Self {
            frames,
            interval_s,
            rad_per_px: super::median(&mut angles).unwrap_or(1e-3),
            is_size_known,
        }
    }

    /// Returns the rays at a time of this camera's clock, each interpolated between a detection and the nearest one
    /// of the next frame, if the two frames are close in time.
    pub(crate) fn at(&self, time_s: f64) -> Vec<TimedRay> {
        let after = self.frames.partition_point(|rays| rays[0].time_s < time_s);
        let before = after.checked_sub(1).map(|before| &self.frames[before]);
        let (Some(next), Some(last)) = (self.frames.get(after), before) else {
            let first = self.frames.first().filter(|rays| rays[0].time_s == time_s);
            return first.cloned().unwrap_or_default();
        };
        if next[0].time_s - last[0].time_s > MAX_GAP * self.interval_s {
            return Vec::new();
        }
        let of_last = last.iter().filter_map(|ray| {
            let cos = |other: &&TimedRay| ray.direction.dot(&other.direction);
            let nearest = next.iter().max_by(|a, b| cos(a).total_cmp(&cos(b)))?;
            Some(ray.between(nearest, time_s))
        });
        of_last.collect()
    }
}

/// How well the rays of two cameras meet under one offset.
struct Meetings {
    /// Mean of a robust cost.
    cost: f64,
    /// Number of detections that were compared.
    count: usize,
}

/// Offset between the clocks of two cameras.
#[derive(Debug, Clone, Copy)]
pub(super) struct PairOffset {
    /// Seconds to add to the second camera's time stamps to obtain the first camera's time.
    pub(super) offset_s: f64,
    /// Improvement of the cost over the other offsets, summed over detections: the strength of the evidence.
    pub(super) gain: f64,
    /// Whether a still larger offset may be better.
    pub(super) at_border: bool,
}

/// Finds the offset of `second` relative to `first` within a range (lowest, highest, seconds) under which the
/// rays meet best; `None` if the two cameras never see the target at the same time.
pub(super) fn pair_offset(
    first: &RayTrack,
    second: &RayTrack,
    [low_s, high_s]: [f64; 2],
) -> Option<PairOffset> {
    let step_s = first.interval_s.min(second.interval_s) / STEPS_PER_FRAME;
    let steps = ((high_s - low_s) / step_s).ceil().max(1.0) as usize;
    let offset_of = |step: usize| low_s + (high_s - low_s) * step as f64 / steps as f64;
    let meetings: Vec<Meetings> = (0..=steps)
        .map(|step| meeting(first, second, offset_of(step)))
        .collect();
    // Offsets that allow few comparisons would win by chance.
    let most = meetings.iter().map(|m| m.count).max()?;
    let least = MIN_COMMON.max(most / 2);
    let compared = || {
        let steps = meetings.iter().enumerate();
        steps.filter(|(_, meeting)| meeting.count >= least)
    };
    let (best, meeting) = compared().min_by(|a, b| a.1.cost.total_cmp(&b.1.cost))?;
    let costs = compared().map(|(_, meeting)| meeting.cost);
    let mean = costs.clone().sum::<f64>() / costs.count() as f64;
    Some(PairOffset {
        offset_s: offset_of(best),
        gain: meeting.count as f64 * (mean - meeting.cost),
        at_border: best == 0 || best == steps,
    })
}

fn meeting(first: &RayTrack, second: &RayTrack, offset_s: f64) -> Meetings {
    let scale_rad = MISS_PX * first.rad_per_px.max(second.rad_per_px);
    let mut sum = Meetings {
        cost: 0.0,
        count: 0,
    };
    let step = second.frames.len().div_ceil(MAX_COMPARED).max(1);
    for ray in second.frames.iter().step_by(step).flatten() {
        let others = first.at(ray.time_s + offset_s);
        let misses = others.iter().filter_map(|other| miss(other, ray));
        let costs = misses.map(|miss| miss.cost(scale_rad, first.is_size_known));
        if let Some(cost) = costs.min_by(f64::total_cmp) {
            sum.cost += cost;
            sum.count += 1;
        }
    }
    sum.cost /= sum.count.max(1) as f64;
    sum
}

/// The closest approach of two rays.
struct Miss {
    /// The angle between the rays there as seen from the cameras, in radians.
    angle_rad: f64,
    /// Logarithms of the sizes that an object there has according to the two cameras, relative to the target's.
    log_sizes: [f64; 2],
    point_m: Point3<f64>,
    /// Distance from the second ray's origin, in metres.
    distance_m: f64,
}

impl Miss {
    /// A robust cost: small if both cameras may see the target.
    fn cost(&self, scale_rad: f64, is_size_known: bool) -> f64 {
        let angle = self.angle_rad / scale_rad;
        let [a, b] = self.log_sizes.map(|log_size| log_size / SIZE_SIGMA);
        let sizes = if is_size_known {
            a * a + b * b
        } else {
            // The least for any size that they share.
            0.5 * (a - b) * (a - b)
        };
        libm::log1p(angle * angle + sizes)
    }
}

/// Returns the closest approach of two rays; `None` for nearly parallel rays, which carry no information.
fn miss(a: &TimedRay, b: &TimedRay) -> Option<Miss> {
    let across = a.direction.cross(&b.direction);
    let sine = across.norm();
    if sine < 0.02 {
        return None;
    }
    let between = b.origin_m - a.origin_m;
    let miss_m = (between.dot(&across) / sine).abs();
    // Distances along the rays to the closest approach; rays that meet behind a camera do not meet.
    let along = |other: &Vector3<f64>| between.cross(other).dot(&across) / (sine * sine);
    let (along_a, along_b) = (along(&b.direction), along(&a.direction));
    let is_ahead = along_a > 0.0 && along_b > 0.0;
    let points_m = [
        a.origin_m + a.direction * along_a,
        b.origin_m + b.direction * along_b,
    ];
    Some(Miss {
        angle_rad: if is_ahead {
            miss_m / libm::hypot(along_a, along_b)
        } else {
            std::f64::consts::PI
        },
        log_sizes: if is_ahead {
            [
                libm::log(along_a / a.distance_m),
                libm::log(along_b / b.distance_m),
            ]
        } else {
            [0.0; 2]
        },
        point_m: nalgebra::center(&points_m[0], &points_m[1]),
        distance_m: along_b,
    })
}

/// A point at which the ray of a detection meets one of another camera.
#[derive(Debug, Clone, Copy)]
pub(super) struct Meeting {
    pub(super) observation: Observation,
    /// Time of the first camera's clock, in seconds.
    pub(super) time_s: f64,
    pub(super) point_m: Point3<f64>,
    /// Diameter that the target's image has there, in metres.
    pub(super) diameter_m: f64,
    /// How well the rays meet: 1 at best, 0 for unrelated ones.
    pub(super) quality: f64,
    /// By how far they miss each other, in pixels.
    miss_px: f64,
}

/// Returns where the ray of each detection meets another camera's best under known offsets, in order of time.
pub(super) fn meetings(tracks: &[RayTrack], offsets_s: &[f64]) -> Vec<Meeting> {
    let of_ray = |camera: usize, ray: &TimedRay| {
        let time_s = ray.time_s + offsets_s[camera];
        let mut best: Option<Meeting> = None;
        for (other, track) in tracks
            .iter()
            .enumerate()
            .filter(|(other, _)| *other != camera)
        {
            let scale_rad = MISS_PX * track.rad_per_px.max(tracks[camera].rad_per_px);
            for across in track.at(time_s - offsets_s[other]) {
                let Some(miss) = miss(&across, ray) else {
                    continue;
                };
                let quality = libm::exp(-miss.cost(scale_rad, track.is_size_known));
                if best.is_none_or(|best| best.quality < quality) {
                    best = Some(Meeting {
                        observation: ray.observation,
                        time_s,
                        point_m: miss.point_m,
                        diameter_m: 2.0 * ray.radius_rad * miss.distance_m,
                        quality,
                        miss_px: miss.angle_rad / tracks[camera].rad_per_px,
                    });
                }
            }
        }
        best
    };
    let mut found = Vec::new();
    for (camera, track) in tracks.iter().enumerate() {
        let rays = track.frames.iter().flatten();
        found.extend(rays.filter_map(|ray| of_ray(camera, ray)));
    }
    found.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
    found
}

/// Returns the points (time in seconds, position in metres) where rays of two cameras meet under known offsets,
/// in order of time: one for each detection that another camera confirms.
pub(super) fn meeting_points(tracks: &[RayTrack], offsets_s: &[f64]) -> Vec<(f64, Point3<f64>)> {
    let mut found = meetings(tracks, offsets_s);
    let mut misses: Vec<f64> = found.iter().map(|meeting| meeting.miss_px).collect();
    let bound = 3.0 * super::median(&mut misses).unwrap_or(0.0) + 1.0;
    found.retain(|meeting| meeting.miss_px <= bound);
    found
        .iter()
        .map(|meeting| (meeting.time_s, meeting.point_m))
        .collect()
}
