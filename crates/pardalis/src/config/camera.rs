//! The cameras of a scene.

use super::reader::{Located, Table};
use crate::Error;
use crate::camera::{
    Camera, DoubleSphere, Equidistant, ExtendedUnified, KannalaBrandt, Mei, Ocam,
    PerspectiveMirror, Pinhole, Unified,
};
use crate::color::{YuvEncoding, YuvMatrix, YuvRange};
use crate::frame::MAX_TIME_S;
use crate::rig::{Pose, pose_from_matrix};

/// One camera of a scene.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraConfig {
    /// Its name.
    pub name: String,
    /// Where its frames come from.
    pub input: Input,
    /// Added to its time stamps, in seconds.
    pub time_offset_s: f64,
    /// Frames left out at the beginning.
    pub first_frame: usize,
    /// The most frames to read.
    pub frame_limit: Option<usize>,
    /// Its model.
    pub camera: Camera,
    /// The size of its images in pixels, where the scene states it.
    pub size_px: Option<Located<[f64; 2]>>,
    /// The image whose white pixels it may use.
    pub mask: Option<Located<String>>,
    /// The circle whose pixels it may use.
    pub mask_circle: Option<MaskCircle>,
    /// Its pose.
    pub world_from_camera: Pose,
}

/// A circle in the image: centre and radius in pixels.
#[derive(Debug, Clone, PartialEq)]
pub struct MaskCircle {
    /// The middle.
    pub center_px: [f64; 2],
    /// The radius.
    pub radius_px: Located<f64>,
}

/// Where a camera's frames come from.
#[derive(Debug, Clone, PartialEq)]
pub enum Input {
    /// A folder of images.
    Images {
        /// The folder.
        folder: Located<String>,
        /// Frames a second; where there is none, `times.csv` beside the images says when each was taken.
        fps: Option<f64>,
    },
    /// Anything that an installed ffmpeg opens.
    Video {
        /// The file, address or device.
        input: Located<String>,
        /// ffmpeg's options before `-i`.
        input_options: Vec<String>,
        /// What the numbers of its pixels mean, where the stream does not say or errs.
        encoding: Option<YuvEncoding>,
    },
}

impl CameraConfig {
    /// Reads one camera; `None` when something needed is missing or faulty, which the journal then says.
    pub(super) fn read(name: String, table: Table) -> Option<Self> {
        let input = read_input(&table);
        let time_offset_s: f64 = table.or("time_offset_s", 0.0);
        if time_offset_s.abs() > MAX_TIME_S {
            table.refuse("time_offset_s", "-1e12 to 1e12 seconds");
        }
        let first_frame = table.or("first_frame", 0);
        let frame_limit = table.optional("frame_limit");
        if frame_limit == Some(0) {
            table.refuse("frame_limit", "1 or more");
        }
        let model = read_model(&table);
        let world_from_camera = match table.required::<[[f64; 4]; 4]>("world_from_camera") {
            Some(rows) => pose_from_matrix(rows)
                .map_err(|error| table.problem("world_from_camera", error.to_string()))
                .ok(),
            None => None,
        };
        let mask = table.located("mask");
        let radius_px = table.located::<f64>("mask_radius_px");
        let center_px = table.optional::<[f64; 2]>("mask_center_px");
        if let Some(radius) = &radius_px
            && radius.value <= 0.0
        {
            table.refuse("mask_radius_px", "a positive number of pixels");
        }
        if center_px.is_some() && radius_px.is_none() {
            table.problem("mask_center_px", "needs mask_radius_px beside it");
        }
        let size_px = table.located("size_px");
        table.finish();
        let (camera, principal_point_px) = model?;
        let mask_circle = radius_px.map(|radius_px| MaskCircle {
            center_px: center_px.unwrap_or(principal_point_px),
            radius_px,
        });
        Some(Self {
            name,
            input: input?,
            time_offset_s,
            first_frame,
            frame_limit,
            camera,
            size_px,
            mask,
            mask_circle,
            world_from_camera: world_from_camera?,
        })
    }
}

fn read_input(table: &Table) -> Option<Input> {
    let images = table.located("images");
    let video = table.located("video");
    let fps = table.optional("fps");
    let input_options = table.optional("input_options");
    let encoding = table.table("yuv").map(|yuv| {
        let matrix = yuv.word(
            "matrix",
            &[("bt601", YuvMatrix::Bt601), ("bt709", YuvMatrix::Bt709)],
            "bt601",
        );
        let range = yuv.word(
            "range",
            &[("full", YuvRange::Full), ("limited", YuvRange::Limited)],
            "limited",
        );
        yuv.finish();
        YuvEncoding {
            matrix: matrix.unwrap_or_default(),
            range: range.unwrap_or_default(),
        }
    });
    if let Some(fps) = fps
        && !(1e-6..=1e6).contains(&fps)
    {
        table.refuse("fps", "1e-6 to 1e6 frames a second");
    }
    match (images, video) {
        (Some(folder), None) => {
            for key in ["input_options", "yuv"] {
                if table.has(key) {
                    table.problem(key, "is for video; a folder of images has no use for it");
                }
            }
            Some(Input::Images { folder, fps })
        }
        (None, Some(input)) => {
            if fps.is_some() {
                table.problem(
                    "fps",
                    "is for folders of images; a video carries its own time stamps",
                );
            }
            Some(Input::Video {
                input,
                input_options: input_options.unwrap_or_default(),
                encoding,
            })
        }
        (Some(_), Some(_)) => {
            table.problem("video", "stands beside images; keep one of them");
            None
        }
        (None, None) => {
            if !table.has("images") && !table.has("video") {
                table.problem_here("says no input; give images = \"FOLDER\" or video = \"FILE\"");
            }
            None
        }
    }
}

/// The camera and its principal point in pixels.
fn read_model(table: &Table) -> Option<(Camera, [f64; 2])> {
    let Some(model) = table.table("model") else {
        if !table.has("model") {
            table.problem(
                "model",
                "is missing; give a table such as [cameras.NAME.model.equidistant]",
            );
        }
        return None;
    };
    let found = model.one_of(&[
        "equidistant",
        "pinhole",
        "kannala_brandt",
        "unified",
        "mei",
        "perspective_mirror",
        "double_sphere",
        "extended_unified",
        "ocam",
    ]);
    model.finish();
    let (kind, parameters) = found?;
    let center_px = parameters.required::<[f64; 2]>("center_px");
    let camera = match kind {
        "equidistant" => read_equidistant(&parameters, center_px),
        "pinhole" => read_pinhole(&parameters, center_px),
        "kannala_brandt" => read_kannala_brandt(&parameters, center_px),
        "unified" => read_unified(&parameters, center_px),
        "mei" => read_mei(&parameters, center_px),
        "perspective_mirror" => read_perspective_mirror(&parameters, center_px),
        "double_sphere" => read_double_sphere(&parameters, center_px),
        "extended_unified" => read_extended_unified(&parameters, center_px),
        _ => read_ocam(&parameters, center_px),
    };
    parameters.finish();
    Some((camera?, center_px?))
}

/// Names the principal point as the scene does.
fn at_center<T>(result: Result<T, Error>) -> Result<T, Error> {
    result.map_err(|error| match error {
        Error::OutOfRange {
            name,
            value,
            allowed,
        } if name == "cx_px" || name == "cy_px" => Error::OutOfRange {
            name: "center_px".to_owned(),
            value,
            allowed,
        },
        other => other,
    })
}

/// Half of the field of view, in radians.
fn read_max_angle(table: &Table) -> Option<f64> {
    let field_of_view_deg: f64 = table.or("field_of_view_deg", 360.0);
    if !(field_of_view_deg > 0.0 && field_of_view_deg <= 360.0) {
        table.refuse("field_of_view_deg", "above 0 and at most 360");
        return None;
    }
    Some((field_of_view_deg / 2.0).to_radians())
}

/// Two focal lengths in pixels.
fn read_focals(table: &Table) -> Option<[f64; 2]> {
    let f = table.required::<[f64; 2]>("f_px")?;
    if f.iter().any(|v| !(*v > 0.0 && *v <= 1e6)) {
        table.refuse("f_px", "positive numbers up to 1e6");
        return None;
    }
    Some(f)
}

fn read_equidistant(table: &Table, center_px: Option<[f64; 2]>) -> Option<Camera> {
    let f = table.required("f_px_per_rad");
    let max_angle_rad = read_max_angle(table);
    let model = Equidistant::new(f?, center_px?, max_angle_rad?);
    table.checked(at_center(model)).map(Camera::Equidistant)
}

fn read_pinhole(table: &Table, center_px: Option<[f64; 2]>) -> Option<Camera> {
    let f = read_focals(table);
    let distortion: Vec<f64> = table.or("distortion", Vec::new());
    let model = Pinhole::new(f?, center_px?, &distortion);
    table.checked(at_center(model)).map(Camera::Pinhole)
}

fn read_kannala_brandt(table: &Table, center_px: Option<[f64; 2]>) -> Option<Camera> {
    let f = read_focals(table);
    let k = table.or("k", [0.0; 4]);
    let max_angle_rad = read_max_angle(table);
    let model = KannalaBrandt::new(f?, center_px?, k, max_angle_rad?);
    table.checked(at_center(model)).map(Camera::KannalaBrandt)
}

fn read_mei(table: &Table, center_px: Option<[f64; 2]>) -> Option<Camera> {
    let f = read_focals(table);
    let skew_px = table.or("skew_px", 0.0);
    let xi = table.required("xi");
    let distortion = table.or("distortion", [0.0; 4]);
    let model = Mei::new(f?, skew_px, center_px?, xi?, distortion);
    table.checked(at_center(model)).map(Camera::Mei)
}

fn read_double_sphere(table: &Table, center_px: Option<[f64; 2]>) -> Option<Camera> {
    let f = read_focals(table);
    let (xi, alpha) = (table.required("xi"), table.required("alpha"));
    let model = DoubleSphere::new(f?, center_px?, xi?, alpha?);
    table.checked(at_center(model)).map(Camera::DoubleSphere)
}

fn read_extended_unified(table: &Table, center_px: Option<[f64; 2]>) -> Option<Camera> {
    let f = read_focals(table);
    let (alpha, beta) = (table.required("alpha"), table.required("beta"));
    let model = ExtendedUnified::new(f?, center_px?, alpha?, beta?);
    table.checked(at_center(model)).map(Camera::ExtendedUnified)
}

fn read_ocam(table: &Table, center_px: Option<[f64; 2]>) -> Option<Camera> {
    let polynomial = table.required::<Vec<f64>>("polynomial");
    let affine = table.or("affine", [1.0, 0.0, 0.0]);
    let max_radius_px = table.required("max_radius_px");
    let model = Ocam::new(&polynomial?, center_px?, affine, max_radius_px?);
    table.checked(at_center(model)).map(Camera::Ocam)
}

fn read_unified(table: &Table, center_px: Option<[f64; 2]>) -> Option<Camera> {
    let (l, m) = (table.required("l"), table.required("m"));
    let f_px = table.or("f_px", 1.0);
    table
        .checked(at_center(Unified::new(l?, m?, f_px, center_px?)))
        .map(Camera::Unified)
}

fn read_perspective_mirror(table: &Table, center_px: Option<[f64; 2]>) -> Option<Camera> {
    let m_px = table.required("m_px");
    table
        .checked(at_center(PerspectiveMirror::new(m_px?, center_px?)))
        .map(Camera::PerspectiveMirror)
}
