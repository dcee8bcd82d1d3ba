//! The search for candidates: positions in the world at which a target may be, from blobs of its colours: along each blob's ray by apparent size, and where the rays of two
//! cameras meet.

use nalgebra::{Point3, Vector3};

use crate::detect::{Blob, BlobSearch};
use crate::likelihood::edge::{EdgeCue, EdgeFrame};
use crate::shape::Shape;
use crate::tracker::candidate::{Candidate, Origin, Verdict};
use crate::tracker::ids::CameraId;
use crate::tuning::{BlobTuning, DetectionTuning};

/// Bisections of the logarithm of the distance. Derivation: find it to 0.14 %.
const BISECTIONS: usize = 12;
/// Distances this share from the nearest and the farthest are at the end of the bisection: no distance has the blob's area. Derivation: more than a bisection's
/// error.
const END_SHARE: f64 = 0.02;

/// A ray in the world: its origin in metres and its unit direction.
#[derive(Debug)]
struct Ray {
    camera: usize,
    origin: Point3<f64>,
    direction: Vector3<f64>,
}

impl Ray {
    fn of(frame: &EdgeFrame, pixel: [f64; 2]) -> Option<Self> {
        let view = frame.prepared().view();
        let ray = view.camera().unproject(pixel)?;
        Some(Self {
            camera: frame.camera(),
            origin: view.world_from_camera() * Point3::from(ray.origin),
            direction: view.world_from_camera() * Vector3::from(ray.direction),
        })
    }

    fn at(&self, distance_m: f64) -> Point3<f64> {
        self.origin + self.direction * distance_m
    }
}

/// Finds candidates. Owns its buffers.
#[derive(Debug)]
pub(super) struct CandidateSearch {
    geometry: Geometry,
    blobs: BlobSearch,
    rays: Vec<Ray>,
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
        (detection, blobs): (DetectionTuning, BlobTuning),
    ) -> Self {
        Self {
            geometry: Geometry {
                shape,
                tuning: detection,
                ground_z_m,
            },
            blobs: BlobSearch::new(blobs),
            rays: Vec::new(),
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
    ) -> Option<([f64; 3], [f64; 3])> {
        let [along, across] = blob.principal_variances_px2();
        let [xx, xy, yy] = blob.covariance_px2;
        let angle = 0.5 * libm::atan2(2.0 * xy, xx - yy);
        // Of a uniform disc, the variance is a quarter of the squared radius; of a uniform line, a twelfth of the squared length.
        let length_px = lengthened * libm::sqrt(12.0 * (along - across));
        let disc = Blob {
            area_px: std::f64::consts::PI * 4.0 * across * widened * widened,
            ..*blob
        };
        let geometry = &self.geometry;
        let half = [libm::cos(angle), libm::sin(angle)].map(|v| 0.5 * length_px * v);
        let [u, v] = blob.centroid_px;
        let middle = Ray::of(frame, [u, v])?;
        let ends = [-1.0, 1.0].map(|sign| Ray::of(frame, [u + sign * half[0], v + sign * half[1]]));
        let [Some(from), Some(to)] = ends else {
            return None;
        };
        let ends = [&from, &to];
        let (position_m, ends_m) = if let Some(ground_z_m) = geometry.ground_z_m {
            let on_ground_m = |ray: &Ray| geometry.on_ground_m(ray, ground_z_m);
            (on_ground_m(&middle)?, ends.map(on_ground_m))
        } else {
            let position_m = geometry.by_size_m(edge, frame, &middle, &disc).ok()?;
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

    /// Adds the candidates of these frames, those of single cameras first, then those of pairs. Those that are not ruled out have a position.
    pub(super) fn search(
        &mut self,
        edge: &mut EdgeCue,
        frames: &[EdgeFrame],
        candidates: &mut Vec<Candidate>,
    ) {
        let Self {
            geometry,
            blobs: search,
            rays,
        } = self;
        rays.clear();
        rays.reserve(frames.len() * search.max_blobs());
        for frame in frames {
            let camera = CameraId::new(frame.camera());
            let context = frame.context();
            let (palette, ranges) = context.colors;
            let blobs = search.find(
                frame.prepared(),
                palette,
                context.posterior,
                ranges,
                &context.correction,
            );
            for &blob in blobs {
                let origin = Origin::Blob(camera, blob);
                let Some(ray) = Ray::of(frame, blob.centroid_px) else {
                    candidates.push(Candidate::new(origin, Verdict::OutOfView));
                    continue;
                };
                let position_m = match geometry.ground_z_m {
                    Some(ground_z_m) => geometry
                        .on_ground_m(&ray, ground_z_m)
                        .ok_or(Verdict::OffGround),
                    None => geometry.by_size_m(edge, frame, &ray, &blob),
                };
                candidates.push(match position_m {
                    Ok(position_m) => at(origin, position_m),
                    Err(verdict) => Candidate::new(origin, verdict),
                });
                rays.push(ray);
            }
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
                    if ray.camera != other.camera {
                        let position_m = geometry.meeting_m(ray, other);
                        candidates.extend(position_m.map(|m| at(Origin::Rays, m)));
                    }
                }
            }
        }
    }
}

/// A candidate that is to be fitted from this position, metres. Until then nothing determines where it is.
pub(super) fn at(origin: Origin, position_m: [f64; 3]) -> Candidate {
    Candidate {
        position_m: Some(position_m),
        ..Candidate::new(origin, Verdict::NoEdges)
    }
}

impl Geometry {
    /// The distance of the farthest candidates, metres.
    fn farthest_m(&self) -> f64 {
        self.tuning.farthest_diameters * self.shape.diameter_m()
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
        (distance_m > 0.0 && distance_m < self.farthest_m())
            .then(|| self.position_m(ray.at(distance_m)))
    }

    /// The position along its ray at which a target has a blob's area, or why there is none.
    fn by_size_m(
        &self,
        edge: &mut EdgeCue,
        frame: &EdgeFrame,
        ray: &Ray,
        blob: &Blob,
    ) -> Result<[f64; 3], Verdict> {
        let nearest_m = self.tuning.nearest_diameters * self.shape.diameter_m();
        let farthest_m = self.farthest_m();
        let [mut near, mut far] = [nearest_m, farthest_m].map(libm::log);
        for _ in 0..BISECTIONS {
            let middle = 0.5 * (near + far);
            let position_m = self.position_m(ray.at(libm::exp(middle)));
            let is_small = edge.area_px(frame, position_m) < blob.area_px;
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

    /// The position at which two rays meet, or pass close by each other.
    fn meeting_m(&self, a: &Ray, b: &Ray) -> Option<[f64; 3]> {
        let between = b.origin - a.origin;
        let cos = a.direction.dot(&b.direction);
        let sin_squared = 1.0 - cos * cos;
        let [along_a, along_b] = [a.direction.dot(&between), b.direction.dot(&between)];
        let distance_a = (along_a - cos * along_b) / sin_squared;
        let distance_b = (cos * along_a - along_b) / sin_squared;
        let farthest_m = self.farthest_m();
        let fits = |distance: f64| distance > 0.0 && distance < farthest_m;
        // Distances of parallel rays are NaN or infinite.
        if !(fits(distance_a) && fits(distance_b)) {
            return None;
        }
        let [at_a, at_b] = [a.at(distance_a), b.at(distance_b)];
        let is_close =
            (at_a - at_b).norm() < self.tuning.meeting_diameters * self.shape.diameter_m();
        is_close.then(|| self.position_m(nalgebra::center(&at_a, &at_b)))
    }
}
