//! Calibration files of other programs: OpenCV, ROS, Kalibr, OCamCalib and Basalt.
//!
//! [`read`] and [`write()`] convert between text and cameras; they do not access files.
//!
//! | format | models | poses |
//! |---|---|---|
//! | OpenCV YAML, XML (JSON is read, too) | pinhole, fisheye, omnidir | of one camera, or of the second relative to the first |
//! | ROS `camera_info` | `plumb_bob`, `rational_polynomial`, `equidistant` | no |
//! | Kalibr camchain | pinhole with radtan, equidistant or none; omni, ds, eucm | yes, the world is the frame of the IMU |
//! | `OCamCalib` `calib_results.txt` | its polynomial | no |
//! | Basalt JSON | pinhole, pinhole-radtan8, kb4, ds, eucm, ucm | yes, the world is the frame of the IMU |
//! | `camera.json` of sequence folders (read only) | `fisheye_equidistant`, pinhole, an exact mirror | yes |
//!
//! Writing rejects cameras that the format cannot represent and names the reason. Reading rejects unknown and
//! contradictory values. Fields for other purposes (IMU noise, vignettes, residuals) are ignored. If a file of several
//! cameras names no common frame, the world is the frame of the first camera.

mod basalt;
mod document;
mod intrinsics;
mod kalibr;
mod ocamcalib;
mod opencv;
mod output;
mod ros;
mod sequence;

use crate::Camera;
use crate::pose::CalibratedCamera;
use document::{Entry, error_at, parse_xml, parse_yaml};
use pardalis_core::Error;
pub use ros::CameraInfo;

/// Largest length of a text, in bytes.
pub const MAX_TEXT_BYTES: usize = 4 << 20;

/// Largest number of cameras in a file.
pub const MAX_CAMERAS: usize = 64;

/// A format of calibration files.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// OpenCV's `FileStorage` as YAML.
    OpenCvYaml,
    /// OpenCV's `FileStorage` as XML.
    OpenCvXml,
    /// ROS `camera_info` as YAML.
    Ros,
    /// Kalibr's camchain.
    Kalibr,
    /// `OCamCalib`'s `calib_results.txt`.
    OcamCalib,
    /// Basalt's calibration.
    Basalt,
}

/// The kind of lens that a file describes, for files whose coefficients are ambiguous, or which camera of the file is meant.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Lens {
    /// Pinhole with Brown-Conrady distortion.
    Pinhole,
    /// OpenCV's fisheye module (Kannala-Brandt).
    Fisheye,
    /// OpenCV's omnidir module (Mei).
    Omnidir,
    /// The camera of rectified images: a pinhole without distortion, which ROS calibrations have as projection matrix.
    Rectified,
}

impl Lens {
    /// All lenses.
    pub const ALL: [Self; 4] = [Self::Pinhole, Self::Fisheye, Self::Omnidir, Self::Rectified];

    /// Returns the name of the lens.
    pub fn name(self) -> &'static str {
        match self {
            Self::Pinhole => "pinhole",
            Self::Fisheye => "fisheye",
            Self::Omnidir => "omnidir",
            Self::Rectified => "rectified",
        }
    }

    /// Reports whether a camera has this kind of lens.
    fn is_of(self, camera: &Camera) -> bool {
        match self {
            Self::Pinhole => matches!(camera, Camera::Pinhole(_)),
            Self::Fisheye => matches!(camera, Camera::KannalaBrandt(_) | Camera::Equidistant(_)),
            Self::Omnidir => matches!(camera, Camera::Mei(_)),
            // After the focal lengths and the principal point.
            Self::Rectified => {
                let is_zero = |(_, value): &(&str, f64)| *value == 0.0;
                matches!(camera, Camera::Pinhole(_)) && camera.parameters()[4..].iter().all(is_zero)
            }
        }
    }
}

impl Format {
    /// All formats.
    pub const ALL: [Self; 6] = [
        Self::OpenCvYaml,
        Self::OpenCvXml,
        Self::Ros,
        Self::Kalibr,
        Self::OcamCalib,
        Self::Basalt,
    ];

    /// Returns the name of the format.
    pub fn name(self) -> &'static str {
        match self {
            Self::OpenCvYaml => "opencv-yaml",
            Self::OpenCvXml => "opencv-xml",
            Self::Ros => "ros",
            Self::Kalibr => "kalibr",
            Self::OcamCalib => "ocamcalib",
            Self::Basalt => "basalt",
        }
    }

    /// Reports whether the format can represent a model, named as by [`crate::Camera::kind`].
    pub fn holds(self, kind: &str) -> bool {
        match self {
            Self::OpenCvYaml | Self::OpenCvXml => {
                matches!(kind, "pinhole" | "kannala_brandt" | "equidistant" | "mei")
            }
            Self::Ros => matches!(kind, "pinhole" | "kannala_brandt" | "equidistant"),
            Self::Kalibr => matches!(
                kind,
                "pinhole"
                    | "kannala_brandt"
                    | "equidistant"
                    | "mei"
                    | "double_sphere"
                    | "extended_unified"
            ),
            Self::OcamCalib => kind == "ocam",
            Self::Basalt => matches!(
                kind,
                "pinhole" | "kannala_brandt" | "equidistant" | "double_sphere" | "extended_unified"
            ),
        }
    }

    /// Detects the format of a text from its content.
    fn detect(text: &str) -> Option<Self> {
        let start = text.trim_start_matches('\u{feff}').trim_start();
        if start.starts_with('<') {
            return Some(Self::OpenCvXml);
        }
        let comments = |what: &str| {
            start
                .lines()
                .any(|line| line.starts_with('#') && line.contains(what))
        };
        if comments("ocam_model") || comments("polynomial coefficients") {
            return Some(Self::OcamCalib);
        }
        None
    }
}

/// Reads the cameras of a calibration file. The format is detected from the content.
///
/// `lens` resolves ambiguous files: four coefficients alone may belong to a pinhole or a fisheye.
/// It must not contradict a file that names its lens, except that a ROS calibration has a camera of its rectified images, too.
///
/// # Errors
///
/// Reports the line and the key of values that are missing, malformed, unsupported or
/// contradictory.
pub fn read(text: &str, lens: Option<Lens>) -> Result<Vec<CalibratedCamera>, Error> {
    read_or(text, lens, |_| None)
}

/// Like [`read`], but first offers the text to a reader of another format. `other` returns `None`
/// for texts that are not of its format.
pub fn read_or(
    text: &str,
    lens: Option<Lens>,
    other: impl FnOnce(&str) -> Option<Result<Vec<CalibratedCamera>, Error>>,
) -> Result<Vec<CalibratedCamera>, Error> {
    if text.len() > MAX_TEXT_BYTES {
        let message = format!(
            "the text has {} bytes; allowed: at most {MAX_TEXT_BYTES}",
            text.len()
        );
        return Err(error_at(1, message));
    }
    let cameras = match Format::detect(text) {
        Some(Format::OcamCalib) => ocamcalib::read(text)?,
        Some(Format::OpenCvXml) => opencv::read(&Entry::root(&parse_xml(text)?), lens)?,
        _ => match other(text) {
            Some(cameras) => cameras?,
            None => read_document(text, lens)?,
        },
    };
    if let Some(lens) = lens
        && let Some(other) = cameras.iter().find(|camera| !lens.is_of(&camera.camera))
    {
        let message = format!(
            "camera {} is {} according to the file, but was to be read as {}; omit the lens (--as, or calibration_lens in a scene)",
            other.name,
            other.camera.kind(),
            lens.name()
        );
        return Err(error_at(1, message));
    }
    match cameras.len() {
        1..=MAX_CAMERAS => Ok(cameras),
        0 => Err(error_at(1, "the file contains no camera".to_owned())),
        n => Err(error_at(
            1,
            format!("the file contains {n} cameras; allowed: at most {MAX_CAMERAS}"),
        )),
    }
}

fn read_document(text: &str, lens: Option<Lens>) -> Result<Vec<CalibratedCamera>, Error> {
    let node = parse_yaml(text)?;
    let root = Entry::root(&node);
    let is_opencv = text.starts_with("%YAML") || text.contains("opencv-matrix");
    if root.get("value0").is_some() {
        basalt::read(&root)
    } else if root.get("cam0").is_some() {
        kalibr::read(&root)
    } else if sequence::recognizes(&root) {
        sequence::read(&root)
    } else if !is_opencv && ros::recognizes(&root) {
        ros::read(&root, lens)
    } else if opencv::recognizes(&root) {
        opencv::read(&root, lens)
    } else {
        Err(error_at(
            1,
            "the calibration format is not recognised; allowed: OpenCV (camera_matrix and distortion_coefficients), \
             ROS camera_info, Kalibr (cam0), OCamCalib (calib_results.txt), Basalt (value0), camera.json of sequence \
             folders (T_world_from_camera) and Pardalis ([cameras.NAME])"
                .to_owned(),
        ))
    }
}

/// Returns the text of a calibration file. Reading it again yields exactly the same numbers.
///
/// The largest angle or radius of a model is omitted, since no other program's format contains it,
/// as are poses where the table above says so.
///
/// # Errors
///
/// Rejects duplicate names of cameras, and cameras that the format cannot represent.
pub fn write(format: Format, cameras: &[CalibratedCamera]) -> Result<String, Error> {
    check_names(cameras)?;
    for camera in cameras {
        check_holds(format, camera)?;
    }
    match format {
        Format::OpenCvYaml => opencv::write(cameras, opencv::Storage::Yaml),
        Format::OpenCvXml => opencv::write(cameras, opencv::Storage::Xml),
        Format::Ros => ros::write(output::single_camera(format, cameras)?),
        Format::Kalibr => kalibr::write(cameras),
        Format::OcamCalib => ocamcalib::write(output::single_camera(format, cameras)?),
        Format::Basalt => basalt::write(cameras),
    }
}

/// Checks that a format can represent a camera's model.
fn check_holds(format: Format, camera: &CalibratedCamera) -> Result<(), Error> {
    let kind = camera.camera.kind();
    if format.holds(kind) {
        return Ok(());
    }
    let able = Format::ALL.into_iter().filter(|other| other.holds(kind));
    // Pardalis' own TOML files, which the crate `pardalis-scene` writes, represent every model.
    let able: Vec<_> = std::iter::once("pardalis")
        .chain(able.map(Format::name))
        .collect();
    Err(Error::out_of_range(
        &format!("the model of camera {}", camera.name),
        kind,
        &format!(
            "a model that {} files can represent; these formats can represent {kind}: {}",
            format.name(),
            able.join(", ")
        ),
    ))
}

/// Checks that the list of cameras is not empty and that their names are unique.
pub fn check_names(cameras: &[CalibratedCamera]) -> Result<(), Error> {
    if cameras.is_empty() {
        return Err(Error::Empty {
            what: "the list of cameras".to_owned(),
            remedy: "give at least one".to_owned(),
        });
    }
    for (i, camera) in cameras.iter().enumerate() {
        if cameras[..i].iter().any(|other| other.name == camera.name) {
            let name = &camera.name;
            return Err(Error::out_of_range(
                "the name of a camera",
                name,
                "unique names",
            ));
        }
    }
    Ok(())
}
