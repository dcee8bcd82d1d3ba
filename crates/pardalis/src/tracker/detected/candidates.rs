//! The search for candidates: positions in the world at which a target may be, from blobs of its colours: along each blob's ray by apparent size, and where the rays of two
//! cameras meet.

use nalgebra::{Point3, Vector3};

use crate::background::Background;
use crate::detect::{Blob, BlobSearch};
use crate::likelihood::edge::{EdgeCue, EdgeFrame, SizePrior};
use crate::shape::Shape;
use crate::tracker::candidate::{Candidate, Origin, Verdict};
use crate::tracker::ids::CameraId;
use crate::tuning::{BackgroundTuning, BlobTuning, DetectionTuning};
use pardalis_core::simd::Level;

/// Bisections of the logarithm of the distance. Derivation: find it to 0.14 %.
const BISECTIONS: usize = 12;
/// Distances this share from the nearest and the farthest are at the end of the bisection: no distance has the blob's area. Derivation: more than a bisection's
/// error.
const END_SHARE: f64 = 0.02;

/// Blobs whose area is this share of the expected one, or its inverse, say nothing of the size. Hand-set: a size a thousand times smaller or larger.
const LEAST_AREA_SHARE: f64 = 1e-6;

/// The least share of a blob's area of a circle inside it that is fitted. Hand-set: in the one
/// clip of a ball that has grown together with its shadow, it is 0.42.
const MIN_CIRCLE_SHARE: f64 = 0.3;

/// A ray in the world: its origin in metres and its unit direction.
#[derive(Debug)]
pub(super) struct Ray {
    camera: usize,
    /// The number of its blob's candidate.
    candidate: usize,
    origin: Point3<f64>,
    direction: Vector3<f64>,
    /// The area of its blob, square pixels.
    area_px: f64,
}

impl Ray {
    /// The ray through a pixel, at which there is a blob of this area in square pixels.
    pub(super) fn of(frame: &EdgeFrame, pixel: [f64; 2], area_px: f64) -> Option<Self> {
        let (origin, direction) = frame.ray(pixel)?;
        Some(Self {
            camera: frame.camera(),
            candidate: 0,
            origin,
            direction,
            area_px,
        })
    }

    fn at(&self, distance_m: f64) -> Point3<f64> {
        self.origin + self.direction * distance_m
    }

    /// The point of the ray that is nearest to another point.
    pub(super) fn nearest_to(&self, point: &Point3<f64>) -> Point3<f64> {
        self.at((point - self.origin).dot(&self.direction))
    }
}

/// Finds candidates. Owns its buffers.
#[derive(Debug)]
pub(super) struct CandidateSearch {
    geometry: Geometry,
    blobs: BlobSearch,
    /// One per camera.
    backgrounds: Vec<Background>,
    /// What moves in the latest frame of a single camera.
    moving: BlobSearch,
    rays: Vec<Ray>,
    /// Whether the largest circles inside blobs are candidates, too.
    pub(super) with_circles: bool,
    /// Whether there are no candidates where look-alikes have been found.
    pub(super) leaves_found: bool,
    /// The time of the frame that was compared last, seconds.
    compared_s: Option<f64>,
    /// These candidates.
    circles: Vec<Candidate>,
}

/// The constraints on a target's position that do not depend on images: its shape and the ground.
#[derive(Debug)]
struct Geometry {
    shape: Shape,
    tuning: DetectionTuning,
    /// The height of a target that stays on the ground, metres.
    ground_z_m: Option<f64>,
}

impl CandidateSearch {
    /// A search for a body of this shape, on the ground at this height (metres) if there is one.
    pub(super) fn new(
        shape: Shape,
        ground_z_m: Option<f64>,
        (cameras, level): (usize, Level),
        (detection, blobs, background): (DetectionTuning, BlobTuning, BackgroundTuning),
    ) -> Self {
        Self {
            geometry: Geometry {
                shape,
                tuning: detection,
                ground_z_m,
            },
            blobs: BlobSearch::new(blobs, level),
            backgrounds: (0..cameras)
                .map(|_| Background::new(background, level))
                .collect(),
            moving: BlobSearch::new(blobs, level),
            rays: Vec::new(),
            with_circles: false,
            leaves_found: false,
            compared_s: None,
            circles: Vec::new(),
        }
    }

    /// The position and the displacement during the exposure of a target whose streak is a blob. The target is wider and the streak longer than follows from the blob, by
    /// these factors. `None` if the blob is round, or the target would be too near or too far.
    pub(super) fn streak_m(
        &self,
        edge: &mut EdgeCue,
        frame: &EdgeFrame,
        blob: &Blob,
        [widened, lengthened]: [f64; 2],
        size: &SizePrior,
    ) -> Option<([f64; 3], [f64; 3])> {
        let [along, across] = blob.principal_variances_px2();
        let [xx, xy, yy] = blob.covariance_px2;
        let angle = 0.5 * libm::atan2(2.0 * xy, xx - yy);
        // Of a uniform disc, the variance is a quarter of the squared radius; of a uniform line, a twelfth of the squared length.
        let length_px = lengthened * libm::sqrt(12.0 * (along - across));
        let disc_px = std::f64::consts::PI * 4.0 * across * widened * widened;
        let geometry = &self.geometry;
        let half = [libm::cos(angle), libm::sin(angle)].map(|v| 0.5 * length_px * v);
        let [u, v] = blob.centroid_px;
        let middle = Ray::of(frame, [u, v], disc_px)?;
        let ends = [-1.0, 1.0]
            .map(|sign| Ray::of(frame, [u + sign * half[0], v + sign * half[1]], disc_px));
        let [Some(from), Some(to)] = ends else {
            return None;
        };
        let ends = [&from, &to];
        let (position_m, ends_m) = if let Some(ground_z_m) = geometry.ground_z_m {
            let on_ground_m = |ray: &Ray| geometry.on_ground_m(ray, ground_z_m);
            (on_ground_m(&middle)?, ends.map(on_ground_m))
        } else {
            let position_m = geometry.by_size_m(edge, frame, &middle, size).ok()?;
            let distance_m = (Point3::from(position_m) - middle.origin).norm();
            let at_m = |ray: &Ray| Some(ray.at(distance_m).into());
            (position_m, ends.map(at_m))
        };
        let [Some(from_m), Some(to_m)] = ends_m else {
            return None;
        };
        let displacement_m = Vector3::from(to_m) - Vector3::from(from_m);
        Some((position_m, displacement_m.into()))
    }

    /// Compares a single camera's frame with those before it, to find later what moves. Frames of several cameras at one instant need no motion: their rays meet. If the camera
    /// itself may move, so does everything in its image.
    pub(super) fn compare(&mut self, frames: &[EdgeFrame]) {
        if let [frame] = frames
            && !frame.prepared().view().is_moving()
            && self.compared_s != Some(frame.prepared().frame().time_s())
        {
            self.compared_s = Some(frame.prepared().frame().time_s());
            self.backgrounds[frame.camera()].compare(frame.prepared());
        }
    }

    /// Finds what moves in the frame that was compared last and may be streaks of the target.
    pub(super) fn find_moving(&mut self, frame: &EdgeFrame) {
        let background = &self.backgrounds[frame.camera()];
        self.moving
            .find_moving(background, |bytes| frame.matches(bytes));
    }

    /// What was found, the largest first.
    pub(super) fn moving(&self) -> &[Blob] {
        self.moving.found()
    }

    /// The candidates at the largest circles inside the blobs of the latest search.
    pub(super) fn circles(&self) -> &[Candidate] {
        &self.circles
    }

    /// Adds the candidates of these frames, those of single cameras first, then those of pairs. Those that are not ruled out have a position.
    pub(super) fn search(
        &mut self,
        edge: &mut EdgeCue,
        frames: &[EdgeFrame],
        size: &SizePrior,
        candidates: &mut Vec<Candidate>,
    ) {
        let Self {
            geometry,
            blobs: search,
            rays,
            with_circles,
            leaves_found,
            circles,
            ..
        } = self;
        circles.clear();
        rays.clear();
        rays.reserve(frames.len() * search.max_blobs());
        for frame in frames {
            let camera = CameraId::new(frame.camera());
            let context = frame.context();
            let blobs = search.find(
                frame.prepared(),
                context.colors,
                context.posterior,
                &context.correction,
                |point| *leaves_found && frame.is_taken(point),
            );
            for &blob in blobs {
                let origin = Origin::Blob(camera, blob);
                let Some(mut ray) = Ray::of(frame, blob.centroid_px, blob.area_px) else {
                    candidates.push(Candidate::new(origin, Verdict::OutOfView));
                    continue;
                };
                let place = match geometry.ground_z_m {
                    Some(ground_z_m) => geometry
                        .on_ground_m(&ray, ground_z_m)
                        .map(|m| (m, log_scale_of(edge, (frame, &ray), m, size)))
                        .ok_or(Verdict::OffGround),
                    None => geometry
                        .by_size_m(edge, frame, &ray, size)
                        .map(|position_m| (position_m, size.log_scale)),
                };
                ray.candidate = candidates.len();
                candidates.push(match place {
                    Ok((position_m, log_scale)) => at(origin, position_m, log_scale),
                    Err(verdict) => Candidate::new(origin, verdict),
                });
                rays.push(ray);
            }
            let round = geometry.ground_z_m.is_none() && matches!(geometry.shape, Shape::Sphere(_));
            if *with_circles && round {
                for number in 0..search.found().len() {
                    circles.extend(geometry.in_circle((edge, frame), search, number, size));
                }
            }
            let blobs = search.found();
            let verdict = if blobs.is_empty() {
                Verdict::NoColors
            } else {
                Verdict::Surplus
            };
            let is_blob = |part: &Blob| part.area_px >= search.min_area_px() as f64;
            match search.left_out() {
                Some(part) if verdict == Verdict::NoColors || is_blob(part) => {
                    candidates.push(Candidate::new(Origin::Blob(camera, *part), verdict));
                }
                None if verdict == Verdict::NoColors => {
                    candidates.push(Candidate::new(Origin::Image(camera), verdict));
                }
                _ => {}
            }
        }
        if geometry.ground_z_m.is_none() {
            for (i, ray) in rays.iter().enumerate() {
                for other in &rays[..i] {
                    let of = |ray: &Ray| frames.iter().find(|f| f.camera() == ray.camera);
                    if ray.camera != other.camera
                        && let (Some(one), Some(two)) = (of(ray), of(other))
                    {
                        let both = [(one, ray), (two, other)];
                        let blobs = Some([ray.candidate, other.candidate]);
                        let meeting = geometry.meeting(edge, both, size);
                        candidates.extend(meeting.map(|found| Candidate { blobs, ..found }));
                    }
                }
            }
        }
    }
}

/// A candidate that is to be fitted from this position, metres. Until then nothing determines where it is.
pub(super) fn at(origin: Origin, position_m: [f64; 3], log_scale: f64) -> Candidate {
    Candidate {
        position_m: Some(position_m),
        log_scale,
        ..Candidate::new(origin, Verdict::NoEdges)
    }
}

/// The logarithm of the scale at which a target at a position has the area of the blob of a ray. Without any tolerance it is that of the size.
fn log_scale_of(
    edge: &mut EdgeCue,
    (frame, ray): (&EdgeFrame, &Ray),
    position_m: [f64; 3],
    size: &SizePrior,
) -> f64 {
    if size.sigma == 0.0 {
        return size.log_scale;
    }
    let ratio = ray.area_px / edge.area_px(frame, position_m, size.scale());
    // Where there is no outline, it has no area.
    let ratio = ratio.clamp(LEAST_AREA_SHARE, 1.0 / LEAST_AREA_SHARE);
    size.log_scale + 0.5 * libm::log(ratio)
}

impl Geometry {
    /// The distance of the farthest candidates of a scale, metres.
    fn farthest_m(&self, scale: f64) -> f64 {
        self.tuning.farthest_diameters * scale * self.shape.diameter_m()
    }

    /// The position of a target whose middle is here.
    fn position_m(&self, middle: Point3<f64>) -> [f64; 3] {
        let [x, y, z] = middle.into();
        let height_m = self.ground_z_m;
        [x, y, height_m.unwrap_or(z - self.shape.middle_height_m())]
    }

    /// The position of a target on the ground that is seen along a ray.
    fn on_ground_m(&self, ray: &Ray, ground_z_m: f64) -> Option<[f64; 3]> {
        let height_m = ground_z_m + self.shape.middle_height_m();
        let distance_m = (height_m - ray.origin.z) / ray.direction.z;
        (distance_m > 0.0 && distance_m < self.farthest_m(1.0))
            .then(|| self.position_m(ray.at(distance_m)))
    }

    /// The position along its ray at which a target has a blob's area, or why there is none.
    fn by_size_m(
        &self,
        edge: &mut EdgeCue,
        frame: &EdgeFrame,
        ray: &Ray,
        size: &SizePrior,
    ) -> Result<[f64; 3], Verdict> {
        let scale = size.scale();
        let nearest_m = self.tuning.nearest_diameters * scale * self.shape.diameter_m();
        let farthest_m = self.farthest_m(scale);
        let [mut near, mut far] = [nearest_m, farthest_m].map(libm::log);
        for _ in 0..BISECTIONS {
            let middle = 0.5 * (near + far);
            let position_m = self.position_m(ray.at(libm::exp(middle)));
            let is_small = edge.area_px(frame, position_m, scale) < ray.area_px;
            *(if is_small { &mut far } else { &mut near }) = middle;
        }
        let distance_m = libm::exp(0.5 * (near + far));
        if distance_m <= (1.0 + END_SHARE) * nearest_m {
            Err(Verdict::TooNear)
        } else if distance_m < (1.0 - END_SHARE) * farthest_m {
            Ok(self.position_m(ray.at(distance_m)))
        } else {
            Err(Verdict::TooFar)
        }
    }

    /// The candidate at the largest circle inside a blob, if that is large enough.
    fn in_circle(
        &self,
        (edge, frame): (&mut EdgeCue, &EdgeFrame),
        search: &BlobSearch,
        number: usize,
        size: &SizePrior,
    ) -> Option<Candidate> {
        let blob = search.found()[number];
        let circle = search.inscribed_circle(number);
        let area_px = std::f64::consts::PI * circle.radius_px * circle.radius_px;
        if area_px < MIN_CIRCLE_SHARE * blob.area_px {
            return None;
        }
        let ray = Ray::of(frame, circle.center_px, area_px)?;
        let position_m = self.by_size_m(edge, frame, &ray, size).ok()?;
        let origin = Origin::Circle(CameraId::new(frame.camera()), blob);
        Some(at(origin, position_m, size.log_scale))
    }

    /// The candidate where two rays meet, or pass close by each other, each with its camera's frame: as large as their blobs suggest.
    fn meeting(
        &self,
        edge: &mut EdgeCue,
        both @ [(_, a), (_, b)]: [(&EdgeFrame, &Ray); 2],
        size: &SizePrior,
    ) -> Option<Candidate> {
        let between = b.origin - a.origin;
        let cos = a.direction.dot(&b.direction);
        let sin_squared = 1.0 - cos * cos;
        let [along_a, along_b] = [a.direction.dot(&between), b.direction.dot(&between)];
        let distance_a = (along_a - cos * along_b) / sin_squared;
        let distance_b = (cos * along_a - along_b) / sin_squared;
        // Distances of parallel rays are NaN or infinite.
        let is_ahead = |distance: f64| distance > 0.0 && distance.is_finite();
        if !(is_ahead(distance_a) && is_ahead(distance_b)) {
            return None;
        }
        let [at_a, at_b] = [a.at(distance_a), b.at(distance_b)];
        let position_m = self.position_m(nalgebra::center(&at_a, &at_b));
        let log_scales = both.map(|one| log_scale_of(edge, one, position_m, size));
        let log_scale = 0.5 * (log_scales[0] + log_scales[1]);
        let scale = libm::exp(log_scale);
        let meeting_m = self.tuning.meeting_diameters * scale * self.shape.diameter_m();
        let is_close = (at_a - at_b).norm() < meeting_m;
        let is_near = distance_a.max(distance_b) < self.farthest_m(scale);
        (is_close && is_near).then(|| at(Origin::Rays, position_m, log_scale))
    }
}
