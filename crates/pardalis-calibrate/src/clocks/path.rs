//! The target's path as a smooth curve in time, fitted together with the clocks' offsets.

use nalgebra::{DVector, Point3, Vector3};

use super::super::least_squares::{Problem, Slopes};
use pardalis::view::View;

/// A curve in space: a uniform cubic B-spline in time.
#[derive(Debug, Clone)]
pub(super) struct Path {
    start_s: f64,
    interval_s: f64,
    controls_m: Vec<Vector3<f64>>,
}

/// The control points that matter at a time, and how much they do.
pub(super) struct Basis {
    /// The first of four control points.
    pub(super) first: usize,
    weights: [f64; 4],
    /// Derivatives of the weights by time, per second.
    slopes_per_s: [f64; 4],
}

impl Path {
    /// The curve through about these points (time in seconds, position in metres), which are at least one and in the order of time. It reaches
    /// from `start_s` to `end_s`.
    pub(super) fn near(
        points: &[(f64, Point3<f64>)],
        start_s: f64,
        end_s: f64,
        interval_s: f64,
    ) -> Self {
        let pieces = ((end_s - start_s) / interval_s).ceil().max(1.0) as usize;
        let control = |i: usize| {
            // A control point pulls most at the middle of its reach.
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

    /// The weights at a time; `None` beyond the curve's ends.
    pub(super) fn basis(&self, time_s: f64) -> Option<Basis> {
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

    fn weighted(&self, first: usize, weights: [f64; 4]) -> Vector3<f64> {
        let controls = &self.controls_m[first..first + 4];
        controls.iter().zip(weights).map(|(c, w)| c * w).sum()
    }

    /// The position at a time; `None` beyond the curve's ends.
    pub(super) fn position_m(&self, time_s: f64) -> Option<Point3<f64>> {
        let basis = self.basis(time_s)?;
        Some(self.weighted(basis.first, basis.weights).into())
    }
}

/// The largest correlation that is believed: with more, a camera's first residual would hardly count.
const MAX_CORRELATION: f64 = 0.98;

/// A pixel where a camera saw the middle of the target.
#[derive(Debug, Clone, Copy)]
pub(super) struct Seen {
    /// The camera's number.
    pub(super) camera: usize,
    /// The camera's time stamp, in seconds.
    pub(super) time_s: f64,
    /// The pixel.
    pub(super) pixel: [f64; 2],
}

/// What is minimised: the distances between what cameras saw and the path's images. The unknowns: three a control point, then, where they
/// are free, the offset of each camera but the first.
#[derive(Clone)]
pub(super) struct PathFit<'a> {
    pub(super) views: &'a [&'a View],
    pub(super) seen: &'a [Seen],
    pub(super) path: Path,
    /// What is added to each camera's time stamps, in seconds; the first is the reference.
    pub(super) offsets_s: Vec<f64>,
    pub(super) offsets_are_free: bool,
    /// The usual time between two frames of each camera, in seconds.
    pub(super) intervals_s: &'a [f64],
    /// How much of what a camera saw amiss in a frame it sees amiss in the next: shadows and edges of things go along with the target.
    pub(super) correlation: f64,
    /// What the control points' second differences cost, in pixels a metre: so little that it matters only where nothing is seen.
    pub(super) stiffness: f64,
}

impl PathFit<'_> {
    /// Where the path's point at a time stamp of a camera is seen.
    fn point_in_camera(&self, camera: usize, time_s: f64) -> Option<(Basis, Point3<f64>)> {
        let basis = self.path.basis(time_s + self.offsets_s[camera])?;
        let point = Point3::from(self.path.weighted(basis.first, basis.weights));
        Some((basis, self.views[camera].camera_from_world() * point))
    }

    /// Observed minus fitted pixel; `None` where the path is not seen.
    pub(super) fn residual_px(&self, seen: &Seen) -> Option<[f64; 2]> {
        let (_, point) = self.point_in_camera(seen.camera, seen.time_s)?;
        let [u, v] = self.views[seen.camera].camera().project(point.into())?;
        Some([seen.pixel[0] - u, seen.pixel[1] - v])
    }

    /// The number of unknowns of the path.
    pub(super) fn path_unknowns(&self) -> usize {
        3 * self.path.controls_m.len()
    }

    /// The number of control points that what is seen depends on.
    pub(super) fn controls_seen(&self) -> usize {
        let mut touched = vec![false; self.path.controls_m.len()];
        for seen in self.seen {
            if let Some(basis) = self.path.basis(seen.time_s + self.offsets_s[seen.camera]) {
                touched[basis.first..basis.first + 4].fill(true);
            }
        }
        touched.iter().filter(|t| **t).count()
    }

    /// Pairs of neighbours among what is seen, where both are of one camera and one frame apart.
    fn is_next(&self, last: &Seen, seen: &Seen) -> bool {
        let step_s = seen.time_s - last.time_s;
        last.camera == seen.camera && step_s < 1.5 * self.intervals_s[seen.camera]
    }

    /// The correlation of residuals from frame to frame, not below 0.
    pub(super) fn measured_correlation(&self) -> f64 {
        let (mut products, mut squares) = (0.0, 0.0);
        for pair in self.seen.windows(2).filter(|p| self.is_next(&p[0], &p[1])) {
            let residuals = [&pair[0], &pair[1]].map(|seen| self.residual_px(seen));
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

    /// The residual of a sighting, fitted minus observed, with its slopes.
    fn row(&self, seen: &Seen) -> Option<Row> {
        let view = self.views[seen.camera];
        let (basis, point) = self.point_in_camera(seen.camera, seen.time_s)?;
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
            residual: [0, 1].map(|i| jacobian.pixel[i] - seen.pixel[i]),
            by_controls: (0..12).map(slope).collect(),
            by_offset: by_point.map(|row| Vector3::from(row).dot(&velocity_mps)),
        })
    }

    /// Calls `visit` with what is seen, but not with the stiffness: residuals of one frame after another as what is new in them, so that they do not
    /// depend on one another.
    pub(super) fn visit_seen(&self, visit: &mut dyn FnMut(Option<[f64; 2]>, Slopes<'_>)) {
        let offsets_at = self.path_unknowns();
        let mut last: Option<(&Seen, Row)> = None;
        for seen in self.seen {
            let Some(row) = self.row(seen) else {
                visit(None, Slopes { blocks: &[] });
                last = None;
                continue;
            };
            let new = match &last {
                Some((before, last)) if self.is_next(before, seen) => {
                    row.without(last, self.correlation)
                }
                _ => row.scaled((1.0 - self.correlation * self.correlation).sqrt()),
            };
            let with_offset = self.offsets_are_free && seen.camera > 0;
            let offset_at = offsets_at + seen.camera.max(1) - 1;
            let blocks: &[(usize, &[[f64; 2]])] = &[
                (3 * new.first, &new.by_controls),
                (offset_at, &[new.by_offset]),
            ];
            let blocks = &blocks[..=usize::from(with_offset)];
            visit(Some(new.residual), Slopes { blocks });
            last = Some((seen, row));
        }
    }

    fn visit_stiffness(&self, visit: &mut dyn FnMut(Option<[f64; 2]>, Slopes<'_>)) {
        for (first, c) in self.path.controls_m.windows(3).enumerate() {
            let difference = (c[0] - 2.0 * c[1] + c[2]) * self.stiffness;
            // Two coordinates at a time, as pixels have: x and y, then z.
            for (residual, places) in [
                ([difference.x, difference.y], [Some(0), Some(1)]),
                ([difference.z, 0.0], [Some(2), None]),
            ] {
                let mut slopes = [[0.0; 2]; 9];
                for (control, factor) in [1.0, -2.0, 1.0].into_iter().enumerate() {
                    for (coordinate, place) in places.into_iter().enumerate() {
                        if let Some(place) = place {
                            slopes[3 * control + place][coordinate] = factor * self.stiffness;
                        }
                    }
                }
                let blocks = &[(3 * first, slopes.as_slice())];
                visit(Some(residual), Slopes { blocks });
            }
        }
    }
}

/// A residual and how it moves with the unknowns.
struct Row {
    /// The first control point that matters.
    first: usize,
    residual: [f64; 2],
    /// By three coordinates of each control point from the first on.
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

    /// Less a share of another row, whose time is not later.
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
        for (i, control) in next.path.controls_m.iter_mut().enumerate() {
            *control += step.fixed_rows::<3>(3 * i);
        }
        let steps = step.iter().skip(self.path_unknowns());
        for (offset_s, step_s) in next.offsets_s[1..].iter_mut().zip(steps) {
            *offset_s += step_s;
        }
        let inside = |seen: &Seen| {
            let time_s = seen.time_s + next.offsets_s[seen.camera];
            next.path.basis(time_s).is_some()
        };
        next.seen.iter().all(inside).then_some(next)
    }

    fn visit(&self, visit: &mut dyn FnMut(Option<[f64; 2]>, Slopes<'_>)) {
        self.visit_seen(visit);
        self.visit_stiffness(visit);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pardalis_camera::Pose;
    use pardalis_camera::{Camera, Pinhole};

    /// Residuals, and each one's slopes by all unknowns.
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
    fn slopes_are_those_of_the_residuals() {
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
        let seen: Vec<Seen> = (0..16)
            .map(|i| Seen {
                camera: i / 8,
                // One frame is missing, so that a run ends.
                time_s: 0.04 * (i % 8) as f64 + if i % 8 > 4 { 0.04 } else { 0.0 },
                pixel: [170.0, 110.0],
            })
            .collect();
        let fit = PathFit {
            views: &views,
            seen: &seen,
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
    fn beyond_its_ends_there_is_no_path() {
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
