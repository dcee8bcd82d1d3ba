//! `pardalis calibrate mount`: where a camera is on a moving platform, from a target at rest.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use anyhow::Result;
use pardalis::camera::RigidMotion;
use pardalis::shape::Stance;
use pardalis::tracker::TrackState;
use pardalis::{Frame, FrameSet, Tracker};
use pardalis_calibrate::board::{Board, detect};
use pardalis_calibrate::{
    CalibrationView, Correspondence, MountCalibration, MountSettings, MountView, calibrate_mount,
};
use pardalis_camera::CalibratedCamera;
use pardalis_scene::calibration::{self, CalibrationFormat};
use pardalis_scene::{CameraConfig, PlatformConfig, PlatformMotion, Scene};

use super::output;
use crate::board::parse_board;
use crate::draw::picture::picture_of;
use crate::files::write_file;
use crate::output::{Shown, print, warn};
use crate::platforms::PlatformRows;
use crate::progress::Progress;
use crate::scene::{self, OpenScene};
use crate::sight::Sight;
use crate::source::{Delivery, Source};
use crate::user_error::user_error;

/// Views of a board, evenly over the recording: more take time and hardly add to the accuracy.
const BOARD_VIEWS: usize = 100;

/// Rows of a track below this confidence may be of something else.
const CERTAIN: f64 = 0.9;

/// A difference of the clocks is reported if it is at least this many standard deviations, and seconds.
const CLOCK_SIGMAS: f64 = 4.0;
const CLOCK_S: f64 = 1e-3;

/// Finds where a camera is on a robot, a pan-tilt head or an arm, from a board or a target at rest
///
/// Needs a scene with a platform that carries the camera, and a recording of 10 seconds or more in which the board,
/// or the scene's target, is at rest and in view, while the platform turns by 30 degrees or more in both directions and
/// drives nearer and farther away. The scene's platform_from_camera is a first guess. For a board it may be anything,
/// except for the height if the platform turns about its vertical axis only; for a target it must be right to about 20
/// degrees and half a metre. Also estimates the offset between the clocks of frames and poses, up to half a second.
///
/// Prints platform_from_camera with standard deviations and the clock's offset, as lines for the scene, and writes
/// camera.toml: a calibration with the camera's pose on the platform.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  pardalis calibrate mount scene.toml --board checkerboard:9x6:0.025
  pardalis calibrate mount scene.toml --target ball --camera front")]
pub(crate) struct Arguments {
    /// The scene
    #[arg(value_name = "SCENE.toml")]
    scene: PathBuf,
    /// The board that is at rest, as for `calibrate board`; without --board, the target must be at rest
    #[arg(long, value_name = "BOARD", conflicts_with = "target")]
    board: Option<String>,
    /// The target that is at rest, if the scene has several
    #[arg(long, value_name = "NAME")]
    target: Option<String>,
    /// The camera, if platforms carry several
    #[arg(long, value_name = "NAME")]
    camera: Option<String>,
    /// The folder for the results [default: in the current directory, the scene's name with -mount]
    #[arg(short, long, value_name = "FOLDER")]
    output: Option<PathBuf>,
}

/// Runs the command.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let path = &arguments.scene;
    let board = arguments.board.as_deref().map(parse_board).transpose()?;
    let scene = scene::read(path)?;
    let number = camera(path, &scene, arguments.camera.as_deref())?;
    let target = match board {
        Some(_) => None,
        None => Some(super::time::target(
            path,
            &scene,
            arguments.target.as_deref(),
        )?),
    };
    let mut open = scene::open(path, scene, None, &[])?;
    let views = match (&board, target) {
        (Some(board), _) => views_of_board(&mut open.sources[number], board)?,
        (None, target) => views_of_target(path, &mut open, number, target.unwrap_or(0))?,
    };
    let config = &open.scene.cameras[number];
    let is_carrier = |rows: &&PlatformRows| config.platform.as_deref() == Some(rows.name());
    let rows = open.platforms.iter().find(is_carrier).ok_or_else(|| {
        user_error!(
            "{}: cameras.{}: is on no platform",
            path.shown(),
            config.name
        )
    })?;
    let platform = rows.whole()?;
    let platform_at = |time_s: f64| {
        let state = platform.state_at(time_s)?;
        let into = state.world_from_platform.rotation.inverse();
        let rates = RigidMotion {
            velocity_m: into * state.velocity_mps,
            turn_rad: into * state.turn_radps,
        };
        Some((state.world_from_platform, rates))
    };
    let size_px = open.sources[number].size();
    let settings = MountSettings::new(config.world_from_camera, size_px);
    let found = calibrate_mount(&config.camera, &views, &platform_at, &settings)
        .map_err(|refusal| user_error!("{}: cameras.{}: {refusal}", path.shown(), config.name))?;

    let folder = output::folder(arguments.output.as_deref(), path, "mount");
    output::make_folder(&folder)?;
    let file = folder.join("camera.toml");
    let calibrated = CalibratedCamera {
        name: config.name.clone(),
        camera: config.camera.clone(),
        size_px: Some(size_px),
        world_from_camera: Some(found.platform_from_camera),
    };
    let text = calibration::write(CalibrationFormat::Pardalis, &[calibrated])?;
    write_file(&file, text.as_bytes())?;
    print(report(&open.scene, config, &found, views.len()));
    output::print_written(&[file]);
    Ok(())
}

/// Returns the number of the camera, which must be on a platform.
fn camera(path: &Path, scene: &Scene, wanted: Option<&str>) -> Result<usize> {
    let carried = scene.cameras.iter().enumerate();
    let carried: Vec<(usize, &CameraConfig)> = carried
        .filter(|(_, camera)| camera.platform.is_some())
        .collect();
    let names: Vec<&str> = carried.iter().map(|(_, camera)| &*camera.name).collect();
    let is_wanted = |(_, camera): &&(usize, &CameraConfig)| Some(&*camera.name) == wanted;
    match (&carried[..], wanted) {
        ([], _) => Err(user_error!(
            "{}: no camera is on a platform; describe the platform in a table [platforms.NAME], and give platform = \"NAME\" in the table of the camera",
            path.shown()
        )),
        ([(number, _)], None) => Ok(*number),
        (_, wanted) => match carried.iter().find(is_wanted) {
            Some((number, _)) => Ok(*number),
            None => Err(user_error!(
                "{}: {}the cameras on platforms are {}; choose one with --camera NAME",
                path.shown(),
                wanted.map_or_else(String::new, |name| format!("no camera {name}: ")),
                names.join(", ")
            )),
        },
    }
}

/// Calls `take` for each frame of a source, in the order of its delivery.
fn each_frame(
    source: &mut Source,
    doing: &'static str,
    mut take: impl FnMut(usize, Frame) -> Result<()>,
) -> Result<()> {
    let progress = Progress::new(doing, source.frame_count());
    for (number, delivery) in source.enumerate() {
        progress.step()?;
        match delivery? {
            Delivery::Frame { frame, .. } => take(number, frame)?,
            Delivery::Broken(error) => {
                progress.aside(|| warn(format!("{error:#}; the frame is ignored")));
            }
        }
    }
    Ok(())
}

/// Returns the views of a board.
fn views_of_board(source: &mut Source, board: &Board) -> Result<Vec<MountView>> {
    let step = source
        .frame_count()
        .map_or(1, |count| count.div_ceil(BOARD_VIEWS))
        .max(1);
    let mut views = Vec::new();
    each_frame(source, "searching the board in", |number, frame| {
        if !number.is_multiple_of(step) {
            return Ok(());
        }
        let Ok(corners) = detect(board, &picture_of(&frame).to_grey()) else {
            return Ok(());
        };
        let correspondences = corners.iter().map(|corner| Correspondence {
            point_m: corner.board_m,
            pixel: corner.pixel,
        });
        views.push(MountView {
            view: CalibrationView {
                name: format!("frame {number}"),
                correspondences: correspondences.collect(),
            },
            time_s: frame.time_s(),
        });
        Ok(())
    })?;
    Ok(views)
}

/// Returns the views of the middle of a target, which is tracked relative to the camera.
fn views_of_target(
    path: &Path,
    open: &mut OpenScene,
    number: usize,
    target: usize,
) -> Result<Vec<MountView>> {
    let config = &open.scene.targets[target];
    let [body] = &config.bodies[..] else {
        return Err(user_error!(
            "{}: targets.{}: has several landmarks; choose a target of one body with --target NAME",
            path.shown(),
            config.name
        ));
    };
    let mut setup = Tracker::builder();
    let view = open.tracker.views()[number].clone();
    let camera = setup.camera(view);
    let id = setup.target(super::time::detect::settings(
        body,
        &scene::colors(path, body)?,
    ));
    let mut tracker = setup.build()?;
    let mut views = Vec::new();
    let source = &mut open.sources[number];
    each_frame(source, "tracking through", |number, frame| {
        let time_s = frame.time_s();
        tracker.observe(&FrameSet::of(camera, frame))?;
        let estimate = tracker.estimate(id)?;
        let is_certain = estimate.state == TrackState::Tracking && estimate.confidence >= CERTAIN;
        let view = &tracker.views()[camera.index()];
        let known = estimate.kinematics.filter(|_| is_certain);
        let sight = known
            .and_then(|known| Sight::of(view, &body.shape, known.position_m, Stance::default()));
        if let Some(sight) = sight {
            views.push(MountView {
                view: CalibrationView {
                    name: format!("frame {number}"),
                    correspondences: vec![Correspondence {
                        point_m: [0.0; 3],
                        pixel: sight.pixel,
                    }],
                },
                time_s,
            });
        }
        Ok(())
    })?;
    Ok(views)
}

/// Returns what was found as text, with the lines to put into the scene.
fn report(scene: &Scene, config: &CameraConfig, found: &MountCalibration, views: usize) -> String {
    let (name, platform) = (&config.name, config.platform.as_deref().unwrap_or_default());
    let before = &config.world_from_camera;
    let now = &found.platform_from_camera;
    let moved_m = (now.translation.vector - before.translation.vector).norm();
    let turned_deg = (now.rotation * before.rotation.inverse())
        .angle()
        .to_degrees();
    let mut text = format!(
        "cameras.{name} on platforms.{platform}, from {} of {views} views; the platform turned by up to {:.0} degrees\n\
         residual  {:.2} px (root mean square), {} points rejected\n",
        found.used_views,
        found.turned_rad.to_degrees(),
        found.rms_px,
        found.outliers
    );
    for (axis, (value, sigma)) in ["x", "y", "z"]
        .into_iter()
        .zip(now.translation.vector.iter().zip(found.position_sigma_m))
    {
        let _ = if sigma == 0.0 {
            writeln!(
                text,
                "{axis}         {value:.5} m, as in the scene: see below"
            )
        } else {
            writeln!(text, "{axis}         {value:.5} ± {sigma:.5} m")
        };
    }
    let turn_deg = found.turn_sigma_rad.map(f64::to_degrees);
    let _ = writeln!(
        text,
        "rotation  ± {:.3}, {:.3}, {:.3} degrees about x, y and z\n\
         The camera is {:.0} mm and {turned_deg:.1} degrees from where the scene has it.",
        turn_deg[0],
        turn_deg[1],
        turn_deg[2],
        1e3 * moved_m
    );
    if let Some(axis) = found.undetermined {
        let [x, y, z] = axis.map(|v| v + 0.0);
        let _ = writeln!(
            text,
            "The platform turned about one axis only, ({x:.2}, {y:.2}, {z:.2}). Its position along this axis cannot be seen from that, and is kept: measure it."
        );
    }
    let is_odometry = |p: &&PlatformConfig| {
        p.name == platform && matches!(p.motion, PlatformMotion::Odometry(..))
    };
    if scene.platforms.iter().any(|p| is_odometry(&p)) {
        text += "Errors of the odometry are not part of the deviations above.\n";
    }
    let rows = now.to_homogeneous();
    let _ = writeln!(text, "\n[cameras.{name}]\nplatform_from_camera = [");
    for row in rows.row_iter() {
        let row: Vec<String> = row.iter().map(|v| format!("{:.6}", v + 0.0)).collect();
        let _ = writeln!(text, "    [{}],", row.join(", "));
    }
    text += "]";
    let is_late = |[offset_s, sigma_s]: &[f64; 2]| {
        offset_s.abs() > CLOCK_SIGMAS * sigma_s && offset_s.abs() >= CLOCK_S
    };
    if let Some([offset_s, sigma_s]) = found.time_offset_s.filter(is_late) {
        let configured = scene.platforms.iter().find(|p| p.name == platform);
        let before_s = configured.map_or(0.0, |platform| platform.time_offset_s);
        let _ = write!(
            text,
            "\n\n# In place of {before_s}: the clocks differ by another {offset_s:.4} ± {sigma_s:.4} s.\n[platforms.{platform}]\ntime_offset_s = {:.4}",
            before_s + offset_s
        );
    }
    text
}
