//! A start without any guess of poses and offsets: each camera alone knows the ball's path roughly, because the size of
//! the ball tells its distance. The paths of two cameras are brought into line for many offsets.

use nalgebra::{Point3, Vector3};

use super::super::temporal::search::{RayTrack, TimedRay};
use pardalis_camera::{Pose, nearest_pose};
use pardalis_core::rng::{Draws, Stage};

/// Search steps per frame interval.
const STEPS_PER_FRAME: f64 = 2.0;

/// Largest number of a camera's frames from which alignments are drawn and on which they are compared.
const COMPARED: usize = 150;

/// Number of alignments that are tried per offset, each from three points.
const SAMPLES: u32 = 60;

/// Number of offsets that are refined on all frames.
const REFINED: usize = 3;

/// Number of fits to the points that agree with the fit before.
const ROUNDS: usize = 8;

/// Standard deviation of the radius of a single detection in pixels; rather too large than too small.
const RADIUS_SIGMA_PX: f64 = 0.4;

/// Least standard deviation of a distance by size, as a share of it.
const LEAST_DISTANCE_SIGMA: f64 = 0.005;

/// Number of standard deviations beyond which two points are not the same.
const AGREEING_SIGMAS: f64 = 3.0;

/// Returns where the ball is by its size, in the frame in which the ray is.
pub(super) fn place_m(ray: &TimedRay) -> Vector3<f64> {
    ray.origin_m.coords + ray.direction * ray.distance_m
}

/// Returns the standard deviation of the distance by size, in metres.
pub(super) fn distance_sigma_m(track: &RayTrack, ray: &TimedRay) -> f64 {
    let share = RADIUS_SIGMA_PX * track.rad_per_px / ray.radius_rad;
    ray.distance_m * share.max(LEAST_DISTANCE_SIGMA)
}

/// Two detections at the same time that may be of the ball.
struct Pair {
    /// Index of the second camera's frame.
    frame: usize,
    first_m: Vector3<f64>,
    second_m: Vector3<f64>,
    /// Largest distance between the two after alignment.
    tolerance_m: f64,
}

/// How the paths of two cameras match best.
#[derive(Debug, Clone, Copy)]
pub(super) struct Link {
    pub(super) first_from_second: Pose,
    /// Seconds to add to the second camera's times to obtain those of the first camera.
    pub(super) offset_s: f64,
    /// Sum of how well points agree, at most 1 for each frame.
    pub(super) support: f64,
    /// Number of frames in which both cameras detect something.
    pub(super) common: usize,
    /// Whether the offset lies at the border of the search range.
    pub(super) at_border: bool,
}

/// Returns how the paths of two cameras match best, with offsets in a range; `None` if they share too few frames.
pub(super) fn link(first: &RayTrack, second: &RayTrack, [low_s, high_s]: [f64; 2]) -> Option<Link> {
    let step_s = first.interval_s.min(second.interval_s) / STEPS_PER_FRAME;
    let steps = ((high_s - low_s) / step_s).ceil().max(1.0) as usize;
    let offset_of = |step: usize| low_s + (high_s - low_s) * step as f64 / steps as f64;
    let thin = second.frames.len().div_ceil(COMPARED).max(1);
    let mut tried: Vec<(usize, f64, Pose)> = (0..=steps)
        .filter_map(|step| {
            let pairs = pairs(first, second, offset_of(step), thin);
            let (support, pose) = best_sample(&pairs, step as u32)?;
            Some((step, support, pose))
        })
        .collect();
    tried.sort_by(|a, b| b.1.total_cmp(&a.1));
    let refined = tried.iter().take(REFINED).map(|&(step, _, pose)| {
        let pairs = pairs(first, second, offset_of(step), 1);
        let (support, pose) = refined(&pairs, pose);
        Link {
            first_from_second: pose,
            offset_s: offset_of(step),
            support,
            common: by_frame(&pairs).count(),
            at_border: step == 0 || step == steps,
        }
    });
    refined.max_by(|a, b| a.support.total_cmp(&b.support))
}

fn pairs(first: &RayTrack, second: &RayTrack, offset_s: f64, thin: usize) -> Vec<Pair> {
    let mut pairs = Vec::new();
    for (frame, rays) in second.frames.iter().enumerate().step_by(thin) {
        for ray in rays {
            pairs.extend(first.at(ray.time_s + offset_s).iter().map(|other| Pair {
                frame,
                first_m: place_m(other),
                second_m: place_m(ray),
                tolerance_m: AGREEING_SIGMAS
                    * libm::hypot(
                        distance_sigma_m(first, other),
                        distance_sigma_m(second, ray),
                    ),
            }));
        }
    }
    pairs
}

fn by_frame(pairs: &[Pair]) -> impl Iterator<Item = &[Pair]> {
    pairs.chunk_by(|a, b| a.frame == b.frame)
}

/// Returns how well two points agree: 1 at best, 0 beyond the tolerance.
fn agreement(pair: &Pair, pose: &Pose) -> f64 {
    let apart = (pose * Point3::from(pair.second_m)).coords - pair.first_m;
    (1.0 - apart.norm_squared() / (pair.tolerance_m * pair.tolerance_m)).max(0.0)
}

/// Returns the pair of a frame that agrees best under an alignment, and how well.
fn best_of<'a>(frame: &'a [Pair], pose: &Pose) -> (f64, &'a Pair) {
    let rated = frame.iter().map(|pair| (agreement(pair, pose), pair));
    rated
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .unwrap_or((0.0, &frame[0]))
}

fn support(pairs: &[Pair], pose: &Pose) -> f64 {
    by_frame(pairs).map(|frame| best_of(frame, pose).0).sum()
}

/// Returns the alignment of three random pairs with the most support.
fn best_sample(pairs: &[Pair], stream: u32) -> Option<(f64, Pose)> {
    let draws = Draws::new(0, 0);
    let sampled = (0..SAMPLES).filter_map(|sample| {
        let places = draws.uniforms(sample, stream, Stage::Ray);
        let chosen = [0, 1, 2].map(|i| pairs.get((places[i] * pairs.len() as f64) as usize));
        let [Some(a), Some(b), Some(c)] = chosen else {
            return None;
        };
        let pose = aligned([a, b, c].into_iter().map(|pair| (1.0, pair)))?;
        Some((support(pairs, &pose), pose))
    });
    sampled.max_by(|a, b| a.0.total_cmp(&b.0))
}

/// Fits an alignment to the pairs that agree with it, several times.
fn refined(pairs: &[Pair], start: Pose) -> (f64, Pose) {
    let mut best = (support(pairs, &start), start);
    for _ in 0..ROUNDS {
        let frames = by_frame(pairs).map(|frame| best_of(frame, &best.1));
        let Some(pose) = aligned(frames.filter(|(weight, _)| *weight > 0.0)) else {
            break;
        };
        let support = support(pairs, &pose);
        if support <= best.0 {
            break;
        }
        best = (support, pose);
    }
    best
}

fn aligned<'a>(pairs: impl Iterator<Item = (f64, &'a Pair)>) -> Option<Pose> {
    let weighted = pairs.map(|(weight, pair)| {
        let weight = weight / (pair.tolerance_m * pair.tolerance_m);
        (weight, [pair.first_m, pair.second_m])
    });
    nearest_pose(&weighted.collect::<Vec<_>>())
}
