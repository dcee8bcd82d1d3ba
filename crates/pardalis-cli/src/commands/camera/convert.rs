//! `pardalis camera convert`: writes a calibration in another program's format.

use std::path::PathBuf;

use anyhow::Result;
use pardalis_camera::CalibratedCamera;
use pardalis_camera::Camera;
use pardalis_scene::calibration::{self, CalibrationFormat};

use super::load::Selection;
use crate::files::write_file;
use crate::output::{Shown, print};
use crate::user_error::user_error;

/// Converts cameras to another format
///
/// Parameters keep every digit, and a model that the format does not support is rejected. Other properties
/// without a place in the format (pose, limit of the field of view, name, image size) are omitted and listed.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  pardalis camera convert calib.yml --to kalibr -o camchain.yaml
  pardalis camera convert four_numbers.yml --as fisheye --to pardalis -o lens.toml
  pardalis camera convert lens.xml --size 1280x960 --to kalibr -o camchain.yaml
  pardalis camera convert rig.toml --camera cam1 --to ros -o cam1.yaml")]
pub(super) struct Arguments {
    #[command(flatten)]
    selection: Selection,
    /// The format to write: pardalis, opencv-yaml, opencv-xml, ros, kalibr, ocamcalib or basalt
    #[arg(long, value_name = "FORMAT", value_parser = format)]
    to: CalibrationFormat,
    /// The file to write
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
}

fn format(word: &str) -> Result<CalibrationFormat, String> {
    CalibrationFormat::ALL
        .into_iter()
        .find(|format| format.name() == word)
        .ok_or_else(|| {
            format!(
                "allowed: {}",
                CalibrationFormat::ALL
                    .map(CalibrationFormat::name)
                    .join(", ")
            )
        })
}

/// Runs the command.
pub(super) fn run(arguments: &Arguments) -> Result<()> {
    let (input, output) = (&arguments.selection.file, &arguments.output);
    let cameras = arguments.selection.cameras()?;
    if let (Ok(from), Ok(to)) = (input.canonicalize(), output.canonicalize())
        && from == to
    {
        return Err(user_error!(
            "-o {}: is the input file; choose another, so that none of its data is lost",
            output.shown()
        ));
    }
    let refuse = |error| user_error!("{}: {error}", input.shown());
    let text = calibration::write(arguments.to, &cameras).map_err(refuse)?;
    // Reading the text back shows what it preserves.
    let held = calibration::read(&text, None).map_err(refuse)?;
    write_file(output, text.as_bytes())?;
    for (camera, held) in cameras.iter().zip(&held) {
        print(format!("{}: {}", camera.name, camera.camera.kind()));
        let lost = lost(camera, held);
        if !lost.is_empty() {
            print(format!(
                "  not written, because {} does not support it: {}",
                arguments.to.name(),
                lost.join(", ")
            ));
        }
    }
    print(format!("  {}", output.shown()));
    Ok(())
}

/// Returns the properties of a camera that were lost in `held`, which was read back from the output.
fn lost(camera: &CalibratedCamera, held: &CalibratedCamera) -> Vec<&'static str> {
    let same_pose = match (&camera.world_from_camera, &held.world_from_camera) {
        (Some(a), Some(b)) => (a.to_homogeneous() - b.to_homogeneous()).amax() < 1e-9,
        (None, _) => true,
        (Some(_), None) => false,
    };
    let same_end = match (lens_end(&camera.camera), lens_end(&held.camera)) {
        (Some(a), Some(b)) => (a - b).abs() <= 1e-9 * a,
        _ => true,
    };
    let parts = [
        ("pose", same_pose),
        ("field of view", same_end),
        ("name", camera.name == held.name),
        (
            "image size",
            camera.size_px.is_none() || camera.size_px == held.size_px,
        ),
    ];
    parts
        .into_iter()
        .filter_map(|(part, kept)| (!kept).then_some(part))
        .collect()
}

/// Returns the limit of a model that is cut off explicitly: an angle in radians, or a radius in pixels.
fn lens_end(camera: &Camera) -> Option<f64> {
    match camera {
        Camera::Equidistant(model) => Some(model.max_angle_rad()),
        Camera::KannalaBrandt(model) => Some(model.max_angle_rad()),
        Camera::Ocam(model) => Some(model.max_radius_px()),
        _ => None,
    }
}
