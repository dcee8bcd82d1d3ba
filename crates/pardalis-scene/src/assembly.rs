//! From the settings of a scene to its tracker, with what the caller reads of its files.

use super::body::BodyConfig;
use super::camera::CameraConfig;
use super::journal::Problem;
use super::platform::PlatformMotion;
use super::start::{StartConfig, TrackStart};
use super::{PlatformConfig, Scene};
use pardalis::color::ColorModel;
use pardalis::likelihood::{Cue, CueSettings};
use pardalis::platform::{OdometryErrors, Platform};
use pardalis::start::Start;
use pardalis::tracker::{BodySettings, PlatformId};
use pardalis::view::View;
use pardalis::{TargetId, Tracker};
use pardalis_camera::Mask;
use pardalis_core::Error;
use pardalis_filter::gaussian::GaussianStart;

/// The files that a scene names, which the caller reads. Names are as the scene has them; errors are messages that name the file.
pub trait Files {
    /// Reads a colour model.
    fn colors(&self, name: &str) -> Result<ColorModel, String>;

    /// Reads a mask for images of this size, width and height in pixels.
    fn mask(&self, name: &str, size_px: (usize, usize)) -> Result<Mask, String>;

    /// Reads the last estimate of a track before the first frames, in the world of the scene, and its time in seconds.
    fn start_of_track(&self, start: &TrackStart) -> Result<(GaussianStart, f64), String>;
}

/// A tracker that is being assembled from a scene: what could be made of its settings and files, and all problems.
///
/// Add all cameras of the scene first, in its order, and then its targets.
///
/// ```
/// use pardalis::color::ColorModel;
/// use pardalis::filter::gaussian::GaussianStart;
/// use pardalis_camera::Mask;
/// use pardalis_scene::{Assembly, Files, Scene, TrackStart};
///
/// /// The scene's files are in the folder of this program.
/// struct Here;
///
/// impl Files for Here {
///     fn colors(&self, name: &str) -> Result<ColorModel, String> {
///         let text = std::fs::read_to_string(name).map_err(|error| format!("{name}: {error}"))?;
///         ColorModel::from_text(&text).map_err(|error| format!("{name}: {error}"))
///     }
///     fn mask(&self, name: &str, _: (usize, usize)) -> Result<Mask, String> {
///         Err(format!("{name}: masks are not used here"))
///     }
///     fn start_of_track(&self, start: &TrackStart) -> Result<(GaussianStart, f64), String> {
///         Err(format!("{}: tracks are not used here", start.file))
///     }
/// }
///
/// let text = "
///     [cameras.left]
///     model.pinhole = { f_px = [300, 300], center_px = [159.5, 119.5] }
///     world_from_camera = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
///
///     [targets.ball]
///     shape.sphere.radius_m = 0.1
///     detector = {}
/// ";
/// let no_calibration = &|name: &str, _| Err(format!("{name}: calibrations are not used here"));
/// let scene = Scene::parse_without_inputs(text, &toml::Table::new(), no_calibration).unwrap();
/// let mut assembly = Assembly::default();
/// for camera in &scene.cameras {
///     assembly.add_camera(camera, Some((320, 240)), &Here);
/// }
/// assembly.add_targets(&scene, true, &Here);
/// let tracker = assembly.finish(&scene).unwrap();
/// assert_eq!(tracker.time_s(), None);
/// ```
#[derive(Debug, Default)]
pub struct Assembly {
    /// The view of each camera, unless it has a problem or no images.
    pub views: Vec<Option<View>>,
    /// The settings of each body of each target, unless they have a problem.
    pub bodies: Vec<Vec<Option<BodySettings>>>,
    /// The problems so far.
    pub problems: Vec<Problem>,
    /// The targets that start from a track, with the time of the start in seconds.
    reinitialized: Vec<(TargetId, GaussianStart, f64)>,
}

impl Assembly {
    /// Returns an assembly of a scene that has these problems.
    pub fn with(problems: Vec<Problem>) -> Self {
        Self {
            problems,
            ..Self::default()
        }
    }

    /// Adds the next camera, whose images have this size in pixels. Without a size, its images have a problem that the caller knows.
    pub fn add_camera(
        &mut self,
        camera: &CameraConfig,
        size_px: Option<(usize, usize)>,
        files: &dyn Files,
    ) {
        let view = size_px.and_then(|size_px| self.noted(camera.view(size_px, files)));
        self.views.push(view);
    }

    /// Adds the targets of a scene.
    ///
    /// `is_complete` says that the scene has no problems, so that its targets refer to the cameras that were added.
    pub fn add_targets(&mut self, scene: &Scene, is_complete: bool, files: &dyn Files) {
        for (number, target) in scene.targets.iter().enumerate() {
            let target_id = TargetId::new(number);
            let bodies = target.bodies.iter();
            let bodies = bodies.map(|body| self.body(target_id, body, is_complete, files));
            let bodies = bodies.collect();
            self.bodies.push(bodies);
        }
    }

    fn body(
        &mut self,
        target: TargetId,
        body: &BodyConfig,
        is_complete: bool,
        files: &dyn Files,
    ) -> Option<BodySettings> {
        let problem = |message: String| match body.start() {
            Some(start) => start.problem(message),
            None => Problem {
                line: 0,
                key: format!("targets.{}", body.name),
                message,
            },
        };
        let start = match body.start().map(|start| &start.value) {
            None => Ok(None),
            Some(StartConfig::Here(start)) => Ok(Some(*start)),
            Some(StartConfig::Track(track)) => {
                files.start_of_track(track).map(|(start, time_s)| {
                    self.reinitialized.push((target, start, time_s));
                    Some(Start::Gaussian(start))
                })
            }
        };
        let start = self.noted(start.map_err(|message| vec![problem(message)]));
        if let (true, Some(Some(Start::Pixel(start)))) = (is_complete, &start)
            && let Some(Some(view)) = self.views.get(start.camera)
            && let Err(error) = start.check_in(view)
        {
            self.problems.push(problem(error.to_string()));
        }
        let colors = self.noted(body.color_model(files).map_err(|problem| vec![problem]));
        let settings = body.settings(colors?, start?);
        self.noted(settings.map_err(|error| vec![problem(error.to_string())]))
    }

    /// Returns the value; notes the problems if there is none.
    fn noted<T>(&mut self, made: Result<T, Vec<Problem>>) -> Option<T> {
        made.map_err(|problems| self.problems.extend(problems)).ok()
    }

    /// Returns the tracker, or else all problems, in the order of lines.
    ///
    /// Platforms have not moved yet: the caller tells the tracker where they are. A camera that was not added, or without a size, is a problem.
    pub fn finish(mut self, scene: &Scene) -> Result<Tracker, Vec<Problem>> {
        for (number, camera) in scene.cameras.iter().enumerate() {
            if self.problems.is_empty() && !matches!(self.views.get(number), Some(Some(_))) {
                let message = format!(
                    "{} has no images of a known size; add it with one",
                    camera.name
                );
                self.problems.push(camera.input.place().problem(message));
            }
        }
        if !self.problems.is_empty() {
            self.problems.sort();
            self.problems.dedup();
            return Err(self.problems);
        }
        self.tracker(scene).map_err(|error| {
            let message = error.to_string();
            vec![Problem {
                line: 1,
                key: String::new(),
                message,
            }]
        })
    }

    fn tracker(self, scene: &Scene) -> Result<Tracker, Error> {
        let mut builder = Tracker::builder();
        builder.seed(scene.seed);
        for platform in &scene.platforms {
            builder.platform(platform.platform()?);
        }
        for (view, camera) in self.views.into_iter().flatten().zip(&scene.cameras) {
            let is_carrier =
                |platform: &PlatformConfig| camera.platform.as_ref() == Some(&platform.name);
            match scene.platforms.iter().position(is_carrier) {
                Some(number) => builder.camera_on(PlatformId::new(number), view)?,
                None => builder.camera(view),
            };
        }
        for (bodies, target) in self.bodies.into_iter().zip(&scene.targets) {
            builder.target(target.settings(bodies.into_iter().flatten().collect()));
        }
        let mut tracker = builder.build()?;
        for (target, start, time_s) in &self.reinitialized {
            tracker.reinitialize(*target, start, *time_s)?;
        }
        Ok(tracker)
    }
}

impl PlatformConfig {
    /// Returns the platform, of whose motion nothing is known yet.
    pub fn platform(&self) -> Result<Platform, Error> {
        Platform::new(match self.motion {
            PlatformMotion::Poses(_) => OdometryErrors::default(),
            PlatformMotion::Odometry(_, errors, _) | PlatformMotion::Given(_, errors) => errors,
        })
    }
}

impl CameraConfig {
    /// Returns its view of images of this size, width and height in pixels.
    ///
    /// Errors: the problems with the size and the masks.
    pub fn view(&self, size_px: (usize, usize), files: &dyn Files) -> Result<View, Vec<Problem>> {
        let (width, height) = size_px;
        let mut problems = Vec::new();
        if let Some(stated) = &self.size_px
            && stated.value != [width as f64, height as f64]
        {
            problems.push(stated.problem(format!(
                "is {} x {}, but the images are {width} x {height}; a camera model is valid for one size only: \
                 give images of that size, or write another scene for these (`pardalis init`)",
                stated.value[0], stated.value[1]
            )));
        }
        let mut mask = None;
        if let Some(file) = &self.mask {
            let read = files.mask(&file.value, size_px);
            mask = read
                .map_err(|message| problems.push(file.problem(message)))
                .ok();
        }
        if let Some(circle) = &self.mask_circle {
            let made = Mask::from_radius(width, height, circle.center_px, circle.radius_px.value);
            let made = made.and_then(|made| match &mask {
                Some(other) => made.and(other),
                None => Ok(made),
            });
            let leaves_nothing = |_| {
                problems.push(circle.radius_px.problem(format!(
                    "leaves no pixel of the {width} x {height} images to look at; \
                     give a larger radius, or another mask_center_px or mask"
                )));
            };
            mask = made.map_err(leaves_nothing).ok();
        }
        if !problems.is_empty() {
            return Err(problems);
        }
        View::new(self.camera.clone(), self.world_from_camera, size_px, mask)
            .and_then(|view| view.with_line_delay_s(self.line_delay_s))
            .map_err(|error| vec![self.input.place().problem(error.to_string())])
    }
}

impl BodyConfig {
    /// Returns its colours, if it has any.
    ///
    /// Errors: the file cannot be read, or lacks what the cues need.
    pub fn color_model(&self, files: &dyn Files) -> Result<Option<ColorModel>, Problem> {
        let Some(file) = &self.colors else {
            return Ok(None);
        };
        let model = files.colors(&file.value);
        let model = model.and_then(|model| self.check_colors(model, &file.value));
        model.map(Some).map_err(|message| {
            file.problem(format!("{message}; `pardalis learn` writes such files"))
        })
    }

    /// Checks that colours have what the cues need.
    fn check_colors(&self, model: ColorModel, name: &str) -> Result<ColorModel, String> {
        let counts_learnt =
            |cue: &CueSettings| matches!(cue.cue, Cue::Window(window) if window.ranges.is_none());
        if model.ranges().is_none() && self.cues().iter().any(counts_learnt) {
            return Err(format!(
                "{name}: has no ranges of hue and saturation, which the window cue needs; learn it again, or give window.hue_deg and window.saturation"
            ));
        }
        let compares_channels = |cue: &CueSettings| matches!(cue.cue, Cue::Region(_));
        if model.channels().is_none() && self.cues().iter().any(compares_channels) {
            return Err(format!(
                "{name}: has no histograms of red, green and blue, which the region cue needs; learn it again"
            ));
        }
        Ok(model)
    }
}
