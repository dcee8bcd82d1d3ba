//! `pardalis calibrate rig`: poses and time offsets of the cameras of a scene, from a ball that is waved through the room.

mod align;
mod report;

use std::path::{Path, PathBuf};

use anyhow::Result;
use pardalis::shape::Shape;
use pardalis::tracker::{DetectedSettings, Region, SizeTolerance};
use pardalis_calibrate::{BallRigCalibration, BallRigSettings, TimedCamera, calibrate_ball_rig};
use pardalis_camera::{CalibratedCamera, Camera};
use pardalis_filter::motion::ConstantVelocity;
use pardalis_scene::{BodyConfig, CameraSetting, Scene, calibration, with_camera_settings};

use super::output;
use super::time::detect::{detect, settings};
use super::time::{check_folder, parse_offset, target};
use crate::board::parse_board;
use crate::commands::init::shown_path;
use crate::files::write_file;
use crate::output::{Shown, print};
use crate::scene::{self, OpenScene};
use crate::scene_files::read_text;
use crate::user_error::user_error;
use align::{Alignment, Ball};
use report::Report;

/// Calibrates the poses and clocks of several cameras with a ball that is waved through the room
///
/// Looks for the ball in every image by itself, and finds the poses and time offsets under which one path through space explains what
/// all cameras show. The cameras need a model of their lens each, but no pose. All lengths are proportional to the radius of the ball
/// in the scene. Record half a minute of the ball in all places that two or more cameras share, near and far, up and down.
///
/// Known points (--points) or a board (--board) say where the world is. Without them, the first camera whose pose the scene gives (not as a
/// guess) keeps it; without any pose, the frame of the first camera is the world. For boards that all cameras see at once, there is
/// `calibrate board --rig`.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  pardalis calibrate rig scene.toml --corrected corrected.toml
  pardalis calibrate rig scene.toml --points floor.csv --corrected corrected.toml   the world is that of known points
  pardalis calibrate rig scene.toml --board checkerboard:9x6:0.025                  the world is that of a board on the floor
  pardalis track corrected.toml

Known points that cameras see; the view is the camera's name. Four in a plane that one camera sees are enough, such as the corners of a rectangle:
  view,u_px,v_px,x_m,y_m,z_m
  left,102.5,310.0,0,0,0

Or three or more places at which the ball was held still, by the clock of the first camera; the places are those of its centre:
  time_s,x_m,y_m,z_m
  3.5,0,0,0.035")]
pub(crate) struct Arguments {
    /// The scene; its first camera is the time reference
    #[arg(value_name = "SCENE.toml")]
    scene: PathBuf,
    /// The ball, if the scene has several targets
    #[arg(long, value_name = "NAME")]
    target: Option<String>,
    /// Known points of the world
    #[arg(long, value_name = "FILE.csv", conflicts_with = "board")]
    points: Option<PathBuf>,
    /// A board at rest in view of one or more cameras, as for `calibrate board`: its first corner is the origin of the world, and its z axis points out of it
    #[arg(long, value_name = "BOARD")]
    board: Option<String>,
    /// Also refines the focal lengths that the data determine to 1 % or better, starting from those of the scene
    #[arg(long)]
    refine_focal: bool,
    /// Largest offset between two clocks to search for in either direction, in seconds
    #[arg(long, value_name = "SECONDS", default_value_t = 0.5, value_parser = parse_offset, allow_negative_numbers = true)]
    max_offset_s: f64,
    /// Also writes the scene with poses and offsets to this file, which must be in the scene's folder and may be the scene
    /// itself
    #[arg(long, value_name = "SCENE.toml")]
    corrected: Option<PathBuf>,
    /// The folder for the results [default: in the current directory, the scene's name with -rig]
    #[arg(short, long, value_name = "FOLDER")]
    output: Option<PathBuf>,
}

/// Runs the command.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let path = &arguments.scene;
    if let Some(corrected) = &arguments.corrected {
        check_folder(path, corrected)?;
    }
    let board = arguments.board.as_deref().map(parse_board).transpose()?;
    let read = scene::read_without_poses(path)?;
    check_cameras(path, &read)?;
    let number = target(path, &read, arguments.target.as_deref())?;
    let ball = ball(path, &read, number)?;
    let alignment = Alignment::read(arguments.points.as_deref(), &read)?;
    let mut open = scene::open(path, read, None, &[])?;
    let alignment = match board {
        Some(board) => Alignment::on_board(&mut open.sources, &board)?,
        None => alignment,
    };
    let body = &open.scene.targets[number].bodies[0];
    let detector = ball_settings(body, scene::colors(path, body)?);
    let views = open.tracker.views();
    let frames = detect(&mut open.sources, views, &body.shape, &detector)?;
    let configs = open.scene.cameras.iter().zip(views).zip(frames);
    let cameras: Vec<TimedCamera> = configs
        .map(|((config, view), frames)| TimedCamera {
            name: &config.name,
            view,
            frames,
        })
        .collect();
    let mut settings = BallRigSettings::default();
    settings.max_offset_s = arguments.max_offset_s;
    settings.refine_focal = arguments.refine_focal;
    let found = calibrate_ball_rig(&cameras, &settings)
        .map_err(|refusal| user_error!("{}: {refusal}", path.shown()))?;
    let world = alignment.world(&open.scene, &found, &ball)?;
    let report = Report::new(&open.scene, &cameras, &found, &world, &ball);

    let folder = output::folder(arguments.output.as_deref(), path, "rig");
    output::make_folder(&folder)?;
    let rig = folder.join("rig.toml");
    let mut written = Vec::new();
    for (file, text) in [
        (rig.clone(), calibration::write_toml(&report.calibrated())),
        (folder.join("cameras.csv"), report.table()?),
        (folder.join("detections.csv"), report.detections()?),
        (folder.join("path.csv"), report.path()?),
        (folder.join("report.html"), report.page()?),
    ] {
        write_file(&file, text.as_bytes())?;
        written.push(file);
    }
    print(&report);
    if let Some(corrected) = &arguments.corrected {
        let text = corrected_scene(path, corrected, &rig, &open, &report.calibrated(), &found)?;
        write_file(corrected, text.as_bytes())?;
        written.push(corrected.clone());
    } else {
        print(report.settings(&shown_path(&rig, path)));
    }
    output::print_written(&written);
    Ok(())
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

/// Returns the scene's text with the poses and offsets that were found. Cameras whose focal length was refined have their lens from
/// the rig's file, or in their model.
fn corrected_scene(
    path: &Path,
    corrected: &Path,
    rig: &Path,
    open: &OpenScene,
    calibrated: &[CalibratedCamera],
    found: &BallRigCalibration,
) -> Result<String> {
    let text = read_text(path)?;
    let given = text.parse::<toml::Table>().unwrap_or_default();
    let mut settings = Vec::new();
    let configs = open
        .scene
        .cameras
        .iter()
        .zip(calibrated)
        .zip(&found.cameras);
    for ((config, camera), of) in configs {
        let mut set = |key, value| {
            settings.push(CameraSetting {
                camera: &config.name,
                key,
                value,
            });
        };
        set("world_from_camera", report::pose_value(camera));
        set(
            "time_offset_s",
            report::corrected_offset_s(config, of).into(),
        );
        if of.focal.is_some_and(|focal| focal.is_refined) {
            let table = given.get("cameras").and_then(|all| all.get(&config.name));
            if table.is_some_and(|table| table.get("calibration").is_some()) {
                set("calibration", shown_path(rig, corrected).into());
                if table.is_some_and(|table| table.get("calibration_camera").is_some()) {
                    set("calibration_camera", config.name.clone().into());
                }
            } else {
                for (key, value) in report::focal_values(&camera.camera) {
                    set(key, value);
                }
            }
        }
    }
    with_camera_settings(&text, &settings).ok_or_else(|| {
        user_error!(
            "{}: the layout of the file does not allow inserting poses and offsets; the results are in {}: give it as `calibration` of each camera, in place of model and pose",
            path.shown(),
            rig.shown()
        )
    })
}
