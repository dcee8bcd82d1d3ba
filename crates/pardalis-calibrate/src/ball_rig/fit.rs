//! Bundle adjustment of a rig over the path of a ball.

use nalgebra::{DVector, Point3, Vector3};

use super::super::least_squares::{Band, Problem, Slopes};
use super::super::pose::stepped_pose;
use super::super::temporal::median;
use super::super::temporal::path::{Basis, Observation, Path};
use super::{LEAST_NOISE_PX, OUTLIER_SIGMAS};
use pardalis_camera::{Camera, Pose};

/// Standard deviation of the error that all outlines of one camera share, in pixels, as that of the edge cue: blur and
/// light make a ball look a little larger or smaller than it is.
const SHARED_SIZE_SIGMA_PX: f64 = 0.15;

/// Standard deviation of the logarithm of the focal length before the fit, if it is free.
pub(super) const FOCAL_SIGMA: f64 = 0.05;

/// What is fitted of one camera.
#[derive(Debug, Clone)]
pub(super) struct FittedCamera {
    pub(super) camera: Camera,
    pub(super) camera_from_world: Pose,
    /// Seconds to add to its time stamps.
    pub(super) offset_s: f64,
    /// Whether the offset is held at 0.
    pub(super) has_first_clock: bool,
    /// By how much the radii of its outlines are too large, in pixels.
    pub(super) size_bias_px: f64,
    /// Logarithm of the focal length relative to the given one.
    pub(super) log_focal: f64,
    /// Whether the focal length is fitted.
    pub(super) is_focal_free: bool,
}

/// Standard deviations of detections, in pixels: of each coordinate, and of the radius.
#[derive(Debug, Clone, Copy)]
pub(super) struct Noise {
    pub(super) pixel_px: f64,
    pub(super) radius_px: f64,
}

/// Largest correlation of consecutive errors that is taken into account.
const MAX_CORRELATION: f64 = 0.9;

/// Motion in the image between two frames from which their errors are different, in pixels.
const OWN_ERROR_PX: f64 = 1.0;

/// Least weight of an observation.
const LEAST_WEIGHT: f64 = 0.02;

/// Times that are closer than this, in seconds, are one.
const SAME_TIME_S: f64 = 1e-3;

/// Standard deviation of an offset that is held, in seconds.
const HELD_S: f64 = 1e-7;

/// Unknowns of a camera's pose and clock.
const PLACE: usize = 7;

/// The least-squares problem, in units of standard deviations. Its unknowns are three per control point of the path,
/// which form a band, then pose and offset of each camera but the first, then the bias of the sizes and, if they are
/// free, the focal length of each camera.
#[derive(Clone)]
pub(super) struct RigFit<'a> {
    pub(super) cameras: Vec<FittedCamera>,
    pub(super) observations: &'a [Observation],
    /// How much each observation counts.
    pub(super) weights: Vec<f64>,
    pub(super) path: Path,
    pub(super) noise: Noise,
    /// Cost of the control points' second differences, per metre: so small that it matters only where there are no
    /// detections.
    pub(super) stiffness: f64,
}

/// Observed minus fitted values of a detection, in pixels.
#[derive(Debug, Clone, Copy)]
pub(super) struct Residual {
    pub(super) pixel_px: [f64; 2],
    pub(super) radius_px: f64,
}

impl RigFit<'_> {
    /// Returns the path's point at a camera's time stamp, in the camera's frame.
    fn point_in_camera(&self, camera: usize, time_s: f64) -> Option<(Basis, Point3<f64>)> {
        let of = &self.cameras[camera];
        let basis = self.path.basis(time_s + of.offset_s)?;
        let point = Point3::from(self.path.weighted(basis.first, basis.weights));
        Some((basis, of.camera_from_world * point))
    }

    /// Returns by how much the radius of a detection exceeds that of a ball at a distance in metres, in pixels.
    fn radius_excess_px(&self, observation: &Observation, distance_m: f64) -> f64 {
        let of = &self.cameras[observation.camera];
        let log_ratio = libm::log(distance_m / observation.distance_m) - of.log_focal;
        observation.radius_px * log_ratio - of.size_bias_px
    }

    /// Returns observed minus fitted values; `None` if the path's point has no pixel.
    pub(super) fn residual(&self, observation: &Observation) -> Option<Residual> {
        let (_, point) = self.point_in_camera(observation.camera, observation.time_s)?;
        let [u, v] = self.cameras[observation.camera]
            .camera
            .project(point.into())?;
        Some(Residual {
            pixel_px: [observation.pixel[0] - u, observation.pixel[1] - v],
            radius_px: self.radius_excess_px(observation, point.coords.norm()),
        })
    }

    /// Returns the number of unknowns of the path.
    fn path_unknowns(&self) -> usize {
        3 * self.path.controls_m.len()
    }

    /// Returns the number of unknowns behind those of the path before the pose and the offset of a camera, not the first.
    pub(super) fn place_at(camera: usize) -> usize {
        PLACE * (camera - 1)
    }

    /// Returns the number of unknowns behind those of the path before the offset of a camera, not the first.
    pub(super) fn offset_at(camera: usize) -> usize {
        Self::place_at(camera) + PLACE - 1
    }

    /// Returns the number of unknowns behind those of the path before the bias of a camera, which its focal length follows.
    fn lens_at(&self, camera: usize) -> usize {
        let free = self.cameras[..camera].iter().filter(|c| c.is_focal_free);
        PLACE * (self.cameras.len() - 1) + camera + free.count()
    }

    /// Returns the number of unknowns behind those of the path before a free focal length.
    pub(super) fn focal_at(&self, camera: usize) -> usize {
        self.lens_at(camera) + 1
    }

    /// Returns how far the image of a detection moves for a motion of the ball across the line of sight, in pixels per metre.
    pub(super) fn px_per_m(&self, observation: &Observation) -> Option<f64> {
        let (_, point) = self.point_in_camera(observation.camera, observation.time_s)?;
        let of = &self.cameras[observation.camera];
        let jacobian = of.camera.project_with_jacobian(point.into())?;
        Some(Vector3::from(jacobian.by_point[0]).norm())
    }

    /// Reports whether a detection is within a few standard deviations of the path.
    pub(super) fn is_inlier(&self, observation: &Observation) -> bool {
        let noise = self.noise;
        self.residual(observation).is_some_and(|residual| {
            let off_px = libm::hypot(residual.pixel_px[0], residual.pixel_px[1]);
            off_px <= OUTLIER_SIGMAS * noise.pixel_px
                && residual.radius_px.abs() <= OUTLIER_SIGMAS * noise.radius_px
        })
    }

    /// Estimates the noise of the detections from the residuals, robustly. It is that of all cameras together: the path would
    /// follow ever more closely a camera that is taken for more exact than the others.
    pub(super) fn update_noise(&mut self) {
        let seen = self.observations.iter().zip(&self.weights);
        let moving = seen.filter(|(_, weight)| **weight > 0.5);
        let residuals: Vec<Residual> = moving.filter_map(|(seen, _)| self.residual(seen)).collect();
        let lengths = residuals.iter();
        let lengths = lengths.map(|r| libm::hypot(r.pixel_px[0], r.pixel_px[1]));
        let sizes = residuals.iter().map(|r| r.radius_px.abs());
        // The path follows the noise, too: as many coordinates as it has unknowns leave no residuals.
        let coordinates = 2.0 * self.observations.len() as f64;
        let left = coordinates - 3.0 * self.constrained_controls() as f64;
        let grown = (coordinates / left.max(0.1 * coordinates)).sqrt();
        // Of Gaussian residuals, the median length is 1.1774 standard deviations of a coordinate, and the median of the
        // absolute value 0.6745 of them.
        let pixel_px = median(&mut lengths.collect::<Vec<_>>()).map(|m| grown * m / 1.1774);
        let radius_px = median(&mut sizes.collect::<Vec<_>>()).map(|m| m / 0.6745);
        if let (Some(pixel_px), Some(radius_px)) = (pixel_px, radius_px) {
            self.noise = Noise {
                pixel_px: pixel_px.max(LEAST_NOISE_PX),
                radius_px: radius_px.max(LEAST_NOISE_PX),
            };
        }
    }

    /// Returns by how much variances grow because the errors of a camera in consecutive frames are alike: shadows and
    /// fingers move along with the ball.
    pub(super) fn inflation(&self) -> f64 {
        let (mut products, mut squares) = (0.0, 0.0);
        for pair in self.observations.windows(2) {
            if pair[0].camera != pair[1].camera || pair[1].frame != pair[0].frame + 1 {
                continue;
            }
            if let [Some(a), Some(b)] = [&pair[0], &pair[1]].map(|seen| self.residual(seen)) {
                let (a, b) = (a.pixel_px, b.pixel_px);
                products += a[0] * b[0] + a[1] * b[1];
                squares += 0.5 * (a[0] * a[0] + a[1] * a[1] + b[0] * b[0] + b[1] * b[1]);
            }
        }
        let correlation = if squares > 0.0 {
            products / squares
        } else {
            0.0
        };
        let correlation = correlation.clamp(0.0, MAX_CORRELATION);
        (1.0 + correlation) / (1.0 - correlation)
    }

    /// Returns where the ball was at the time of each observation: time of the first camera in seconds, position in metres.
    pub(super) fn places(&self) -> Vec<(f64, [f64; 3])> {
        let place = |seen: &Observation| {
            let time_s = seen.time_s + self.cameras[seen.camera].offset_s;
            Some((time_s, self.path.position_m(time_s)?.into()))
        };
        let mut places: Vec<(f64, [f64; 3])> = self.observations.iter().filter_map(place).collect();
        places.sort_by(|a, b| a.0.total_cmp(&b.0));
        // Cameras with a common trigger share their times.
        places.dedup_by(|later, earlier| later.0 - earlier.0 < SAME_TIME_S);
        places
    }

    /// Returns the number of control points that influence at least one observation.
    pub(super) fn constrained_controls(&self) -> usize {
        let mut touched = vec![false; self.path.controls_m.len()];
        for observation in self.observations {
            let time_s = observation.time_s + self.cameras[observation.camera].offset_s;
            if let Some(basis) = self.path.basis(time_s) {
                touched[basis.first..basis.first + 4].fill(true);
            }
        }
        touched.iter().filter(|t| **t).count()
    }

    fn visit_observation(
        &self,
        (observation, weight): (&Observation, f64),
        visit: &mut dyn FnMut(Option<[f64; 2]>, Slopes<'_>),
    ) {
        let camera = observation.camera;
        let of = &self.cameras[camera];
        let at_point = self.point_in_camera(camera, observation.time_s);
        let found = at_point.and_then(|(basis, point)| {
            let jacobian = of.camera.project_with_jacobian(point.into())?;
            Some((basis, point, jacobian))
        });
        let Some((basis, point, jacobian)) = found else {
            visit(None, Slopes { blocks: &[] });
            return;
        };
        let distance_m = point.coords.norm();
        let grown = 1.0 / weight.sqrt();
        let [pixel_px, radius_px] = [self.noise.pixel_px, self.noise.radius_px].map(|s| grown * s);
        let sigma = [pixel_px, pixel_px, radius_px];
        // By the point in the camera's frame: two coordinates of the pixel, and the radius.
        let by_point = [
            Vector3::from(jacobian.by_point[0]) / sigma[0],
            Vector3::from(jacobian.by_point[1]) / sigma[1],
            point.coords * (observation.radius_px / (distance_m * distance_m * sigma[2])),
        ];
        let velocity_mps =
            of.camera_from_world.rotation * self.path.weighted(basis.first, basis.slopes_per_s);
        let rotation = of.camera_from_world.rotation.matrix();
        let by_control = by_point.map(|row| rotation.tr_mul(&row));
        let rotated = point.coords - of.camera_from_world.translation.vector;
        let focal = focal_places(&of.camera);
        let by_focal = [0, 1].map(|i| {
            let parameters = of.camera.parameters();
            let slope = |&place: &usize| jacobian.by_parameters[place][i] * parameters[place].1;
            focal.iter().map(slope).sum::<f64>() / sigma[i]
        });
        let lens_at = self.path_unknowns() + self.lens_at(camera);
        let place_at = self.path_unknowns() + Self::place_at(camera.max(1));
        let mut block = |residual: [f64; 2], rows: [usize; 2], lens: [[f64; 2]; 2]| {
            // A missing second coordinate is zero.
            let pair = |values: [f64; 3]| rows.map(|row| values.get(row).copied().unwrap_or(0.0));
            let of_control =
                |i: usize| pair(by_control.map(|row| row[i % 3] * basis.weights[i / 3]));
            let by_path: [[f64; 2]; 12] = std::array::from_fn(of_control);
            let by_place: [[f64; 2]; PLACE] = std::array::from_fn(|i| {
                pair(by_point.map(|row| match i {
                    0..3 => row.dot(&Vector3::ith(i, 1.0).cross(&rotated)),
                    3..6 => row[i - 3],
                    _ => row.dot(&velocity_mps),
                }))
            });
            let path = (3 * basis.first, &by_path[..]);
            let lens = (lens_at, &lens[..=usize::from(of.is_focal_free)]);
            let place = (place_at, &by_place[..]);
            let with_place = [path, place, lens];
            let blocks: &[_] = if camera == 0 {
                &[path, lens]
            } else {
                &with_place
            };
            visit(Some(residual), Slopes { blocks });
        };
        let [u, v] = jacobian.pixel;
        let pixel = [u - observation.pixel[0], v - observation.pixel[1]];
        block(
            [pixel[0] / sigma[0], pixel[1] / sigma[1]],
            [0, 1],
            [[0.0; 2], by_focal],
        );
        let radius = self.radius_excess_px(observation, distance_m) / sigma[2];
        let by_bias = [-1.0 / sigma[2], 0.0];
        let by_focal = [-observation.radius_px / sigma[2], 0.0];
        block([radius, 0.0], [2, 3], [by_bias, by_focal]);
    }

    fn visit_priors(&self, visit: &mut dyn FnMut(Option<[f64; 2]>, Slopes<'_>)) {
        for (number, of) in self.cameras.iter().enumerate() {
            let at = self.path_unknowns() + self.lens_at(number);
            let shared = 1.0 / SHARED_SIZE_SIGMA_PX;
            let focal = 1.0 / FOCAL_SIGMA;
            let slopes = [[shared, 0.0], [0.0, focal]];
            let residual = [of.size_bias_px * shared, of.log_focal * focal];
            let lens = (at, &slopes[..=usize::from(of.is_focal_free)]);
            visit(Some(residual), Slopes { blocks: &[lens] });
            if of.has_first_clock && number > 0 {
                let at = self.path_unknowns() + Self::offset_at(number);
                let residual = [of.offset_s / HELD_S, 0.0];
                let slope: &[[f64; 2]] = &[[1.0 / HELD_S, 0.0]];
                visit(
                    Some(residual),
                    Slopes {
                        blocks: &[(at, slope)],
                    },
                );
            }
        }
        self.path.visit_stiffness(self.stiffness, visit);
    }
}

/// Returns how much each observation counts: less than 1 where the ball hardly moves in the image, because its outline then has the
/// same error in every frame.
pub(super) fn weights(observations: &[Observation]) -> Vec<f64> {
    let moved_px = |a: &Observation, b: &Observation| {
        let is_next = a.camera == b.camera;
        is_next.then(|| libm::hypot(b.pixel[0] - a.pixel[0], b.pixel[1] - a.pixel[1]))
    };
    let weight = |(number, seen): (usize, &Observation)| {
        let before = number.checked_sub(1).map(|before| &observations[before]);
        let before = before.and_then(|before| moved_px(before, seen));
        let after = observations.get(number + 1);
        let after = after.and_then(|after| moved_px(seen, after));
        let moved_px = before.into_iter().chain(after).reduce(f64::max);
        (moved_px.unwrap_or(0.0) / OWN_ERROR_PX).clamp(LEAST_WEIGHT, 1.0)
    };
    observations.iter().enumerate().map(weight).collect()
}

/// Returns the places of the focal lengths among the parameters of a camera, which scale its image.
pub(super) fn focal_places(camera: &Camera) -> Vec<usize> {
    const NAMES: [&str; 5] = ["fx_px", "fy_px", "f_px", "f_px_per_rad", "m_px"];
    let parameters = camera.parameters();
    let places = parameters.iter().enumerate();
    let is_focal = |name: &str| NAMES.contains(&name);
    places
        .filter(|(_, (name, _))| is_focal(name))
        .map(|(place, _)| place)
        .collect()
}

impl Problem for RigFit<'_> {
    fn unknowns(&self) -> usize {
        self.path_unknowns() + self.lens_at(self.cameras.len())
    }

    fn band(&self) -> Band {
        Band {
            unknowns: self.path_unknowns(),
            width: 12,
        }
    }

    fn stepped(&self, step: &DVector<f64>) -> Option<Self> {
        let mut next = self.clone();
        let path_unknowns = self.path_unknowns();
        next.path.step(&step.as_slice()[..path_unknowns]);
        let step = &step.as_slice()[path_unknowns..];
        for (number, of) in next.cameras.iter_mut().enumerate() {
            if number > 0 {
                let at = Self::place_at(number);
                of.camera_from_world = stepped_pose(&of.camera_from_world, &step[at..at + 6]);
                of.offset_s += step[Self::offset_at(number)];
            }
            let at = self.lens_at(number);
            of.size_bias_px += step[at];
            if of.is_focal_free {
                let change = step[at + 1];
                of.log_focal += change;
                let mut values: Vec<f64> = of.camera.parameters().iter().map(|p| p.1).collect();
                for place in focal_places(&of.camera) {
                    values[place] *= libm::exp(change);
                }
                of.camera = of.camera.with_parameters(&values).ok()?;
            }
        }
        let inside = |observation: &Observation| {
            let time_s = observation.time_s + next.cameras[observation.camera].offset_s;
            next.path.basis(time_s).is_some()
        };
        next.observations.iter().all(inside).then_some(next)
    }

    fn visit(&self, visit: &mut dyn FnMut(Option<[f64; 2]>, Slopes<'_>)) {
        for (observation, weight) in self.observations.iter().zip(&self.weights) {
            self.visit_observation((observation, *weight), visit);
        }
        self.visit_priors(visit);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pardalis_camera::Pinhole;

    /// Returns the residuals with their derivatives with respect to all unknowns.
    fn evaluated(fit: &RigFit) -> Vec<([f64; 2], Vec<[f64; 2]>)> {
        let mut rows = Vec::new();
        fit.visit(&mut |residual, slopes| {
            let mut all = vec![[0.0; 2]; fit.unknowns()];
            for &(start, block) in slopes.blocks {
                all[start..start + block.len()].copy_from_slice(block);
            }
            rows.push((residual.unwrap(), all));
        });
        rows
    }

    #[test]
    fn derivatives_match_finite_differences() {
        let fitted = |x: f64, is_focal_free: bool| FittedCamera {
            camera: Camera::Pinhole(
                Pinhole::new([300.0, 310.0], [160.0, 120.0], &[-0.1, 0.01, 0.0, 0.0]).unwrap(),
            ),
            camera_from_world: stepped_pose(
                &Pose::translation(x, 0.1, 0.2),
                &[0.1 * x, 0.05, -0.02, 0.0, 0.0, 0.0],
            ),
            offset_s: 0.01 * x,
            has_first_clock: false,
            size_bias_px: 0.1 * x,
            log_focal: 0.02 * x,
            is_focal_free,
        };
        let points: Vec<(f64, Point3<f64>)> = (0..12)
            .map(|i| {
                let t = 0.04 * f64::from(i);
                (t, Point3::new(0.1 + t * t, 0.2 * t - 0.1, 2.0 - t))
            })
            .collect();
        let observations: Vec<Observation> = (0..24)
            .map(|i| Observation {
                camera: i / 8,
                frame: i % 8,
                time_s: 0.04 * (i % 8) as f64,
                pixel: [170.0, 110.0],
                radius_px: 5.0 + i as f64,
                distance_m: 2.0,
            })
            .collect();
        let fit = RigFit {
            cameras: vec![fitted(0.0, true), fitted(0.5, false), fitted(-0.4, true)],
            weights: (0..24).map(|i| 0.1 + 0.03 * f64::from(i)).collect(),
            observations: &observations,
            path: Path::near(&points, -0.1, 0.6, 0.07),
            noise: Noise {
                pixel_px: 0.3,
                radius_px: 0.4,
            },
            stiffness: 0.5,
        };
        let here = evaluated(&fit);
        let step = 1e-6;
        for unknown in 0..fit.unknowns() {
            let stepped = |by: f64| {
                let mut step = DVector::zeros(fit.unknowns());
                step[unknown] = by;
                evaluated(&fit.stepped(&step).unwrap())
            };
            let (before, after) = (stepped(-step), stepped(step));
            for (row, (_, slopes)) in here.iter().enumerate() {
                for i in 0..2 {
                    let measured = (after[row].0[i] - before[row].0[i]) / (2.0 * step);
                    let error = (measured - slopes[unknown][i]).abs();
                    let scale = 1.0 + slopes[unknown][i].abs();
                    assert!(
                        error < 1e-5 * scale,
                        "row {row}, unknown {unknown}: {error}"
                    );
                }
            }
        }
    }
}
