//! Where cameras stand: rigid transforms between the world, in metres, and a camera's frame.

use nalgebra::{IsometryMatrix3, Matrix3, Rotation3, Translation3, Vector3};

use crate::Error;
use crate::camera::Camera;

/// A rigid transform. `a_from_b` takes coordinates in frame b to frame a.
pub type Pose = IsometryMatrix3<f64>;

/// One camera as calibration files hold it.
#[derive(Debug, Clone, PartialEq)]
pub struct CalibratedCamera {
    /// Its name.
    pub name: String,
    /// Its model.
    pub camera: Camera,
    /// Width and height of its images in pixels, where the file says them.
    pub size_px: Option<(usize, usize)>,
    /// Its pose, where the file says one; the file's reference frame (the first camera, say) is the world.
    pub world_from_camera: Option<Pose>,
}

/// A pose from a 4x4 matrix, rows first, as calibration files give it.
///
/// The rotation may be off by rounding (1e-4); it is made exact. Mirrored, scaled or skewed matrices are refused.
pub fn pose_from_matrix(rows: [[f64; 4]; 4]) -> Result<Pose, Error> {
    const NAME: &str = "the pose matrix";
    if rows.iter().flatten().any(|v| !v.is_finite()) {
        return Err(Error::out_of_range(NAME, "not finite", "finite numbers"));
    }
    if rows[3] != [0.0, 0.0, 0.0, 1.0] {
        return Err(Error::out_of_range(
            NAME,
            format!("{:?} in its last row", rows[3]),
            "0, 0, 0, 1 there",
        ));
    }
    if let Some(value) = (0..3).map(|i| rows[i][3]).find(|v| v.abs() > 1e6) {
        return Err(Error::out_of_range(
            NAME,
            format!("{value:?} in its last column"),
            "-1e6 to 1e6 metres there",
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
                "no rotation (its columns are off by {deviation:.1e}, its determinant is {:.3})",
                matrix.determinant()
            ),
            "orthonormal columns and determinant 1 in the left 3 x 3 part",
        ));
    }
    // Gram-Schmidt: exact to rounding after the check above.
    let x = matrix.column(0).normalize();
    let y = (matrix.column(1) - x * x.dot(&matrix.column(1))).normalize();
    let rotation = Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[x, y, x.cross(&y)]));
    let translation = Vector3::new(rows[0][3], rows[1][3], rows[2][3]);
    Ok(Pose::from_parts(Translation3::from(translation), rotation))
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Point3;

    #[test]
    fn a_pose_moves_points_and_faulty_matrices_are_refused() {
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
