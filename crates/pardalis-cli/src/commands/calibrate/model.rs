//! Options that select the models to fit and their starting values.

use std::path::{Path, PathBuf};

use anyhow::Result;
use pardalis_calibrate::{CalibrationStart, ModelKind, OUTLIER_SIGMAS};
use pardalis_camera::CalibratedCamera;

use crate::output::Shown;
use crate::scene_files::read_calibration;
use crate::user_error::user_error;

#[derive(Debug, clap::Args)]
pub(super) struct ModelOptions {
    /// The model to fit, or several to compare: names separated by commas, or all
    ///
    /// Of several models, the best is the one with the fewest parameters whose held-out RMS is within 3 % of
    /// the smallest.
    ///
    /// Ordinary lenses: pinhole (with distortion k1, k2, p1, p2, k3). Fisheyes: equidistant (one focal
    /// length), kannala_brandt, double_sphere, extended_unified, ocam (a polynomial; also for mirrors).
    /// Mirrors: unified (shape l, scale m), mei (shape xi, with distortion; also for fisheyes),
    /// perspective_mirror.
    #[arg(
        long,
        value_name = "NAME,NAME|all",
        value_delimiter = ',',
        required_unless_present = "start"
    )]
    model: Vec<String>,
    /// In place of --model: a calibration file with approximate values from which the fit starts
    ///
    /// The fit keeps the file's model and what points cannot determine, such as the shape of an exact mirror.
    #[arg(long, value_name = "CAMERA.toml", conflicts_with = "model")]
    start: Option<PathBuf>,
    /// Rejects points whose residual exceeds this number of robust standard deviations; inf keeps all points
    #[arg(long, value_name = "SIGMAS", value_parser = parse_sigmas, default_value_t = OUTLIER_SIGMAS)]
    pub(super) outliers: f64,
}

/// A model to fit.
pub(super) struct Model {
    /// Name.
    pub(super) name: &'static str,
    /// Initial camera.
    pub(super) start: CalibrationStart,
    /// Number of robust standard deviations beyond which a point is an outlier.
    pub(super) outlier_sigmas: f64,
}

impl ModelOptions {
    /// Returns the requested models without repetition.
    ///
    /// Fails if a name is unknown or the file to start from cannot be read.
    pub(super) fn models(&self) -> Result<Vec<Model>> {
        if let Some(path) = &self.start {
            let remedy = "extract one with pardalis camera convert --camera NAME";
            let camera = read_camera(path, None, remedy)?.camera;
            let name = camera.kind();
            let start = CalibrationStart::Near(camera);
            return Ok(vec![Model {
                name,
                start,
                outlier_sigmas: self.outliers,
            }]);
        }
        named(&self.model, self.outliers)
    }
}

/// Returns the models of these names without repetition, from unknown parameters.
///
/// Fails if a name is unknown.
pub(super) fn named(names: &[String], outlier_sigmas: f64) -> Result<Vec<Model>> {
    let mut kinds: Vec<ModelKind> = Vec::new();
    for name in names {
        let of_name = match &**name {
            "all" if names.len() > 1 => {
                return Err(user_error!(
                    "--model {}: all includes every model; give either all or names",
                    names.join(",")
                ));
            }
            "all" => ModelKind::ALL.to_vec(),
            name => vec![ModelKind::from_name(name).ok_or_else(|| unknown_model(name))?],
        };
        for kind in of_name {
            if !kinds.contains(&kind) {
                kinds.push(kind);
            }
        }
    }
    let model = |kind: ModelKind| Model {
        name: kind.name(),
        start: CalibrationStart::Model(kind),
        outlier_sigmas,
    };
    Ok(kinds.into_iter().map(model).collect())
}

fn unknown_model(name: &str) -> anyhow::Error {
    let known: Vec<&str> = ModelKind::ALL.iter().map(|kind| kind.name()).collect();
    user_error!(
        "--model {name}: unknown model; allowed: {}, or all",
        known.join(", ")
    )
}

/// Reads a camera from a calibration file: the one with this name, or the only one.
///
/// Fails if the file cannot be read, has no such camera, or has several and `name` is missing; `remedy` then
/// states how to choose one.
pub(super) fn read_camera(
    path: &Path,
    name: Option<&str>,
    remedy: &str,
) -> Result<CalibratedCamera> {
    let cameras = read_calibration(Path::new(""), &path.to_string_lossy(), None)
        .map_err(|message| user_error!("{message}"))?;
    let names: Vec<String> = cameras.iter().map(|camera| camera.name.clone()).collect();
    let names = names.join(", ");
    let several = cameras.len() > 1;
    let found = cameras
        .into_iter()
        .find(|camera| name.is_none_or(|name| camera.name == name));
    match (found, name) {
        (None, name) => Err(user_error!(
            "{}: has no camera {}; found: {names}",
            path.shown(),
            name.unwrap_or("at all")
        )),
        (Some(_), None) if several => Err(user_error!(
            "{}: has several cameras ({names}); {remedy}",
            path.shown()
        )),
        (Some(camera), _) => Ok(camera),
    }
}

/// Parses a number of robust standard deviations.
fn parse_sigmas(text: &str) -> Result<f64, String> {
    let sigmas = text.parse().ok().filter(|sigmas| *sigmas >= 2.0);
    sigmas.ok_or_else(|| "allowed: 2 or more, such as 6; inf keeps all points".to_owned())
}
