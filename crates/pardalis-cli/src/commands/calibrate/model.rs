//! Which models are fitted, and from what they start.

use std::path::{Path, PathBuf};

use anyhow::Result;
use pardalis_calibrate::{CalibrationStart, ModelKind, OUTLIER_SIGMAS};
use pardalis_camera::CalibratedCamera;

use crate::scene::read_calibration;
use crate::user_error::user_error;

#[derive(Debug, clap::Args)]
pub(super) struct ModelOptions {
    /// The model to fit, or several to compare: names with commas between them, or all
    ///
    /// Of several, the best is that of fewest parameters whose held-out RMS is within 3 % of the least.
    ///
    /// Ordinary lenses: pinhole (with distortion k1, k2, p1, p2, k3). Fisheyes: equidistant (one focal length), kannala_brandt,
    /// double_sphere, extended_unified, ocam (a polynomial; mirrors too). Mirrors: unified (shape l, scale m), mei (shape xi, with
    /// distortion; fisheyes too), perspective_mirror.
    #[arg(
        long,
        value_name = "NAME,NAME|all",
        value_delimiter = ',',
        required_unless_present = "start"
    )]
    model: Vec<String>,
    /// In place of --model: a calibration file whose camera is fitted anew, starting from its numbers
    ///
    /// Its model is kept, and so is what points cannot tell, such as the shape of an exact mirror.
    #[arg(long, value_name = "CAMERA.toml", conflicts_with = "model")]
    start: Option<PathBuf>,
    /// Leaves out points whose residual is more robust standard deviations than this; inf keeps all
    #[arg(long, value_name = "SIGMAS", value_parser = parse_sigmas, default_value_t = OUTLIER_SIGMAS)]
    pub(super) outliers: f64,
}

/// A model to fit.
pub(super) struct Model {
    /// Its name.
    pub(super) name: &'static str,
    /// What it starts from.
    pub(super) start: CalibrationStart,
    /// Robust standard deviations beyond which points are left out.
    pub(super) outlier_sigmas: f64,
}

impl ModelOptions {
    /// The models that were asked for, each once.
    ///
    /// Errors: a name is unknown, or the file to start from cannot be read.
    pub(super) fn models(&self) -> Result<Vec<Model>> {
        if let Some(path) = &self.start {
            let remedy = "take one out with pardalis camera convert --camera NAME";
            let camera = read_camera(path, None, remedy)?.camera;
            let name = camera.kind();
            let start = CalibrationStart::Near(camera);
            return Ok(vec![self.model(name, start)]);
        }
        let mut kinds: Vec<ModelKind> = Vec::new();
        for name in &self.model {
            let named = match &**name {
                "all" if self.model.len() > 1 => {
                    return Err(user_error!(
                        "--model {}: all has every model already; give all alone, or the names of some",
                        self.model.join(",")
                    ));
                }
                "all" => ModelKind::ALL.to_vec(),
                name => vec![ModelKind::from_name(name).ok_or_else(|| unknown_model(name))?],
            };
            for kind in named {
                if !kinds.contains(&kind) {
                    kinds.push(kind);
                }
            }
        }
        let of_kind = |kind: ModelKind| self.model(kind.name(), CalibrationStart::Model(kind));
        Ok(kinds.into_iter().map(of_kind).collect())
    }

    fn model(&self, name: &'static str, start: CalibrationStart) -> Model {
        Model {
            name,
            start,
            outlier_sigmas: self.outliers,
        }
    }
}

fn unknown_model(name: &str) -> anyhow::Error {
    let known: Vec<&str> = ModelKind::ALL.iter().map(|kind| kind.name()).collect();
    user_error!(
        "--model {name}: there is no such model; allowed: {}, or all",
        known.join(", ")
    )
}

/// A camera of a calibration file: the one of this name, or the only one.
///
/// Errors: the file cannot be read, has no such camera, or has several and none is named, for which there is the remedy.
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
            path.display(),
            name.unwrap_or("at all")
        )),
        (Some(_), None) if several => Err(user_error!(
            "{}: has several cameras ({names}); {remedy}",
            path.display()
        )),
        (Some(camera), _) => Ok(camera),
    }
}

/// Parses robust standard deviations.
fn parse_sigmas(text: &str) -> Result<f64, String> {
    let sigmas = text.parse().ok().filter(|sigmas| *sigmas >= 2.0);
    sigmas.ok_or_else(|| "allowed: 2 or more, such as 6; inf keeps all points".to_owned())
}

/// Parses `WIDTHxHEIGHT`.
pub(in crate::commands) fn parse_size(text: &str) -> Result<(usize, usize), String> {
    let sides = text
        .split_once('x')
        .and_then(|(width, height)| Some((width.parse().ok()?, height.parse().ok()?)));
    let allowed = 1..=pardalis_core::error::MAX_IMAGE_SIDE_PX;
    sides
        .filter(|(width, height)| allowed.contains(width) && allowed.contains(height))
        .ok_or_else(|| {
            format!(
                "allowed: width and height in pixels up to {}, such as 640x480",
                allowed.end()
            )
        })
}
