//! The text of a scene file that people go on from.

use std::fmt::Write as _;
use std::path::Path;

use anyhow::Result;

use super::sequence::SequenceCamera;
use super::{Model, Opened};
use crate::fault::fault;

/// Where nobody says how many frames a second there are.
pub(super) const GUESSED_FPS: f64 = 25.0;
/// The same of the ball: a size 5 football's.
const GUESSED_RADIUS_M: f64 = 0.11;

/// What the scene's text is made of.
pub(super) struct SceneText<'a> {
    pub(super) cameras: Vec<CameraText>,
    pub(super) target: &'a str,
    pub(super) colors: String,
    pub(super) radius_m: Option<f64>,
    pub(super) pixel: Option<[f64; 2]>,
}

/// One camera's part of the text.
pub(super) struct CameraText {
    name: String,
    size: (usize, usize),
    /// The lines about frames and times.
    input: String,
    /// The model's table without its header.
    model: String,
    /// The model's name in scenes.
    kind: &'static str,
    /// Rows of the pose.
    pose: [[f64; 4]; 4],
    /// Behind the pose and the model where they are guesses.
    mark: &'static str,
}

const CHANGE: &str = "  # CHANGE: a guess";

impl CameraText {
    /// A camera whose calibration is known.
    pub(super) fn known(
        camera: &SequenceCamera,
        file: &Path,
        opened: &Opened,
        path: &str,
        fps: Option<f64>,
    ) -> Result<Self> {
        let refuse = |what: &str| fault!("{}: camera {}: {what}", file.display(), camera.name);
        if (camera.width, camera.height) != opened.size {
            return Err(refuse(&format!(
                "the calibration is for {} x {} pixels, the images are {} x {}",
                camera.width, camera.height, opened.size.0, opened.size.1
            )));
        }
        let needed = |value: Option<f64>, key: &str| {
            value.ok_or_else(|| refuse(&format!("{key} is missing")))
        };
        let center = || -> Result<String> {
            let (cx, cy) = (needed(camera.cx, "cx")?, needed(camera.cy, "cy")?);
            Ok(format!("center_px = [{cx:?}, {cy:?}]"))
        };
        let (kind, model) = match &*camera.model {
            "fisheye_equidistant" => {
                let f = needed(camera.f_px_per_rad, "f_px_per_rad")?;
                let view = camera
                    .fov_deg
                    .map(|fov| format!("\nfield_of_view_deg = {fov:?}"))
                    .unwrap_or_default();
                (
                    "equidistant",
                    format!("f_px_per_rad = {f:?}\n{}{view}", center()?),
                )
            }
            "pinhole" => {
                let (fx, fy) = (needed(camera.fx, "fx")?, needed(camera.fy, "fy")?);
                let mut distortion = camera.distortion.clone();
                if distortion.len() > 5 {
                    return Err(refuse(
                        "distortion has more than five numbers, k1, k2, p1, p2, k3",
                    ));
                }
                distortion.resize(5, 0.0);
                (
                    "pinhole",
                    format!(
                        "f_px = [{fx:?}, {fy:?}]\n{}\ndistortion = {distortion:?}  # k1, k2, p1, p2, k3",
                        center()?
                    ),
                )
            }
            other => {
                return Err(refuse(&format!(
                    "the model {other} cannot be used yet; allowed: fisheye_equidistant, pinhole (or name a model of your own: --camera unified)"
                )));
            }
        };
        let pose = serde_json::from_value(camera.world_from_camera.clone()).map_err(|_| {
            refuse(
                "T_world_from_camera is no fixed 4 x 4 matrix; moving cameras cannot be used yet",
            )
        })?;
        let input = input_lines(opened, path, fps);
        Ok(Self {
            name: camera.name.clone(),
            size: opened.size,
            input,
            model,
            kind,
            pose,
            mark: "",
        })
    }

    /// A camera of which only the model's name is known.
    pub(super) fn guessed(model: Model, opened: &Opened, path: &str, fps: Option<f64>) -> Self {
        let (width, height) = (opened.size.0 as f64, opened.size.1 as f64);
        let half = width.min(height) / 2.0;
        let center = format!(
            "center_px = [{:?}, {:?}]  # CHANGE: the principal point",
            (width - 1.0) / 2.0,
            (height - 1.0) / 2.0
        );
        // An image circle as high as the image; a pinhole of about 60 degrees; a mirror that shows 45 degrees below the horizon at half the radius.
        let (kind, parameters, pose) = match model {
            Model::Equidistant => {
                let f = half / 92.5_f64.to_radians();
                let parameters = format!(
                    "f_px_per_rad = {f:.1}  # CHANGE: pixels a radian\n{center}\nfield_of_view_deg = 185.0  # CHANGE: the full angle"
                );
                ("equidistant", parameters, LOOKING_DOWN)
            }
            Model::Pinhole => {
                let f = 0.87 * width;
                let parameters = format!(
                    "f_px = [{f:.1}, {f:.1}]  # CHANGE: focal lengths\n{center}\ndistortion = [0.0, 0.0, 0.0, 0.0, 0.0]  # k1, k2, p1, p2, k3"
                );
                ("pinhole", parameters, LOOKING_AHEAD)
            }
            Model::Unified => {
                let parameters = format!(
                    "l = 0.9  # CHANGE: the mirror's shape: below 1 a hyperbola, 1 a parabola\nm = {half:.1}  # CHANGE: pixels; the horizon lies (l + m) / l pixels from center_px\n{center}"
                );
                ("unified", parameters, LOOKING_UP)
            }
            Model::PerspectiveMirror => {
                let parameters = format!(
                    "m_px = {:.1}  # CHANGE: pixels from center_px to what lies 45 degrees below the horizon\n{center}",
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
            model: parameters,
            kind,
            pose,
            mark: CHANGE,
        }
    }

    fn text(&self, text: &mut String) {
        let Self {
            name,
            size: (width, height),
            input,
            model,
            kind,
            pose,
            mark,
        } = self;
        let _ = writeln!(text, "[cameras.{name}]\n{input}");
        let _ = writeln!(
            text,
            "size_px = [{width}, {height}]  # the model below holds for this size only"
        );
        let half = width.min(height) / 2;
        text.push_str("# mask = \"mask.png\"     # white: pixels that may be used; black: the robot's own body, bars, rims\n");
        let _ = writeln!(
            text,
            "# mask_radius_px = {half}  # or a circle around center_px"
        );
        text.push_str("# Takes camera coordinates (x right, y down, z forward) to world coordinates (metres, z up).\n");
        let _ = writeln!(text, "world_from_camera = [{mark}");
        for row in pose {
            let _ = writeln!(text, "    {row:?},");
        }
        let _ = writeln!(text, "]\n\n[cameras.{name}.model.{kind}]\n{model}\n");
    }
}

/// One metre above the floor, the optical axis straight down; the top of the image is ahead.
const LOOKING_DOWN: [[f64; 4]; 4] = [
    [0.0, -1.0, 0.0, 0.0],
    [-1.0, 0.0, 0.0, 0.0],
    [0.0, 0.0, -1.0, 1.0],
    [0.0, 0.0, 0.0, 1.0],
];
/// One metre above the floor, along the world's x.
const LOOKING_AHEAD: [[f64; 4]; 4] = [
    [0.0, 0.0, 1.0, 0.0],
    [-1.0, 0.0, 0.0, 0.0],
    [0.0, -1.0, 0.0, 1.0],
    [0.0, 0.0, 0.0, 1.0],
];
/// One metre above the floor, up into a mirror; the top of the image is ahead.
const LOOKING_UP: [[f64; 4]; 4] = [
    [0.0, -1.0, 0.0, 0.0],
    [1.0, 0.0, 0.0, 0.0],
    [0.0, 0.0, 1.0, 1.0],
    [0.0, 0.0, 0.0, 1.0],
];

fn input_lines(opened: &Opened, path: &str, fps: Option<f64>) -> String {
    let path = toml::Value::String(path.to_owned());
    if opened.is_video {
        return format!(
            "video = {path}\n# input_options = [\"-f\", \"v4l2\"]  # ffmpeg's options before -i, for cameras such as /dev/video0"
        );
    }
    let times = match fps {
        _ if opened.has_times => {
            "# times.csv beside the images says when each was taken".to_owned()
        }
        Some(fps) => format!("fps = {fps:?}"),
        None => format!(
            "fps = {GUESSED_FPS:?}  # CHANGE: frames a second, or put times.csv beside the images"
        ),
    };
    format!("images = {path}\n{times}")
}

impl SceneText<'_> {
    /// The file's text.
    pub(super) fn text(&self) -> String {
        let mut text = String::from(
            "# A scene: what `pardalis track` tracks, through which cameras.\n\
             # Paths start at this file's folder. Lengths are in metres, times in seconds, image distances in pixels.\n\n\
             seed = 1  # the same seed gives the same results, for any number of threads\n\n",
        );
        for camera in &self.cameras {
            camera.text(&mut text);
        }
        let target = self.target;
        let (radius_m, radius_mark) = match self.radius_m {
            Some(radius_m) => (radius_m, ""),
            None => (GUESSED_RADIUS_M, "  # CHANGE: the ball's radius"),
        };
        let colors = toml::Value::String(self.colors.clone());
        let _ = writeln!(
            text,
            "[targets.{target}]\n\
             shape.sphere.radius_m = {radius_m:?}{radius_mark}\n\
             colors = {colors}  # made by `pardalis learn`\n\n\
             # How the outline is compared with the image. The published real-time settings are 0.7 and 1.3 with 300 particles.\n\
             [targets.{target}.contour]\n\
             inner_scale = 0.9\n\
             outer_scale = 1.1\n\
             points = 50\n\n\
             [targets.{target}.filter]\n\
             particles = 5000\n\
             resampling = \"systematic\"  # or stratified, residual, multinomial\n\
             resample_below = 1.0  # share of the particles; 1: at every step, as published\n\n\
             # White noise of this density disturbs the velocity: about 1 for what rolls or is carried, 100 for what is thrown and bounces.\n\
             # Too low, and quick turns are missed; too high, and the target is lost sooner while something hides it.\n\
             [targets.{target}.motion.constant_velocity]\n\
             acceleration_density_m2ps3 = 100.0\n"
        );
        self.start_text(&mut text, radius_m);
        text
    }

    /// Faults: the given pixel is outside the first camera's image.
    pub(super) fn check_pixel(&self) -> Result<()> {
        let (width, height) = self.cameras[0].size;
        let inside = |[x, y]: [f64; 2]| {
            (0.0..=width as f64 - 1.0).contains(&x) && (0.0..=height as f64 - 1.0).contains(&y)
        };
        match self.pixel {
            Some(pixel) if !inside(pixel) => Err(fault!(
                "--pixel {},{}: is outside the image of {width} x {height} pixels",
                pixel[0],
                pixel[1]
            )),
            _ => Ok(()),
        }
    }

    fn start_text(&self, text: &mut String, radius_m: f64) {
        let target = self.target;
        let camera = &self.cameras[0];
        let (width, height) = camera.size;
        let middle = [(width as f64 - 1.0) / 2.0, (height as f64 - 1.0) / 2.0];
        let pixel = self.pixel.unwrap_or(middle);
        let mark = match self.pixel {
            Some(_) => "",
            None => "  # CHANGE: a pixel near the middle of the target in the first frame",
        };
        let _ = writeln!(
            text,
            "# Where it starts: along the ray through a pixel of the first frame …\n\
             [targets.{target}.start.pixel]\n\
             camera = \"{}\"\n\
             pixel = {pixel:?}{mark}\n\
             max_range_m = 8.0\n\n\
             # … or, in place of that, around a known position:\n\
             # [targets.{target}.start.gaussian]\n\
             # position_m = [1.0, 0.0, {:?}]\n\
             # position_sigma_m = 0.1\n\
             # velocity_mps = [0.0, 0.0, 0.0]\n\
             # velocity_sigma_mps = 0.5",
            camera.name, radius_m
        );
    }
}
