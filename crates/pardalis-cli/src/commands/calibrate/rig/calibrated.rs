//! The calibration of a rig, for the command and for the studio.

use std::path::Path;

use anyhow::Result;
use pardalis::Frame;
use pardalis::shape::Shape;
use pardalis::tracker::{DetectedSettings, Region, SizeTolerance};
use pardalis_calibrate::{
    BallRigCalibration, BallRigSettings, Detection, TimedCamera, calibrate_ball_rig,
};
use pardalis_camera::Camera;
use pardalis_camera::formats::Lens;
use pardalis_filter::motion::ConstantVelocity;
use pardalis_scene::{BodyConfig, CameraSetting, Scene, calibration, with_camera_settings};

use super::super::time::detect::{Until, detect, settings};
use super::super::time::target;
use super::align::{Alignment, Ball, Known, World};
use super::report::{self, Report};
use crate::output::Shown;
use crate::scene;
use crate::scene_files::read_calibration;
use crate::source::OpenCameras;
use crate::user_error::user_error;

/// What to calibrate, from what, and how.
pub(in crate::commands) struct Task<'a> {
    /// The file of the scene, at whose folder its paths start.
    pub(in crate::commands) path: &'a Path,
    pub(in crate::commands) text: &'a str,
    /// The ball, if the scene has several targets.
    pub(in crate::commands) target: Option<&'a str>,
    pub(in crate::commands) known: Known,
    pub(in crate::commands) settings: BallRigSettings,
    pub(in crate::commands) until: Until,
}

/// A rig that was calibrated with a ball.
pub(in crate::commands) struct CalibratedRig {
    scene: Scene,
    /// The size of the images of each camera in pixels, and the number of its frames.
    seen: Vec<((usize, usize), usize)>,
    found: BallRigCalibration,
    world: World,
    ball: Ball,
}

impl CalibratedRig {
    /// Detects the ball and calibrates the rig. Calls `seen` with each frame and the name of its camera. Takes live cameras that are open already, and leaves them
    /// there at the end, unless they fail.
    ///
    /// Errors: the scene has problems, or the detections do not determine the rig, with the remedy.
    pub(in crate::commands) fn of(
        task: &Task,
        live: &mut OpenCameras,
        seen: &(impl Fn(&str, &Frame, &[Detection]) + Sync),
    ) -> Result<Self> {
        let path = task.path;
        let read = scene::parse_without_poses(task.text, path)?;
        check_cameras(path, &read)?;
        let number = target(path, &read, task.target)?;
        let ball = ball(path, &read, number)?;
        let alignment = Alignment::known(&task.known, &read)?;
        live.stop = task.until.stop.clone();
        let mut open = scene::open_with(path, read, None, &[], live)?;
        let alignment = match &task.known {
            Known::Board(board) => Alignment::on_board(&mut open.sources, board)?,
            _ => alignment,
        };
        let body = &open.scene.targets[number].bodies[0];
        let detector = ball_settings(body, scene::colors(path, body)?);
        let frames = detect(
            &mut open.sources,
            open.tracker.views(),
            (&body.shape, &detector),
            &task.until,
            &|number: usize, frame: &Frame, detections: &[Detection]| {
                seen(&open.scene.cameras[number].name, frame, detections);
            },
        );
        live.open = open.take_live(path);
        let (frames, views) = (frames?, open.tracker.views());
        let configs = open.scene.cameras.iter().zip(views).zip(frames);
        let cameras: Vec<TimedCamera> = configs
            .map(|((config, view), frames)| TimedCamera {
                name: &config.name,
                view,
                frames,
            })
            .collect();
        let found = calibrate_ball_rig(&cameras, &task.settings)
            .map_err(|refusal| user_error!("{}: {refusal}", path.shown()))?;
        let world = alignment.world(&open.scene, &found, &ball)?;
        let seen = cameras
            .iter()
            .map(|camera| (camera.view.size(), camera.frames.len()));
        Ok(Self {
            seen: seen.collect(),
            scene: open.scene,
            found,
            world,
            ball,
        })
    }

    pub(in crate::commands) fn report(&self) -> Report<'_> {
        Report::new(
            &self.scene,
            &self.seen,
            &self.found,
            &self.world,
            &self.ball,
        )
    }

    /// Returns the text of the calibration file of the rig.
    pub(in crate::commands) fn rig_text(&self) -> String {
        calibration::write_toml(&self.report().calibrated())
    }

    /// Returns the text of the scene in the file at `path` with the poses and offsets that were found; `None` if its layout does not allow it.
    ///
    /// Cameras whose calibration file has a pose, and those whose focal length was refined, have their lens and pose from the rig's file, whose path from
    /// the scene is `rig`, unless their model is in the scene.
    pub(in crate::commands) fn corrected(
        &self,
        path: &Path,
        text: &str,
        rig: &str,
    ) -> Option<String> {
        let given = text.parse::<toml::Table>().unwrap_or_default();
        let folder = path.parent().unwrap_or(Path::new(""));
        let calibrated = self.report().calibrated();
        let mut settings = Vec::new();
        let configs = self.scene.cameras.iter().zip(&calibrated);
        for (number, ((config, camera), of)) in configs.zip(&self.found.cameras).enumerate() {
            let mut set = |key, value| {
                settings.push(CameraSetting {
                    camera: &config.name,
                    key,
                    value,
                    // Beside a guess, all poses are.
                    is_guess: key == "world_from_camera" && self.world.guess.is_some(),
                });
            };
            let table = given.get("cameras").and_then(|all| all.get(&config.name));
            let has = |key: &str| table.is_some_and(|table| table.get(key).is_some());
            let file = table.and_then(|table| table.get("calibration")?.as_str());
            let is_refined = of.focal.is_some_and(|focal| focal.is_refined);
            // A pose beside that of a file would look like a mistake.
            let is_posed = file.is_some_and(|file| has_pose(folder, file));
            if file.is_some() && (is_refined || is_posed) {
                set("calibration", rig.into());
                if has("calibration_camera") {
                    set("calibration_camera", config.name.clone().into());
                }
            } else if is_refined {
                for (key, value) in report::focal_values(&camera.camera) {
                    set(key, value);
                }
            }
            let is_kept = self.world.guess == Some(number);
            if !is_kept && (!is_posed || has("world_from_camera")) {
                set("world_from_camera", report::pose_value(camera));
            }
            set(
                "time_offset_s",
                report::corrected_offset_s(config, of).into(),
            );
        }
        with_camera_settings(text, &settings)
    }
}

/// Reports whether a calibration file has poses.
fn has_pose(folder: &Path, file: &str) -> bool {
    // Which lens it is for does not matter, but may have to be said.
    let lenses = [None, Some(Lens::Pinhole)];
    let cameras = lenses
        .into_iter()
        .find_map(|lens| read_calibration(folder, file, lens).ok());
    cameras.is_some_and(|all| all.iter().any(|one| one.world_from_camera.is_some()))
}

/// Requires two or more cameras with lenses, at rest.
fn check_cameras(path: &Path, scene: &Scene) -> Result<()> {
    for camera in &scene.cameras {
        let (key, what) = if camera.platform.is_some() {
            (
                "platform",
                "the camera moves, and the cameras of a rig are at rest; `calibrate mount` finds where it is on its platform",
            )
        } else if matches!(camera.camera, Camera::Plane(_)) {
            (
                "model",
                "is that of a plane, which has no lens; give the model of a lens, such as from `calibrate board`",
            )
        } else {
            continue;
        };
        return Err(user_error!(
            "{}: cameras.{}.{key}: {what}",
            path.shown(),
            camera.name
        ));
    }
    if scene.cameras.len() < 2 {
        return Err(user_error!(
            "{}: has one camera, and a rig has two or more; add the others",
            path.shown()
        ));
    }
    Ok(())
}

/// Returns the ball. Its radius must be known, because it gives the scale.
fn ball(path: &Path, scene: &Scene, number: usize) -> Result<Ball> {
    let target = &scene.targets[number];
    let refused = |what: &str| {
        Err(user_error!(
            "{}: targets.{}: {what}",
            path.shown(),
            target.name
        ))
    };
    match &target.bodies[..] {
        [body] => match &body.shape {
            Shape::Sphere(ball) => match body.size {
                SizeTolerance::Share(tolerance) => Ok(Ball {
                    radius_m: ball.radius_m,
                    tolerance,
                }),
                _ => refused(
                    "the radius of the ball is unknown, and all lengths are proportional to it; measure the ball, and give radius_m",
                ),
            },
            _ => refused(
                "is no ball, and a rig is calibrated with a ball; define a target with shape.sphere and choose it with --target NAME",
            ),
        },
        _ => refused(
            "has several landmarks, and a rig is calibrated with a ball; define a target of one body and choose it with --target NAME",
        ),
    }
}

/// Returns the settings for detecting the ball with a single camera whose pose is unknown: the ball may be anywhere.
fn ball_settings(body: &BodyConfig, colors: pardalis::color::ColorModel) -> DetectedSettings {
    let mut settings = settings(body, &colors);
    settings.motion = ConstantVelocity::BETWEEN_VELOCITY_JUMPS.into();
    settings.existence.region = Region::default();
    settings.start = None;
    settings
}
