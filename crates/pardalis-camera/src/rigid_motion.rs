//! Rigid motions at constant rates: the exponential and the logarithm of SE(3), and interpolation between poses.

use nalgebra::{Matrix3, Rotation3, Translation3, Vector3};

use crate::Pose;

/// Below this angle in radians, series take the place of quotients. Derivation: their next term is below double precision.
const SMALL_RAD: f64 = 1e-4;

/// A rigid motion at constant rates that takes one unit of time: along a line, an arc or a screw.
///
/// Its [pose](RigidMotion::pose) is the exponential of SE(3), in the frame in which the motion begins.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct RigidMotion {
    /// The velocity of the origin in the moving frame, metres per unit of time.
    pub velocity_m: Vector3<f64>,
    /// The angular velocity in the moving frame, radians per unit of time.
    pub turn_rad: Vector3<f64>,
}

/// The matrix that takes a vector to its cross product with this one from the left.
fn cross_matrix(v: &Vector3<f64>) -> Matrix3<f64> {
    Matrix3::new(0.0, -v.z, v.y, v.z, 0.0, -v.x, -v.y, v.x, 0.0)
}

/// The rotation vector of a rotation, exact for small angles, too.
fn turn_of(rotation: &Rotation3<f64>) -> Vector3<f64> {
    let m = rotation.matrix();
    let sine = 0.5
        * Vector3::new(
            m[(2, 1)] - m[(1, 2)],
            m[(0, 2)] - m[(2, 0)],
            m[(1, 0)] - m[(0, 1)],
        );
    let (sin, cos) = (sine.norm(), 0.5 * (m.trace() - 1.0));
    if sin < SMALL_RAD && cos < 0.0 {
        // Half a turn has no sine.
        return rotation.scaled_axis();
    }
    let angle = libm::atan2(sin, cos);
    sine * if sin > 0.0 { angle / sin } else { 1.0 }
}

impl RigidMotion {
    /// Returns the motion that begins at the identity and ends at a pose: the logarithm of SE(3). Of the two ways to turn, the shorter.
    pub fn to(pose: &Pose) -> Self {
        let turn_rad = turn_of(&pose.rotation);
        let angle = turn_rad.norm();
        let cross = cross_matrix(&turn_rad);
        // (1 - (θ/2) cot(θ/2)) / θ²
        let square_share = if angle < SMALL_RAD {
            1.0 / 12.0
        } else {
            let (sin, cos) = libm::sincos(0.5 * angle);
            (1.0 - 0.5 * angle * cos / sin) / (angle * angle)
        };
        let inverse = Matrix3::identity() - cross * 0.5 + cross * cross * square_share;
        Self {
            velocity_m: inverse * pose.translation.vector,
            turn_rad,
        }
    }

    /// Returns the pose in which the motion ends that begins at the identity: the exponential of SE(3).
    pub fn pose(&self) -> Pose {
        let angle = self.turn_rad.norm();
        let cross = cross_matrix(&self.turn_rad);
        let (share, square_share) = if angle < SMALL_RAD {
            (0.5, 1.0 / 6.0)
        } else {
            let (sin, cos) = libm::sincos(angle);
            let squared = angle * angle;
            ((1.0 - cos) / squared, (angle - sin) / (squared * angle))
        };
        let along = Matrix3::identity() + cross * share + cross * cross * square_share;
        Pose::from_parts(
            Translation3::from(along * self.velocity_m),
            Rotation3::new(self.turn_rad),
        )
    }

    /// Returns the motion at the same rates for this multiple of the time.
    #[must_use]
    pub fn times(&self, factor: f64) -> Self {
        Self {
            velocity_m: self.velocity_m * factor,
            turn_rad: self.turn_rad * factor,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn close(a: &Pose, b: &Pose) -> bool {
        (a.to_homogeneous() - b.to_homogeneous()).amax() < 1e-12
    }

    #[test]
    fn poses_of_motions_and_motions_to_poses_are_inverse() {
        let velocities = [[0.0; 3], [0.3, -1.0, 2.0]].map(Vector3::from);
        for turn in [0.0, 1e-9, 9e-5, 1.1e-4, 0.3, 1.0, 3.0] {
            for axis in [[0.0, 0.0, 1.0], [0.6, -0.8, 0.0], [0.48, 0.6, -0.64]] {
                for velocity_m in velocities {
                    let motion = RigidMotion {
                        velocity_m,
                        turn_rad: Vector3::from(axis) * turn,
                    };
                    let again = RigidMotion::to(&motion.pose());
                    assert!((again.velocity_m - velocity_m).norm() < 1e-9, "{motion:?}");
                    assert!((again.turn_rad - motion.turn_rad).norm() < 1e-9);
                }
            }
        }
    }

    #[test]
    fn motions_at_constant_rates_add_up_and_follow_arcs() {
        let motion = RigidMotion {
            velocity_m: Vector3::new(0.5, 0.0, 0.1),
            turn_rad: Vector3::new(0.0, 0.0, std::f64::consts::FRAC_PI_2),
        };
        let halves = motion.times(0.5).pose() * motion.times(0.5).pose();
        assert!(close(&halves, &motion.pose()));
        // A quarter of a circle whose length is 0.5 m, in a screw that rises by 0.1 m.
        let radius_m = 0.5 / std::f64::consts::FRAC_PI_2;
        let end = motion.pose().translation.vector;
        assert!((end - Vector3::new(radius_m, radius_m, 0.1)).norm() < 1e-12);
    }
}
