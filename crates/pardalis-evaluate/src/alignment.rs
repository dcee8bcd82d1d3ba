//! Tracks in another world frame than the truth.

use nalgebra::{Point3, Vector3};
use pardalis::filter::estimate::covariance_matrix;
use pardalis_camera::{Pose, nearest_pose};

use crate::EstimatedState;

/// Rounds that find the pose by the sum of distances, and then those by the sum of squares of estimates that are not lost.
const ROUNDS: [usize; 2] = [30, 5];

/// Least distance in the weights of the first rounds, in metres.
const LEAST_DISTANCE_M: f64 = 1e-4;

/// Returns the pose of the tracks' world in that of the truth, from pairs of a true and an estimated position in metres: the one
/// with the least sum of squared distances of those estimates that are not farther than `lost_beyond_m` from the truth then. `None` if they lie on a line.
///
/// Estimates far from the truth do not count: the first rounds minimise the sum of distances.
pub fn alignment(pairs: &[[[f64; 3]; 2]], lost_beyond_m: f64) -> Option<Pose> {
    let pairs = pairs.iter().map(|pair| pair.map(Vector3::from));
    let mut weighted: Vec<(f64, [Vector3<f64>; 2])> = pairs.map(|pair| (1.0, pair)).collect();
    let mut pose = nearest_pose(&weighted)?;
    for round in 0..ROUNDS[0] + ROUNDS[1] {
        for (weight, [truth, estimate]) in &mut weighted {
            let distance_m = (pose * Point3::from(*estimate) - Point3::from(*truth)).norm();
            *weight = if round < ROUNDS[0] {
                1.0 / distance_m.max(LEAST_DISTANCE_M)
            } else {
                f64::from(u8::from(distance_m <= lost_beyond_m))
            };
        }
        pose = nearest_pose(&weighted)?;
    }
    Some(pose)
}

impl EstimatedState {
    /// Returns the estimate in the world of the truth, in which the world of the track has this pose.
    pub fn moved(&self, truth_from_track: &Pose) -> Self {
        let turn = truth_from_track.rotation;
        let place = |at_m: [f64; 3]| (truth_from_track * Point3::from(at_m)).coords.into();
        let turned = |covariance: [f64; 6]| {
            let turned = turn.matrix() * covariance_matrix(covariance) * turn.matrix().transpose();
            [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)].map(|at| turned[at])
        };
        Self {
            position_m: place(self.position_m),
            best_position_m: self.best_position_m.map(place),
            velocity_mps: self.velocity_mps.map(|v| (turn * Vector3::from(v)).into()),
            heading_rad: self.heading_rad.map(|heading_rad| {
                let (sin, cos) = libm::sincos(heading_rad);
                let ahead = turn * Vector3::new(cos, sin, 0.0);
                libm::atan2(ahead.y, ahead.x)
            }),
            velocity_covariance_m2ps2: self.velocity_covariance_m2ps2.map(turned),
            covariance_m2: self.covariance_m2.map(turned),
        }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Rotation3, Translation3};

    use super::*;

    fn pose() -> Pose {
        let turn = Rotation3::from_euler_angles(0.3, -0.2, 1.9);
        Pose::from_parts(Translation3::new(1.0, -2.0, 0.5), turn)
    }

    fn pairs(truth_from_track: &Pose) -> Vec<[[f64; 3]; 2]> {
        let at = |n: f64| Point3::new(n.cos(), (0.7 * n).sin(), 0.02 * n);
        let numbers = (0..100).map(f64::from);
        let pairs = numbers.map(|n| [at(n), truth_from_track.inverse() * at(n)]);
        pairs.map(|pair| pair.map(|p| p.coords.into())).collect()
    }

    #[test]
    fn the_pose_is_found_although_a_third_of_the_estimates_are_lost() {
        let pose = pose();
        let mut pairs = pairs(&pose);
        for (n, [_, estimate]) in pairs.iter_mut().enumerate().filter(|(n, _)| n % 3 == 0) {
            estimate[0] += 2.0 + 0.01 * n as f64;
        }
        let found = alignment(&pairs, 0.5).unwrap();
        let apart = (found.inverse() * pose).to_homogeneous() - nalgebra::Matrix4::identity();
        assert!(apart.abs().max() < 1e-6, "{apart}");
        // On a line, nothing says how it is turned about it.
        let line: Vec<_> = (0..9).map(|n| [[f64::from(n), 0.0, 0.0]; 2]).collect();
        assert_eq!(alignment(&line, 0.5), None);
        assert_eq!(alignment(&[], 0.5), None);
    }

    #[test]
    fn all_parts_of_an_estimate_are_moved() {
        let about_z = Pose::from_parts(
            Translation3::new(1.0, 0.0, 0.0),
            Rotation3::from_euler_angles(0.0, 0.0, std::f64::consts::FRAC_PI_2),
        );
        let estimate = EstimatedState {
            best_position_m: Some([0.0, 2.0, 0.0]),
            velocity_mps: Some([3.0, 0.0, 1.0]),
            velocity_covariance_m2ps2: Some([9.0, 0.25, 0.5, 4.0, 0.125, 1.0]),
            heading_rad: Some(0.25),
            covariance_m2: Some([4.0, 0.5, 0.25, 1.0, 0.125, 9.0]),
            ..EstimatedState::at([2.0, 0.0, 5.0])
        };
        let moved = estimate.moved(&about_z);
        let near = |a: &[f64], b: &[f64]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-12);
        assert!(near(&moved.position_m, &[1.0, 2.0, 5.0]));
        assert!(near(&moved.best_position_m.unwrap(), &[-1.0, 0.0, 0.0]));
        assert!(near(&moved.velocity_mps.unwrap(), &[0.0, 3.0, 1.0]));
        assert!(near(
            &[moved.heading_rad.unwrap()],
            &[0.25 + std::f64::consts::FRAC_PI_2]
        ));
        let turned = [1.0, -0.5, -0.125, 4.0, 0.25, 9.0];
        assert!(near(&moved.covariance_m2.unwrap(), &turned));
        let turned = [4.0, -0.25, -0.125, 9.0, 0.5, 1.0];
        let of_velocity_m2ps2 = moved.velocity_covariance_m2ps2.unwrap();
        assert!(near(&of_velocity_m2ps2, &turned));
    }
}
