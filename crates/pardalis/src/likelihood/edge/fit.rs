//! Fits the position at which a target's outlines agree best with the frames: Newton's method on the log-likelihoods of correspondence lines, over all cameras at once.

use nalgebra::{Matrix3, Matrix4, Vector2, Vector3, Vector4};

use super::detection::Detection;
use super::form::FormEvidence;
use super::frame::{Octave, SECTORS};
use super::lines::{CorrespondenceLines, NoFit, log_mean_exp};
use super::offset::{OffsetSlope, shift};
use super::patch::Patch;
use super::size::SizePrior;
use super::yaw::YawPrior;
use super::{EdgeCue, EdgeFrame, LANES};
use crate::tuning::EdgeTuning;

/// The damping of Newton steps (Levenberg-Marquardt), a share of the curvature: at first, ... Hand-set, as the following.
const FIRST_DAMPING: f64 = 1e-3;
/// ... its factors after a step that makes the fit better, and after one that does not, ...
const DAMPING_FACTORS: [f64; 2] = [0.1, 30.0];
/// ... and the least after one that does not.
const LEAST_FAILED_DAMPING: f64 = 1e-2;
/// The distance over which projections are differentiated, in diameters. Hand-set: single precision still tells the difference.
const STEP_DIAMETERS: f64 = 0.02;

/// Below this share of the information that a known position would leave, the frames do not tell form from position, such as size from distance. Hand-set: cameras side by side.
const LEAST_SIZE_SHARE: f64 = 1e-4;

/// The angle over which outlines of a body that turns are differentiated, radians. Derivation: its ends then move as far as when the position changes by [`STEP_DIAMETERS`].
const STEP_RAD: f64 = 2.0 * STEP_DIAMETERS;

/// The number of deviations of a sector that are tried when an outline is judged. Hand-set: a quarter of a pixel apart, as lines' shifts.
pub(super) const DEVIATIONS: usize = 5;

/// These deviations, up to a tolerance either way.
pub(super) fn deviations_px(tolerance_px: f32) -> [f32; DEVIATIONS] {
    std::array::from_fn(|i| (2.0 * i as f32 / (DEVIATIONS - 1) as f32 - 1.0) * tolerance_px)
}

/// A Gaussian of positions, if there is one: mean and inverse covariance.
pub(crate) type PositionPrior<'a> = Option<(&'a Vector3<f64>, &'a Matrix3<f64>)>;

/// Where a fit begins, and what is known before.
#[derive(Debug, Clone, Copy)]
pub(crate) struct FitStart<'a> {
    /// A position in the world, metres.
    pub(crate) position_m: [f64; 3],
    /// How far the outline moves while the shutter is open, metres: zero unless it is fitted as a streak.
    pub(crate) displacement_m: [f64; 3],
    /// The logarithm of the scale at which outlines are sought first.
    pub(crate) log_scale: f64,
    /// The prior of the position, fitted together with the lines.
    pub(crate) prior: PositionPrior<'a>,
    /// The prior of the size, which is fitted if several cameras see a ball, or if it stays on the ground.
    pub(crate) size: SizePrior,
    /// The prior of the yaw, at whose mean outlines are sought first; only for bodies that turn.
    pub(crate) yaw: Option<YawPrior>,
    /// Whether motion is planar, which keeps the height.
    pub(crate) is_planar: bool,
    /// An outline whose log-likelihood ratio is no greater than this is of no use: it is not fitted in finer octaves.
    pub(crate) min_log_ratio: f64,
}

/// The same for a place: a position followed by the form, the logarithm of the scale of a ball or the yaw of a body that turns.
struct Prior {
    gaussian: Option<(Vector4<f64>, Matrix4<f64>)>,
    form: FormPrior,
    is_planar: bool,
}

/// The prior of the form.
#[derive(Debug, Clone, Copy)]
enum FormPrior {
    Size(SizePrior),
    Yaw(YawPrior),
}

impl FormPrior {
    fn likeliest(&self) -> f64 {
        match self {
            Self::Size(size) => size.log_scale,
            Self::Yaw(yaw) => yaw.yaw_rad,
        }
    }

    fn log_density(&self, form: f64) -> f64 {
        match self {
            Self::Size(size) => size.log_density(form),
            Self::Yaw(yaw) => yaw.log_density(form),
        }
    }

    fn information(&self, form: f64) -> f64 {
        match self {
            Self::Size(size) => size.information(form),
            Self::Yaw(yaw) => yaw.information(),
        }
    }
}

/// What the lines say at a detection: the log-likelihood ratio, with its gradient and curvature in position and form.
struct Slope {
    log_ratio: f64,
    gradient: Vector4<f64>,
    curvature: Matrix4<f64>,
    /// The sum of the lines' curvatures, 1/px².
    of_shift: f64,
    /// By how many pixels the outline moves at most, per metre along each axis and per unit of the form.
    px_per_unit: [f64; 4],
}

impl Prior {
    /// The logarithm of its density at a detection, and of those of the cameras' offsets.
    fn log_density(&self, detection: &Detection) -> f64 {
        let place = detection.place();
        let mut log_density = self.form.log_density(place[FORM]) + detection.offsets_log_density();
        if let Some((mean, information)) = self.gaussian {
            let off = place - mean;
            log_density -= 0.5 * (off.transpose() * information * off)[0];
        }
        log_density
    }
}

/// The index of the form.
const FORM: usize = 3;

impl EdgeCue {
    /// Fits the best position near a start; returns why not if no camera sees the target's colours there. Writes into `detection`, whose buffers it reuses.
    ///
    /// The outline is fitted in the octave in which it is judged, then octave by octave down to the frame's own pixels as long as these agree.
    pub(crate) fn fit(
        &mut self,
        frames: &[EdgeFrame],
        start: &FitStart,
        detection: &mut Detection,
    ) -> Result<(), NoFit> {
        self.patches.iter_mut().for_each(Patch::clear);
        detection.position_m = start.position_m;
        detection.displacement_m = start.displacement_m;
        detection.log_scale = start.log_scale;
        detection.yaw = start.yaw.filter(|_| self.turns);
        detection.yaw_rad = detection.yaw.map_or(0.0, |yaw| yaw.yaw_rad);
        let form = detection
            .yaw
            .map_or(FormPrior::Size(start.size), FormPrior::Yaw);
        detection.reset_offsets(frames);
        let gaussian = start.prior.map(|(mean, information)| {
            let mean = mean.push(form.likeliest());
            (mean, information.fixed_resize::<4, 4>(0.0))
        });
        let prior = Prior {
            gaussian,
            form,
            is_planar: start.is_planar,
        };
        self.fit_octave(frames, &prior, 0, detection)?;
        detection.coarse_log_ratio = detection.log_likelihood_ratio;
        self.judge(frames, detection);
        // The edges of a streak are no sharper in finer octaves.
        if detection.is_streak() || detection.coarse_log_ratio <= start.min_log_ratio {
            return Ok(());
        }
        let octaves = detection.lines().iter().map(|lines| lines.octave.0);
        for finer in 1..=octaves.max().unwrap_or(0) {
            if !self.refine(frames, &prior, finer, detection) {
                break;
            }
        }
        Ok(())
    }

    /// Judges the outline at the detection's position, for which the lines were placed, and notes the mean colours within it.
    pub(super) fn judge(&mut self, frames: &[EdgeFrame], detection: &mut Detection) {
        let (position, stance) = (
            detection.position_m.map(|v| [v as f32; LANES]),
            detection.stance(),
        );
        let is_streak = detection.is_streak();
        let exponent = self.settings.likelihood_exponent as f32;
        let tolerance_px = self.tuning.judged_tolerance_px;
        detection.judged_log_ratio = 0.0;
        detection.rectangle_nats = 0.0;
        for lines in &mut detection.lines[..detection.camera_count] {
            let Some(frame) = frames.iter().find(|frame| frame.camera() == lines.camera) else {
                continue;
            };
            detection.body_colors[lines.camera] = lines.body_color;
            self.project(frame.projector(), &position, stance);
            shift(&mut self.coordinates, detection.offsets[lines.camera].px);
            let of_fit = lines.replace_exponent(exponent, self.level);
            let mut sums = [[0_f32; DEVIATIONS]; SECTORS];
            let deviations_px = deviations_px(tolerance_px);
            for (k, [u, v]) in self.coordinates.iter().enumerate() {
                let shift_px = lines.shift_px(k, [u[0], v[0]]);
                let shifts_px = deviations_px.map(|deviation_px| shift_px + deviation_px);
                let log_ratios = lines.line_log_ratios(k, &shifts_px);
                for (sum, log_ratio) in sums[lines.sector(k)].iter_mut().zip(log_ratios) {
                    *sum += log_ratio;
                }
            }
            let sums = sums.map(|sums| log_mean_exp(&sums));
            detection.judged_log_ratio += f64::from(lines.log_likelihood_ratio(&sums));
            if let Some(rectangles) = self.rectangles.as_ref().filter(|_| !is_streak) {
                let of_rectangle = rectangles.log_ratio(lines, &self.coordinates, tolerance_px);
                let rarity = self.tuning.rectangle_rarity_nats;
                detection.rectangle_nats +=
                    libm::log1p(libm::exp(f64::from(of_rectangle) - rarity));
            }
            lines.replace_exponent(of_fit, self.level);
        }
    }

    /// Fits in octaves finer by one than before, from the position and with the uncertainty found there. Returns whether the finer octaves agree; otherwise
    /// nothing changes.
    fn refine(
        &mut self,
        frames: &[EdgeFrame],
        known: &Prior,
        finer: u8,
        detection: &mut Detection,
    ) -> bool {
        let cameras = detection.camera_count;
        let (position_m, log_ratio) = (detection.position_m, detection.log_likelihood_ratio);
        let (drift_m, of_form) = (detection.drift_m, detection.of_form);
        let (mean, information) = (detection.place(), detection.information);
        let prior = Prior {
            gaussian: Some((mean, information)),
            ..*known
        };
        detection.keep_coarse_offsets();
        let fitted = self.fit_octave(frames, &prior, finer, detection);
        let moved = detection.place() - mean;
        let agrees = fitted.is_ok()
            && detection.camera_count == cameras
            && (moved.transpose() * information * moved)[0]
                < self.tuning.max_refined_sigmas.powi(2)
            && detection.log_likelihood_ratio > self.tuning.min_refined_share * log_ratio;
        if !agrees {
            detection.position_m = position_m;
            detection.set_form(mean[FORM]);
            detection.restore_coarse_offsets();
            // As before: there were lines.
            let _ = self.place_lines(frames, finer - 1, detection);
            self.slope(frames, detection);
            detection.information = information;
            (detection.drift_m, detection.of_form) = (drift_m, of_form);
            detection.log_likelihood_ratio = log_ratio;
        }
        agrees
    }

    /// Fits the position in octaves `finer` than those in which the outline is judged.
    fn fit_octave(
        &mut self,
        frames: &[EdgeFrame],
        prior: &Prior,
        finer: u8,
        detection: &mut Detection,
    ) -> Result<(), NoFit> {
        let EdgeTuning {
            rounds,
            steps,
            min_shift_px,
            max_shift_px,
            ..
        } = self.tuning;
        for round in 0..=rounds {
            self.place_lines(frames, finer, detection)?;
            if !self.fits_form(prior, detection) && detection.form() != prior.form.likeliest() {
                detection.set_form(prior.form.likeliest());
                self.place_lines(frames, finer, detection)?;
            }
            if round == rounds {
                break;
            }
            let fixed = [prior.is_planar, !self.fits_form(prior, detection)];
            let mut damping = FIRST_DAMPING;
            let mut slope = self.slope(frames, detection);
            let mut value = slope.log_ratio + prior.log_density(detection);
            let mut moved_px = 0.0_f64;
            for _ in 0..steps {
                let here = detection.place();
                let with_prior = self.with_prior(&slope, detection, prior);
                let Some((step, size_px)) = solve(with_prior, damping, fixed, &slope.px_per_unit)
                else {
                    break;
                };
                // Lines do not reach farther.
                let shrink = (max_shift_px / size_px).min(1.0);
                let (step, size_px) = (step * shrink, size_px * shrink);
                detection.step_offsets(&step, max_shift_px);
                detection.set_place(&(here + step));
                let new_slope = self.slope(frames, detection);
                let new_value = new_slope.log_ratio + prior.log_density(detection);
                if new_value > value {
                    (slope, value) = (new_slope, new_value);
                    damping *= DAMPING_FACTORS[0];
                    moved_px += size_px;
                } else {
                    detection.set_place(&here);
                    detection.restore_offsets();
                    damping = (damping * DAMPING_FACTORS[1]).max(LEAST_FAILED_DAMPING);
                }
                if size_px < min_shift_px {
                    break;
                }
            }
            if moved_px < min_shift_px && round > 0 {
                break;
            }
        }
        let slope = self.slope(frames, detection);
        detection.information = slope.curvature;
        detection.log_likelihood_ratio = slope.log_ratio;
        let fits_form = self.fits_form(prior, detection);
        detection.note_form(&slope, prior.is_planar, fits_form);
        if detection.log_likelihood_ratio.is_finite() {
            Ok(())
        } else {
            Err(NoFit::NoEdges)
        }
    }

    /// Places correspondence lines around the detection's position in each camera that shows the target's colours there, in octaves `finer` than those in which
    /// the outline is judged. Returns why not if none does.
    pub(super) fn place_lines(
        &mut self,
        frames: &[EdgeFrame],
        finer: u8,
        detection: &mut Detection,
    ) -> Result<(), NoFit> {
        let mut count = 0;
        let mut no_fit = NoFit::OutOfView;
        for frame in frames {
            detection.make_room(frame.camera());
            let position = detection.position_m.map(|v| [v as f32; LANES]);
            self.project(frame.projector(), &position, detection.stance());
            shift(&mut self.coordinates, detection.offsets[frame.camera()].px);
            if detection.lines.len() == count {
                detection.lines.push(CorrespondenceLines::default());
            }
            let octave = Octave(self.octave().0.saturating_sub(finer));
            let displacement_px = self.displacement_px(frame, detection);
            let table = &self.tables[usize::from(octave.0)];
            let lines = &mut detection.lines[count];
            let placed = lines.place(
                (frame, octave),
                (&self.coordinates, displacement_px),
                table,
                (&self.settings, &self.tuning),
                (&mut self.buffers, &mut self.patches[frame.camera()]),
            );
            match placed {
                Ok(()) => count += 1,
                Err(reason) if reason > no_fit => no_fit = reason,
                Err(_) => {}
            }
        }
        detection.camera_count = count;
        if count > 0 { Ok(()) } else { Err(no_fit) }
    }

    /// Returns by how much the middle of the body moves in a frame during the exposure, in pixels.
    fn displacement_px(&self, frame: &EdgeFrame, detection: &Detection) -> [f32; 2] {
        if !detection.is_streak() {
            return [0.0; 2];
        }
        let mut places = [[0_f32; LANES]; 3];
        for axis in 0..3 {
            let middle = if axis == 2 {
                f64::from(self.middle_height_m)
            } else {
                0.0
            };
            for (lane, place) in places[axis].iter_mut().enumerate() {
                let share = if lane == 0 { -0.5 } else { 0.5 };
                let moved = share * detection.displacement_m[axis];
                *place = (detection.position_m[axis] + middle + moved) as f32;
            }
        }
        let [u, v] = frame.projector().project(self.level, &places);
        let displacement = [u[1] - u[0], v[1] - v[0]];
        if displacement.iter().all(|v| v.is_finite()) {
            displacement
        } else {
            [0.0; 2]
        }
    }

    /// Whether the frames determine the form of a detection, given what is known before. The edges of streaks are too soft.
    fn fits_form(&self, prior: &Prior, detection: &Detection) -> bool {
        let is_seen = match prior.form {
            FormPrior::Yaw(_) => true,
            FormPrior::Size(size) => {
                let has_depth = detection.camera_count > 1 || prior.is_planar;
                self.is_ball && has_depth && size.sigma > 0.0
            }
        };
        is_seen && !detection.is_streak()
    }

    /// Returns gradient and curvature with the prior's.
    fn with_prior(
        &self,
        slope: &Slope,
        detection: &Detection,
        prior: &Prior,
    ) -> (Vector4<f64>, Matrix4<f64>) {
        let (mut gradient, mut curvature) = (slope.gradient, slope.curvature);
        if let Some((mean, information)) = prior.gaussian {
            gradient -= information * (detection.place() - mean);
            curvature += information;
        }
        if self.fits_form(prior, detection) {
            let form = detection.form();
            let information = prior.form.information(form);
            let off = form - prior.form.likeliest();
            gradient[FORM] -= information * off;
            curvature[(FORM, FORM)] += information;
        }
        (gradient, curvature)
    }

    /// Returns what the lines say at a detection. Notes the log-likelihood ratio of each camera's.
    fn slope(&mut self, frames: &[EdgeFrame], detection: &mut Detection) -> Slope {
        let mut slope = Slope {
            log_ratio: 0.0,
            gradient: Vector4::zeros(),
            curvature: Matrix4::zeros(),
            of_shift: 0.0,
            px_per_unit: [0.0; 4],
        };
        let (position, stance) = (Vector3::from(detection.position_m), detection.stance());
        let turns = detection.yaw.is_some();
        let span_px = self.tuning.span_px;
        // Either way along each axis.
        let step_m = STEP_DIAMETERS * self.diameter_m * stance.scale;
        let mut positions = [[0_f32; LANES]; 3];
        for lane in 0..LANES {
            for axis in 0..3 {
                let sign = [(1 + 2 * axis, 1.0), (2 + 2 * axis, -1.0)]
                    .into_iter()
                    .find_map(|(at, sign)| (at == lane).then_some(sign));
                positions[axis][lane] = (position[axis] + sign.unwrap_or(0.0) * step_m) as f32;
            }
        }
        let width_m: [f32; 3] = std::array::from_fn(|axis| {
            positions[axis][1 + 2 * axis] - positions[axis][2 + 2 * axis]
        });
        for lines in &mut detection.lines[..detection.camera_count] {
            let Some(frame) = frames.iter().find(|frame| frame.camera() == lines.camera) else {
                continue;
            };
            self.project(frame.projector(), &positions, stance);
            if turns {
                self.differentiate_yaw(frame, detection.position_m);
            }
            let offset = &mut detection.offsets[lines.camera];
            offset.note_middle(&self.coordinates);
            shift(&mut self.coordinates, offset.px);
            let has_error = frame.context().offset_sigma_px > 0.0;
            let mut of_offset = OffsetSlope::default();
            // A ball that grows looks like one that comes nearer.
            let nearer = frame.viewpoint_m() - position;
            let sums = lines.sums_of_first(&self.coordinates);
            lines.fitted_log_ratio = lines.log_likelihood_ratio(&sums);
            slope.log_ratio += f64::from(lines.fitted_log_ratio);
            let visible = lines.visible_given(&sums);
            for k in 0..lines.line_count() {
                let [u, v] = &self.coordinates[k];
                let [nu, nv] = lines.normal(k);
                let along = Vector3::from_fn(|axis, _| {
                    let [plus, minus] = [1 + 2 * axis, 2 + 2 * axis];
                    let moved = (u[plus] - u[minus]) * nu + (v[plus] - v[minus]) * nv;
                    f64::from(lines.octave.scale() * moved / width_m[axis])
                });
                // The outline has no pixel here.
                if along.iter().any(|v| v.is_nan()) {
                    continue;
                }
                let of_form = if turns {
                    let [u, v] = self.of_yaw[k];
                    let moved = f64::from(lines.octave.scale() * (u * nu + v * nv));
                    if moved.is_nan() { 0.0 } else { moved }
                } else if self.is_ball {
                    along.dot(&nearer)
                } else {
                    0.0
                };
                let along = along.push(of_form);
                for axis in 0..4 {
                    slope.px_per_unit[axis] = slope.px_per_unit[axis].max(along[axis].abs());
                }
                let shift_px = lines.shift_px(k, [u[0], v[0]]);
                let shifts_px = [-span_px, 0.0, span_px].map(|d| shift_px + d);
                let [less, here, more] = lines.line_log_ratios(k, &shifts_px);
                let gradient = (more - less) / (2.0 * span_px);
                let least = self.tuning.min_curvature * lines.likelihood_exponent;
                let curvature = ((2.0 * here - less - more) / (span_px * span_px)).max(least);
                let weight = f64::from(visible[lines.sector(k)]);
                slope.gradient += along * (weight * f64::from(gradient));
                slope.curvature += along * along.transpose() * (weight * f64::from(curvature));
                slope.of_shift += weight * f64::from(curvature);
                if has_error {
                    let normal = Vector2::new(nu, nv) * lines.octave.scale();
                    let of_line = [gradient, curvature].map(|of_line| weight * f64::from(of_line));
                    of_offset.add(&along, normal.map(f64::from), of_line);
                }
            }
            if let Some((gradient, curvature)) = offset.note(of_offset) {
                slope.gradient -= gradient;
                slope.curvature -= curvature;
            }
        }
        slope
    }

    /// Writes how far the points of the outline that was projected last, its first lane, at this position, move as the body turns. The outline follows the points of the body that are on it:
    /// elsewhere the body turns to or from the camera.
    fn differentiate_yaw(&mut self, frame: &EdgeFrame, position_m: [f64; 3]) {
        let projector = frame.projector();
        let center = position_m.map(|v| v as f32);
        projector.turn_points(center, STEP_RAD, &mut self.points);
        projector.project_all(self.level, &self.points, &mut self.turned);
        for (of_yaw, [u, v]) in self.of_yaw.iter_mut().zip(&self.turned) {
            let width_rad = 2.0 * STEP_RAD as f32;
            *of_yaw = [(u[0] - u[1]) / width_rad, (v[0] - v[1]) / width_rad];
        }
    }
}

impl Detection {
    /// Notes what slopes without any prior say of the form, and how the position depends on it.
    fn note_form(&mut self, slope: &Slope, is_planar: bool, fits_form: bool) {
        let of_both: Vector3<f64> = slope.curvature.fixed_view::<3, 1>(0, FORM).into();
        let (mut curvature, mut of_both_free) = (slope.curvature, of_both);
        let mut of_position = slope.gradient.xyz();
        if is_planar {
            fix(&mut curvature, 2);
            of_both_free[2] = 0.0;
            of_position[2] = 0.0;
        }
        let free: Matrix3<f64> = curvature.fixed_view::<3, 3>(0, 0).into();
        self.of_form = None;
        self.drift_m = Vector3::zeros();
        let Some(factor) = free.cholesky() else {
            return;
        };
        self.drift_m = -factor.solve(&of_both_free);
        if !fits_form {
            return;
        }
        let own = slope.curvature[(FORM, FORM)];
        let information = own + self.drift_m.dot(&of_both_free);
        if information > LEAST_SIZE_SHARE * own {
            let gradient = slope.gradient[FORM] + self.drift_m.dot(&of_position);
            self.of_form = Some(FormEvidence {
                form: self.form() + gradient / information,
                information,
                px_per_unit: (own / slope.of_shift).sqrt(),
            });
        }
    }
}

/// Takes an axis out of a system of equations: its unknown does not depend on the others.
fn fix(curvature: &mut Matrix4<f64>, fixed: usize) {
    for axis in 0..4 {
        curvature[(axis, fixed)] = 0.0;
        curvature[(fixed, axis)] = 0.0;
    }
    curvature[(fixed, fixed)] = 1.0;
}

/// Returns the damped Newton step, and by how many pixels it moves the outline at most. Height and form may be fixed.
fn solve(
    (mut gradient, mut curvature): (Vector4<f64>, Matrix4<f64>),
    damping: f64,
    [height, form]: [bool; 2],
    px_per_unit: &[f64; 4],
) -> Option<(Vector4<f64>, f64)> {
    for axis in 0..4 {
        curvature[(axis, axis)] *= 1.0 + damping;
    }
    for (axis, is_fixed) in [(2, height), (FORM, form)] {
        if is_fixed {
            fix(&mut curvature, axis);
            gradient[axis] = 0.0;
        }
    }
    let step = curvature.cholesky()?.solve(&gradient);
    let size_px: f64 = (0..4)
        .map(|axis| step[axis].abs() * px_per_unit[axis])
        .fold(0.0, f64::max);
    size_px.is_finite().then_some((step, size_px))
}
