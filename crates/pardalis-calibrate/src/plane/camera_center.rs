//! Position of the camera above the plane.

use nalgebra::{Matrix3, Matrix3x2, Vector3};

use pardalis_camera::Homography;
use pardalis_core::Error;

/// Largest accepted relative difference between the lengths of the plane's two axes.
const MAX_STRETCH: f64 = 0.2;

/// Largest accepted cosine of the angle between the axes.
const MAX_COSINE: f64 = 0.2;

/// Computes the camera's position in the plane frame, in metres. `f_px` and `center_px` are its focal lengths
/// and principal point in pixels.
///
/// inv(K) H is [r1 r2 t] up to scale; polar decomposition makes r1 and r2 orthonormal (Zhang 2000, appendix C).
///
/// # Errors
///
/// Fails if the intrinsics do not fit the homography: the plane's axes then differ in length or are far from
/// perpendicular.
pub fn camera_center_m(
    homography: &Homography,
    f_px: [f64; 2],
    center_px: [f64; 2],
) -> Result<[f64; 3], Error> {
    let usable = f_px.iter().all(|f| *f >= 1e-3 && *f <= 1e6);
    if !usable || !center_px.iter().all(|c| c.abs() <= 1e6) {
        return Err(Error::out_of_range(
            "f_px, center_px",
            format!("{f_px:?}, {center_px:?}"),
            "focal lengths from 0.001 to 1e6 and a principal point within 1e6, in pixels",
        ));
    }
    let intrinsics = Matrix3::new(
        f_px[0],
        0.0,
        center_px[0],
        0.0,
        f_px[1],
        center_px[1],
        0.0,
        0.0,
        1.0,
    );
    let columns = intrinsics
        .try_inverse()
        .map_or_else(Matrix3::zeros, |inverse| inverse * homography.matrix());
    let axes: Matrix3x2<f64> = columns.fixed_columns::<2>(0).into();
    let [x_length, y_length] = [0, 1].map(|axis| axes.column(axis).norm());
    let cosine = axes.column(0).dot(&axes.column(1)) / (x_length * y_length);
    let stretch = x_length / y_length;
    let fits = cosine.abs() <= MAX_COSINE
        && (1.0 / (1.0 + MAX_STRETCH)..=1.0 + MAX_STRETCH).contains(&stretch);
    let svd = axes.svd(true, true);
    let (Some(u), Some(v_t), true) = (svd.u, svd.v_t, fits) else {
        return Err(Error::refused(
            format!(
                "the intrinsics do not fit the plane: with focal lengths {:?} px and the principal point {:?} px its axes would be at {:.0} degrees, \
                 and lengths along x {:.2} times those along y",
                f_px,
                center_px,
                libm::acos(cosine).to_degrees(),
                stretch
            ),
            "check the focal length, and the points on the plane",
        ));
    };
    let turned = u * v_t;
    let [x, y]: [Vector3<f64>; 2] = [0, 1].map(|axis| turned.column(axis).into());
    let camera_from_plane = Matrix3::from_columns(&[x, y, x.cross(&y)]);
    let translation = columns.column(2) / (x_length * y_length).sqrt();
    Ok((-camera_from_plane.transpose() * translation).into())
}
