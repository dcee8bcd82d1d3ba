//! The target's path as a smooth curve in time, fitted together with the time offsets.

use nalgebra::{DVector, Point3, Vector3};

use super::super::least_squares::{Problem, Slopes};
use pardalis::view::View;

/// Uniform cubic B-spline in time through space.
#[derive(Debug, Clone)]
pub(crate) struct Path {
    start_s: f64,
    interval_s: f64,
    pub(crate) controls_m: Vec<Vector3<f64>>,
}

/// The control points with influence at one time, and their weights.
pub(crate) struct Basis {
    /// Index of the first of four control points.
    pub(crate) first: usize,
    pub(crate) weights: [f64; 4],
    /// Derivatives of the weights with respect to time, per second.
    pub(crate) slopes_per_s: [f64; 4],
}

impl Path {
    /// Builds a curve near these points (time in seconds, position in metres) from `start_s` to `end_s`. The
    /// points, at least one, are in order of time.
    pub(crate) fn near(
        points: &[(f64, Point3<f64>)],
        start_s: f64,
        end_s: f64,
        interval_s: f64,
    ) -> Self {
        let pieces = ((end_s - start_s) / interval_s).ceil().max(1.0) as usize;
        let control = |i: usize| {
            // A control point has the most influence at the middle of its support.
            let time_s = start_s + (i as f64 - 1.0) * interval_s;
            let next = points.partition_point(|(at_s, _)| *at_s < time_s);
            match (next.checked_sub(1).map(|i| points[i]), points.get(next)) {
                (Some((before_s, before)), Some((after_s, after))) => {
                    let share = (time_s - before_s) / (after_s - before_s);
                    before.coords.lerp(&after.coords, share)
                }
                (Some((_, point)), None) | (None, Some(&(_, point))) => point.coords,
                (None, None) => Vector3::zeros(),
            }
        };
        Self {
            start_s,
            interval_s,
            controls_m: (0..pieces + 3).map(control).collect(),
        }
    }

    /// Returns the weights at a time; `None` outside the curve.
    pub(crate) fn basis(&self, time_s: f64) -> Option<Basis> {
        let place = (time_s - self.start_s) / self.interval_s;
        let pieces = self.controls_m.len() - 3;
        if !(place >= 0.0 && place <= pieces as f64) {
            return None;
        }
        let first = (place as usize).min(pieces - 1);
        let t = place - first as f64;
        let s = 1.0 - t;
        let weights = [
            s * s * s,
            3.0 * t * t * t - 6.0 * t * t + 4.0,
            3.0 * s * s * s - 6.0 * s * s + 4.0,
            t * t * t,
        ];
        let slopes = [-s * s, 3.0 * t * t - 4.0 * t, -3.0 * s * s + 4.0 * s, t * t];
        Some(Basis {
            first,
            weights: weights.map(|w| w / 6.0),
            slopes_per_s: slopes.map(|w| 0.5 * w / self.interval_s),
        })
    }

    pub(crate) fn weighted(&self, first: usize, weights: [f64; 4]) -> Vector3<f64> {
        let controls = &self.controls_m[first..first + 4];
        controls.iter().zip(weights).map(|(c, w)| c * w).sum()
    }

    /// Returns the position at a time; `None` outside the curve.
    pub(crate) fn position_m(&self, time_s: f64) -> Option<Point3<f64>> {
        let basis = self.basis(time_s)?;
        Some(self.weighted(basis.first, basis.weights).into())
    }

    /// Calls `visit` with the second differences of the control points times a stiffness per metre, and their
    /// derivatives.
    pub(crate) fn visit_stiffness(
        &self,
        stiffness: f64,
        visit: &mut dyn FnMut(Option<[f64; 2]>, Slopes<'_>),
    ) {
        for (first, c) in self.controls_m.windows(3).enumerate() {
            let difference = (c[0] - 2.0 * c[1] + c[2]) * stiffness;
            // Two coordinates at a time, as in pixels: x and y, then z.
            for (residual, places) in [
                ([difference.x, difference.y], [Some(0), Some(1)]),
                ([difference.z, 0.0], [Some(2), None]),
            ] {
                let mut slopes = [[0.0; 2]; 9];
                for (control, factor) in [1.0, -2.0, 1.0].into_iter().enumerate() {
                    for (coordinate, place) in places.into_iter().enumerate() {
                        if let Some(place) = place {
                            slopes[3 * control + place][coordinate] = factor * stiffness;
                        }
                    }
                }
                let blocks = &[(3 * first, slopes.as_slice())];
                visit(Some(residual), Slopes { blocks });
            }
        }
    }

    /// Moves the control points by three coordinates each.
    pub(crate) fn step(&mut self, step: &[f64]) {
        for (control, by) in self.controls_m.iter_mut().zip(step.chunks_exact(3)) {
            *control += Vector3::new(by[0], by[1], by[2]);
        }
    }
}

/// Largest correlation that is applied: with a larger one, the first residual of a camera would hardly count.
const MAX_CORRELATION: f64 = 0.98;

/// A detection with its camera and time.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Observation {
    /// Index of the camera.
    pub(crate) camera: usize,
    /// Index of the frame among those of its camera.
    pub(crate) frame: usize,
    /// Time of the exposure by the clock of the camera, in seconds.
    pub(crate) time_s: f64,
    /// Pixel of the target's middle.
    pub(crate) pixel: [f64; 2],
    /// Radius of its image, in pixels.
    pub(crate) radius_px: f64,
    /// Distance from the camera by its size, in metres.
    pub(crate) distance_m: f64,
}

/// The least-squares problem: distances between the detections and the images of the path. The unknowns are
/// three per control point and, if the offsets are free, the offset of each camera but the first.
#[derive(Clone)]
pub(super) struct PathFit<'a> {
    pub(super) views: &'a [&'a View],
    pub(super) observations: &'a [Observation],
    pub(super) path: Path,
    /// Seconds added to each camera's time stamps; the first camera is the reference.
    pub(super) offsets_s: Vec<f64>,
    pub(super) offsets_are_free: bool,
    /// Median time between two frames of each camera, in seconds.
    pub(super) intervals_s: &'a [f64],
    /// Correlation between the errors of a camera in consecutive frames: shadows and occluding edges move
    /// along with the target.
    pub(super) correlation: f64,
    /// Cost of the control points' second differences, in pixels per metre: so small that it matters only
    /// where there are no detections.
    pub(super) stiffness: f64,
}

impl PathFit<'_> {
    /// Returns the path's point at a camera's time stamp, in the camera's frame.
    fn point_in_camera(&self, camera: usize, time_s: f64) -> Option<(Basis, Point3<f64>)> {
        let basis = self.path.basis(time_s + self.offsets_s[camera])?;
        let point = Point3::from(self.path.weighted(basis.first, basis.weights));
        Some((basis, self.views[camera].camera_from_world() * point))
    }

    /// Returns observed minus fitted pixel; `None` if the path's point has no pixel.
    pub(super) fn residual_px(&self, observation: &Observation) -> Option<[f64; 2]> {
        let (_, point) = self.point_in_camera(observation.camera, observation.time_s)?;
        let [u, v] = self.views[observation.camera]
            .camera()
            .project(point.into())?;
        Some([observation.pixel[0] - u, observation.pixel[1] - v])
    }

    /// Returns the number of unknowns of the path.
    pub(super) fn path_unknowns(&self) -> usize {
        3 * self.path.controls_m.len()
    }

    /// Returns the number of control points that influence at least one observation.
    pub(super) fn constrained_controls(&self) -> usize {
        let mut touched = vec![false; self.path.controls_m.len()];
        for observation in self.observations {
            if let Some(basis) = self
                .path
                .basis(observation.time_s + self.offsets_s[observation.camera])
            {
                touched[basis.first..basis.first + 4].fill(true);
            }
        }
        touched.iter().filter(|t| **t).count()
    }

    /// Reports whether two observations belong to consecutive frames of one camera.
    fn is_next(&self, last: &Observation, observation: &Observation) -> bool {
        let step_s = observation.time_s - last.time_s;
        last.camera == observation.camera && step_s < 1.5 * self.intervals_s[observation.camera]
    }

    /// Returns the correlation of residuals between consecutive frames, at least 0.
    pub(super) fn measured_correlation(&self) -> f64 {
        let (mut products, mut squares) = (0.0, 0.0);
        for pair in self
            .observations
            .windows(2)
            .filter(|p| self.is_next(&p[0], &p[1]))
        {
            let residuals = [&pair[0], &pair[1]].map(|observation| self.residual_px(observation));
            if let [Some(a), Some(b)] = residuals {
                products += a[0] * b[0] + a[1] * b[1];
                squares += 0.5 * (a[0] * a[0] + a[1] * a[1] + b[0] * b[0] + b[1] * b[1]);
            }
        }
        if squares > 0.0 {
            (products / squares).clamp(0.0, MAX_CORRELATION)
        } else {
            0.0
        }
    }

    /// Returns the residual of an observation, fitted minus observed, with its derivatives.
    fn row(&self, observation: &Observation) -> Option<Row> {
        let view = self.views[observation.camera];
        let (basis, point) = self.point_in_camera(observation.camera, observation.time_s)?;
        let jacobian = view.camera().project_with_jacobian(point.into())?;
        let rotation = view.camera_from_world().rotation.matrix();
        let by_point: [[f64; 3]; 2] = jacobian.by_point.map(|row| {
            let row = Vector3::from(row).transpose() * rotation;
            [row.x, row.y, row.z]
        });
        let velocity_mps = self.path.weighted(basis.first, basis.slopes_per_s);
        let slope = |i: usize| by_point.map(|row| row[i % 3] * basis.weights[i / 3]);
        Some(Row {
            first: basis.first,
            residual: [0, 1].map(|i| jacobian.pixel[i] - observation.pixel[i]),
            by_controls: (0..12).map(slope).collect(),
            by_offset: by_point.map(|row| Vector3::from(row).dot(&velocity_mps)),
        })
    }

    /// Calls `visit` with the residuals of the observations, without those of the stiffness. Within a run of
    /// frames, each residual is reduced by its correlation with the previous one, so that the residuals are
    /// independent.
    pub(super) fn visit_observations(&self, visit: &mut dyn FnMut(Option<[f64; 2]>, Slopes<'_>)) {
        let offsets_at = self.path_unknowns();
        let mut last: Option<(&Observation, Row)> = None;
        for observation in self.observations {
            let Some(row) = self.row(observation) else {
                visit(None, Slopes { blocks: &[] });
                last = None;
                continue;
            };
            let new = match &last {
                Some((before, last)) if self.is_next(before, observation) => {
                    row.without(last, self.correlation)
                }
                _ => row.scaled((1.0 - self.correlation * self.correlation).sqrt()),
            };
            let with_offset = self.offsets_are_free && observation.camera > 0;
            let offset_at = offsets_at + observation.camera.max(1) - 1;
            let blocks: &[(usize, &[[f64; 2]])] = &[
                (3 * new.first, &new.by_controls),
                (offset_at, &[new.by_offset]),
            ];
            let blocks = &blocks[..=usize::from(with_offset)];
            visit(Some(new.residual), Slopes { blocks });
            last = Some((observation, row));
        }
    }
}

/// A residual and its derivatives.
struct Row {
    /// Index of the first control point with influence.
    first: usize,
    residual: [f64; 2],
    /// With respect to the three coordinates of each control point from the first on.
    by_controls: Vec<[f64; 2]>,
    by_offset: [f64; 2],
}

impl Row {
    fn scaled(&self, factor: f64) -> Self {
        let scale = |pair: &[f64; 2]| pair.map(|value| factor * value);
        Self {
            first: self.first,
            residual: scale(&self.residual),
            by_controls: self.by_controls.iter().map(scale).collect(),
            by_offset: scale(&self.by_offset),
        }
    }

    /// Subtracts a share of another row whose time is not later.
    fn without(&self, last: &Self, share: f64) -> Self {
        let less = |a: [f64; 2], b: [f64; 2]| [0, 1].map(|i| a[i] - share * b[i]);
        let first = last.first.min(self.first);
        let controls = (self.first + 4).max(last.first + 4) - first;
        let mut by_controls = vec![[0.0; 2]; 3 * controls];
        for (row, factor) in [(self, 1.0), (last, -share)] {
            let from = 3 * (row.first - first);
            for (sum, slopes) in by_controls[from..].iter_mut().zip(&row.by_controls) {
                *sum = [0, 1].map(|i| sum[i] + factor * slopes[i]);
            }
        }
        Self {
            first,
            residual: less(self.residual, last.residual),
            by_controls,
            by_offset: less(self.by_offset, last.by_offset),
        }
    }
}

impl Problem for PathFit<'_> {
    fn unknowns(&self) -> usize {
        let offsets = if self.offsets_are_free {
            self.views.len() - 1
        } else {
            0
        };
        self.path_unknowns() + offsets
    }

    fn stepped(&self, step: &DVector<f64>) -> Option<Self> {
        let mut next = self.clone();
        next.path.step(&step.as_slice()[..self.path_unknowns()]);
        let steps = step.iter().skip(self.path_unknowns());
        for (offset_s, step_s) in next.offsets_s[1..].iter_mut().zip(steps) {
            *offset_s += step_s;
        }
        let inside = |observation: &Observation| {
            let time_s = observation.time_s + next.offsets_s[observation.camera];
            next.path.basis(time_s).is_some()
        };
        next.observations.iter().all(inside).then_some(next)
    }

    fn visit(&self, visit: &mut dyn FnMut(Option<[f64; 2]>, Slopes<'_>)) {
        self.visit_observations(visit);
        self.path.visit_stiffness(self.stiffness, visit);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pardalis_camera::Pose;
    use pardalis_camera::{Camera, Pinhole};

    /// Returns the residuals with their derivatives with respect to all unknowns.
    fn evaluated(fit: &PathFit) -> Vec<([f64; 2], Vec<[f64; 2]>)> {
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
        let camera = Camera::Pinhole(Pinhole::new([300.0; 2], [160.0, 120.0], &[]).unwrap());
        let beside = Pose::translation(0.5, 0.1, 0.2);
        let views = [Pose::identity(), beside]
            .map(|pose| View::new(camera.clone(), pose, (320, 240), None).unwrap());
        let views: Vec<&View> = views.iter().collect();
        let points: Vec<(f64, Point3<f64>)> = (0..12)
            .map(|i| {
                let t = 0.04 * f64::from(i);
                (t, Point3::new(0.1 + t * t, 0.2 * t - 0.1, 2.0 - t))
            })
            .collect();
        let observations: Vec<Observation> = (0..16)
            .map(|i| Observation {
                camera: i / 8,
                frame: i % 8,
                // One frame is missing, which ends a run.
                time_s: 0.04 * (i % 8) as f64 + if i % 8 > 4 { 0.04 } else { 0.0 },
                pixel: [170.0, 110.0],
                radius_px: 5.0,
                distance_m: 2.0,
            })
            .collect();
        let fit = PathFit {
            views: &views,
            observations: &observations,
            path: Path::near(&points, -0.1, 0.6, 0.07),
            offsets_s: vec![0.0, 0.013],
            offsets_are_free: true,
            intervals_s: &[0.04, 0.04],
            correlation: 0.6,
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
                    assert!(error < 1e-3, "row {row}, unknown {unknown}: {error}");
                }
            }
        }
    }

    #[test]
    fn path_is_undefined_beyond_its_ends() {
        let points = [(0.0, Point3::new(1.0, 2.0, 3.0))];
        let path = Path::near(&points, 0.0, 1.0, 0.3);
        for inside_s in [0.0, 0.5, 1.0] {
            let position = path.position_m(inside_s).unwrap();
            assert!((position - points[0].1).norm() < 1e-12);
        }
        for outside_s in [-1e-9, 1.3, f64::NAN, f64::INFINITY] {
            assert_eq!(path.position_m(outside_s), None);
        }
    }
}
