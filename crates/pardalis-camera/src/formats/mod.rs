//! Calibration files of other programs, as text in and text out: OpenCV, ROS, Kalibr, OCamCalib and Basalt.
//!
//! | format | models | poses |
//! |---|---|---|
//! | OpenCV YAML, XML (JSON is read too) | pinhole, fisheye, omnidir | of one camera, or of the second from the first |
//! | ROS `camera_info` | `plumb_bob`, `rational_polynomial`, `equidistant` | no |
//! | Kalibr camchain | pinhole with radtan, equidistant or none; omni, ds, eucm | yes, the IMU's frame is the world |
//! | `OCamCalib` `calib_results.txt` | its polynomial | no |
//! | Basalt JSON | pinhole, pinhole-radtan8, kb4, ds, eucm, ucm | yes, the IMU's frame is the world |
//! | `camera.json` of sequence folders (read only) | `fisheye_equidistant`, pinhole, an exact mirror | yes |
//!
//! What a format cannot hold is refused by name when it is written; what a file says and we do not understand, or what contradicts itself, is refused when
//! it is read. Fields of other purposes (IMU noise, vignettes, residuals) are passed over. Where a file of several cameras names no
//! common frame, the first camera's is the world.

mod basalt;
mod document;
mod intrinsics;
mod kalibr;
mod ocamcalib;
mod opencv;
mod ros;
mod sequence;
mod written;

use crate::Camera;
use crate::pose::CalibratedCamera;
use document::{Entry, fault_at, parse_xml, parse_yaml};
use pardalis_core::Error;

/// The longest text that is read, in bytes.
pub const MAX_TEXT_BYTES: usize = 4 << 20;

/// The most cameras of one file.
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

/// Which lens a file is about, where its coefficients could mean several.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Lens {
    /// Pinhole with Brown-Conrady distortion.
    Pinhole,
    /// OpenCV's fisheye module (Kannala-Brandt).
    Fisheye,
    /// OpenCV's omnidir module (Mei).
    Omnidir,
}

impl Lens {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Pinhole, Self::Fisheye, Self::Omnidir];

    /// The word for it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Pinhole => "pinhole",
            Self::Fisheye => "fisheye",
            Self::Omnidir => "omnidir",
        }
    }

    /// Whether a camera is of this lens.
    fn is_of(self, camera: &Camera) -> bool {
        match self {
            Self::Pinhole => matches!(camera, Camera::Pinhole(_)),
            Self::Fisheye => matches!(camera, Camera::KannalaBrandt(_) | Camera::Equidistant(_)),
            Self::Omnidir => matches!(camera, Camera::Mei(_)),
        }
    }
}

impl Format {
    /// All of them.
    pub const ALL: [Self; 6] = [
        Self::OpenCvYaml,
        Self::OpenCvXml,
        Self::Ros,
        Self::Kalibr,
        Self::OcamCalib,
        Self::Basalt,
    ];

    /// The word for it.
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

    /// Whether it can hold a model, named as by [`crate::Camera::kind`].
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

    /// The format of a text, by its content.
    fn of(text: &str) -> Option<Self> {
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

/// Reads the cameras of a calibration file of any format, which is told by its content.
///
/// `lens` says what the file is about where it does not: four coefficients alone may be a pinhole's or a fisheye's. A file that says so itself must agree.
pub fn read(text: &str, lens: Option<Lens>) -> Result<Vec<CalibratedCamera>, Error> {
    read_or(text, lens, |_| None)
}

/// Reads a calibration file as [`read`] does, after offering the text to a reader of a further format: `other` returns `None` for
/// texts that are not of its format.
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
        return Err(fault_at(1, message));
    }
    let cameras = match Format::of(text) {
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
            "camera {} is {} by what the file says, but it was to be read as {}; leave that out (--as, or calibration_lens in a scene)",
            other.name,
            other.camera.kind(),
            lens.name()
        );
        return Err(fault_at(1, message));
    }
    match cameras.len() {
        1..=MAX_CAMERAS => Ok(cameras),
        0 => Err(fault_at(1, "the file holds no camera".to_owned())),
        n => Err(fault_at(
            1,
            format!("the file holds {n} cameras; allowed: at most {MAX_CAMERAS}"),
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
    } else if sequence::recognises(&root) {
        sequence::read(&root)
    } else if !is_opencv && ros::recognises(&root) {
        ros::read(&root, lens)
    } else if opencv::recognises(&root) {
        opencv::read(&root, lens)
    } else {
        Err(fault_at(
            1,
            "is no calibration that is understood; allowed: OpenCV (camera_matrix and distortion_coefficients), ROS camera_info, \
             Kalibr (cam0), OCamCalib (calib_results.txt), Basalt (value0), camera.json of sequence folders (T_world_from_camera) \
             and Pardalis ([cameras.NAME])"
                .to_owned(),
        ))
    }
}

/// The text of a calibration file. Numbers are written so that reading gives the same ones.
///
/// Refused, by the camera's name: what the format cannot hold, and a name that stands twice. Left out: the largest angle or radius of a model, which no other
/// program's format has, and poses where the table above says so.
pub fn write(format: Format, cameras: &[CalibratedCamera]) -> Result<String, Error> {
    check_names(cameras)?;
    for camera in cameras {
        let kind = camera.camera.kind();
        if !format.holds(kind) {
            let able = Format::ALL.into_iter().filter(|other| other.holds(kind));
            // Pardalis' own TOML files, which the crate `pardalis-scene` writes, hold every model.
            let able: Vec<_> = std::iter::once("pardalis")
                .chain(able.map(Format::name))
                .collect();
            return Err(Error::out_of_range(
                &format!("the model of camera {}", camera.name),
                kind,
                &format!(
                    "a model that {} files can hold; {kind} is held by: {}",
                    format.name(),
                    able.join(", ")
                ),
            ));
        }
    }
    match format {
        Format::OpenCvYaml => opencv::write(cameras, opencv::Storage::Yaml),
        Format::OpenCvXml => opencv::write(cameras, opencv::Storage::Xml),
        Format::Ros => ros::write(written::only_one(format, cameras)?),
        Format::Kalibr => kalibr::write(cameras),
        Format::OcamCalib => ocamcalib::write(written::only_one(format, cameras)?),
        Format::Basalt => basalt::write(cameras),
    }
}

/// Refuses an empty list of cameras, and two cameras of one name.
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
                "each name once",
            ));
        }
    }
    Ok(())
}
