//! Elements that several formats write: numbers, lists, parameters and poses.

use super::Format;
use crate::Camera;
use crate::pose::{CalibratedCamera, Pose};
use pardalis_core::Error;

/// Returns the shortest text that every parser reads as the same number: YAML 1.1 requires a
/// decimal point and a signed exponent.
pub(super) fn number(value: f64) -> String {
    let text = format!("{value:?}");
    let Some((mantissa, exponent)) = text.split_once('e') else {
        return text;
    };
    let point = if mantissa.contains('.') { "" } else { ".0" };
    let sign = if exponent.starts_with('-') { "" } else { "+" };
    format!("{mantissa}{point}e{sign}{exponent}")
}

/// Returns `a, b, c`.
pub(super) fn numbers(values: &[f64]) -> String {
    values
        .iter()
        .map(|&value| number(value))
        .collect::<Vec<_>>()
        .join(", ")
}

/// Returns the values of the named parameters of a camera. Its model must have them.
pub(super) fn parameters<const N: usize>(camera: &Camera, names: [&str; N]) -> [f64; N] {
    let all = camera.parameters();
    names.map(|name| {
        let found = all.iter().find(|(known, _)| *known == name);
        found.expect("the model has this parameter").1
    })
}

/// Returns fx, fy, cx, cy. For an equidistant fisheye, fx and fy are equal.
pub(super) fn focals_and_center(camera: &Camera) -> [f64; 4] {
    if let Camera::Equidistant(_) = camera {
        let [f, cx, cy] = parameters(camera, ["f_px_per_rad", "cx_px", "cy_px"]);
        [f, f, cx, cy]
    } else {
        parameters(camera, ["fx_px", "fy_px", "cx_px", "cy_px"])
    }
}

/// Returns OpenCV's four fisheye coefficients, zeros for the equidistant model, and `None` for
/// other models.
pub(super) fn fisheye(camera: &Camera) -> Option<[f64; 4]> {
    match camera {
        Camera::KannalaBrandt(_) => Some(parameters(camera, ["k1", "k2", "k3", "k4"])),
        Camera::Equidistant(_) => Some([0.0; 4]),
        _ => None,
    }
}

/// Returns a pinhole's twelve coefficients in OpenCV's order.
pub(super) fn pinhole_distortion(camera: &Camera) -> [f64; 12] {
    parameters(
        camera,
        [
            "k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4",
        ],
    )
}

/// Returns the smallest of `counts` (in increasing order) such that all further coefficients are
/// zero, or `None` if all are too small.
pub(super) fn count_of(distortion: &[f64; 12], counts: &[usize]) -> Option<usize> {
    counts
        .iter()
        .copied()
        .find(|&count| distortion[count..].iter().all(|&v| v == 0.0))
}

/// Creates the error that a format cannot represent a property of a camera.
pub(super) fn not_representable(
    camera: &CalibratedCamera,
    what: &str,
    value: impl ToString,
    allowed: &str,
) -> Error {
    Error::out_of_range(&format!("{what} of camera {}", camera.name), value, allowed)
}

/// Returns the camera if it is the only one.
pub(super) fn single_camera(
    format: Format,
    cameras: &[CalibratedCamera],
) -> Result<&CalibratedCamera, Error> {
    match cameras {
        [camera] => Ok(camera),
        _ => Err(Error::out_of_range(
            "the number of cameras",
            cameras.len(),
            &format!(
                "1 in a {} file; write each camera to its own file",
                format.name()
            ),
        )),
    }
}

/// Returns the size of the images, which the format requires.
pub(super) fn size_px(camera: &CalibratedCamera) -> Result<(usize, usize), Error> {
    camera.size_px.ok_or_else(|| {
        not_representable(
            camera,
            "the size of the images",
            "unknown",
            "a known size, which this format requires: specify it with --size, or as size_px in a Pardalis file",
        )
    })
}

/// Returns the 4x4 matrix of a transform.
pub(super) fn rows(a_from_b: &Pose) -> [[f64; 4]; 4] {
    let matrix = a_from_b.to_homogeneous();
    std::array::from_fn(|i| std::array::from_fn(|j| matrix[(i, j)]))
}

/// Returns the poses of all cameras in a common frame, or `None` if no camera has a pose. Rejects a
/// mixture.
pub(super) fn poses(cameras: &[CalibratedCamera]) -> Result<Option<Vec<Pose>>, Error> {
    let known = cameras
        .iter()
        .filter(|camera| camera.world_from_camera.is_some())
        .count();
    let missing = cameras.iter().find(|c| c.world_from_camera.is_none());
    match missing {
        Some(camera) if known > 0 => Err(not_representable(
            camera,
            "the pose",
            "missing, but other cameras have one",
            "world_from_camera for all cameras or for none",
        )),
        Some(_) => Ok(None),
        None => Ok(cameras.iter().map(|c| c.world_from_camera).collect()),
    }
}
