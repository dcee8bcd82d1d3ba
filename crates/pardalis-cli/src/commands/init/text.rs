//! The text of a new scene file.

use std::fmt::Write as _;

use anyhow::Result;
use pardalis_camera::CalibratedCamera;
use pardalis_camera::Camera;
use pardalis_camera::formats::Lens;

use super::{Fov, Input, Model as ModelName, Opened};
use crate::focal_length::{TYPICAL_FOV_DEG, focal_length_px, middle_px};
use crate::user_error::user_error;

/// Frame rate if it is unknown, in frames per second.
pub(crate) const GUESSED_FPS: f64 = 25.0;
/// Radius of the ball if it is unknown, in metres: that of a size 5 football.
const GUESSED_RADIUS_M: f64 = 0.11;

/// The data from which the scene's text is formatted.
pub(super) struct SceneText<'a> {
    pub(super) cameras: Vec<CameraText>,
    pub(super) target: &'a str,
    pub(super) colors: String,
    pub(super) radius_m: Option<f64>,
    pub(super) pixel: Option<[f64; 2]>,
}

/// The section of one camera.
pub(crate) struct CameraText {
    pub(crate) name: String,
    size: (usize, usize),
    /// The lines about frames and times.
    input: String,
    model: Model,
    /// Rows of the pose, if it is not in a file.
    guessed_pose: Option<[[f64; 4]; 4]>,
}

/// The source of a camera's model.
enum Model {
    InFile(Calibration),
    /// The model's name in scenes, and its table without the header.
    Guessed(&'static str, String),
}

/// A calibration file as the scene refers to it.
pub(crate) struct Calibration {
    pub(crate) file: String,
    /// Its name there, if that may differ.
    pub(crate) camera: Option<String>,
    pub(crate) lens: Option<Lens>,
}

impl CameraText {
    /// Describes a camera of a calibration file. Its pose is guessed if the file has none.
    pub(crate) fn known(
        camera: &CalibratedCamera,
        calibration: Calibration,
        opened: &Opened,
        path: &str,
        fps: Option<f64>,
    ) -> Self {
        let guessed_pose = match &camera.camera {
            model if model.looks_into_mirror() => LOOKING_UP,
            Camera::Pinhole(_) => LOOKING_AHEAD,
            _ => LOOKING_DOWN,
        };
        Self {
            name: camera.name.clone(),
            size: opened.size,
            input: input_lines(opened, path, fps),
            model: Model::InFile(calibration),
            guessed_pose: camera.world_from_camera.is_none().then_some(guessed_pose),
        }
    }

    /// Describes a camera of which only the model's name is known, and perhaps the angle of a pinhole camera.
    pub(crate) fn guessed(
        model: ModelName,
        fov: &Fov,
        opened: &Opened,
        path: &str,
        fps: Option<f64>,
    ) -> Self {
        let (width, height) = (opened.size.0 as f64, opened.size.1 as f64);
        let half = width.min(height) / 2.0;
        let middle_px = middle_px(opened.size);
        let center = format!("center_px = {middle_px:?}  # CHANGE: the principal point");
        // Guesses: an image circle as high as the image; a mirror that shows 45 degrees below the horizon at half the radius.
        let (kind, parameters, pose) = match model {
            ModelName::Equidistant => {
                let f = half / 92.5_f64.to_radians();
                let parameters = format!(
                    "f_px_per_rad = {f:.1}  # CHANGE: pixels per radian of a fisheye; for webcams and phones: init --camera pinhole\n{center}\nfield_of_view_deg = 185.0  # CHANGE: the full angle"
                );
                ("equidistant", parameters, LOOKING_DOWN)
            }
            ModelName::Pinhole => {
                let known = format!("center_px = {middle_px:?}  # the middle of the image");
                let (fov_deg, origin, center) = match fov {
                    Fov::Given(fov_deg) => (
                        *fov_deg,
                        format!(
                            "{} degrees across the longer side",
                            (100.0 * fov_deg).round() / 100.0
                        ),
                        known,
                    ),
                    Fov::Exif(fov_deg, image) => (
                        *fov_deg,
                        format!(
                            "from the EXIF data of {image}: {fov_deg:.1} degrees across the longer side"
                        ),
                        known,
                    ),
                    Fov::Unknown => (
                        TYPICAL_FOV_DEG,
                        format!(
                            "CHANGE: for {TYPICAL_FOV_DEG} degrees across the longer side, which is typical; calibrate the camera, or give --fov"
                        ),
                        center,
                    ),
                };
                let f = focal_length_px(opened.size, fov_deg);
                let parameters = format!(
                    "f_px = [{f:.1}, {f:.1}]  # {origin}\n{center}\ndistortion = [0.0, 0.0, 0.0, 0.0, 0.0]  # k1, k2, p1, p2, k3"
                );
                ("pinhole", parameters, LOOKING_AHEAD)
            }
            ModelName::Unified => {
                let parameters = format!(
                    "l = 0.9  # CHANGE: mirror shape: below 1 hyperbolic, 1 parabolic\nm = {half:.1}  # CHANGE: pixels; the horizon lies (l + m) / l pixels from center_px\n{center}"
                );
                ("unified", parameters, LOOKING_UP)
            }
            ModelName::PerspectiveMirror => {
                let parameters = format!(
                    "m_px = {:.1}  # CHANGE: pixels from center_px to the circle 45 degrees below the horizon\n{center}",
                    half / 2.0
                );
                ("perspective_mirror", parameters, LOOKING_UP)
            }
        };
        let input = input_lines(opened, path, fps);
        Self {
            name: "camera".to_owned(),
            size: opened.size,
            input,
            model: Model::Guessed(kind, parameters),
            guessed_pose: Some(pose),
        }
    }

    /// Gives the camera another name.
    pub(crate) fn named(self, name: String) -> Self {
        Self { name, ..self }
    }

    /// Adds lines of settings to those about frames and times.
    #[cfg(feature = "studio")]
    pub(crate) fn with_settings(mut self, lines: &str) -> Self {
        if !lines.is_empty() {
            self.input = format!("{}\n{}", self.input, lines.trim_end());
        }
        self
    }

    pub(crate) fn text(&self, text: &mut String) {
        let Self {
            name,
            size: (width, height),
            input,
            model,
            guessed_pose,
        } = self;
        let _ = writeln!(text, "[cameras.{name}]\n{input}");
        match model {
            Model::InFile(Calibration { file, camera, lens }) => {
                let file = toml::Value::String(file.clone());
                let holds = match guessed_pose {
                    Some(_) => "the lens",
                    None => "the lens and the pose",
                };
                let _ = writeln!(
                    text,
                    "calibration = {file}  # {holds}; see `pardalis camera show`"
                );
                if let Some(camera) = camera {
                    let _ = writeln!(text, "calibration_camera = \"{camera}\"");
                }
                if let Some(lens) = lens {
                    let _ = writeln!(text, "calibration_lens = \"{}\"", lens.name());
                }
            }
            Model::Guessed(..) => {
                let _ = writeln!(
                    text,
                    "size_px = [{width}, {height}]  # the model below is valid only for this size"
                );
            }
        }
        let half = width.min(height) / 2;
        text.push_str("# mask = \"mask.png\"     # white: usable pixels; black: the robot's own body, bars, rims\n");
        let _ = writeln!(
            text,
            "# mask_radius_px = {half}  # or a circle around center_px"
        );
        if let Some(rows) = guessed_pose {
            text.push_str("# Maps camera coordinates (x right, y down, z forward) to world coordinates (metres, z up); `pardalis calibrate pose` computes it.\n");
            text.push_str("world_from_camera = [  # CHANGE: a guess\n");
            for row in rows {
                let _ = writeln!(text, "    {row:?},");
            }
            text.push_str("]\n");
        }
        text.push('\n');
        if let Model::Guessed(kind, parameters) = model {
            let _ = writeln!(text, "[cameras.{name}.model.{kind}]\n{parameters}\n");
        }
    }
}

/// One metre above the floor, optical axis straight down, the top of the image ahead.
const LOOKING_DOWN: [[f64; 4]; 4] = [
    [0.0, -1.0, 0.0, 0.0],
    [-1.0, 0.0, 0.0, 0.0],
    [0.0, 0.0, -1.0, 1.0],
    [0.0, 0.0, 0.0, 1.0],
];
/// One metre above the floor, looking along the world's x axis.
const LOOKING_AHEAD: [[f64; 4]; 4] = [
    [0.0, 0.0, 1.0, 0.0],
    [-1.0, 0.0, 0.0, 0.0],
    [0.0, -1.0, 0.0, 1.0],
    [0.0, 0.0, 0.0, 1.0],
];
/// One metre above the floor, looking up into a mirror, the top of the image ahead.
const LOOKING_UP: [[f64; 4]; 4] = [
    [0.0, -1.0, 0.0, 0.0],
    [1.0, 0.0, 0.0, 0.0],
    [0.0, 0.0, 1.0, 1.0],
    [0.0, 0.0, 0.0, 1.0],
];

fn input_lines(opened: &Opened, path: &str, fps: Option<f64>) -> String {
    let quoted = |text: &str| toml::Value::String(text.to_owned());
    let path = quoted(path);
    let times = match (&opened.input, fps) {
        (Input::Video, _) => {
            return format!(
                "video = {path}  # or a camera such as /dev/video0; input.format, input.codec and others say how to open it"
            );
        }
        (Input::SingleImage, _) => return format!("images = {path}  # or a folder of images"),
        (Input::Mcap { topic }, _) => {
            return format!("mcap = {path}\ntopic = {}", quoted(topic));
        }
        (Input::Images { has_times: true }, _) => {
            "# times.csv next to the images contains their time stamps".to_owned()
        }
        (_, Some(fps)) => format!("fps = {fps:?}"),
        (_, None) => format!(
            "fps = {GUESSED_FPS:?}  # CHANGE: frames per second, or put times.csv next to the images"
        ),
    };
    format!("images = {path}\n{times}")
}

/// Returns the table of a ball.
pub(crate) fn target_text(name: &str, radius_m: Option<f64>, colors: &str) -> String {
    let (radius_m, radius_mark) = match radius_m {
        Some(radius_m) => (radius_m, ""),
        None => (GUESSED_RADIUS_M, "  # CHANGE: the ball's radius"),
    };
    let colors = toml::Value::String(colors.to_owned());
    format!(
        "[targets.{name}]\n\
         shape.sphere.radius_m = {radius_m:?}{radius_mark}\n\
         colors = {colors}  # made by `pardalis learn`\n"
    )
}

/// The beginning of a scene.
pub(crate) const HEAD: &str = "# A scene for `pardalis track`: cameras and targets.\n\
    # Paths are relative to this file. Lengths are in metres, times in seconds, image distances in pixels.\n\n\
    seed = 1  # the same seed gives the same results for any number of threads\n";

/// Said of the list of guesses.
pub(crate) const ABOUT_GUESSES: &str = "# Guesses, of which `pardalis track` warns. Replace each in its line marked CHANGE, and remove it here.\n";

/// The mark of a line with a guess.
const MARK: &str = "# CHANGE";

/// Returns the full keys of the guesses in the tables of a scene, which are the lines with the mark.
pub(crate) fn guesses(text: &str) -> Vec<String> {
    let mut table = "";
    let mut keys = Vec::new();
    for line in text.lines() {
        let header = line
            .strip_prefix('[')
            .and_then(|rest| rest.split(']').next());
        // A row of a list has commas.
        if let Some(header) = header.filter(|header| !header.contains(',')) {
            table = header;
        } else if let (true, Some((key, _))) = (line.contains(MARK), line.split_once(" = "))
            && !line.starts_with('#')
        {
            keys.push(format!("{table}.{key}"));
        }
    }
    keys
}

impl SceneText<'_> {
    /// Formats the text of the scene file.
    pub(super) fn text(&self) -> String {
        let mut text = HEAD.to_owned();
        let settings = self.settings();
        let guesses = guesses(&settings);
        if !guesses.is_empty() {
            text.push_str(ABOUT_GUESSES);
            text.push_str("guessed = [\n");
            for key in guesses {
                let _ = writeln!(text, "    \"{key}\",");
            }
            text.push_str("]\n");
        }
        text + "\n" + &settings
    }

    /// Formats the tables of cameras and targets.
    fn settings(&self) -> String {
        let mut text = String::new();
        for camera in &self.cameras {
            camera.text(&mut text);
        }
        text.push_str(&target_text(self.target, self.radius_m, &self.colors));
        match self.pixel {
            Some(pixel) => self.push_click(&mut text, pixel),
            None => text.push_str(
                "# Nothing more is needed: the target is detected automatically, reported as occluded or lost, and detected again.\n",
            ),
        }
        text
    }

    /// Appends the settings of the published method, which starts from a click.
    fn push_click(&self, text: &mut String, pixel: [f64; 2]) {
        let (target, camera) = (self.target, &self.cameras[0].name);
        let _ = writeln!(
            text,
            "\n# Start: along the ray through a pixel of the first frame. Without this and the contour, the target is detected automatically.\n\
             [targets.{target}.start.pixel]\n\
             camera = \"{camera}\"\n\
             pixel_px = {pixel:?}\n\
             max_range_m = 8.0\n\n\
             # Comparison of the outline with the image. The published real-time settings are 0.7 and 1.3 with 300 particles.\n\
             [targets.{target}.contour]\n\
             inner_scale = 0.9\n\
             outer_scale = 1.1\n\
             points = 50\n\n\
             [targets.{target}.filter]\n\
             particles = 5000\n\
             resampling = \"systematic\"  # or stratified, residual, multinomial\n\
             resample_below = 1.0  # share of the particles; 1: at every step, as published\n\n\
             # Spectral density of the white noise on the velocity: about 1 if the target rolls or is carried, 100 if it is thrown and bounces.\n\
             # If too low, quick turns are missed; if too high, the target is lost sooner while it is occluded.\n\
             [targets.{target}.motion.constant_velocity]\n\
             acceleration_density_m2ps3 = 100.0"
        );
    }

    /// Errors: the given pixel is outside the first camera's image.
    pub(super) fn check_pixel(&self) -> Result<()> {
        let (width, height) = self.cameras[0].size;
        let inside = |[x, y]: [f64; 2]| {
            (0.0..=width as f64 - 1.0).contains(&x) && (0.0..=height as f64 - 1.0).contains(&y)
        };
        match self.pixel {
            Some(pixel) if !inside(pixel) => Err(user_error!(
                "--pixel {},{}: outside the image of {width} x {height} pixels",
                pixel[0],
                pixel[1]
            )),
            _ => Ok(()),
        }
    }
}
