//! What is painted on balls.

use nalgebra::Vector3;

/// Paint on a ball, over its texture. Colours are linear red, green and blue, 0 to 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Mark {
    /// Seams along great circles at right angles to each other.
    Seams {
        /// Number of seams: the first is horizontal, the second contains the ball's x and z axes, and the third its y
        /// and z axes.
        count: usize,
        /// Width of each in metres.
        width_m: f64,
        /// Colour.
        color: [f64; 3],
    },
    /// A round logo.
    Logo {
        /// Direction from the ball's centre: body frame, unit length.
        direction: Vector3<f64>,
        /// Radius in metres, straight from the logo's centre to its border.
        radius_m: f64,
        /// Colour.
        color: [f64; 3],
    },
}

impl Mark {
    /// Maximum number of seams.
    pub const MAX_SEAMS: usize = 3;

    /// Returns the colour at a point of the ball's surface (body frame, metres); `None` off the mark.
    pub(super) fn color_at(&self, point_m: &Vector3<f64>) -> Option<[f64; 3]> {
        match self {
            Self::Seams {
                count,
                width_m,
                color,
            } => {
                let off_m = [point_m.z, point_m.y, point_m.x].map(f64::abs);
                let is_covered = off_m[..*count].iter().any(|off_m| 2.0 * off_m < *width_m);
                is_covered.then_some(*color)
            }
            Self::Logo {
                direction,
                radius_m,
                color,
            } => {
                let off_m = (direction * point_m.norm() - point_m).norm();
                (off_m < *radius_m).then_some(*color)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seams_follow_great_circles_and_logos_lie_around_their_direction() {
        let seams = |count| Mark::Seams {
            count,
            width_m: 0.02,
            color: [0.1; 3],
        };
        let on = |mark: Mark, [x, y, z]: [f64; 3]| {
            mark.color_at(&(0.5 * Vector3::new(x, y, z).normalize()))
                .is_some()
        };
        assert!(on(seams(1), [1.0, 2.0, 0.03]) && !on(seams(1), [1.0, 2.0, 0.06]));
        assert!(!on(seams(1), [1.0, 0.0, 1.0]) && on(seams(2), [1.0, 0.0, 1.0]));
        assert!(!on(seams(2), [0.0, 1.0, 1.0]) && on(seams(3), [0.0, 1.0, 1.0]));
        let logo = Mark::Logo {
            direction: Vector3::x(),
            radius_m: 0.1,
            color: [0.1; 3],
        };
        assert!(on(logo, [1.0, 0.19, 0.0]) && !on(logo, [1.0, 0.22, 0.0]));
        assert!(!on(logo, [-1.0, 0.0, 0.0]));
    }
}
