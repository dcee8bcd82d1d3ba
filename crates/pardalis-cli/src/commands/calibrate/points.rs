//! `pardalis calibrate points`: intrinsics from a table of known points.

use std::path::PathBuf;

use anyhow::Result;

use super::fit::Fits;
use super::model::ModelOptions;
use super::observations::{self, Columns};
use super::output;
use super::report::Report;
use crate::arguments::parse_size;

/// Calibrates a camera from known points and their pixels
///
/// The table has the columns x_m,y_m,z_m,u_px,v_px in any order; other columns are ignored. Points with the same text in the column
/// `view` share one camera pose; without that column all points do, and the camera file includes the pose.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  pardalis calibrate points points.csv --model kannala_brandt --size 640x480
  pardalis calibrate points points.csv --model all --size 640x480 -o compared
  pardalis calibrate points train.csv --model all --size 640x480 --test test.csv
  pardalis calibrate points points.csv --model unified --size 640x480 --columns u=u_noisy_px,v=v_noisy_px")]
pub(crate) struct Arguments {
    /// The table
    #[arg(value_name = "FILE.csv")]
    points: PathBuf,
    #[command(flatten)]
    model: ModelOptions,
    /// Width and height of the images in pixels
    #[arg(long, value_name = "WIDTHxHEIGHT", value_parser = parse_size)]
    size: (usize, usize),
    /// A table of test views with the same columns, to evaluate each fitted model: the intrinsics are fixed, the pose
    /// of each view is fitted, and the RMS includes all points
    #[arg(long, value_name = "FILE.csv")]
    test: Option<PathBuf>,
    /// Columns with other names
    #[arg(long, value_name = "x=NAME,...,v=NAME", value_parser = Columns::parse)]
    columns: Option<Columns>,
    /// The folder for the results [default: in the current directory, the table's name with -calibration]
    #[arg(short, long, value_name = "FOLDER")]
    output: Option<PathBuf>,
}

/// Runs the command.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let models = arguments.model.models()?;
    let columns = arguments.columns.clone().unwrap_or_default();
    let observations = observations::read(&arguments.points, &columns)?;
    let size_px = arguments.size;
    observations.check(&arguments.points, size_px)?;
    let read_test = |path: &PathBuf| {
        let test = observations::read(path, &columns)?;
        test.check(path, size_px)?;
        anyhow::Ok(test)
    };
    let test = arguments.test.as_ref().map(read_test).transpose()?;
    let mut fits = Fits::of(
        &arguments.points,
        &observations.views,
        models,
        size_px,
        false,
    )?;
    if let Some(test) = &test {
        fits.test_on(&test.views);
    }
    let report = Report {
        camera: "camera",
        size_px,
        observations: &observations,
        fits: &fits,
        images: &[],
        note: None,
    };
    let folder = output::folder(
        arguments.output.as_deref(),
        &arguments.points,
        "calibration",
    );
    output::write(&folder, &report)
}
