//! Scene files: reads them, opens the files they name, and reports every problem before anything runs.

use std::path::{Path, PathBuf};

use anyhow::Result;
use pardalis::Tracker;
use pardalis::color::ColorModel;
use pardalis::view::View;
use pardalis_scene::{
    Assembly, BodyConfig, CameraConfig, Input, Located, Problem, ReadCalibration, Scene,
    StartConfig, VideoFormat, VideoInput, VideoPlace,
};

use crate::detections::{CameraDetections, Detections, Images};
use crate::measurements::MeasurementRows;
use crate::named_files;
use crate::output::{Shown, warn};
use crate::platforms::{self, PlatformRows};
use crate::rectangle::{find_in_images, find_in_source};
use crate::rig;
use crate::scene_files::{SceneFiles, read_calibration, read_text, resolve};
use crate::shell_word::shell_word;
use crate::source::decode::media_kind;
use crate::source::images::image_names;
use crate::source::{OpenCameras, Source, SourceConfig, SourceKind, Timing};
use crate::units;
use crate::user_error::{UserError, user_error};

/// With an interval of this many seconds or more between images, time stamps may be in another unit.
const LONG_STEP_S: f64 = 5.0;

/// Maximum number of problems of a scene that are listed.
const MAX_LISTED: usize = 50;

/// A scene whose files are open.
pub(crate) struct OpenScene {
    /// The contents of the file.
    pub(crate) scene: Scene,
    /// The frames of each camera, in the scene's order.
    pub(crate) sources: Vec<Source>,
    /// The motion of each platform, in the scene's order.
    pub(crate) platforms: Vec<PlatformRows>,
    /// What other sensors measure.
    pub(crate) measurements: Vec<MeasurementRows>,
    /// What another program detected.
    pub(crate) detections: Detections,
    /// The tracker, ready for the first frames.
    pub(crate) tracker: Tracker,
}

impl OpenScene {
    /// Takes the live sources from the scene in the file at `path`, with their settings, for whoever takes their frames next. The others end.
    pub(crate) fn take_live(&mut self, path: &Path) -> Vec<(SourceConfig, Source)> {
        let folder = path.parent().unwrap_or(Path::new(""));
        let sources = self.scene.cameras.iter().zip(self.sources.drain(..));
        let live = sources.filter(|(_, source)| source.is_live());
        live.filter_map(|(camera, source)| Some((source_config(camera, folder).ok()?, source)))
            .collect()
    }
}

/// Reads the text of a scene file.
pub(crate) fn read_scene_text(path: &Path) -> Result<String> {
    let name = path.shown();
    if !path.exists() {
        return Err(user_error!(
            "{name}: cannot be read: there is no such file; check the name, or write a scene with `pardalis init`"
        ));
    }
    if path.is_dir() {
        let scene = path.join("scene.toml");
        return Err(if scene.is_file() {
            user_error!(
                "{name}: is a folder; give the scene in it: {}",
                scene.shown()
            )
        } else {
            user_error!(
                "{name}: is a folder without scene.toml; give a scene, or write one with `pardalis init {}`",
                shell_word(path)
            )
        });
    }
    match media_kind(path) {
        Some("image") => Err(user_error!(
            "{name}: is an image, not a scene; `pardalis init FOLDER` writes a scene of a folder of images"
        )),
        Some(kind) => Err(user_error!(
            "{name}: is a {kind}, not a scene; `pardalis init {name}` writes a scene of it"
        )),
        None => read_text(path),
    }
}

/// Reads and checks a scene file; of the files it names, only calibrations are opened, and recordings in which a rectangle
/// determines a camera's model. Live cameras have the models of rectangles once they are open. Warns of probable mistakes.
pub(crate) fn read(path: &Path) -> Result<Scene> {
    read_with(path, &toml::Table::new())
}

/// Reads and checks a scene file like [`read`], with some settings replaced: full keys, such as
/// `targets.ball.filter.particles`, with their values.
pub(crate) fn read_with(path: &Path, replaced: &toml::Table) -> Result<Scene> {
    parse(&read_scene_text(path)?, path, replaced)
}

/// Reads and checks the text of a scene like [`parse`], whose cameras may lack poses.
pub(crate) fn parse_without_poses(text: &str, path: &Path) -> Result<Scene> {
    checked(text, path, Scene::parse_without_poses)
}

/// Reads and checks the text of a scene that is in the file at `path`, or will be, like [`read_with`].
pub(crate) fn parse(text: &str, path: &Path, replaced: &toml::Table) -> Result<Scene> {
    checked(text, path, |text, read_calibration| {
        Scene::parse_with(text, replaced, read_calibration)
    })
}

fn checked(
    text: &str,
    path: &Path,
    parse: impl Fn(&str, ReadCalibration) -> Result<Scene, Vec<Problem>>,
) -> Result<Scene> {
    let folder = path.parent().unwrap_or(Path::new(""));
    let mut scene = parse(text, &|file, lens| read_calibration(folder, file, lens))
        .map_err(|problems| problems_in("scene", path, &problems))?;
    let mut problems = Vec::new();
    for camera in &mut scene.cameras {
        problems.extend(find_rectangle(camera, folder, false, &mut scene.resolved).err());
    }
    if !problems.is_empty() {
        return Err(problems_in("scene", path, &problems));
    }
    for warning in &scene.warnings {
        warn(format!("{}: {warning}", path.shown()));
    }
    Ok(scene)
}

/// Opens the live cameras of the scene in the file at `path` whose models rectangles determine, and closes them again.
pub(crate) fn find_live_rectangles(path: &Path, scene: &mut Scene) -> Result<()> {
    let folder = path.parent().unwrap_or(Path::new(""));
    for camera in &mut scene.cameras {
        find_rectangle(camera, folder, true, &mut scene.resolved)
            .map_err(|problem| problems_in("scene", path, &[problem]))?;
    }
    Ok(())
}

/// Sets the model of a live or a recorded camera whose model a rectangle determines.
fn find_rectangle(
    camera: &mut CameraConfig,
    folder: &Path,
    is_live: bool,
    resolved: &mut toml::Table,
) -> Result<(), Problem> {
    if camera.rectangle.is_none() {
        return Ok(());
    }
    let source = source_config(camera, folder)?;
    if source.is_live() != is_live {
        return Ok(());
    }
    find_in_images(camera, source, resolved)
}

/// Opens all files of a scene, which was read from the file at `path`. `seed`, if given, replaces the scene's seed, and
/// `stills`, if any, replace the frames of its only camera.
pub(crate) fn open(
    path: &Path,
    scene: Scene,
    seed: Option<u32>,
    stills: &[PathBuf],
) -> Result<OpenScene> {
    let mut live = OpenCameras::default();
    open_with(path, scene, seed, stills, &mut live)
}

/// Opens all files of a scene as [`open`] does, but takes live cameras that are open already.
///
/// Errors: also if it is to stop while a live camera is waited for.
pub(crate) fn open_with(
    path: &Path,
    mut scene: Scene,
    seed: Option<u32>,
    stills: &[PathBuf],
    live: &mut OpenCameras,
) -> Result<OpenScene> {
    if !stills.is_empty() && scene.cameras.len() != 1 {
        return Err(user_error!(
            "{}: the scene has {} cameras, and the camera of images on the command line is ambiguous; leave them out, or give a scene with one camera",
            path.shown(),
            scene.cameras.len()
        ));
    }
    if let Some(seed) = seed {
        scene.seed = seed;
        scene
            .resolved
            .insert("seed".to_owned(), toml::Value::Integer(i64::from(seed)));
    }
    if !stills.is_empty() {
        find_live_rectangles(path, &mut scene)?;
        // They are at no time, and the world is the platform's frame.
        scene.platforms.clear();
        for target in &mut scene.targets {
            target.measurements = None;
        }
    }
    let folder = path.parent().unwrap_or(Path::new(""));
    let mut parts = Parts::with(scene, Vec::new());
    parts.open_cameras(folder, stills, live)?;
    if parts.assembly.problems.is_empty() {
        let units = units::warnings(&parts.scene, path);
        let warnings = parts.source_warnings(path).into_iter().chain(units);
        warnings.for_each(warn);
    }
    parts.open_targets(folder);
    parts.finish(path)
}

/// Reads and opens as much of a scene as its problems allow, in spite of them.
///
/// Errors: the file cannot be read.
pub(crate) fn open_parts(path: &Path) -> Result<Parts> {
    let text = read_scene_text(path)?;
    let folder = path.parent().unwrap_or(Path::new(""));
    let (scene, problems) =
        Scene::parse_parts(&text, &|file, lens| read_calibration(folder, file, lens));
    let missing = named_files::missing(&text, folder, &scene);
    let mut parts = Parts::with(scene, problems);
    parts.assembly.problems.extend(missing);
    parts.open_cameras(folder, &[], &mut OpenCameras::default())?;
    parts.find_recorded_rectangles(folder);
    parts.open_targets(folder);
    Ok(parts)
}

/// Reads a scene's text and opens the files that it names in a folder, except for frames: `sizes_px` are those of the images of cameras, by their
/// names, as far as they are known. Cameras may lack poses, which is among the problems.
#[cfg(feature = "studio")]
pub(crate) fn parts_of_text(
    text: &str,
    folder: &Path,
    sizes_px: &std::collections::BTreeMap<String, (usize, usize)>,
) -> Parts {
    let (scene, problems) =
        Scene::parse_parts_without_poses(text, &|file, lens| read_calibration(folder, file, lens));
    let missing = named_files::missing(text, folder, &scene);
    let mut parts = Parts::with(scene, problems);
    parts.assembly.problems.extend(missing);
    for camera in &parts.scene.cameras {
        let size_px = sizes_px.get(&camera.name).copied();
        let files = SceneFiles::of(folder);
        parts.assembly.add_camera(camera, size_px, &files);
        parts.sources.push(None);
    }
    parts.open_targets(folder);
    parts
}

/// A scene whose files are being opened: what could be opened, and all problems.
pub(crate) struct Parts {
    /// The cameras and targets without problems in the text.
    pub(crate) scene: Scene,
    /// The frames of each of its cameras, if they could be opened.
    pub(crate) sources: Vec<Option<Source>>,
    /// The motion of its platforms, if their files are right.
    pub(crate) platforms: Vec<PlatformRows>,
    /// What other sensors measure of its targets, if their files are right.
    measurements: Vec<MeasurementRows>,
    /// What another program detected, if the files are right.
    detections: Detections,
    /// Its views and bodies, and all problems.
    pub(crate) assembly: Assembly,
    /// Whether the text has no problem, so that cameras and targets are complete.
    is_complete: bool,
}

impl Parts {
    fn with(scene: Scene, problems: Vec<Problem>) -> Self {
        Self {
            detections: Detections::of(&scene.targets),
            scene,
            sources: Vec::new(),
            platforms: Vec::new(),
            measurements: Vec::new(),
            is_complete: problems.is_empty(),
            assembly: Assembly::with(problems),
        }
    }

    /// Opens the frames of all cameras, or `stills` in place of those of its only camera.
    ///
    /// Errors: the stills cannot be opened.
    fn open_cameras(
        &mut self,
        folder: &Path,
        stills: &[PathBuf],
        live: &mut OpenCameras,
    ) -> Result<()> {
        // The images that come while a camera is being opened need poses, too.
        let listening: Vec<_> = (self.scene.platforms.iter())
            .map(|platform| {
                let place = &platform.motion.file().value;
                platforms::live::is_address(place).then(|| PlatformRows::listen(platform))
            })
            .collect();
        for camera in &mut self.scene.cameras {
            let source = if stills.is_empty() {
                open_source(camera, folder, &mut self.scene.resolved, live)
            } else {
                Ok(Source::stills(stills)?)
            };
            let source = source
                .map_err(|problem| self.assembly.problems.push(problem))
                .ok();
            let size_px = source.as_ref().map(Source::size);
            self.assembly
                .add_camera(camera, size_px, &SceneFiles::of(folder));
            self.sources.push(source);
        }
        let problems = rig::problems(&self.opened(), folder);
        self.assembly.problems.extend(problems);
        self.open_platforms(folder, listening);
        self.read_measurements(folder);
        self.read_detections(folder, !stills.is_empty());
        Ok(())
    }

    /// Reads what another program detected in the images of the scene.
    fn read_detections(&mut self, folder: &Path, are_others: bool) {
        for (camera, source) in self.scene.cameras.iter().zip(&self.sources) {
            // The problem with a source that cannot be opened is known.
            let (Some(file), Some(source)) = (&camera.detections, source) else {
                self.detections.push(None);
                continue;
            };
            let path = resolve(folder, &file.value);
            let targets = &self.scene.targets;
            let read = if are_others {
                Err(user_error!(
                    "is of the scene's images; leave out those on the command line, or remove the targets with a detector"
                ))
            } else if source.is_live() {
                Err(user_error!(
                    "is of recorded images, and the camera is live; record its video first, or give boxes to the library (FrameSet::with_boxes)"
                ))
            } else if self.is_complete {
                images_of(source, folder, &camera.input)
                    .and_then(|images| CameraDetections::read(&path, camera, targets, &images))
                    .map(Some)
            } else {
                Ok(None)
            };
            let read = read.map_err(|error| file.problem(format!("{error:#}")));
            let read = read.map_err(|problem| self.assembly.problems.push(problem));
            self.detections.push(read.ok().flatten());
        }
        let mut files = self
            .scene
            .cameras
            .iter()
            .filter_map(|c| c.detections.as_ref());
        if let (Some(file), Err(error)) = (files.next(), self.detections.check(&self.scene.targets))
        {
            let path = resolve(folder, &file.value);
            self.assembly
                .problems
                .push(file.problem(format!("{}: {error:#}", path.shown())));
        }
    }

    /// Reads what other sensors measure.
    fn read_measurements(&mut self, folder: &Path) {
        for (number, target) in self.scene.targets.iter().enumerate() {
            let Some(file) = target.measurements.as_ref().filter(|_| self.is_complete) else {
                continue;
            };
            let sources = self.sources.iter().flatten();
            let read = if sources.clone().any(Source::is_live) {
                Err(user_error!(
                    "is of the past, and a camera is live; record its video first, or call Tracker::observe_measurement of the library"
                ))
            } else {
                MeasurementRows::read(&resolve(folder, &file.value), number, target)
            };
            let read = read.and_then(|rows| {
                let mut spans = sources.filter_map(Source::span);
                match spans.find_map(|span| rows.problem_with(&span)) {
                    Some(problem) => Err(user_error!("{problem}")),
                    None => Ok(rows),
                }
            });
            match read {
                Ok(rows) => self.measurements.push(rows),
                Err(error) => {
                    let problem = file.problem(format!("{error:#}"));
                    self.assembly.problems.push(problem);
                }
            }
        }
    }

    /// Reads the motion of all platforms, except for those that are listened to already.
    fn open_platforms(&mut self, folder: &Path, listening: Vec<Option<Result<PlatformRows>>>) {
        for (platform, listening) in self.scene.platforms.iter().zip(listening) {
            let file = platform.motion.file();
            let carried = self.scene.cameras.iter().zip(&self.sources);
            let carried =
                carried.filter(|(camera, _)| camera.platform.as_ref() == Some(&platform.name));
            let sources: Vec<&Source> = carried.filter_map(|(_, source)| source.as_ref()).collect();
            let is_address = listening.is_some();
            let mismatch = match sources.first() {
                Some(source) if source.is_live() && !is_address => Some(
                    "is of the past, and a camera on the platform is live; give the address where its poses come in, such as \"udp://127.0.0.1:7001\", or record its video first",
                ),
                Some(source) if is_address && !source.is_live() => Some(
                    "comes in while tracking, and the cameras on the platform are recordings; give a file, with times on their clock",
                ),
                _ => None,
            };
            if let Some(mismatch) = mismatch {
                self.assembly.problems.push(file.problem(mismatch));
                continue;
            }
            let rows = listening.unwrap_or_else(|| PlatformRows::read(platform, folder));
            let rows = rows.and_then(|rows| {
                let mut spans = sources.iter().filter_map(|source| source.span());
                match spans.find_map(|span| rows.problem_with(&span)) {
                    Some(problem) => Err(user_error!("{problem}")),
                    None => Ok(rows),
                }
            });
            match rows {
                Ok(rows) => self.platforms.push(rows),
                Err(error) => self
                    .assembly
                    .problems
                    .push(file.problem(format!("{error:#}"))),
            }
        }
    }

    /// Sets the models of recorded cameras that rectangles determine.
    fn find_recorded_rectangles(&mut self, folder: &Path) {
        let Self {
            scene,
            sources,
            assembly,
            ..
        } = self;
        for (number, camera) in scene.cameras.iter_mut().enumerate() {
            // The problem with a source that cannot be opened is known.
            let Some(source) = sources[number].as_ref().filter(|source| !source.is_live()) else {
                continue;
            };
            let size_px = source.size();
            let found = find_rectangle(camera, folder, false, &mut scene.resolved);
            assembly.views[number] = match found {
                Ok(()) if camera.rectangle.is_none() => continue,
                // Its problems with size and mask are known.
                Ok(()) => camera.view(size_px, &SceneFiles::of(folder)).ok(),
                Err(problem) => {
                    assembly.problems.push(problem);
                    None
                }
            };
        }
    }

    /// Opens the files of all targets.
    fn open_targets(&mut self, folder: &Path) {
        let bodies = self.scene.targets.iter().flat_map(|target| &target.bodies);
        let is_track = |start: &Located<StartConfig>| matches!(start.value, StartConfig::Track(_));
        let continues = bodies.filter_map(BodyConfig::start).any(is_track);
        let opened = self.sources.iter_mut().flatten().filter(|_| continues);
        let first_times_s = opened.filter_map(Source::first_time_s);
        let files = SceneFiles {
            folder,
            first_time_s: first_times_s.reduce(f64::min),
        };
        let is_complete = self.is_complete;
        self.assembly.add_targets(&self.scene, is_complete, &files);
    }

    fn opened(&self) -> Vec<rig::Opened<'_>> {
        let sources = self.sources.iter().map(Option::as_ref);
        self.scene.cameras.iter().zip(sources).collect()
    }

    /// Returns warnings of sources that open, of time stamps that may not be in seconds although all cameras agree, and of detections.
    pub(crate) fn source_warnings(&self, path: &Path) -> Vec<String> {
        let of_camera = |(camera, source): rig::Opened| {
            let source = source?;
            source_warning(path, camera, source).or_else(|| unit_warning(path, camera, source))
        };
        let of_cameras = self.opened().into_iter().filter_map(of_camera);
        let of_detections = self.detections.warnings().filter_map(|(number, warning)| {
            let file = self.scene.cameras[number].detections.as_ref()?;
            let problem = file.problem(warning.clone());
            Some(format!("{}: {problem}", path.shown()))
        });
        of_cameras.chain(of_detections).collect()
    }

    /// Returns the scene with its tracker; fails with all problems if there are any.
    pub(crate) fn finish(self, path: &Path) -> Result<OpenScene> {
        let tracker = self.assembly.finish(&self.scene);
        let tracker = tracker.map_err(|problems| problems_in("scene", path, &problems))?;
        Ok(OpenScene {
            scene: self.scene,
            sources: self.sources.into_iter().flatten().collect(),
            platforms: self.platforms,
            measurements: self.measurements,
            detections: self.detections,
            tracker,
        })
    }
}

/// Describes the images of a camera for its file of detections.
fn images_of(source: &Source, folder: &Path, input: &Input) -> Result<Images> {
    let names = match input {
        Input::Images { folder: images, .. } => Some(image_names(&resolve(folder, &images.value))?),
        Input::Video { .. } | Input::Mcap { .. } | Input::Given(_) => None,
    };
    Ok(Images {
        size_px: source.size(),
        count: source.frame_count(),
        names,
    })
}

fn source_warning(path: &Path, camera: &CameraConfig, source: &Source) -> Option<String> {
    let problem = camera.input.place().problem(source.warning()?);
    Some(format!("{}: {problem}", path.shown()))
}

fn unit_warning(path: &Path, camera: &CameraConfig, source: &Source) -> Option<String> {
    let step_s = source.span()?.step_s?;
    let is_long = matches!(camera.input, Input::Images { fps: None, .. }) && step_s > LONG_STEP_S;
    is_long.then(|| {
        format!(
            "{}: cameras.{}: its images are {step_s} s apart in times.csv, which is in seconds; are these milliseconds?",
            path.shown(),
            camera.name
        )
    })
}

/// Opens one camera of the scene in the file at `path`; `stills`, if any, replace its frames.
pub(crate) fn open_camera(
    path: &Path,
    camera: &CameraConfig,
    stills: &[PathBuf],
) -> Result<(Source, View)> {
    let folder = path.parent().unwrap_or(Path::new(""));
    let mut camera = camera.clone();
    let problem = |problem| problems_in("scene", path, &[problem]);
    let resolved = &mut toml::Table::new();
    let source = if stills.is_empty() {
        let live = &mut OpenCameras::default();
        let source = open_source(&mut camera, folder, resolved, live).map_err(problem)?;
        source_warning(path, &camera, &source).iter().for_each(warn);
        source
    } else {
        find_rectangle(&mut camera, folder, true, resolved).map_err(problem)?;
        Source::stills(stills)?
    };
    let view = camera.view(source.size(), &SceneFiles::of(folder));
    match view {
        Ok(view) => Ok((source, view)),
        Err(problems) => Err(problems_in("scene", path, &problems)),
    }
}

/// Returns one error that lists all problems of a scene or another file (`what`).
pub(crate) fn problems_in(what: &str, path: &Path, problems: &[Problem]) -> anyhow::Error {
    use std::fmt::Write as _;
    let mut text = match problems.len() {
        1 => format!("{}: a problem in the {what}:", path.shown()),
        n => format!("{}: {n} problems in the {what}:", path.shown()),
    };
    for problem in problems.iter().take(MAX_LISTED) {
        let _ = write!(text, "\n  {problem}");
    }
    if problems.len() > MAX_LISTED {
        let _ = write!(text, "\n  and {} more", problems.len() - MAX_LISTED);
    }
    anyhow::Error::new(UserError(text))
}

/// Opens the source of a camera. If it is live, a rectangle in its images sets the camera's model.
fn open_source(
    camera: &mut CameraConfig,
    folder: &Path,
    resolved: &mut toml::Table,
    live: &mut OpenCameras,
) -> Result<Source, Problem> {
    let config = source_config(camera, folder)?;
    let place = camera.input.place();
    let source = live.take(&config);
    let mut source = source.map_err(|error| place.problem(format!("{error:#}")))?;
    if source.is_live() {
        find_in_source(camera, &mut source, resolved)?;
    }
    Ok(source)
}

/// Returns the source settings of a camera of a scene in this folder.
pub(crate) fn source_config(camera: &CameraConfig, folder: &Path) -> Result<SourceConfig, Problem> {
    let kind = match &camera.input {
        Input::Mcap { file, topic } => SourceKind::Mcap {
            file: resolve(folder, &file.value),
            topic: topic.clone(),
        },
        Input::Given(place) => return Err(place.problem(Input::MISSING)),
        Input::Images {
            folder: images,
            fps,
        } => {
            let images_folder = resolve(folder, &images.value);
            let has_times = images_folder.join("times.csv").is_file();
            let timing = match (fps, has_times) {
                (Some(fps), false) => Timing::Fps(*fps),
                (Some(_), true) => {
                    return Err(images.problem(format!(
                        "{} holds times.csv, and the scene gives fps; keep one of them",
                        images_folder.shown()
                    )));
                }
                // A single image is at the time zero.
                (None, false) if images_folder.is_file() => Timing::Fps(1.0),
                (None, false) if images_folder.is_dir() => {
                    return Err(images.problem(format!(
                        "the times of the images are unknown; give fps, or put times.csv into {}",
                        images_folder.shown()
                    )));
                }
                // A missing folder is reported when it is opened.
                (None, _) => Timing::TimesFile,
            };
            SourceKind::Images {
                folder: images_folder,
                timing,
            }
        }
        Input::Video {
            video, encoding, ..
        } => {
            let resolved = |name: &String| resolve(folder, name).to_string_lossy().into_owned();
            let place = match &video.place {
                VideoPlace::File(name) => VideoPlace::File(resolved(name)),
                VideoPlace::Device(name) if video.settings.format == Some(VideoFormat::V4l2) => {
                    VideoPlace::Device(resolved(name))
                }
                other => other.clone(),
            };
            SourceKind::Video {
                video: VideoInput {
                    place,
                    settings: video.settings.clone(),
                },
                encoding: *encoding,
            }
        }
    };
    Ok(SourceConfig {
        kind,
        time_offset_s: camera.time_offset_s,
        frames: camera.frames,
    })
}

/// Reads the colours of a body of the scene in the file at `path`.
///
/// Errors: the body has no colours, or the file cannot be read.
pub(crate) fn colors(path: &Path, body: &BodyConfig) -> Result<ColorModel> {
    let folder = path.parent().unwrap_or(Path::new(""));
    let read = body.color_model(&SceneFiles::of(folder));
    let read = read.map_err(|problem| problems_in("scene", path, &[problem]))?;
    read.ok_or_else(|| {
        user_error!(
            "{}: targets.{}.colors: is missing, and the target is detected by its colours; give a file written by `pardalis learn`",
            path.shown(),
            body.name
        )
    })
}
