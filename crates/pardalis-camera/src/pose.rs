//! Poses: rigid transforms between the world frame and a camera frame, in metres.

use nalgebra::{IsometryMatrix3, Matrix3, Rotation3, Translation3, Vector3};

use crate::Camera;
use pardalis_core::Error;

/// A rigid transform. `a_from_b` transforms coordinates of frame b to frame a.
pub type Pose = IsometryMatrix3<f64>;

/// A camera as described by a calibration file.
#[derive(Debug, Clone, PartialEq)]
pub struct CalibratedCamera {
    /// Name.
    pub name: String,
    /// Camera model.
    pub camera: Camera,
    /// Width and height of the images in pixels. `None` if the file does not contain them.
    pub size_px: Option<(usize, usize)>,
    /// Pose. `None` if the file contains no pose. The world frame is the file's reference frame,
    /// for example the first camera.
    pub world_from_camera: Option<Pose>,
}

/// Creates a pose from the rows of a 4x4 matrix.
///
/// The rotation may deviate from orthonormality by rounding (1e-4) and is orthonormalised.
///
/// # Errors
///
/// Mirrored, scaled and skewed matrices, non-finite numbers and translations beyond 1e6 m are
/// rejected.
pub fn pose_from_matrix(rows: [[f64; 4]; 4]) -> Result<Pose, Error> {
    const NAME: &str = "the pose matrix";
    if rows.iter().flatten().any(|v| !v.is_finite()) {
        return Err(Error::out_of_range(NAME, "not finite", "finite numbers"));
    }
    if rows[3] != [0.0, 0.0, 0.0, 1.0] {
        return Err(Error::out_of_range(
            NAME,
            format!("{:?} in its last row", rows[3]),
            "0, 0, 0, 1",
        ));
    }
    if let Some(value) = (0..3).map(|i| rows[i][3]).find(|v| v.abs() > 1e6) {
        return Err(Error::out_of_range(
            NAME,
            format!("{value:?} in its last column"),
            "translations of -1e6 to 1e6 metres",
        ));
    }
    let matrix = Matrix3::from_fn(|i, j| rows[i][j]);
    let deviation = (matrix.transpose() * matrix - Matrix3::identity())
        .abs()
        .max();
    if deviation > 1e-4 || matrix.determinant() < 0.0 {
        return Err(Error::out_of_range(
            NAME,
            format!(
                "not a rotation (its columns deviate by {deviation:.1e}, its determinant is {:.3})",
                matrix.determinant()
            ),
            "orthonormal columns and determinant 1 in the left 3 x 3 part",
        ));
    }
    // Gram-Schmidt orthonormalisation, exact up to rounding after the check above.
    let x = matrix.column(0).normalize();
    let y = (matrix.column(1) - x * x.dot(&matrix.column(1))).normalize();
    let rotation = Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[x, y, x.cross(&y)]));
    let translation = Vector3::new(rows[0][3], rows[1][3], rows[2][3]);
    Ok(Pose::from_parts(Translation3::from(translation), rotation))
}

/// Returns the pose of a camera at one point that looks at another point (world frame, metres), or
/// `None` if the points coincide. The image is upright, turned counter-clockwise by `roll_rad`. For
/// a camera that looks straight up or down, the world's y axis points up in the image.
pub fn looking_at(from_m: Vector3<f64>, at_m: Vector3<f64>, roll_rad: f64) -> Option<Pose> {
    /// Directions closer to the vertical than this have no upright image.
    const VERTICAL: f64 = 1e-6;
    let z = (at_m - from_m).try_normalize(1e-9)?;
    let up = if z.xy().norm() > VERTICAL {
        Vector3::z()
    } else {
        Vector3::y()
    };
    let x = z.cross(&up).normalize();
    let y = z.cross(&x);
    let (sin, cos) = libm::sincos(roll_rad);
    let columns = [x * cos + y * sin, y * cos - x * sin, z];
    let rotation = Rotation3::from_matrix_unchecked(Matrix3::from_columns(&columns));
    Some(Pose::from_parts(Translation3::from(from_m), rotation))
}

/// Returns the pose that best moves the second points to the first ones, in the sense of weighted least squares, from weights and pairs of points
/// (Kabsch 1976; Umeyama 1991 without a scale). `None` if the points lie on a line, or there are fewer than three.
pub fn nearest_pose(points: &[(f64, [Vector3<f64>; 2])]) -> Option<Pose> {
    let total: f64 = points.iter().map(|(weight, _)| weight).sum();
    let mean = |which: usize| {
        let weighted = points.iter().map(|(weight, pair)| pair[which] * *weight);
        weighted.sum::<Vector3<f64>>() / total
    };
    let (first, second) = (mean(0), mean(1));
    let products = points
        .iter()
        .map(|(weight, [a, b])| (a - first) * (b - second).transpose() * *weight);
    let svd = products.sum::<Matrix3<f64>>().svd(true, true);
    let (u, v_t) = (svd.u?, svd.v_t?);
    // The singular values are in descending order. Three points always lie in a plane, and a plane suffices.
    let [largest, middle, _] = svd.singular_values.into();
    if !(middle > 1e-6 * largest) {
        return None;
    }
    let flip = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, (u * v_t).determinant()));
    let rotation = Rotation3::from_matrix_unchecked(u * flip * v_t);
    let translation = first - rotation * second;
    let is_finite = rotation
        .matrix()
        .iter()
        .chain(&translation)
        .all(|v| v.is_finite());
    is_finite.then(|| Pose::from_parts(Translation3::from(translation), rotation))
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Point3;

    #[test]
    fn a_camera_looks_at_its_target_with_the_world_upright() {
        let from = Vector3::new(1.0, 2.0, 0.5);
        let camera_from = |at: Vector3<f64>, roll_rad| {
            let pose = looking_at(from, at, roll_rad).unwrap();
            assert!((pose.rotation.matrix().determinant() - 1.0).abs() < 1e-12);
            let at_in_camera = pose.inverse() * Point3::from(at);
            assert!(at_in_camera.x.abs() < 1e-12 && at_in_camera.y.abs() < 1e-12);
            assert!((at_in_camera.z - (at - from).norm()).abs() < 1e-12);
            pose.inverse()
        };
        let at = Vector3::new(3.0, 1.0, 0.2);
        // Higher points have a smaller v: y points down in the camera frame.
        let up = camera_from(at, 0.0).rotation * Vector3::z();
        assert!(up.x.abs() < 1e-12 && up.y < -0.9);
        // With the image turned counter-clockwise, the world's up points left.
        let up = camera_from(at, std::f64::consts::FRAC_PI_2).rotation * Vector3::z();
        assert!(up.y.abs() < 1e-12 && up.x < -0.9);
        camera_from(from - Vector3::z(), 0.3);
        assert!(looking_at(from, from, 0.0).is_none());
    }

    #[test]
    fn poses_transform_points_and_invalid_matrices_are_rejected() {
        let down = [
            [0.0, -1.0, 0.0, 0.1],
            [-1.0, 0.0, 0.0, 0.2],
            [0.0, 0.0, -1.0, 0.9],
            [0.0, 0.0, 0.0, 1.0],
        ];
        let world_from_camera = pose_from_matrix(down).unwrap();
        let point = world_from_camera * Point3::new(1.25, -1.35, 0.28);
        assert!((point - Point3::new(1.45, -1.05, 0.62)).norm() < 1e-12);
        let mut mirrored = down;
        mirrored[2][2] = 1.0;
        assert!(pose_from_matrix(mirrored).is_err());
        let mut infinite = down;
        infinite[0][3] = f64::INFINITY;
        assert!(pose_from_matrix(infinite).is_err());
        let mut far = down;
        far[0][3] = 1e7;
        assert!(pose_from_matrix(far).is_err());
        let mut scaled = down;
        scaled[0][1] = -2.0;
        assert!(pose_from_matrix(scaled).is_err());
    }
}
