//! `pardalis calibrate pose`: pose of a calibrated camera from a table of known points.

use std::path::PathBuf;

use anyhow::Result;
use pardalis_calibrate::{
    Calibration, Correspondence, FittedParameter, FittedView, OUTLIER_SIGMAS, PoseFit, fit_pose,
};

use super::fit::{Fit, Fits, all_observed_points};
use super::model::read_camera;
use super::observations::{self, Columns};
use super::output;
use super::report::Report;
use crate::arguments::parse_size;
use crate::commands::camera::optics::Optics;
use crate::draw::calibration::{GRID_CELLS, cell_counts};
use crate::output::Shown;
use crate::user_error::user_error;

/// Points whose heights differ by less than this share of their extent lie in a horizontal plane. Hand-set.
const FLAT_SHARE: f64 = 0.01;

/// Computes the pose of a calibrated camera from known points
#[derive(Debug, clap::Args)]
#[command(after_help = "Example:
  pardalis calibrate pose points.csv --camera camera.toml")]
pub(crate) struct Arguments {
    /// The table, as for `calibrate points`, with a single view: at least four points in one plane, or six
    #[arg(value_name = "FILE.csv")]
    points: PathBuf,
    /// The camera: a calibration file of any format
    #[arg(long, value_name = "FILE")]
    camera: PathBuf,
    /// The camera's name, if the file has several
    #[arg(long, value_name = "NAME")]
    camera_name: Option<String>,
    /// Width and height of the images in pixels, if the camera file does not state them
    #[arg(long, value_name = "WIDTHxHEIGHT", value_parser = parse_size)]
    size: Option<(usize, usize)>,
    /// Columns with other names
    #[arg(long, value_name = "x=NAME,...,v=NAME", value_parser = Columns::parse)]
    columns: Option<Columns>,
    /// The folder for the results [default: in the current directory, the table's name with -pose]
    #[arg(short, long, value_name = "FOLDER")]
    output: Option<PathBuf>,
}

/// Runs the command.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let known = read_camera(
        &arguments.camera,
        arguments.camera_name.as_deref(),
        "choose one with --camera-name NAME",
    )?;
    let size_px = known.size_px.or(arguments.size).ok_or_else(|| {
        user_error!(
            "{}: does not state the size of the images; give it with --size WIDTHxHEIGHT",
            arguments.camera.shown()
        )
    })?;
    let columns = arguments.columns.clone().unwrap_or_default();
    let observations = observations::read(&arguments.points, &columns)?;
    let [view] = observations.views.as_slice() else {
        return Err(user_error!(
            "{}: has {} views, but a pose needs exactly one; keep the rows of one view",
            arguments.points.shown(),
            observations.views.len()
        ));
    };
    observations.check(&arguments.points, size_px)?;
    let fit = fit_pose(
        &known.camera,
        size_px,
        &view.correspondences,
        OUTLIER_SIGMAS,
    )
    .map_err(|refusal| user_error!("{}: {refusal}", arguments.points.shown()))?;
    let note = below_points(&view.correspondences, &fit);
    let held = |(name, value)| FittedParameter {
        name,
        value,
        sigma: None,
    };
    let squares = fit
        .residuals_px
        .iter()
        .flatten()
        .map(|[du, dv]| du * du + dv * dv);
    let count = fit.residuals_px.iter().flatten().count().max(1);
    let mut calibration = Calibration {
        parameters: known.camera.parameters().into_iter().map(held).collect(),
        rms_px: fit.rms_px,
        rms_all_px: (squares.sum::<f64>() / count as f64).sqrt(),
        held_out_rms_px: None,
        coverage: 0.0,
        max_angle_rad: view
            .correspondences
            .iter()
            .filter_map(|point| Optics::new(&known.camera, size_px).angle_rad(point.pixel))
            .fold(0.0, f64::max),
        camera: known.camera,
        views: vec![FittedView {
            name: view.name.clone(),
            camera_from_target: fit.camera_from_target,
            pose_sigma: fit.pose_sigma,
            residuals_px: fit.residuals_px,
            outliers: fit.outliers,
            rms_px: fit.rms_px,
        }],
    };
    let counts = cell_counts(
        size_px,
        &all_observed_points(&calibration, &observations.views),
    );
    let seen = counts.iter().flatten().filter(|count| **count > 0).count();
    calibration.coverage = seen as f64 / (GRID_CELLS * GRID_CELLS) as f64;
    let report = Report {
        camera: &known.name,
        size_px,
        observations: &observations,
        fits: &Fits {
            fitted: vec![Fit {
                calibration,
                trial: None,
            }],
            failed: Vec::new(),
        },
        images: &[],
        note,
    };
    output::write(
        &output::folder(arguments.output.as_deref(), &arguments.points, "pose"),
        &report,
    )
}

/// Says that a camera is below the horizontal plane in which all points lie: it would see a floor from there if points are exchanged, and they fit as well.
pub(crate) fn below_points(points: &[Correspondence], fit: &PoseFit) -> Option<String> {
    let [x, y, z] = [0, 1, 2].map(|axis| {
        let kept = points.iter().enumerate();
        let kept = kept.filter(|(number, _)| !fit.outliers.contains(number));
        let values = kept.map(move |(_, point)| point.point_m[axis]);
        let least = values.clone().fold(f64::INFINITY, f64::min);
        [least, values.fold(f64::NEG_INFINITY, f64::max)]
    });
    let extent_m = (x[1] - x[0]).max(y[1] - y[0]);
    let below_m = z[0] - fit.camera_from_target.inverse().translation.z;
    (z[1] - z[0] <= FLAT_SHARE * extent_m && below_m > 0.0).then(|| {
        format!(
            "the camera is {below_m:.2} m below the plane of the points: if they are on a floor or a table and z points up, some of them are exchanged, or an axis points the other way"
        )
    })
}
