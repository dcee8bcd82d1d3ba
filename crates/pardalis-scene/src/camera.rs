//! The cameras of a scene.

use super::description::above;
use super::model::{Model, pose_of_model, principal_point_px, read_any_model};
use super::plane::RectangleConfig;
use super::reader::{Located, Table};
use super::setting::{Setting, Word};
use super::video::{VideoInput, combine, read_settings, set_size_px};
use pardalis::color::{YuvEncoding, YuvMatrix, YuvRange};
use pardalis::frame::MAX_TIME_S;
use pardalis_camera::formats::Lens;
use pardalis_camera::{CalibratedCamera, Pose, pose_from_matrix};
use pardalis_camera::{Camera, Plane};

impl Word for YuvMatrix {
    const WORDS: &'static [(&'static str, Self)] =
        &[("bt601", Self::Bt601), ("bt709", Self::Bt709)];
}

impl Word for YuvRange {
    const WORDS: &'static [(&'static str, Self)] =
        &[("full", Self::Full), ("limited", Self::Limited)];
}

impl Word for Lens {
    const WORDS: &'static [(&'static str, Self)] = &[
        ("pinhole", Self::Pinhole),
        ("fisheye", Self::Fisheye),
        ("omnidir", Self::Omnidir),
        ("rectified", Self::Rectified),
    ];
}

/// Reads the calibration file of this name. Errors are messages that name file and line.
///
/// The second argument resolves ambiguous coefficients in the file, or selects the camera of rectified images ([`pardalis_camera::formats::read`]).
pub type ReadCalibration<'a> =
    &'a dyn Fn(&str, Option<Lens>) -> Result<Vec<CalibratedCamera>, String>;

/// One camera of a scene.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraConfig {
    /// Its name.
    pub name: String,
    /// The source of its frames.
    pub input: Input,
    /// Added to its time stamps, in seconds.
    pub time_offset_s: f64,
    /// Time from the exposure of one row to that of the next, in seconds ([`pardalis::View::with_line_delay_s`]).
    pub line_delay_s: f64,
    /// The frames that are read.
    pub frames: FrameRange,
    /// The file with what another program detected in its images.
    pub detections: Option<Located<String>>,
    /// Whether it looked at every image: otherwise those that the file does not have say nothing.
    pub detections_complete: bool,
    /// Its model. Until a rectangle is found in its images, the model of [`Plane::image`].
    pub camera: Camera,
    /// The rectangle in its images that determines its model, if the scene uses one.
    pub rectangle: Option<Located<RectangleConfig>>,
    /// The size of its images in pixels, if the scene states it.
    pub size_px: Option<Located<[f64; 2]>>,
    /// The image whose white pixels are usable.
    pub mask: Option<Located<String>>,
    /// The circle whose pixels are usable.
    pub mask_circle: Option<MaskCircle>,
    /// Its pose in the world; of a camera on a platform, its pose there.
    pub world_from_camera: Pose,
    /// Whether its pose is stated and no guess. Otherwise it need not even be given in a scene that was read with
    /// [`Scene::parse_without_poses`](super::Scene::parse_without_poses), and is then the identity.
    pub has_pose: bool,
    /// The platform that carries it.
    pub platform: Option<String>,
}

/// A selection of the frames of an input.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FrameRange {
    /// Number of frames skipped at the beginning.
    pub first: usize,
    /// From there on, every `step`-th frame is read; at least 1.
    pub step: usize,
    /// Maximum number of frames to read.
    pub limit: Option<usize>,
}

impl FrameRange {
    /// All frames.
    pub const ALL: Self = Self {
        first: 0,
        step: 1,
        limit: None,
    };

    /// Returns how many of `frames` frames are read.
    pub fn count_of(&self, frames: usize) -> usize {
        let left = frames.saturating_sub(self.first).div_ceil(self.step);
        left.min(self.limit.unwrap_or(usize::MAX))
    }

    /// Reports whether the frame with this index is read, ignoring the limit.
    pub fn takes(&self, frame: usize) -> bool {
        frame >= self.first && (frame - self.first).is_multiple_of(self.step)
    }
}

/// A circle in the image: centre and radius in pixels.
#[derive(Debug, Clone, PartialEq)]
pub struct MaskCircle {
    /// The centre.
    pub center_px: [f64; 2],
    /// The radius.
    pub radius_px: Located<f64>,
}

/// Where the frames of cameras and the motion of platforms come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Inputs {
    /// From what the scene names, which it must.
    Named,
    /// From the caller: the scene needs no inputs, and those that it names are not used.
    Given,
}

/// Whether a scene must state the poses of its cameras.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Poses {
    /// It must.
    Stated,
    /// The caller finds those that it does not state.
    Sought,
}

/// The source of a camera's frames.
#[derive(Debug, Clone, PartialEq)]
pub enum Input {
    /// A folder of images, or one image.
    Images {
        /// The folder.
        folder: Located<String>,
        /// Frames per second; if `None`, `times.csv` in the folder states the time of each image.
        fps: Option<f64>,
    },
    /// A video, which an installed ffmpeg opens.
    Video {
        /// The file, address or device, as written.
        name: Located<String>,
        /// What is opened, and how.
        video: VideoInput,
        /// Encoding of its pixels, if the stream does not state it or states it wrongly.
        encoding: Option<YuvEncoding>,
    },
    /// Images in an MCAP recording.
    Mcap {
        /// The recording.
        file: Located<String>,
        /// The topic of the images; `None` for the only one with images.
        topic: Option<String>,
    },
    /// The caller has the frames, of a scene that was read with [`Inputs::Given`]; with the place of the camera's table.
    Given(Located<String>),
}

impl Input {
    /// What is wrong with a camera that has none.
    pub const MISSING: &str =
        "has no input; give images = \"FOLDER\", video = \"FILE\" or mcap = \"FILE\"";

    /// Returns the folder, file, address or device, with its position in the scene; no name without an input.
    pub fn place(&self) -> &Located<String> {
        match self {
            Self::Images { folder: file, .. } | Self::Mcap { file, .. } => file,
            Self::Video { name, .. } | Self::Given(name) => name,
        }
    }
}

impl CameraConfig {
    /// Reads one camera. Returns `None` after reporting a problem to the journal.
    pub(super) fn read(
        name: String,
        table: Table,
        platforms: &[String],
        read_calibration: ReadCalibration,
        (inputs, poses): (Inputs, Poses),
    ) -> Option<Self> {
        let mut input = read_input(&table, inputs);
        let time_offset_s: f64 = table
            .key(
                "time_offset_s",
                "Added to the camera's time stamps; `pardalis calibrate time` estimates it.",
            )
            .within(-MAX_TIME_S..=MAX_TIME_S)
            .or(0.0);
        let line_delay_s: f64 = table
            .key(
                "line_delay_s",
                "Rolling shutter: time from the exposure of one row to that of the next, the readout time over the number of rows. The middle row is exposed at the frame's time. Only detected targets use it.",
            )
            .within(-1e-3..=1e-3)
            .or(0.0);
        let all = FrameRange::ALL;
        let frames = FrameRange {
            first: table
                .key("first_frame", "Number of frames to skip at the beginning.")
                .or(all.first),
            step: table
                .key("frame_step", "Read every n-th frame from there on.")
                .within(1.0..)
                .or(all.step),
            limit: table
                .key("frame_limit", "Maximum number of frames to read.")
                .within(1.0..)
                .depends("all frames")
                .optional(),
        };
        let detections = table
            .key("detections", "File of boxes that another program detected in the camera's images, for targets with a `detector`. Relative to this file.")
            .depends("none")
            .located();
        let detections_complete = table
            .key("detections_complete", "Whether the other program looked at every image. If false, images without a row in the file say nothing, and a row without a box says that nothing was found.")
            .or(true);
        if !detections_complete && detections.is_none() {
            table.problem(
                "detections_complete",
                "needs detections; add them, or remove it",
            );
        }
        let platform = read_platform(&table, platforms);
        let optics = read_optics(&name, &table, read_calibration, poses);
        let mask = table
            .key(
                "mask",
                "Image file of the camera's size; only pixels where it is white are used.",
            )
            .depends("all pixels")
            .located();
        let radius_px = table
            .key(
                "mask_radius_px",
                "Use only pixels within a circle of this radius, such as the image circle of a fisheye lens.",
            )
            .within(above(0.0, f64::INFINITY))
            .depends("all pixels")
            .located::<f64>();
        let center_px = table
            .key(
                "mask_center_px",
                "Centre of that circle; needs `mask_radius_px`.",
            )
            .depends("the principal point")
            .optional::<[f64; 2]>();
        if center_px.is_some() && !table.has("mask_radius_px") {
            table.problem("mask_center_px", "needs mask_radius_px; add it");
        }
        if let (Some(Input::Video { video, .. }), Some(optics)) = (&mut input, &optics) {
            let size_px = optics.size_px.as_ref().map(|size_px| size_px.value);
            set_size_px(&table, &mut video.settings, size_px);
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
            line_delay_s,
            frames,
            detections,
            detections_complete,
            camera: optics.camera,
            rectangle: optics.rectangle,
            size_px: optics.size_px,
            mask,
            mask_circle,
            world_from_camera: optics.world_from_camera.unwrap_or_default(),
            has_pose: optics.world_from_camera.is_some(),
            platform,
        })
    }
}

impl CameraConfig {
    /// Returns the camera's position in the world, in metres; `None` for a camera of a plane whose position is unknown.
    pub fn position_m(&self) -> Option<[f64; 3]> {
        match &self.camera {
            Camera::Plane(plane) => plane.center_m(),
            _ => Some(self.world_from_camera.translation.vector.into()),
        }
    }
}

/// Elements of two matrices of the same pose differ at most by this much, because files contain rounded numbers.
const SAME_POSE: f64 = 1e-6;

/// The settings of a camera's optics, from the scene or from a calibration file.
struct Optics {
    camera: Camera,
    rectangle: Option<Located<RectangleConfig>>,
    size_px: Option<Located<[f64; 2]>>,
    /// `None` only if poses are sought.
    world_from_camera: Option<Pose>,
}

fn read_optics(
    name: &str,
    table: &Table,
    read_calibration: ReadCalibration,
    poses: Poses,
) -> Option<Optics> {
    let topic = table
        .get("topic")
        .and_then(|topic| topic.get_ref().as_str());
    let file = read_calibrated(name, table, read_calibration, topic);
    let model = if table.has("calibration") {
        if table.knows("model") {
            table.conflict("model", "calibration");
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
    if matches!(model, Some(Camera::Plane(_))) {
        let message =
            "cannot be combined with a camera of a plane, whose frame is the world's; remove it";
        let given = ["world_from_camera", "platform_from_camera", "platform"];
        if let Some(key) = given.into_iter().find(|key| table.knows(key)) {
            table.problem(key, message);
            return None;
        }
    }
    let pose_key = pose_key(table);
    let own_pose = model.as_ref().and_then(pose_of_model);
    // An invalid plane reports its own problems.
    let needs_no_pose = table
        .peek("model")
        .is_some_and(|model| model.has("plane") || model.has("image"));
    let pose_is_missing = if needs_no_pose || table.has(pose_key) {
        None
    } else if table.has("calibration") {
        let in_file = file
            .as_ref()
            .is_none_or(|file| file.world_from_camera.is_some());
        (!in_file).then_some("is missing, and the calibration file has no pose either")
    } else {
        Some("is missing")
    };
    if let Some(missing) = pose_is_missing.filter(|_| poses == Poses::Stated) {
        let wanted = <[[f64; 4]; 4]>::allowed();
        let commands = if pose_key == "world_from_camera" {
            "`pardalis calibrate pose` or, for several cameras at once, `pardalis calibrate rig`"
        } else {
            "`pardalis calibrate mount`"
        };
        table.problem(
            pose_key,
            format!("{missing}; give {wanted}, or find it with {commands}"),
        );
    }
    let given_pose = read_any_pose(table);
    let file_pose = file.as_ref().and_then(|file| file.world_from_camera);
    // An override suits a camera that was moved, but may also be a forgotten guess of `pardalis init`.
    if let (Some(given), Some(in_file)) = (&given_pose, &file_pose)
        && (given.to_homogeneous() - in_file.to_homogeneous()).amax() > SAME_POSE
    {
        table.warn(
            pose_key,
            "overrides the pose in the calibration file; remove it to use that pose",
        );
    }
    let given_size = table
        .key(
            "size_px",
            "Width and height of the images, which are checked against it.",
        )
        .within(above(0.0, f64::INFINITY))
        .depends("the size in the calibration file, or that of the first image")
        .located::<[f64; 2]>();
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
    let world_from_camera = own_pose.or(given_pose).or(file_pose);
    if world_from_camera.is_none() && poses == Poses::Stated {
        return None;
    }
    Some(Optics {
        camera: model?,
        rectangle,
        size_px: given_size.or_else(|| file_size.map(|size| table.at("calibration", size))),
        world_from_camera,
    })
}

/// Reads the platform that carries the camera, if there is one. Reports an unknown one.
pub(super) fn read_platform(table: &Table, platforms: &[String]) -> Option<String> {
    let name = table
        .key(
            "platform",
            "The platform that carries the camera, a name in `platforms`.",
        )
        .depends("a camera at rest in the world")
        .optional::<String>()?;
    if platforms.is_empty() {
        let message = format!(
            "is {name}, and the scene has no platforms; describe it in a table [platforms.{name}]"
        );
        table.problem("platform", message);
    } else if !platforms.contains(&name) {
        table.reject("platform", &platforms.join(", "));
    }
    Some(name)
}

/// The key of the camera's pose.
pub(super) fn pose_key(table: &Table) -> &'static str {
    if table.has("platform") {
        "platform_from_camera"
    } else {
        "world_from_camera"
    }
}

/// Reads the pose on a platform, if it is given.
fn read_pose_on_platform(table: &Table) -> Option<Pose> {
    let rows = table
        .key(
            "platform_from_camera",
            "Pose of the camera on its platform, in place of `world_from_camera`: the homogeneous matrix that takes points from the camera's frame to the platform's (x forward, y left, z up, in metres).",
        )
        .unit("m")
        .depends("for a camera on a platform, unless the calibration file contains the pose")
        .conditional::<[[f64; 4]; 4]>();
    if table.has("platform_from_camera") && !table.has("platform") {
        let message = "needs platform; add platform = \"NAME\", or give world_from_camera";
        table.problem("platform_from_camera", message);
    }
    pose_from_matrix(rows?)
        .map_err(|error| table.problem("platform_from_camera", error.to_string()))
        .ok()
}

/// Reads the pose, if it is given: on the platform for a camera that is on one, and in the world otherwise.
pub(super) fn read_any_pose(table: &Table) -> Option<Pose> {
    let (in_world, on_platform) = (read_pose(table), read_pose_on_platform(table));
    if !table.has("platform") {
        return in_world;
    }
    if table.has("world_from_camera") {
        let message = "cannot be combined with platform, on which the camera moves; give platform_from_camera instead";
        table.problem("world_from_camera", message);
    }
    on_platform
}

/// Reports whether a topic has rectified images by the names of ROS: `image_rect`, `image_rect_color` or `image_rect_raw`, perhaps compressed.
pub fn is_rectified(topic: &str) -> bool {
    let topic = topic.trim_end_matches("/compressed");
    let name = topic.rsplit('/').next().unwrap_or(topic);
    name == "image_rect" || name.starts_with("image_rect_")
}

/// Returns the camera of the calibration file, if the scene names one. `topic` is that of its images in a recording.
pub(super) fn read_calibrated(
    name: &str,
    table: &Table,
    read_calibration: ReadCalibration,
    topic: Option<&str>,
) -> Option<CalibratedCamera> {
    let file: Option<String> = table
        .key(
            "calibration",
            "Calibration file with the camera's model, and perhaps its size and pose: a file of Pardalis, OpenCV, Kalibr, ROS or OCamCalib. Relative to this file.",
        )
        .optional();
    let wanted: Option<String> = table
        .key(
            "calibration_camera",
            "The camera's name in a calibration file of several cameras.",
        )
        .depends("the camera's own name")
        .optional();
    let lens: Option<Lens> = table
        .key(
            "calibration_lens",
            "The lens model of the calibration file, where its coefficients could belong to several; or `rectified`, for images that were rectified with a calibration of ROS: its projection matrix P.",
        )
        .depends("as the file states; `rectified` of a recording's calibration, if the last part of `topic` begins with `image_rect`")
        .optional();
    if !table.has("calibration") {
        for key in ["calibration_camera", "calibration_lens"] {
            if table.has(key) {
                table.problem(key, "needs calibration; add calibration = \"FILE\"");
            }
        }
    }
    if table.has("calibration_lens") && lens.is_none() {
        return None;
    }
    let file = file?;
    // What is recorded beside rectified images is the calibration of the raw ones.
    let is_recorded = file.to_ascii_lowercase().ends_with(".mcap");
    let is_of_rectified = is_recorded && topic.is_some_and(is_rectified);
    let lens = lens.or(is_of_rectified.then_some(Lens::Rectified));
    let cameras = read_calibration(&file, lens)
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
            table.reject("calibration_camera", &names);
        } else {
            let message =
                format!("contains the cameras {names}; select one with calibration_camera");
            table.problem("calibration", message);
        }
    }
    found.cloned()
}

/// Reads the pose, if it is given.
pub(super) fn read_pose(table: &Table) -> Option<Pose> {
    let rows = table
        .key(
            "world_from_camera",
            "Pose of the camera: the homogeneous matrix that takes points from the camera's frame (x right, y down, z forward, in metres) to the world's.",
        )
        .unit("m")
        .depends("unless the calibration file contains the pose, or the model is a plane")
        .conditional::<[[f64; 4]; 4]>()?;
    pose_from_matrix(rows)
        .map_err(|error| table.problem("world_from_camera", error.to_string()))
        .ok()
}

fn read_input(table: &Table, inputs: Inputs) -> Option<Input> {
    let images = table
        .key(
            "images",
            "Folder of JPEG and PNG images, read in the order of their names, or one image. Give either this, `video` or `mcap`.",
        )
        .depends("unless `video` or `mcap` is given")
        .located_conditional();
    let video = table
        .key(
            "video",
            "Video file, address of a stream (`rtsp`, `rtp`, `udp`, `tcp`, `http`, `https`), device such as `/dev/video0`, or `-` for standard input; opened with ffmpeg.",
        )
        .depends("unless `images` or `mcap` is given")
        .located_conditional::<String>();
    let mcap = table
        .key(
            "mcap",
            "MCAP recording with images, as messages of ROS 2 or Foxglove. Relative to this file.",
        )
        .depends("unless `images` or `video` is given")
        .located_conditional::<String>();
    let topic: Option<String> = table
        .key("topic", "The topic of the images in the recording.")
        .depends("the only one with images")
        .optional();
    if table.has("topic") && !table.has("mcap") && !table.is_describing() {
        table.problem("topic", "applies to mcap only; remove it");
    }
    let fps = table
        .key(
            "fps",
            "Frame rate of a folder of images, or of a video in a format without time stamps; the rate that a device is asked for.",
        )
        .within(1e-6..=1e6)
        .depends("the times in `times.csv` beside the images, or the rate of the device")
        .optional();
    let settings = read_settings(table);
    let encoding = table.section(
        "yuv",
        "How the pixels of a video encode colour, where the stream does not state it or is wrong. Only for `video`.",
        |yuv| {
            let default = YuvEncoding::VIDEO;
            let matrix = yuv
                .key("matrix", "Weights of red, green and blue in Y.")
                .word(default.matrix);
            let range = yuv
                .key("range", "Whether Y covers 0 to 255 or 16 to 235.")
                .word(default.range);
            Some(YuvEncoding {
                matrix: matrix?,
                range: range?,
            })
        },
    );
    let given: Vec<_> = ["images", "video", "mcap"]
        .into_iter()
        .filter(|key| table.has(key))
        .collect();
    if let [first, second, ..] = given[..] {
        table.conflict(second, first);
        return None;
    }
    let refuse = |keys: &[&'static str], only: &str| {
        for key in keys.iter().filter(|key| table.has(key)) {
            table.problem(key, format!("applies to {only} only; remove it"));
        }
    };
    match (images, video, mcap) {
        (Some(folder), ..) => {
            refuse(&["input", "yuv"], "video");
            Some(Input::Images { folder, fps })
        }
        (_, Some(name), _) => {
            let video = combine(table, &name.value, fps, settings)?;
            Some(Input::Video {
                name,
                video,
                encoding,
            })
        }
        (.., Some(file)) => {
            refuse(&["input", "yuv"], "video");
            refuse(&["fps"], "images and video");
            Some(Input::Mcap { file, topic })
        }
        // A key with a problem has reported it.
        _ if !given.is_empty() => None,
        _ if inputs == Inputs::Given => Some(Input::Given(table.here())),
        _ => {
            table.problem_here(Input::MISSING);
            None
        }
    }
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
