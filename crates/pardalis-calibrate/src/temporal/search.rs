//! Coarse search for time offsets without an initial guess: the offset under which the rays of two cameras
//! meet best.

use nalgebra::{Matrix3, Point3, Vector3};

use super::path::Observation;
use pardalis::view::View;

/// Largest gap to interpolate across, in typical frame intervals.
const MAX_GAP: f64 = 2.5;

/// Search steps per frame interval.
const STEPS_PER_FRAME: f64 = 4.0;

/// Distance in pixels between two rays beyond which their detections increasingly count as unrelated.
const MISS_PX: f64 = 3.0;

/// Smallest number of simultaneous detections that two cameras must share.
const MIN_COMMON: usize = 8;

/// Largest number of a camera's detections that are compared; more would not improve the result.
const MAX_COMPARED: usize = 400;

/// A ray in the world, at a time of the camera's clock.
#[derive(Debug, Clone, Copy)]
struct TimedRay {
    time_s: f64,
    origin_m: Point3<f64>,
    direction: Vector3<f64>,
}

/// Rays of the detections of one camera, in order of time.
#[derive(Debug, Clone)]
pub(super) struct RayTrack {
    rays: Vec<TimedRay>,
    /// Median time between two frames, in seconds.
    pub(super) interval_s: f64,
    /// Angular size of a pixel, in radians.
    rad_per_px: f64,
}

impl RayTrack {
    /// Computes the rays of one camera's detections, which are in order of time.
    pub(super) fn new<'a>(
        view: &View,
        observations: impl Iterator<Item = &'a Observation>,
        interval_s: f64,
    ) -> Self {
        let pose = view.world_from_camera();
        let mut angles = Vec::new();
        let rays = observations
            .filter_map(|observation| {
                let ray = view.camera().unproject(observation.pixel)?;
                let beside = view
                    .camera()
                    .unproject([observation.pixel[0] + 1.0, observation.pixel[1]]);
                angles.extend(beside.map(|beside| {
                    let [a, b] = [ray, beside].map(|ray| Vector3::from(ray.direction));
                    libm::atan2(a.cross(&b).norm(), a.dot(&b))
                }));
                Some(TimedRay {
                    time_s: observation.time_s,
                    origin_m: pose * Point3::from(ray.origin),
                    direction: pose.rotation * Vector3::from(ray.direction),
                })
            })
            .collect();
        Self {
            rays,
            interval_s,
            rad_per_px: super::median(&mut angles).unwrap_or(1e-3),
        }
    }

    /// Returns the ray at a time of this camera's clock, interpolated between two detections that are close
    /// in time.
    fn at(&self, time_s: f64) -> Option<TimedRay> {
        let after = self.rays.partition_point(|ray| ray.time_s < time_s);
        let next = self.rays.get(after)?;
        if next.time_s == time_s {
            return Some(*next);
        }
        let last = &self.rays[after.checked_sub(1)?];
        let gap_s = next.time_s - last.time_s;
        if gap_s > MAX_GAP * self.interval_s {
            return None;
        }
        let share = (time_s - last.time_s) / gap_s;
        Some(TimedRay {
            time_s,
            origin_m: last
                .origin_m
                .coords
                .lerp(&next.origin_m.coords, share)
                .into(),
            direction: last.direction.lerp(&next.direction, share).normalize(),
        })
    }
}

/// How well the rays of two cameras meet under one offset.
struct Meeting {
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
    let meetings: Vec<Meeting> = (0..=steps)
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

fn meeting(first: &RayTrack, second: &RayTrack, offset_s: f64) -> Meeting {
    let scale_rad = MISS_PX * first.rad_per_px.max(second.rad_per_px);
    let mut sum = Meeting {
        cost: 0.0,
        count: 0,
    };
    let step = second.rays.len().div_ceil(MAX_COMPARED).max(1);
    for ray in second.rays.iter().step_by(step) {
        let Some(other) = first.at(ray.time_s + offset_s) else {
            continue;
        };
        let Some(miss_rad) = miss_rad(&other, ray) else {
            continue;
        };
        sum.cost += libm::log1p((miss_rad / scale_rad) * (miss_rad / scale_rad));
        sum.count += 1;
    }
    sum.cost /= sum.count.max(1) as f64;
    sum
}

/// Returns the angle between two rays at their closest approach as seen from the cameras, in radians; `None`
/// for nearly parallel rays, which carry no information.
fn miss_rad(a: &TimedRay, b: &TimedRay) -> Option<f64> {
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
    if along_a <= 0.0 || along_b <= 0.0 {
        return Some(std::f64::consts::PI);
    }
    Some(miss_m / libm::hypot(along_a, along_b))
}

/// Returns the points (time in seconds, position in metres) where rays of several cameras meet under known
/// offsets, in order of time: one for each detection that another camera confirms.
pub(super) fn meeting_points(tracks: &[RayTrack], offsets_s: &[f64]) -> Vec<(f64, Point3<f64>)> {
    let mut found = Vec::new();
    for (camera, track) in tracks.iter().enumerate() {
        for ray in &track.rays {
            let time_s = ray.time_s + offsets_s[camera];
            let others = tracks.iter().zip(offsets_s).enumerate();
            let rays: Vec<TimedRay> = others
                .filter(|(other, _)| *other != camera)
                .filter_map(|(_, (other, offset_s))| other.at(time_s - offset_s))
                .chain([*ray])
                .collect();
            if let Some((point, miss_rad)) = nearest_point(&rays) {
                found.push((time_s, point, miss_rad / track.rad_per_px));
            }
        }
    }
    let mut misses: Vec<f64> = found.iter().map(|f| f.2).collect();
    let bound = 3.0 * super::median(&mut misses).unwrap_or(0.0) + 1.0;
    let mut points: Vec<(f64, Point3<f64>)> = found
        .into_iter()
        .filter(|(_, _, miss_px)| *miss_px <= bound)
        .map(|(time_s, point, _)| (time_s, point))
        .collect();
    points.sort_by(|a, b| a.0.total_cmp(&b.0));
    points
}

/// Returns the point nearest to two or more rays, and the largest angle by which a ray misses it, in radians.
fn nearest_point(rays: &[TimedRay]) -> Option<(Point3<f64>, f64)> {
    if rays.len() < 2 {
        return None;
    }
    let (mut matrix, mut right) = (Matrix3::zeros(), Vector3::zeros());
    for ray in rays {
        let across = Matrix3::identity() - ray.direction * ray.direction.transpose();
        matrix += across;
        right += across * ray.origin_m.coords;
    }
    // The smallest eigenvalue is about the squared sine of the angle between two rays.
    if matrix.symmetric_eigenvalues().min() < 1e-3 {
        return None;
    }
    let point = Point3::from(matrix.try_inverse()? * right);
    let miss = |ray: &TimedRay| {
        let to_point = point - ray.origin_m;
        libm::atan2(
            to_point.cross(&ray.direction).norm(),
            to_point.dot(&ray.direction),
        )
    };
    let largest = rays.iter().map(miss).fold(0.0, f64::max);
    Some((point, largest))
}
