//! Detections: where the frames of one instant show a target.

use nalgebra::{Matrix3, Matrix4, Vector3, Vector4};

use super::Surrounding;
use super::form::FormEvidence;
use super::frame::SECTORS;
use super::lines::{CorrespondenceLines, NoFit};
use super::offset::Offset;
use super::yaw::YawPrior;
use crate::shape::Stance;
use crate::tuning::AdaptationTuning;

/// Where a target is seen, by the frames of one instant alone. Nothing changes it once it is fitted.
#[derive(Debug, Clone, Default)]
pub(crate) struct Detection {
    pub(super) position_m: [f64; 3],
    /// How far it moved while the shutter was open.
    pub(super) displacement_m: [f64; 3],
    pub(super) log_scale: f64,
    pub(super) yaw_rad: f64,
    /// The prior of the yaw of a body that turns. It is the form that is fitted, of a ball the logarithm of the scale.
    pub(super) yaw: Option<YawPrior>,
    /// The curvature of the log-likelihood in position and form.
    pub(super) information: Matrix4<f64>,
    pub(super) drift_m: Vector3<f64>,
    pub(super) of_form: Option<FormEvidence>,
    pub(super) log_likelihood_ratio: f64,
    pub(super) coarse_log_ratio: f64,
    pub(super) judged_log_ratio: f64,
    pub(super) rectangle_nats: f64,
    /// The lines of each camera that sees it come first; the rest are buffers.
    pub(super) lines: Vec<CorrespondenceLines>,
    pub(super) camera_count: usize,
    /// By how much each camera shows it beside its projection, by the camera's number.
    pub(super) offsets: Vec<Offset>,
    /// The mean Y, U and V within its outline, by the camera's number, in the octave in which it is judged: colour models have those of that octave. Finer ones show the rim alone, where
    /// fingers, blur and shadow are.
    pub(super) body_colors: Vec<[f32; 3]>,
    /// The number of the candidate from which it was fitted.
    candidate: usize,
}

/// In place of the mean colour in a camera that did not see the body when it was judged.
pub(super) const NO_COLOR: [f32; 3] = [-1.0; 3];

impl Detection {
    /// Its position in the world, metres.
    pub(crate) fn position_m(&self) -> [f64; 3] {
        self.position_m
    }

    /// How far it moved while the shutter was open, metres: zero unless it was fitted as a streak.
    pub(crate) fn displacement_m(&self) -> [f64; 3] {
        self.displacement_m
    }

    /// Whether it was fitted as a streak: an outline that moves while the shutter is open.
    pub(crate) fn is_streak(&self) -> bool {
        self.displacement_m != [0.0; 3]
    }

    /// Its scale relative to the target's shape.
    pub(crate) fn scale(&self) -> f64 {
        libm::exp(self.log_scale)
    }

    /// The logarithm of its scale.
    pub(crate) fn log_scale(&self) -> f64 {
        self.log_scale
    }

    /// Its stance.
    pub(crate) fn stance(&self) -> Stance {
        Stance {
            scale: self.scale(),
            yaw_rad: self.yaw_rad,
        }
    }

    pub(super) fn form(&self) -> f64 {
        if self.yaw.is_some() {
            self.yaw_rad
        } else {
            self.log_scale
        }
    }

    pub(super) fn set_form(&mut self, form: f64) {
        if self.yaw.is_some() {
            self.yaw_rad = form;
        } else {
            self.log_scale = form;
        }
    }

    /// Its position and form.
    pub(super) fn place(&self) -> Vector4<f64> {
        Vector3::from(self.position_m).push(self.form())
    }

    pub(super) fn set_place(&mut self, place: &Vector4<f64>) {
        self.position_m = place.xyz().into();
        self.set_form(place[3]);
    }

    /// The curvature of the log-likelihood at its position, 1/m²: the inverse of the position's covariance, given its scale and whatever its yaw.
    pub(crate) fn information(&self) -> Matrix3<f64> {
        let given: Matrix3<f64> = self.information.fixed_view::<3, 3>(0, 0).into();
        let Some(yaw) = &self.yaw else {
            return given;
        };
        let of_both: Vector3<f64> = self.information.fixed_view::<3, 1>(0, 3).into();
        given - of_both * of_both.transpose() / (self.information[(3, 3)] + yaw.information())
    }

    /// How the position would change with the logarithm of the scale, metres: in one camera alone, along its ray. Only for balls.
    pub(crate) fn drift_m(&self) -> [f64; 3] {
        if self.yaw.is_some() {
            return [0.0; 3];
        }
        self.drift_m.into()
    }

    /// What the frames say of the size of a ball; `None` if they do not determine it.
    pub(crate) fn size(&self) -> Option<&FormEvidence> {
        self.of_form.as_ref().filter(|_| self.yaw.is_none())
    }

    /// What the frames say of the yaw of a body that turns; `None` if they do not determine it.
    pub(crate) fn yaw(&self) -> Option<&FormEvidence> {
        self.of_form.as_ref().filter(|_| self.yaw.is_some())
    }

    /// The log-likelihood ratio of its lines at its position against an edge anywhere nearby, summed over the cameras that see it, in nats.
    pub(crate) fn log_likelihood_ratio(&self) -> f64 {
        self.log_likelihood_ratio
    }

    /// What a camera's lines add to their log-likelihood ratio so that at its position each camera has the same share of the sum, in nats: none then outweighs
    /// that another contradicts.
    pub(super) fn balance(&self, lines: &CorrespondenceLines) -> f32 {
        let mean = self.log_likelihood_ratio / self.camera_count as f64;
        (mean - f64::from(lines.fitted_log_ratio)) as f32
    }

    /// The greatest log-likelihood ratio that a camera's lines may have, in nats.
    pub(super) fn most(&self, lines: &CorrespondenceLines) -> f32 {
        if self.camera_count == 1 {
            lines.fitted_log_ratio
        } else {
            f32::INFINITY
        }
    }

    /// Its log-likelihood ratio in the octave in which it is judged.
    pub(crate) fn coarse_log_ratio(&self) -> f64 {
        self.coarse_log_ratio
    }

    /// How far its outline as a whole is the target's: the same in the octave in which it is judged, where each sector may deviate from the outline by a
    /// fraction of a pixel, against an edge anywhere or, if it is a ball's, a rectangle. Errors that the whole outline shares, as the fit has them, would excuse any
    /// contradiction, such as the corners of a book.
    pub(crate) fn judged_log_ratio(&self) -> f64 {
        self.judged_log_ratio - self.rectangle_nats
    }

    /// By how many nats its outline is likelier a rectangle than the target's, if the target itself may be covered: 0 at least.
    pub(crate) fn contradiction_nats(&self) -> f64 {
        (self.rectangle_nats - self.judged_log_ratio.max(0.0)).max(0.0)
    }

    /// How far the colours on both sides of its outline differ, grey levels: in the camera in which they differ most.
    pub(crate) fn contrast(&self) -> f64 {
        let contrasts = self.lines().iter().map(|lines| lines.contrast);
        contrasts.fold(0.0, f32::max).into()
    }

    /// The number of the candidate from which it was fitted.
    pub(crate) fn candidate(&self) -> usize {
        self.candidate
    }

    /// The number of cameras that see it, 1 at least.
    pub(crate) fn camera_count(&self) -> usize {
        self.camera_count
    }

    /// The numbers of the cameras that see it.
    pub(crate) fn cameras(&self) -> impl Iterator<Item = usize> + Clone {
        self.lines().iter().map(|lines| lines.camera)
    }

    /// The share of its outline along which the target's colours are visible, 0 to 1: the mean over the cameras that see it.
    pub(crate) fn visible_share(&self) -> f64 {
        let sum: f32 = self.lines().iter().map(|lines| lines.visible_share).sum();
        f64::from(sum) / self.camera_count as f64
    }

    /// The share of what surrounds it in the target's colours, in the camera in which it is greatest.
    pub(crate) fn around_share(&self) -> f64 {
        let shares = self.lines().iter().map(|lines| lines.around_share);
        shares.fold(0.0, f32::max).into()
    }

    /// The same for the camera in which it is least.
    pub(crate) fn least_visible_share(&self) -> f32 {
        let shares = self.lines().iter().map(|lines| lines.visible_share);
        shares.fold(1.0, f32::min)
    }

    /// The same for one camera; `None` if that does not see it.
    pub(crate) fn visible_share_in(&self, camera: usize) -> Option<f64> {
        let lines = self.lines_of(camera).next()?;
        Some(f64::from(lines.visible_share))
    }

    /// The mean Y, U and V of its rim, for each camera that sees it: that of the finest octave in which it was fitted.
    pub(crate) fn rim_colors(&self) -> impl Iterator<Item = (usize, [f32; 3])> {
        let lines = self.lines().iter();
        lines.map(|lines| (lines.camera, lines.body_color))
    }

    /// The mean Y, U and V within its outline, for each camera that sees it.
    pub(crate) fn body_colors(&self) -> impl Iterator<Item = (usize, [f32; 3])> {
        let lines = self.lines().iter();
        let colors = lines.map(|lines| (lines.camera, self.body_colors[lines.camera]));
        colors.filter(|(_, color)| *color != NO_COLOR)
    }

    /// The same for one camera; `None` if that does not see it unoccluded.
    pub(crate) fn unoccluded_body_color(
        &self,
        camera: usize,
        tuning: &AdaptationTuning,
    ) -> Option<[f32; 3]> {
        let lines = self.lines_of(camera).next()?;
        let color = Some(self.body_colors[camera]).filter(|color| *color != NO_COLOR);
        color.filter(|_| lines.visible_share >= tuning.unoccluded_share)
    }

    /// Updates what surrounds the target in a camera's image: slowly, and not in sectors into which something else has come.
    pub(crate) fn update_surrounding(
        &self,
        camera: usize,
        known: &mut Option<Surrounding>,
        tuning: &AdaptationTuning,
    ) {
        let Some(lines) = self.lines_of(camera).next() else {
            return;
        };
        let known = known.get_or_insert(lines.surrounding);
        let is_new = |sector: usize| known[sector].iter().any(|value| value.is_nan());
        let rates: [f32; SECTORS] = std::array::from_fn(|sector| {
            if is_new(sector) {
                1.0
            } else {
                tuning.surrounding_rate * lines.unchanged[sector]
            }
        });
        for ((known, seen), rate) in known.iter_mut().zip(&lines.surrounding).zip(rates) {
            if seen.iter().all(|value| value.is_finite()) {
                for (known, value) in known.iter_mut().zip(seen) {
                    *known = if rate == 1.0 {
                        *value
                    } else {
                        *known + rate * (value - *known)
                    };
                }
            }
        }
    }

    /// A detection at a position and of a scale, without lines yet.
    #[cfg(test)]
    pub(super) fn at(position_m: [f64; 3], scale: f64) -> Self {
        Self {
            position_m,
            log_scale: libm::log(scale),
            ..Self::default()
        }
    }

    /// The correspondence lines of each camera that sees it.
    pub(super) fn lines(&self) -> &[CorrespondenceLines] {
        &self.lines[..self.camera_count]
    }

    /// Those of one camera.
    pub(super) fn lines_of(
        &self,
        camera: usize,
    ) -> impl Iterator<Item = &CorrespondenceLines> + Clone {
        let lines = self.lines().iter();
        lines.filter(move |lines| lines.camera == camera)
    }
}

/// Detections of one instant. Owns their buffers: no more of them than it has room for, or than before, allocate nothing.
#[derive(Debug)]
pub(crate) struct Detections {
    buffers: Vec<Detection>,
    count: usize,
}

impl Detections {
    /// Makes room for detections, each with an outline of this many points in each camera.
    pub(crate) fn with_room(detections: usize, cameras: usize, points: usize) -> Self {
        let lines = || {
            let lines = (0..cameras).map(|_| CorrespondenceLines::with_room(points));
            lines.collect()
        };
        let detection = |_| Detection {
            lines: lines(),
            offsets: vec![Offset::default(); cameras],
            body_colors: vec![NO_COLOR; cameras],
            ..Detection::default()
        };
        Self {
            buffers: (0..detections).map(detection).collect(),
            count: 0,
        }
    }

    /// Removes all.
    pub(crate) fn clear(&mut self) {
        self.count = 0;
    }

    /// Adds what `fit` makes of a buffer for the candidate of this number, if it finds something.
    pub(crate) fn push_fit(
        &mut self,
        candidate: usize,
        fit: impl FnOnce(&mut Detection) -> Result<(), NoFit>,
    ) -> Result<&Detection, NoFit> {
        if self.buffers.len() == self.count {
            self.buffers.push(Detection::default());
        }
        let detection = &mut self.buffers[self.count];
        detection.candidate = candidate;
        fit(detection)?;
        self.count += 1;
        Ok(detection)
    }

    /// The detections found so far.
    pub(crate) fn as_slice(&self) -> &[Detection] {
        &self.buffers[..self.count]
    }

    /// Keeps the best `most` detections above a log-likelihood ratio that lie farther than `apart_m` metres from one another, best first.
    pub(crate) fn keep_distinct(&mut self, min_log_ratio: f64, apart_m: f64, most: usize) {
        let found = &mut self.buffers[..self.count];
        // Of two equally likely ones that of the first candidate comes first.
        found.sort_unstable_by(|a, b| {
            let by_ratio = b.coarse_log_ratio.total_cmp(&a.coarse_log_ratio);
            by_ratio.then(a.candidate.cmp(&b.candidate))
        });
        let mut kept = 0;
        for i in 0..found.len() {
            let here = Vector3::from(found[i].position_m);
            let is_apart =
                |other: &Detection| (here - Vector3::from(other.position_m)).norm() > apart_m;
            if kept < most
                && found[i].coarse_log_ratio > min_log_ratio
                && found[..kept].iter().all(is_apart)
            {
                found.swap(kept, i);
                kept += 1;
            }
        }
        self.count = kept;
    }
}
