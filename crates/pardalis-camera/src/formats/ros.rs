//! ROS `camera_info` as YAML: files of `camera_calibration` and `camera_info_manager`, and messages
//! printed by `rostopic echo`.

use super::document::Entry;
use super::intrinsics::{
    CameraMatrix, lens_of, resolve_lens, sanitized_name, size_px, transform_from_parts,
};
use super::output;
use super::{Format, Lens};
use crate::pose::CalibratedCamera;
use crate::{Camera, Pinhole};
use pardalis_core::Error;

/// Synonymous keys in files, ROS 1 messages and ROS 2 messages.
const CAMERA_MATRIX: [&str; 3] = ["camera_matrix", "K", "k"];
const DISTORTION: [&str; 3] = ["distortion_coefficients", "D", "d"];
const RECTIFICATION: [&str; 3] = ["rectification_matrix", "R", "r"];
const PROJECTION: [&str; 3] = ["projection_matrix", "P", "p"];

fn one_of<'a>(root: &Entry<'a>, names: &[&str]) -> Result<Option<Entry<'a>>, Error> {
    let names: Vec<_> = names.iter().map(|&name| name.to_owned()).collect();
    root.one_of(&names)
}

/// Returns the content of a message that is nested in `camera_info`.
fn unwrapped<'a>(root: &Entry<'a>) -> Entry<'a> {
    root.get("camera_info").unwrap_or_else(|| root.clone())
}

/// Reports whether the document contains a camera matrix and a key that only ROS writes.
pub(super) fn recognizes(root: &Entry) -> bool {
    let root = unwrapped(root);
    let has = |names: &[&str]| names.iter().any(|name| root.get(name).is_some());
    has(&CAMERA_MATRIX)
        && (has(&RECTIFICATION[..1])
            || has(&PROJECTION)
            || has(&["camera_name", "distortion_model"]))
}

/// Reads the camera of a document.
pub(super) fn read(root: &Entry, lens: Option<Lens>) -> Result<Vec<CalibratedCamera>, Error> {
    let root = &unwrapped(root);
    let missing = |what: &str| root.error(format!("{what} is missing"));
    let width = one_of(root, &["image_width", "width"])?.ok_or_else(|| missing("image_width"))?;
    let height =
        one_of(root, &["image_height", "height"])?.ok_or_else(|| missing("image_height"))?;
    let size_px = size_px(&width, &height)?;
    let matrix = one_of(root, &CAMERA_MATRIX)?.ok_or_else(|| missing(CAMERA_MATRIX[0]))?;
    let distortion = one_of(root, &DISTORTION)?.ok_or_else(|| missing(DISTORTION[0]))?;
    let coefficients = distortion.matrix()?;
    let coefficients = coefficients.vector()?;
    let elements = matrix.matrix()?;
    if elements.data.first() == Some(&0.0) {
        return Err(matrix.error(
            "starts with 0, which means in ROS that the camera is not calibrated; calibrate it",
        ));
    }
    let stated = match root.get("distortion_model") {
        Some(word) => Some(word),
        None => root.get("camera_model"),
    };
    let word = stated.as_ref().map(lens_of).transpose()?;
    let lens = match lens {
        // Whatever the lens of the raw images.
        Some(Lens::Rectified) => Lens::Rectified,
        lens => resolve_lens(word, lens, &distortion, coefficients.len())?,
    };
    let camera_matrix = CameraMatrix::read(elements)?;
    check_rectification(root)?;
    let camera = match lens {
        Lens::Pinhole => camera_matrix.pinhole(&distortion, coefficients)?,
        Lens::Fisheye => camera_matrix.fisheye(&distortion, coefficients)?,
        Lens::Omnidir => {
            return Err(distortion.error(
                "belongs to an omnidir model according to the file; allowed in ROS: plumb_bob, rational_polynomial, equidistant",
            ));
        }
        Lens::Rectified => rectified(root)?,
    };
    check_region(root, size_px)?;
    let name = match root.get("camera_name") {
        Some(name) => name.text()?,
        None => String::new(),
    };
    Ok(vec![CalibratedCamera {
        name: sanitized_name(&name, "camera"),
        camera,
        size_px: Some(size_px),
        world_from_camera: None,
    }])
}

/// Returns the camera of the rectified images. The last column of P, which tells where the camera is beside another one, belongs to the pose.
fn rectified(root: &Entry) -> Result<Camera, Error> {
    let missing =
        || root.error("projection_matrix is missing: the camera of rectified images".to_owned());
    let projection = one_of(root, &PROJECTION)?.ok_or_else(missing)?;
    let [[fx, skew, cx, _], [zero, fy, cy, _], _] = projection.matrix()?.rows::<3, 4>()?;
    if fx == 0.0 {
        return Err(projection.error(
            "starts with 0: the calibration has no camera of rectified images; use the raw images, or state the model of the camera",
        ));
    }
    if skew != 0.0 || zero != 0.0 {
        return Err(projection.error("has a skew, which rectified images do not have"));
    }
    let model = Pinhole::new([fx, fy], [cx, cy], &[]);
    projection.checked(model).map(Camera::Pinhole)
}

/// Checks R and P, which concern the rectified image.
fn check_rectification(root: &Entry) -> Result<(), Error> {
    if let Some(entry) = one_of(root, &RECTIFICATION)? {
        let rows = entry.matrix()?.rows::<3, 3>()?;
        if rows != [[0.0; 3]; 3] {
            transform_from_parts(&entry, rows, [0.0; 3])?;
        }
    }
    if let Some(entry) = one_of(root, &PROJECTION)? {
        let rows = entry.matrix()?.rows::<3, 4>()?;
        if rows != [[0.0; 4]; 3] && rows[2] != [0.0, 0.0, 1.0, 0.0] {
            return Err(entry.error(format!(
                "has {:?} in its last row; allowed: 0, 0, 1, 0",
                rows[2]
            )));
        }
    }
    Ok(())
}

/// Checks that the calibration is for whole images at full resolution.
fn check_region(root: &Entry, (width, height): (usize, usize)) -> Result<(), Error> {
    for key in ["binning_x", "binning_y"] {
        if let Some(binning) = root.get(key)
            && binning.number()? > 1.0
        {
            return Err(
                binning.invalid("0 or 1: the calibration must be for images at full resolution")
            );
        }
    }
    let Some(region) = root.get("roi") else {
        return Ok(());
    };
    for (key, full) in [
        ("x_offset", 0),
        ("y_offset", 0),
        ("width", width),
        ("height", height),
    ] {
        if let Some(entry) = region.get(key) {
            let value = entry.number()?;
            if value != 0.0 && value != full as f64 {
                let allowed = format!("0 or {full}: the calibration must be for the whole image");
                return Err(entry.invalid(&allowed));
            }
        }
    }
    Ok(())
}

/// A camera in the fields of ROS's message `sensor_msgs/CameraInfo`, which files and messages of other programs have, too.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraInfo {
    /// `plumb_bob`, `rational_polynomial` or `equidistant`.
    pub distortion_model: &'static str,
    /// The coefficients of the distortion.
    pub d: Vec<f64>,
    /// The camera matrix, row by row.
    pub k: [f64; 9],
    /// The rotation to the rectified image: none.
    pub r: [f64; 9],
    /// The camera matrix of the rectified image: the same.
    pub p: [f64; 12],
}

impl CameraInfo {
    /// Returns the fields of a camera.
    ///
    /// Errors: the format cannot represent it.
    pub fn of(camera: &CalibratedCamera) -> Result<Self, Error> {
        super::check_holds(Format::Ros, camera)?;
        let [fx, fy, cx, cy] = output::focals_and_center(&camera.camera);
        let (distortion_model, d) = if let Some(k) = output::fisheye(&camera.camera) {
            ("equidistant", k.to_vec())
        } else {
            let all = output::pinhole_distortion(&camera.camera);
            match output::count_of(&all, &[5, 8]) {
                Some(5) => ("plumb_bob", all[..5].to_vec()),
                Some(count) => ("rational_polynomial", all[..count].to_vec()),
                None => {
                    return Err(output::not_representable(
                        camera,
                        "the distortion",
                        "too long: it has the thin-prism coefficients s1 to s4",
                        "k1 k2 p1 p2 k3 k4 k5 k6 in ROS files; OpenCV files can represent all twelve",
                    ));
                }
            }
        };
        Ok(Self {
            distortion_model,
            d,
            k: [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0],
            r: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
            p: [fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0],
        })
    }
}

/// Returns the text of one camera in the layout of `camera_calibration`, without its pose.
pub(super) fn write(camera: &CalibratedCamera) -> Result<String, Error> {
    let (width, height) = output::size_px(camera)?;
    let info = CameraInfo::of(camera)?;
    let matrix = |rows: usize, columns: usize, data: &[f64]| {
        let data = output::numbers(data);
        format!("  rows: {rows}\n  cols: {columns}\n  data: [{data}]\n")
    };
    Ok(format!(
        "image_width: {width}\nimage_height: {height}\ncamera_name: {}\ncamera_matrix:\n{}distortion_model: {}\n\
         distortion_coefficients:\n{}rectification_matrix:\n{}projection_matrix:\n{}",
        quoted(&camera.name),
        matrix(3, 3, &info.k),
        info.distortion_model,
        matrix(1, info.d.len(), &info.d),
        matrix(3, 3, &info.r),
        matrix(3, 4, &info.p),
    ))
}

/// Quotes a name: YAML does not read unquoted names such as `on` or `12` as texts.
fn quoted(name: &str) -> String {
    format!("\"{}\"", name.replace(['"', '\\'], "_"))
}
