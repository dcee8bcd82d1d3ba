//! `pardalis camera show`: describes a calibration in numbers and pictures.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::{f64::consts, fs};

use anyhow::Result;
use pardalis_camera::CalibratedCamera;

use super::grid::{GridOptions, read_image};
use super::load::Selection;
use super::optics::{Optics, RadiusSample};
use crate::draw::lens::{FieldOfView, LensCurve, write_distortion, write_field_of_view};
use crate::output::{Shown, print};
use crate::user_error::user_error;

const EXAMPLES: &str = "Examples:
  pardalis camera show scene.toml                        the cameras of a scene, in numbers
  pardalis camera show lens.xml --size 640x480           if the file does not state the size
  pardalis camera show rig.toml -o rig-cameras           also pictures of what the lens sees
  pardalis camera show cam.toml --grid image.jpg -o out  also the world's grid over an image, to see
                                                         whether the pose is right";

/// Shows cameras: model, field of view, resolution, pose
///
/// Angles are measured from the optical axis; the resolution is the number of pixels per degree along the
/// radius of the image. With -o, also draws pictures: the angles in the image, and radius and resolution
/// against the angle.
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct Arguments {
    #[command(flatten)]
    selection: Selection,
    /// The folder for pictures
    #[arg(short, long, value_name = "FOLDER")]
    output: Option<PathBuf>,
    #[command(flatten)]
    grid: GridOptions,
}

/// Runs the command.
pub(super) fn run(arguments: &Arguments) -> Result<()> {
    let file = &arguments.selection.file;
    let mut cameras = arguments.selection.cameras()?;
    let image = match &arguments.grid.grid {
        Some(path) => {
            let camera = Selection::only_camera(&cameras, "--grid")?;
            let image = read_image(path, &camera)?;
            cameras[0].size_px = Some((image.width() as usize, image.height() as usize));
            Some(image)
        }
        None => None,
    };
    let mut descriptions = Vec::new();
    let mut files = Vec::new();
    for camera in &cameras {
        let Some(size_px) = camera.size_px else {
            return Err(user_error!(
                "{}: camera {}: the image size is unknown; give it with --size, such as --size 640x480",
                file.shown(),
                camera.name
            ));
        };
        let optics = Optics::new(&camera.camera, size_px);
        let radius = optics.radius();
        descriptions.push(description(camera, size_px, &optics, &radius));
        let Some(folder) = &arguments.output else {
            continue;
        };
        fs::create_dir_all(folder).map_err(|error| {
            user_error!(
                "-o {}: the folder cannot be created: {error}; choose another",
                folder.shown()
            )
        })?;
        let stem = file_stem(&camera.name);
        let view = field_of_view(&optics, size_px);
        files.extend(write_field_of_view(
            folder,
            &format!("{stem}-field-of-view"),
            &view,
        )?);
        files.extend(draw_distortion(
            folder,
            &format!("{stem}-distortion"),
            &radius,
        )?);
        if let Some(image) = &image {
            let path = folder.join(format!("{stem}-grid.png"));
            arguments.grid.draw(file, camera, image, &path)?;
            files.push(path);
        }
    }
    print(descriptions.join("\n"));
    for file in files {
        print(format!("  {}", file.shown()));
    }
    Ok(())
}

/// Converts a camera's name to a part of a file name.
fn file_stem(name: &str) -> String {
    let fit = |c: char| c.is_alphanumeric() || matches!(c, '-' | '_');
    name.chars().map(|c| if fit(c) { c } else { '_' }).collect()
}

/// Formats all numbers of a camera as lines of text.
fn description(
    camera: &CalibratedCamera,
    (width, height): (usize, usize),
    optics: &Optics,
    radius: &[RadiusSample],
) -> String {
    let mut text = format!("{}\n", camera.name);
    let mut row = |name: &str, value: String| {
        // Writing to a String cannot fail.
        let _ = writeln!(text, "  {name:18} {value}");
    };
    row("model", camera.camera.kind().to_owned());
    for (name, value) in camera.camera.parameters() {
        row(name, format!("{value}"));
    }
    row("image", format!("{width} x {height} px"));
    let [across, down, diagonal] = optics.fields_of_view_rad().map(f64::to_degrees);
    row(
        "field of view",
        format!("{across:.2}° horizontal, {down:.2}° vertical, {diagonal:.2}° diagonal"),
    );
    let largest_deg = optics.largest_angle_rad().to_degrees();
    let from = if optics.looks_ahead() { "z" } else { "-z" };
    row("largest angle", format!("{largest_deg:.2}° from {from}"));
    let share = optics.share_without_ray();
    if share > 0.0 {
        let percent = 100.0 * share;
        row(
            "image circle",
            format!("{percent:.1} % of the pixels have no ray"),
        );
    }
    let per_degree = |sample: &RadiusSample| sample.radial_px_per_rad.to_radians();
    if let [first, .., last] = radius {
        row(
            "pixels per degree",
            format!(
                "{:.3} at the centre, {:.3} at the edge",
                per_degree(first),
                per_degree(last)
            ),
        );
    }
    match &camera.world_from_camera {
        Some(world_from_camera) => {
            let position = world_from_camera.translation.vector;
            row("position", format!("{} m", listed(position.into())));
            let axis = world_from_camera.rotation.matrix().column(2).into_owned();
            let facing = if optics.looks_ahead() { axis } else { -axis };
            row("viewing direction", listed(facing.into()));
        }
        None => row("pose", "none".to_owned()),
    }
    text.pop();
    text
}

fn listed(vector: [f64; 3]) -> String {
    // Avoids -0.
    let [x, y, z] = vector.map(|c| (1e4 * c).round() / 1e4 + 0.0);
    format!("x {x:.4}, y {y:.4}, z {z:.4}")
}

/// Computes the curves of every ten degrees from the axis, and of every thirty around it.
fn field_of_view(optics: &Optics, size_px: (usize, usize)) -> FieldOfView {
    const STEPS: usize = 360;
    let largest_rad = optics.largest_angle_rad();
    let circle = |degrees: usize| {
        let angle_rad = (degrees as f64).to_radians();
        let azimuths = (0..=STEPS).map(|i| consts::TAU * i as f64 / STEPS as f64);
        let curve = azimuths.map(|azimuth| optics.pixel_at(angle_rad, azimuth));
        (format!("{degrees}°"), curve.collect())
    };
    let spoke = |degrees: usize| {
        let azimuth_rad = (degrees as f64).to_radians();
        let angles = (0..=STEPS).map(|i| largest_rad * i as f64 / STEPS as f64);
        angles
            .map(|angle| optics.pixel_at(angle, azimuth_rad))
            .collect()
    };
    let circles = (1..18)
        .map(|i| 10 * i)
        .filter(|degrees| (*degrees as f64).to_radians() <= largest_rad);
    FieldOfView {
        size_px,
        rim_px: optics.rim_px(1440),
        circles: circles.map(circle).collect(),
        spokes: (0..12).map(|i| spoke(30 * i)).collect(),
    }
}

/// Draws radius and resolution, compared with ideal lenses of the same focal length at the centre.
fn draw_distortion(folder: &Path, name: &str, radius: &[RadiusSample]) -> Result<[PathBuf; 2]> {
    let f_px = radius
        .first()
        .map_or(0.0, |sample| sample.radial_px_per_rad);
    let curve = |name, value: &dyn Fn(&RadiusSample) -> f64| LensCurve {
        name,
        points: radius
            .iter()
            .map(|sample| (sample.angle_rad.to_degrees(), value(sample)))
            .collect(),
    };
    // A pinhole sees less than 90 degrees.
    let tan = |angle_rad: f64| {
        if angle_rad < consts::FRAC_PI_2 {
            libm::tan(angle_rad)
        } else {
            f64::INFINITY
        }
    };
    let radii = [
        curve("this camera", &|s| s.radius_px),
        curve("equidistant", &|s| f_px * s.angle_rad),
        curve("pinhole", &|s| f_px * tan(s.angle_rad)),
    ];
    let resolutions = [
        curve("along the radius", &|s| s.radial_px_per_rad.to_radians()),
        curve("across it", &|s| s.tangential_px_per_rad.to_radians()),
    ];
    write_distortion(folder, name, &radii, &resolutions)
}
