//! Stances: how large a shape is, and which way it is turned.

/// How a shape stands: its size relative to that of its description, and the angle by which it is turned.
///
/// ```
/// use pardalis::shape::Stance;
///
/// let turned = Stance { yaw_rad: 0.5, ..Stance::default() };
/// assert_eq!(turned.scale, 1.0);
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stance {
    /// The factor by which it is larger than its description, about its centre; 1 for a shape as described.
    pub scale: f64,
    /// The angle about the vertical, in radians, counterclockwise as seen from above; 0 for a shape as described.
    pub yaw_rad: f64,
}

impl Default for Stance {
    fn default() -> Self {
        Self::scaled(1.0)
    }
}

impl Stance {
    /// The stance of a shape that is larger than its description by a factor and not turned.
    pub fn scaled(scale: f64) -> Self {
        Self {
            scale,
            yaw_rad: 0.0,
        }
    }

    /// The direction of its x axis, times its scale.
    pub(crate) fn scaled_direction(&self) -> [f64; 2] {
        let (sin, cos) = libm::sincos(self.yaw_rad);
        [self.scale * cos, self.scale * sin]
    }
}
