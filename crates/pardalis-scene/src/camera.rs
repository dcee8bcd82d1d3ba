//! The cameras of a scene.

use super::mirror;
use super::plane::{self, PlaneModel, RectangleConfig};
use super::reader::{Located, Table};
use super::setting::Setting;
use pardalis::color::{YuvEncoding, YuvMatrix, YuvRange};
use pardalis::frame::MAX_TIME_S;
use pardalis_camera::formats::Lens;
use pardalis_camera::{CalibratedCamera, Pose, pose_from_matrix};
use pardalis_camera::{
    Camera, DoubleSphere, Equidistant, ExactMirror, ExtendedUnified, KannalaBrandt, Mei, Ocam,
    PerspectiveMirror, Pinhole, Plane, Unified,
};
use pardalis_core::Error;

/// Reads the calibration file of this name, as the caller finds it; on failure the message, which names file and line.
///
/// The second argument says what the file is about where it does not ([`pardalis_camera::formats::read`]).
pub type ReadCalibration<'a> =
    &'a dyn Fn(&str, Option<Lens>) -> Result<Vec<CalibratedCamera>, String>;

/// One camera of a scene.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraConfig {
    /// Its name.
    pub name: String,
    /// Where its frames come from.
    pub input: Input,
    /// Added to its time stamps, in seconds.
    pub time_offset_s: f64,
    /// Which of its frames are read.
    pub frames: FrameRange,
    /// Its model; until a rectangle is found in its images, that of [`Plane::image`].
    pub camera: Camera,
    /// The rectangle by which the program finds its model, where that is how it is known.
    pub rectangle: Option<Located<RectangleConfig>>,
    /// The size of its images in pixels, where the scene states it.
    pub size_px: Option<Located<[f64; 2]>>,
    /// The image whose white pixels it may use.
    pub mask: Option<Located<String>>,
    /// The circle whose pixels it may use.
    pub mask_circle: Option<MaskCircle>,
    /// Its pose.
    pub world_from_camera: Pose,
}

/// Some of the frames of an input.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FrameRange {
    /// Frames left out at the beginning.
    pub first: usize,
    /// From there on, every so many-th frame is read; at least 1.
    pub step: usize,
    /// The most frames to read.
    pub limit: Option<usize>,
}

impl FrameRange {
    /// All of them.
    pub const ALL: Self = Self {
        first: 0,
        step: 1,
        limit: None,
    };

    /// How many of so many frames are read.
    pub fn count_of(&self, frames: usize) -> usize {
        let left = frames.saturating_sub(self.first).div_ceil(self.step);
        left.min(self.limit.unwrap_or(usize::MAX))
    }

    /// Whether the frame of this number is read, the limit aside.
    pub fn takes(&self, frame: usize) -> bool {
        frame >= self.first && (frame - self.first).is_multiple_of(self.step)
    }
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

impl Input {
    /// The folder, file, address or device, with its place in the scene.
    pub fn place(&self) -> &Located<String> {
        match self {
            Self::Images { folder, .. } => folder,
            Self::Video { input, .. } => input,
        }
    }
}

impl CameraConfig {
    /// Reads one camera; `None` when something needed is missing or faulty, which the journal then says.
    pub(super) fn read(
        name: String,
        table: Table,
        read_calibration: ReadCalibration,
    ) -> Option<Self> {
        let input = read_input(&table);
        let time_offset_s: f64 = table.or("time_offset_s", 0.0);
        if time_offset_s.abs() > MAX_TIME_S {
            table.refuse("time_offset_s", "-1e12 to 1e12 seconds");
        }
        let frames = FrameRange {
            first: table.or("first_frame", 0),
            step: table.or("frame_step", 1),
            limit: table.optional("frame_limit"),
        };
        for (key, count) in [
            ("frame_step", Some(frames.step)),
            ("frame_limit", frames.limit),
        ] {
            if count == Some(0) {
                table.refuse(key, "1 or more");
            }
        }
        let optics = read_optics(&name, &table, read_calibration);
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
        table.finish();
        let optics = optics?;
        let mask_circle = radius_px.map(|radius_px| MaskCircle {
            center_px: center_px.unwrap_or_else(|| principal_point_px(&optics.camera)),
            radius_px,
        });
        Some(Self {
            name,
            input: input?,
            time_offset_s,
            frames,
            camera: optics.camera,
            rectangle: optics.rectangle,
            size_px: optics.size_px,
            mask,
            mask_circle,
            world_from_camera: optics.world_from_camera,
        })
    }
}

impl CameraConfig {
    /// Where it stands in the world, in metres; nothing where only a plane that it sees is known.
    pub fn position_m(&self) -> Option<[f64; 3]> {
        match &self.camera {
            Camera::Plane(plane) => plane.center_m(),
            _ => Some(self.world_from_camera.translation.vector.into()),
        }
    }
}

/// Elements of two matrices of the same pose differ by this much at most: files round.
const SAME_POSE: f64 = 1e-6;

/// What a scene says of a camera itself, or a calibration file in its place.
struct Optics {
    camera: Camera,
    rectangle: Option<Located<RectangleConfig>>,
    size_px: Option<Located<[f64; 2]>>,
    world_from_camera: Pose,
}

fn read_optics(name: &str, table: &Table, read_calibration: ReadCalibration) -> Option<Optics> {
    let file = read_calibrated(name, table, read_calibration);
    let model = if table.has("calibration") {
        if table.table("model").is_some() {
            table.problem("model", "stands beside calibration; keep one of them");
        }
        file.as_ref().map(|file| Model::Known(file.camera.clone()))
    } else {
        read_any_model(table)
    };
    let (model, rectangle) = match model {
        None => (None, None),
        Some(Model::Known(camera)) => (Some(camera), None),
        Some(Model::Rectangle(rectangle)) => (Some(Camera::Plane(Plane::image())), Some(rectangle)),
    };
    if matches!(model, Some(Camera::Plane(_))) && table.knows("world_from_camera") {
        let message = "stands beside a camera of a plane, whose frame is the world's; leave it out";
        table.problem("world_from_camera", message);
        return None;
    }
    let own_pose = model.as_ref().and_then(pose_of_model);
    // Of a faulty plane its own problems are told.
    let needs_no_pose = table
        .table("model")
        .is_some_and(|model| model.has("plane") || model.has("image"));
    let pose_is_missing = if needs_no_pose || table.has("world_from_camera") {
        None
    } else if table.has("calibration") {
        let in_file = file
            .as_ref()
            .is_none_or(|file| file.world_from_camera.is_some());
        (!in_file).then_some("is missing, and the calibration file has no pose either")
    } else {
        Some("is missing")
    };
    if let Some(missing) = pose_is_missing {
        let wanted = <[[f64; 4]; 4]>::ALLOWED;
        table.problem("world_from_camera", format!("{missing}; give {wanted}"));
    }
    let given_pose = read_pose(table);
    let file_pose = file.as_ref().and_then(|file| file.world_from_camera);
    // A camera that was mounted anew keeps its file; but init's guess may have been forgotten.
    if let (Some(given), Some(in_file)) = (&given_pose, &file_pose)
        && (given.to_homogeneous() - in_file.to_homogeneous()).amax() > SAME_POSE
    {
        let path: Option<String> = table.optional("calibration");
        table.warn(
            "world_from_camera",
            format!(
                "stands in place of the pose in {}; take it out to use that one",
                path.unwrap_or_default()
            ),
        );
    }
    let given_size = table.located::<[f64; 2]>("size_px");
    let file_size = file
        .as_ref()
        .and_then(|file| file.size_px)
        .map(|(w, h)| [w as f64, h as f64]);
    if let (Some(given), Some([width, height])) = (&given_size, file_size)
        && given.value != [width, height]
    {
        let message =
            format!("contradicts the calibration file, which is for images of {width} x {height}");
        table.problem("size_px", message);
    }
    Some(Optics {
        camera: model?,
        rectangle,
        size_px: given_size.or_else(|| file_size.map(|size| table.at("calibration", size))),
        world_from_camera: own_pose.or(given_pose).or(file_pose)?,
    })
}

/// The pose of cameras that are known by a plane of the world: their frame is the world's.
pub(super) fn pose_of_model(camera: &Camera) -> Option<Pose> {
    matches!(camera, Camera::Plane(_)).then(Pose::identity)
}

/// The camera of the calibration file, where the scene names one.
pub(super) fn read_calibrated(
    name: &str,
    table: &Table,
    read_calibration: ReadCalibration,
) -> Option<CalibratedCamera> {
    let file: Option<String> = table.optional("calibration");
    let wanted: Option<String> = table.optional("calibration_camera");
    let lens_word: Option<String> = table.optional("calibration_as");
    if !table.has("calibration") {
        for key in ["calibration_camera", "calibration_as"] {
            if table.has(key) {
                table.problem(key, "needs calibration = \"FILE\" beside it");
            }
        }
    }
    let lens = match lens_word {
        None => None,
        Some(word) => {
            let lens = Lens::ALL.into_iter().find(|lens| lens.name() == word);
            if lens.is_none() {
                table.refuse("calibration_as", "\"pinhole\", \"fisheye\", \"omnidir\"");
                return None;
            }
            lens
        }
    };
    let cameras = read_calibration(&file?, lens)
        .map_err(|message| table.problem("calibration", message))
        .ok()?;
    let names = cameras
        .iter()
        .map(|camera| camera.name.as_str())
        .collect::<Vec<_>>()
        .join(", ");
    let found = match &wanted {
        Some(wanted) => cameras.iter().find(|camera| camera.name == *wanted),
        None if cameras.len() == 1 => cameras.first(),
        None => cameras.iter().find(|camera| camera.name == name),
    };
    if found.is_none() {
        if wanted.is_some() {
            table.refuse("calibration_camera", &names);
        } else {
            let message = format!("holds the cameras {names}; say which by calibration_camera");
            table.problem("calibration", message);
        }
    }
    found.cloned()
}

/// The pose, if it is given.
pub(super) fn read_pose(table: &Table) -> Option<Pose> {
    let rows = table.optional::<[[f64; 4]; 4]>("world_from_camera")?;
    pose_from_matrix(rows)
        .map_err(|error| table.problem("world_from_camera", error.to_string()))
        .ok()
}

/// Where the optical axis meets the image: every model has such a point.
fn principal_point_px(camera: &Camera) -> [f64; 2] {
    let parameters = camera.parameters();
    ["cx_px", "cy_px"].map(|name| {
        let found = parameters.iter().find(|(known, _)| *known == name);
        found.map_or(0.0, |&(_, value)| value)
    })
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

/// A camera's model.
enum Model {
    Known(Camera),
    /// By a rectangle that is to be found in its images.
    Rectangle(Located<RectangleConfig>),
}

/// The camera's model, from the table `model`, where there are no images to find anything in.
pub(super) fn read_model(table: &Table) -> Option<Camera> {
    match read_any_model(table)? {
        Model::Known(camera) => Some(camera),
        Model::Rectangle(_) => {
            let message = "is found in a camera's images, and only a scene has these; give points or homography, as `pardalis calibrate plane` writes them";
            table.problem("model", message);
            None
        }
    }
}

/// The camera's model, from the table `model`.
fn read_any_model(table: &Table) -> Option<Model> {
    let Some(model) = table.table("model") else {
        if !table.has("model") {
            table.problem(
                "model",
                "is missing; give a table such as [cameras.NAME.model.equidistant], or in a scene calibration = \"FILE\"",
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
        "exact_mirror",
        "plane",
        "image",
    ]);
    model.finish();
    let (kind, parameters) = found?;
    if kind == "plane" || kind == "image" {
        let model = if kind == "plane" {
            plane::read_plane(&parameters)
        } else {
            Some(PlaneModel::Known(Plane::image()))
        };
        let model = model.map(|model| match model {
            PlaneModel::Known(plane) => Model::Known(Camera::Plane(plane)),
            PlaneModel::Rectangle(config) => Model::Rectangle(parameters.at("rectangle", config)),
        });
        parameters.finish();
        return model;
    }
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
        "ocam" => read_ocam(&parameters, center_px),
        _ => read_exact_mirror(&parameters, center_px),
    };
    parameters.finish();
    camera.map(Model::Known)
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

fn read_exact_mirror(table: &Table, center_px: Option<[f64; 2]>) -> Option<Camera> {
    let f = read_focals(table);
    let profile = mirror::read_profile(table);
    let model = ExactMirror::new(f?, center_px?, profile?);
    table.checked(at_center(model)).map(Camera::ExactMirror)
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

#[cfg(test)]
mod tests {
    use super::FrameRange;

    #[test]
    fn ranges_count_the_frames_that_they_take() {
        for (first, step, limit) in [(0, 1, None), (2, 3, None), (1, 2, Some(2)), (9, 1, None)] {
            let range = FrameRange { first, step, limit };
            for frames in 0..9 {
                let taken = (0..frames).filter(|&frame| range.takes(frame)).count();
                let expected = taken.min(limit.unwrap_or(usize::MAX));
                assert_eq!(range.count_of(frames), expected, "{range:?} of {frames}");
            }
        }
    }
}
