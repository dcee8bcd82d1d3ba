//! The offsets of a detection, one per camera.

use nalgebra::{Matrix3, Vector4};

use super::detection::{Detection, NO_COLOR};
use super::frame::EdgeFrame;
use super::offset::Offset;

impl Detection {
    /// Forgets the offsets. The priors are those of the frames' cameras.
    pub(super) fn reset_offsets(&mut self, frames: &[EdgeFrame]) {
        self.offsets.fill(Offset::default());
        self.body_colors.fill(NO_COLOR);
        for frame in frames {
            self.make_room(frame.camera());
            self.offsets[frame.camera()] = Offset::with_sigma(frame.context().offset_sigma_px);
        }
    }

    /// Makes room for the offset and the body's colour of a camera.
    pub(super) fn make_room(&mut self, camera: usize) {
        if self.offsets.len() <= camera {
            self.offsets.resize(camera + 1, Offset::default());
            self.body_colors.resize(camera + 1, NO_COLOR);
        }
    }

    /// The offset of a camera.
    pub(crate) fn offset(&self, camera: usize) -> Offset {
        self.offsets.get(camera).copied().unwrap_or_default()
    }

    /// Moves all offsets with a step of position and logarithm of the scale.
    pub(super) fn step_offsets(&mut self, step: &Vector4<f64>, most_px: f64) {
        for lines in &self.lines[..self.camera_count] {
            let most_px = most_px / f64::from(lines.octave.scale());
            self.offsets[lines.camera].step(step, most_px);
        }
    }

    /// Takes the latest step back.
    pub(super) fn restore_offsets(&mut self) {
        for lines in &self.lines[..self.camera_count] {
            self.offsets[lines.camera].restore();
        }
    }

    /// Keeps the offsets until [`Detection::restore_coarse_offsets`].
    pub(super) fn keep_coarse_offsets(&mut self) {
        self.offsets.iter_mut().for_each(Offset::keep_coarse);
    }

    pub(super) fn restore_coarse_offsets(&mut self) {
        self.offsets.iter_mut().for_each(Offset::restore_coarse);
    }

    /// How its position depends on what a camera's outline is off, as the covariance per square pixel, m²/px².
    pub(crate) fn m2_per_px2(&self, camera: usize) -> Matrix3<f64> {
        let covariance_m2 = self.information().try_inverse();
        let m_per_px = self
            .offset(camera)
            .m_per_px(&covariance_m2.unwrap_or_else(Matrix3::zeros));
        m_per_px * m_per_px.transpose()
    }

    /// The sum over the cameras of the logarithms of the offsets' prior densities, relative to those at none.
    pub(crate) fn offsets_log_density(&self) -> f64 {
        let lines = self.lines().iter();
        lines
            .map(|lines| self.offset(lines.camera).log_density())
            .sum()
    }
}
