//! `pardalis calibrate board`: cameras from images of a calibration board.

use std::path::{Path, PathBuf};

use anyhow::Result;
use pardalis_calibrate::Calibration;
use pardalis_calibrate::board::Board;
use pardalis_scene::{NAMES_ALLOWED, is_name};

use super::board_checks::{check_found, side, side_note};
use super::fit::Fits;
use super::images::{self, observations};
use super::model::ModelOptions;
use super::report::Report;
use super::{board_rig, output};
use crate::board::parse_board;
use crate::user_error::user_error;

/// Largest relative deviation of a measured distance.
const DISTANCE_TOLERANCE: f64 = 0.05;

/// Calibrates a camera, or several at once, from images of a calibration board
#[derive(Debug, clap::Args)]
#[command(after_help = "Boards:
  checkerboard:9x6:0.06                      inner corners; side of a square in metres
  charuco:5x7:0.04:0.03:DICT_4X4_50          squares; sides of a square and a marker in metres; OpenCV's dictionary
  aprilgrid:6x6:0.088:0.3                    tags; side of a tag in metres; gap between tags by a tag's side
  board.toml, target.yaml                    the same in a file; Kalibr's target files

Examples:
  pardalis calibrate board images --board checkerboard:9x6:0.06 --model pinhole
  pardalis calibrate board images --board checkerboard:9x6:0.06 --model all --distance 000.jpg=0.85
  pardalis calibrate board --rig left='stereo/left*.jpg' --rig right='stereo/right*.jpg' \\
    --board checkerboard:9x6:0.025 --model pinhole")]
pub(crate) struct Arguments {
    /// A folder of images, or images; a pattern such as 'left*.jpg' is allowed
    #[arg(
        value_name = "FOLDER|IMAGE",
        required_unless_present = "rig",
        conflicts_with = "rig"
    )]
    images: Vec<PathBuf>,
    /// The board
    #[arg(long, value_name = "BOARD")]
    board: String,
    #[command(flatten)]
    model: ModelOptions,
    /// A camera of a rig with its folder or pattern of images; repeat for each camera. Sorted by name, the images of
    /// all cameras must be simultaneous
    #[arg(long, value_name = "NAME=FOLDER|PATTERN", value_parser = parse_camera)]
    rig: Vec<(String, PathBuf)>,
    /// A measured distance from the camera to the board's first corner in an image. The calibration fails if it
    /// differs: nothing else reveals a wrong square size
    #[arg(long, value_name = "IMAGE=METRES", value_parser = parse_distance, conflicts_with = "rig")]
    distance: Vec<(String, f64)>,
    /// The folder for the results [default: in the current directory, the name of the first folder, image or pattern
    /// with -calibration; for a rig, rig-calibration]
    #[arg(short, long, value_name = "FOLDER")]
    output: Option<PathBuf>,
}

/// Runs the command.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let board = parse_board(&arguments.board)?;
    if !arguments.rig.is_empty() {
        let folder = output::folder(arguments.output.as_deref(), Path::new("rig"), "calibration");
        return board_rig::run(&board, &arguments.model, &arguments.rig, &folder);
    }
    let models = arguments.model.models()?;
    let mut files = Vec::new();
    for path in &arguments.images {
        files.extend(images::files(path)?);
    }
    let (images, size_px) = images::search(&board, &files)?;
    let observations = observations(&images);
    let source = &arguments.images[0];
    check_found(source, &images)?;
    let fits = Fits::of(source, &observations.views, models, size_px, true)?;
    for (image, distance_m) in &arguments.distance {
        check_distance(&board, &fits.fitted[0].calibration, image, *distance_m)?;
    }
    let report = Report {
        camera: "camera",
        size_px,
        observations: &observations,
        fits: &fits,
        images: &images,
        note: side_note(&board),
    };
    let folder = output::folder(arguments.output.as_deref(), source, "calibration");
    output::write(&folder, &report)
}

/// Fails if the fitted distance to the board differs from the measured one.
fn check_distance(
    board: &Board,
    calibration: &Calibration,
    image: &str,
    measured_m: f64,
) -> Result<()> {
    let view = calibration.views.iter().find(|view| view.name == image).ok_or_else(|| {
        user_error!("--distance {image}: the board was found in no image of this name; give the name of a file in which it was found")
    })?;
    let fitted_m = view.camera_from_target.translation.vector.norm();
    let ratio = measured_m / fitted_m;
    if (ratio - 1.0).abs() <= DISTANCE_TOLERANCE {
        return Ok(());
    }
    let (what, side_m) = side(board);
    Err(user_error!(
        "--distance {image}: measured {measured_m} m, but the calibration gives {fitted_m:.3} m: the ratio {ratio:.3} is more than 5 % from 1; \
         a {what} of {:.5} m instead of {side_m} m would match: measure the board, and correct --board or the distance",
        side_m * ratio
    ))
}

/// Parses `NAME=FOLDER`.
fn parse_camera(text: &str) -> Result<(String, PathBuf), String> {
    text.split_once('=')
        .filter(|(name, path)| is_name(name) && !path.is_empty())
        .map(|(name, path)| (name.to_owned(), PathBuf::from(path)))
        .ok_or_else(|| {
            format!(
                "allowed: {NAMES_ALLOWED}, then = and a folder or pattern, such as left=images/left"
            )
        })
}

/// Parses `IMAGE=METRES`.
fn parse_distance(text: &str) -> Result<(String, f64), String> {
    text.rsplit_once('=')
        .and_then(|(image, metres)| Some((image.to_owned(), metres.parse().ok()?)))
        .filter(|(_, metres)| (1e-3..=1e4).contains(metres))
        .ok_or_else(|| {
            "allowed: the name of an image, = and metres, such as 000.jpg=0.85".to_owned()
        })
}
