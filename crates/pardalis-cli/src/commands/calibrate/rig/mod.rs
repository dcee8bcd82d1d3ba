//! `pardalis calibrate rig`: poses and time offsets of the cameras of a scene, from a ball that is waved through the room.

mod align;
mod calibrated;
mod report;

use std::path::PathBuf;

use anyhow::Result;
use pardalis_calibrate::BallRigSettings;

use super::output;
use super::time::detect::Until;
use super::time::{check_folder, parse_offset};
use crate::arguments::parse_duration_s;
use crate::board::parse_board;
use crate::commands::init::shown_path;
use crate::files::write_file;
use crate::output::{Shown, print};
use crate::scene;
use crate::source::OpenCameras;
use crate::user_error::user_error;
pub(in crate::commands) use align::Known;
pub(in crate::commands) use calibrated::{CalibratedRig, Task};

/// Calibrates the poses and clocks of several cameras with a ball that is waved through the room
///
/// Looks for the ball in every image by itself, and finds the poses and time offsets under which one path through space explains what
/// all cameras show. The cameras need a model of their lens each, but no pose. All lengths are proportional to the radius of the ball
/// in the scene. Record half a minute of the ball in all places that two or more cameras share, near and far, up and down.
///
/// Known points (--points) or a board (--board) say where the world is. Without them, the first camera whose pose the scene gives (not as a
/// guess) keeps it; without any pose, the first guess is kept, or else the frame of the first camera is the world. For boards that all cameras see at once, there is
/// `calibrate board --rig`.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  pardalis calibrate rig scene.toml --corrected corrected.toml
  pardalis calibrate rig scene.toml --points floor.csv --corrected corrected.toml   the world is that of known points
  pardalis calibrate rig scene.toml --board checkerboard:9x6:0.025                  the world is that of a board on the floor
  pardalis calibrate rig live.toml --duration 30 --corrected live.toml               live cameras: wave the ball for half a minute
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
    /// How long live cameras are watched
    #[arg(long = "duration", value_name = "SECONDS", value_parser = parse_duration_s, allow_negative_numbers = true)]
    duration_s: Option<f64>,
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
    let known = match (&arguments.points, &arguments.board) {
        (Some(points), _) => Known::File(points.clone()),
        (None, Some(board)) => Known::Board(parse_board(board)?),
        (None, None) => Known::Scene,
    };
    let mut settings = BallRigSettings::default();
    settings.max_offset_s = arguments.max_offset_s;
    settings.refine_focal = arguments.refine_focal;
    let task = Task {
        path,
        text: &scene::read_scene_text(path)?,
        target: arguments.target.as_deref(),
        known,
        settings,
        until: Until {
            duration_s: arguments.duration_s,
            ..Until::default()
        },
    };
    let calibrated = CalibratedRig::of(&task, &mut OpenCameras::default(), &|_, _, _| ())?;
    let report = calibrated.report();

    let folder = output::folder(arguments.output.as_deref(), path, "rig");
    output::make_folder(&folder)?;
    let rig = folder.join("rig.toml");
    let mut written = Vec::new();
    for (file, text) in [
        (rig.clone(), calibrated.rig_text()),
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
        let text = calibrated.corrected(path, task.text, &shown_path(&rig, corrected));
        let text = text.ok_or_else(|| {
            user_error!(
                "{}: the layout of the file does not allow inserting poses and offsets; the results are in {}: give it as `calibration` of each camera, in place of model and pose",
                path.shown(),
                rig.shown()
            )
        })?;
        write_file(corrected, text.as_bytes())?;
        written.push(corrected.clone());
    } else {
        print(report.settings(&shown_path(&rig, path)));
    }
    output::print_written(&written);
    Ok(())
}
