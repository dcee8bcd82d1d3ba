//! OpenCV's `FileStorage` (YAML, XML, JSON), with the various keys that its calibration samples and
//! users' scripts write.
//!
//! A file contains one camera, or two cameras whose keys end in 1 and 2. `R` and `T` (or a rotation
//! vector and `T`) transform from the frame of the first camera (for a single camera, the world
//! frame) to the camera.

use std::fmt::Write as _;

use nalgebra::{Rotation3, Vector3};

use super::Lens;
use super::document::Entry;
use super::intrinsics::{
    CameraMatrix, lens_of, resolve_lens, size_from_pair, size_px, transform_from_parts,
};
use super::output;
use crate::Camera;
use crate::pose::{CalibratedCamera, Pose};
use pardalis_core::Error;

/// Largest component of a rotation vector, in radians: several turns.
const MAX_ANGLE_RAD: f64 = 100.0;

const CAMERA_MATRIX: &[&str] = &[
    "camera_matrix",
    "cameraMatrix",
    "Camera_Matrix",
    "intrinsic_matrix",
    "K",
    "M",
];
const DISTORTION: &[&str] = &[
    "distortion_coefficients",
    "Distortion_Coefficients",
    "distCoeffs",
    "dist_coeffs",
    "D",
];
const XI: &[&str] = &["xi", "Xi"];

/// Returns the variants of a key for a camera number: `1` yields `K1` and `K_1`. The number is
/// empty in files of a single camera.
fn keys(names: &[&str], number: &str) -> Vec<String> {
    names
        .iter()
        .flat_map(|name| match number {
            "" => vec![(*name).to_owned()],
            number => vec![format!("{name}{number}"), format!("{name}_{number}")],
        })
        .collect()
}

/// Reports whether the document contains a camera matrix under one of its usual names.
pub(super) fn recognizes(root: &Entry) -> bool {
    ["", "1", "2"].iter().any(|number| {
        keys(CAMERA_MATRIX, number)
            .iter()
            .any(|key| root.get(key).is_some())
    })
}

/// Reads the cameras of a document.
pub(super) fn read(root: &Entry, lens: Option<Lens>) -> Result<Vec<CalibratedCamera>, Error> {
    let size_px = read_size(root)?;
    let relative = read_transform(root)?;
    if let Some(matrix) = root.one_of(&keys(CAMERA_MATRIX, ""))? {
        let camera = read_camera(root, matrix, "", lens)?;
        return Ok(vec![CalibratedCamera {
            name: "camera".to_owned(),
            camera,
            size_px,
            world_from_camera: relative.map(|camera_from_world| camera_from_world.inverse()),
        }]);
    }
    let mut cameras = Vec::new();
    for number in ["1", "2"] {
        if let Some(matrix) = root.one_of(&keys(CAMERA_MATRIX, number))? {
            cameras.push(CalibratedCamera {
                name: format!("cam{number}"),
                camera: read_camera(root, matrix, number, lens)?,
                size_px,
                world_from_camera: None,
            });
        }
    }
    match &mut cameras[..] {
        [] => Err(root.error(
            "contains no camera; allowed: camera_matrix (or cameraMatrix, K; K1 and K2, M1 and M2) with distortion_coefficients (or distCoeffs, D)",
        )),
        [first, second] => {
            if let Some(second_from_first) = relative {
                first.world_from_camera = Some(Pose::identity());
                second.world_from_camera = Some(second_from_first.inverse());
            }
            Ok(cameras)
        }
        _ => Ok(cameras),
    }
}

fn read_camera(
    root: &Entry,
    matrix: Entry,
    number: &str,
    asked: Option<Lens>,
) -> Result<Camera, Error> {
    let Some(distortion) = root.one_of(&keys(DISTORTION, number))? else {
        return Err(matrix.error(format!(
            "has no distortion coefficients; add {}{number} (zeros for a lens without distortion)",
            DISTORTION[0]
        )));
    };
    let coefficients = distortion.matrix()?;
    let coefficients = coefficients.vector()?;
    let xi = root.one_of(&keys(XI, number))?;
    let stated = stated_lens(root)?;
    if let (Some(xi), Some(lens)) = (&xi, stated)
        && lens != Lens::Omnidir
    {
        return Err(xi.error(format!(
            "belongs to omnidir, but the lens is {} according to the file",
            lens.name()
        )));
    }
    let stated = if xi.is_some() {
        Some(Lens::Omnidir)
    } else {
        stated
    };
    let lens = resolve_lens(stated, asked, &distortion, coefficients.len())?;
    let matrix = CameraMatrix::read(matrix.matrix()?)?;
    match (lens, xi) {
        (Lens::Pinhole, _) => matrix.pinhole(&distortion, coefficients),
        (Lens::Fisheye, _) => matrix.fisheye(&distortion, coefficients),
        (Lens::Omnidir, Some(xi)) => {
            let [value] = xi.matrix()?.data[..] else {
                return Err(xi.invalid("one number"));
            };
            matrix.omnidir(value, &distortion, coefficients)
        }
        (Lens::Omnidir, None) => Err(root.error(format!("xi{number} is missing"))),
        (Lens::Rectified, _) => Err(distortion.error(
            "is of raw images; only calibrations of ROS have a camera of rectified ones, as projection_matrix",
        )),
    }
}

/// Returns the lens that the file states: OpenCV's calibration sample writes `fisheye_model`, other
/// programs a name.
fn stated_lens(root: &Entry) -> Result<Option<Lens>, Error> {
    let word = match root.get("distortion_model") {
        Some(word) => Some(word),
        None => root.get("camera_model"),
    };
    let word = word.as_ref().map(lens_of).transpose()?;
    let Some(flag) = root.get("fisheye_model") else {
        return Ok(word);
    };
    let lens = match flag.whole(0, 1)? {
        0 => Lens::Pinhole,
        _ => Lens::Fisheye,
    };
    match word {
        Some(word) if word != lens => Err(flag.error(format!(
            "means {}, but the file also names a {} model; keep one",
            lens.name(),
            word.name()
        ))),
        _ => Ok(Some(lens)),
    }
}

fn read_size(root: &Entry) -> Result<Option<(usize, usize)>, Error> {
    let side = |names: [&str; 3]| root.one_of(&names.map(str::to_owned));
    let width = side(["image_width", "image_Width", "imageWidth"])?;
    let height = side(["image_height", "image_Height", "imageHeight"])?;
    let pair = side(["image_size", "imageSize", "img_size"])?;
    let sides = match (&width, &height) {
        (Some(width), Some(height)) => Some(size_px(width, height)?),
        (Some(one), None) | (None, Some(one)) => {
            return Err(one.error("appears without the other side of the image; add it"));
        }
        (None, None) => None,
    };
    let Some(pair) = pair else {
        return Ok(sides);
    };
    let size = size_from_pair(&pair)?;
    match sides {
        Some(sides) if sides != size => Err(pair.error(format!(
            "is {} x {}, but image_width and image_height are {} x {}; keep one",
            size.0, size.1, sides.0, sides.1
        ))),
        _ => Ok(Some(size)),
    }
}

/// Reads `R` or a rotation vector, and a translation in metres. Returns `None` unless both are
/// present.
fn read_transform(root: &Entry) -> Result<Option<Pose>, Error> {
    let one_of = |names: &[&str]| {
        let names: Vec<_> = names.iter().map(|&name| name.to_owned()).collect();
        root.one_of(&names)
    };
    let rotation = one_of(&["R", "rvec", "om"])?;
    let translation = one_of(&["T", "tvec", "t"])?;
    let (Some(rotation), Some(translation)) = (rotation, translation) else {
        return Ok(None);
    };
    let three = |entry: &Entry| -> Result<[f64; 3], Error> {
        let matrix = entry.matrix()?;
        let values = matrix.vector()?.try_into();
        values.map_err(|_| entry.invalid("3 numbers"))
    };
    let offset = three(&translation)?;
    let matrix = rotation.matrix()?;
    let turn = if matrix.data.len() == 9 {
        matrix.rows::<3, 3>()?
    } else {
        let vector = three(&rotation)?;
        if vector.iter().any(|v| v.abs() > MAX_ANGLE_RAD) {
            return Err(rotation.invalid("a rotation vector in radians, each number within 100"));
        }
        let turn = Rotation3::from_scaled_axis(Vector3::from(vector));
        std::array::from_fn(|i| std::array::from_fn(|j| turn[(i, j)]))
    };
    transform_from_parts(&rotation, turn, offset).map(Some)
}

/// The syntax of `FileStorage` to write.
#[derive(Clone, Copy)]
pub(super) enum Storage {
    Yaml,
    Xml,
}

/// Returns the text of one or two cameras. For two cameras, it contains the pose of the second
/// relative to the first.
pub(super) fn write(cameras: &[CalibratedCamera], storage: Storage) -> Result<String, Error> {
    let poses = output::poses(cameras)?;
    let (sizes_agree, camera_from_reference) = match cameras {
        [_] => (true, poses.map(|poses| poses[0].inverse())),
        [a, b] => (
            a.size_px == b.size_px,
            poses.map(|poses| poses[1].inverse() * poses[0]),
        ),
        _ => {
            return Err(Error::out_of_range(
                "the number of cameras",
                cameras.len(),
                "1 or 2 in an OpenCV file; write each camera to its own file",
            ));
        }
    };
    if !sizes_agree {
        return Err(output::not_representable(
            &cameras[1],
            "the size of the images",
            "different from that of the first camera",
            "images of the same size in an OpenCV file; write each camera to its own file",
        ));
    }
    let mut file = Writer::new(storage);
    if let Some((width, height)) = cameras[0].size_px {
        file.scalar("image_width", width);
        file.scalar("image_height", height);
    }
    let fisheyes = cameras
        .iter()
        .filter(|camera| output::fisheye(&camera.camera).is_some())
        .count();
    if fisheyes == cameras.len() {
        file.scalar("fisheye_model", 1);
    } else if fisheyes > 0 {
        return Err(output::not_representable(
            &cameras[1],
            "the model",
            "different from that of the first camera",
            "either fisheyes only or no fisheye in an OpenCV file; write each camera to its own file",
        ));
    }
    for (i, camera) in cameras.iter().enumerate() {
        let key = |single: &str, stereo: &str| match cameras.len() {
            1 => single.to_owned(),
            _ => format!("{stereo}{}", i + 1),
        };
        let [fx, fy, cx, cy] = output::focals_and_center(&camera.camera);
        let mut skew = 0.0;
        let mut xi = None;
        let distortion = match &camera.camera {
            Camera::Mei(_) => {
                let [s, x] = output::parameters(&camera.camera, ["skew_px", "xi"]);
                (skew, xi) = (s, Some(x));
                output::parameters(&camera.camera, ["k1", "k2", "p1", "p2"]).to_vec()
            }
            other => {
                // Write at least five coefficients for a pinhole: four could be those of a fisheye.
                let pinhole =
                    |d: [f64; 12]| d[..output::count_of(&d, &[5, 8]).unwrap_or(12)].to_vec();
                output::fisheye(other).map_or_else(
                    || pinhole(output::pinhole_distortion(other)),
                    |k| k.to_vec(),
                )
            }
        };
        file.matrix(
            &key("camera_matrix", "K"),
            3,
            &[fx, skew, cx, 0.0, fy, cy, 0.0, 0.0, 1.0],
        );
        file.matrix(
            &key("distortion_coefficients", "D"),
            distortion.len(),
            &distortion,
        );
        if let Some(xi) = xi {
            file.scalar(&key("xi", "xi"), output::number(xi));
        }
    }
    if let Some(pose) = camera_from_reference {
        let rows = output::rows(&pose);
        let rotation: Vec<f64> = rows[..3].iter().flat_map(|row| row[..3].to_vec()).collect();
        file.matrix("R", 3, &rotation);
        file.matrix("T", 1, &[rows[0][3], rows[1][3], rows[2][3]]);
    }
    Ok(file.finish())
}

struct Writer {
    storage: Storage,
    text: String,
}

impl Writer {
    fn new(storage: Storage) -> Self {
        let text = match storage {
            Storage::Yaml => "%YAML:1.0\n---\n",
            Storage::Xml => "<?xml version=\"1.0\"?>\n<opencv_storage>\n",
        };
        Self {
            storage,
            text: text.to_owned(),
        }
    }

    fn scalar(&mut self, key: &str, value: impl std::fmt::Display) {
        // Writing to a String cannot fail.
        let _ = match self.storage {
            Storage::Yaml => writeln!(self.text, "{key}: {value}"),
            Storage::Xml => writeln!(self.text, "<{key}>{value}</{key}>"),
        };
    }

    fn matrix(&mut self, key: &str, columns: usize, data: &[f64]) {
        let rows = data.len() / columns;
        let _ = match self.storage {
            Storage::Yaml => writeln!(
                self.text,
                "{key}: !!opencv-matrix\n   rows: {rows}\n   cols: {columns}\n   dt: d\n   data: [ {} ]",
                output::numbers(data)
            ),
            Storage::Xml => writeln!(
                self.text,
                "<{key} type_id=\"opencv-matrix\">\n  <rows>{rows}</rows>\n  <cols>{columns}</cols>\n  <dt>d</dt>\n  <data>\n    {}</data></{key}>",
                output::numbers(data).replace(',', "")
            ),
        };
    }

    fn finish(self) -> String {
        match self.storage {
            Storage::Yaml => self.text,
            Storage::Xml => self.text + "</opencv_storage>\n",
        }
    }
}
