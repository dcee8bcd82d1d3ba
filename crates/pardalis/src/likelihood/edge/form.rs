//! The form of a body: the logarithm of the scale of a ball, the yaw of a body that turns.

/// What the frames of one instant alone say of the form of a target, whatever its position.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct FormEvidence {
    /// The likeliest logarithm of the scale of a ball, or yaw of a body that turns.
    pub(crate) form: f64,
    /// Its inverse variance.
    pub(crate) information: f64,
    /// By how many of the pixels in which they were fitted the outlines move per unit of the form: the radius of a ball. An error of one pixel that all of them
    /// share changes the form by its inverse.
    pub(crate) px_per_unit: f64,
}
