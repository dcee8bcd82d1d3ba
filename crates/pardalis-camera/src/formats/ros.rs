//! ROS `camera_info` as YAML: the files of `camera_calibration` and `camera_info_manager`, and messages as `rostopic echo` prints them.

use super::Lens;
use super::document::Entry;
use super::intrinsics::{
    CameraMatrix, lens_of, plain_name, settle_lens, size_px, transform_from_parts,
};
use super::written;
use crate::pose::CalibratedCamera;
use pardalis_core::Error;

/// Names of the same thing in files, in ROS 1 messages and in ROS 2 messages.
const CAMERA_MATRIX: [&str; 3] = ["camera_matrix", "K", "k"];
const DISTORTION: [&str; 3] = ["distortion_coefficients", "D", "d"];
const RECTIFICATION: [&str; 3] = ["rectification_matrix", "R", "r"];
const PROJECTION: [&str; 3] = ["projection_matrix", "P", "p"];

fn one_of<'a>(root: &Entry<'a>, names: &[&str]) -> Result<Option<Entry<'a>>, Error> {
    let names: Vec<_> = names.iter().map(|&name| name.to_owned()).collect();
    root.one_of(&names)
}

/// Messages in files are sometimes wrapped.
fn unwrapped<'a>(root: &Entry<'a>) -> Entry<'a> {
    root.get("camera_info").unwrap_or_else(|| root.clone())
}

/// Whether the document has a camera matrix and what only ROS writes beside it.
pub(super) fn recognises(root: &Entry) -> bool {
    let root = unwrapped(root);
    let has = |names: &[&str]| names.iter().any(|name| root.get(name).is_some());
    has(&CAMERA_MATRIX)
        && (has(&RECTIFICATION[..1])
            || has(&PROJECTION)
            || has(&["camera_name", "distortion_model"]))
}

/// The camera of a document.
pub(super) fn read(root: &Entry, lens: Option<Lens>) -> Result<Vec<CalibratedCamera>, Error> {
    let root = &unwrapped(root);
    let missing = |what: &str| root.fault(format!("{what} is missing"));
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
        return Err(
            matrix.fault("begins with 0, by which ROS says that the camera is not calibrated")
        );
    }
    let stated = match root.get("distortion_model") {
        Some(word) => Some(word),
        None => root.get("camera_model"),
    };
    let word = stated.as_ref().map(lens_of).transpose()?;
    let lens = settle_lens(word, lens, &distortion, coefficients.len())?;
    let camera_matrix = CameraMatrix::read(elements)?;
    let camera = match lens {
        Lens::Pinhole => camera_matrix.pinhole(&distortion, coefficients)?,
        Lens::Fisheye => camera_matrix.fisheye(&distortion, coefficients)?,
        Lens::Omnidir => {
            return Err(distortion.fault(
                "belongs to an omnidir model by what the file says; allowed in ROS: plumb_bob, rational_polynomial, equidistant",
            ));
        }
    };
    check_rectification(root)?;
    check_region(root, size_px)?;
    let name = match root.get("camera_name") {
        Some(name) => name.text()?,
        None => String::new(),
    };
    Ok(vec![CalibratedCamera {
        name: plain_name(&name, "camera"),
        camera,
        size_px: Some(size_px),
        world_from_camera: None,
    }])
}

/// R and P are of the rectified image and not ours, but must be what they claim to be.
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
            return Err(entry.fault(format!(
                "has {:?} in its last row; allowed: 0, 0, 1, 0",
                rows[2]
            )));
        }
    }
    Ok(())
}

/// The calibration is of whole images at full resolution.
fn check_region(root: &Entry, (width, height): (usize, usize)) -> Result<(), Error> {
    for key in ["binning_x", "binning_y"] {
        if let Some(binning) = root.get(key)
            && binning.number()? > 1.0
        {
            return Err(
                binning.refuse("0 or 1, since the calibration is of images at full resolution")
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
                let allowed = format!("0 or {full}, since the calibration is of the whole image");
                return Err(entry.refuse(&allowed));
            }
        }
    }
    Ok(())
}

/// The text of one camera, as `camera_calibration` lays it out. A pose is left out.
pub(super) fn write(camera: &CalibratedCamera) -> Result<String, Error> {
    let (width, height) = written::size_px(camera)?;
    let [fx, fy, cx, cy] = written::focals_and_center(&camera.camera);
    let (model, distortion) = if let Some(k) = written::fisheye(&camera.camera) {
        ("equidistant", k.to_vec())
    } else {
        let all = written::pinhole_distortion(&camera.camera);
        match written::count_of(&all, &[5, 8]) {
            Some(5) => ("plumb_bob", all[..5].to_vec()),
            Some(count) => ("rational_polynomial", all[..count].to_vec()),
            None => {
                return Err(written::cannot_hold(
                    camera,
                    "the distortion",
                    "longer, with the thin prism's s1 to s4",
                    "k1 k2 p1 p2 k3 k4 k5 k6 in ROS files; OpenCV files hold all twelve",
                ));
            }
        }
    };
    let matrix = |rows: usize, columns: usize, data: &[f64]| {
        let data = written::numbers(data);
        format!("  rows: {rows}\n  cols: {columns}\n  data: [{data}]\n")
    };
    let zeros_and_one = [0.0, 0.0, 1.0];
    let k = [&[fx, 0.0, cx, 0.0, fy, cy], &zeros_and_one[..]].concat();
    let p = [fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0];
    let r = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
    Ok(format!(
        "image_width: {width}\nimage_height: {height}\ncamera_name: {}\ncamera_matrix:\n{}distortion_model: {model}\n\
         distortion_coefficients:\n{}rectification_matrix:\n{}projection_matrix:\n{}",
        quoted(&camera.name),
        matrix(3, 3, &k),
        matrix(1, distortion.len(), &distortion),
        matrix(3, 3, &r),
        matrix(3, 4, &p),
    ))
}

/// A name in quotes: names such as `on` or `12` are no texts in YAML without them.
fn quoted(name: &str) -> String {
    format!("\"{}\"", name.replace(['"', '\\'], "_"))
}
