//! `pardalis likelihood`: illustrates the contour cue in one frame of a scene (thesis figs. 4.5, 4.7 and 5.1).

mod curves;

use std::path::{Path, PathBuf};

use anyhow::Result;
use nalgebra::Point3;
use pardalis::reference;
use pardalis::shape::Stance;
use pardalis::view::View;
use pardalis_scene::{BodyConfig, Scene};

use self::curves::{Setup, along_ray, over_scales, to_csv};
use crate::commands::locate::parse_pixel;
use crate::draw::likelihood::{Sampled, write_curves, write_sampled};
use crate::files::write_file;
use crate::output::{Shown, print};
use crate::scene;
use crate::source::{Delivery, Source};
use crate::user_error::user_error;

/// Margin of the picture around the outer contour, in pixels.
const MARGIN_PX: f64 = 4.0;
/// Maximum side of the picture, in pixels of the image.
const MAX_SIDE_PX: usize = 120;
/// Number of points of the drawn outline.
const OUTLINE_POINTS: usize = 200;

/// Illustrates the likelihood of the contour cue in one frame
///
/// For one position of a target, writes into a folder: sampled.svg (the inner and outer pixels that are compared,
/// over the image), scales.svg (the likelihood of the outline scaled by a factor) and ray.svg (the likelihood of a
/// target along the ray through a pixel, against its distance from the camera), each also as PNG, and the curves as
/// scales.csv and ray.csv. Likelihoods are log-likelihood ratios to pure background in nats.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  pardalis likelihood ball.toml --at 1.35,-1.25,0.62 -o likelihood
  pardalis likelihood ball.toml --frame 20 --at 1.35,-1.25,0.62 --pixel 457,90 --contours 0.9,1.1 -o likelihood")]
pub(crate) struct Arguments {
    /// The scene file, with one or more cameras and a target that uses the contour cue
    #[arg(value_name = "SCENE.toml")]
    scene: PathBuf,
    /// The position of the target in the world, in metres
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_position, allow_hyphen_values = true)]
    at: [f64; 3],
    /// The index of the frame, from 0
    #[arg(long, default_value_t = 0)]
    frame: usize,
    /// The target [default: the first]
    #[arg(long)]
    target: Option<String>,
    /// The pixel whose ray is searched [default: the projection of the position]
    #[arg(long, value_name = "U,V", value_parser = parse_pixel)]
    pixel: Option<[f64; 2]>,
    /// Scales of another inner and outer contour, for a second curve in addition to the scene's
    #[arg(long, value_name = "INNER,OUTER", value_parser = parse_pixel)]
    contours: Option<[f64; 2]>,
    /// The largest distance along the ray, in metres
    #[arg(long, default_value_t = 8.0)]
    max_range_m: f64,
    /// The folder for the results
    #[arg(short, long, value_name = "FOLDER")]
    output: PathBuf,
}

/// Runs the command.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let scene = scene::read(&arguments.scene)?;
    let body = body_of(&scene, arguments)?;
    let colors = scene::colors(&arguments.scene, body)?;
    let camera = &scene.cameras[0];
    let (source, view) = scene::open_camera(&arguments.scene, camera, &[])?;
    let frame = frame_of(source, arguments.frame)?;
    let Some(settings) = body.contour() else {
        return Err(user_error!(
            "{}: targets.{} has no contour cue, the only one that this command illustrates",
            arguments.scene.shown(),
            body.name
        ));
    };
    let range_m = arguments.max_range_m;
    if !(range_m > 0.0 && range_m.is_finite()) {
        return Err(user_error!(
            "--max-range-m {range_m}: allowed: more than 0 metres"
        ));
    }
    let setup = Setup {
        shape: body.shape,
        colors: &colors,
        views: std::slice::from_ref(&view),
        frames: &[(0, frame)],
    };
    let all_settings = curves::with_contours(settings, arguments.contours)?;
    let pixel = match arguments.pixel {
        Some(pixel) => pixel,
        None => pixel_of(&view, arguments.at)?,
    };
    let folder = &arguments.output;
    std::fs::create_dir_all(folder)
        .map_err(|error| user_error!("-o {}: {error}", folder.shown()))?;

    let scales = over_scales(&setup, &all_settings, arguments.at);
    let (ray, distance_m) = along_ray(&setup, &all_settings, pixel, arguments.at, range_m)?;
    let mut files = Vec::new();
    for (stem, name, x_name, curves, marked) in [
        (
            "scales",
            "scale",
            "scale of the outline",
            &scales,
            (1.0, "the true size"),
        ),
        (
            "ray",
            "distance_m",
            "distance along the ray (m)",
            &ray,
            (distance_m, "the given position"),
        ),
    ] {
        let path = folder.join(format!("{stem}.csv"));
        write_file(&path, to_csv(name, curves).as_bytes())?;
        files.push(path);
        files.extend(write_curves(folder, stem, x_name, curves, marked)?);
    }
    files.extend(write_pixels(folder, &setup, settings, arguments.at)?);
    for file in files {
        print(file.shown());
    }
    Ok(())
}

/// Returns the body whose likelihood is computed.
fn body_of<'s>(scene: &'s Scene, arguments: &Arguments) -> Result<&'s BodyConfig> {
    let targets = &scene.targets;
    let target = match &arguments.target {
        None => targets.first(),
        Some(name) => targets.iter().find(|target| target.name == *name),
    };
    let Some(target) = target else {
        let names: Vec<&str> = targets.iter().map(|target| &*target.name).collect();
        return Err(user_error!(
            "--target {}: allowed: {}",
            arguments.target.as_deref().unwrap_or_default(),
            names.join(", ")
        ));
    };
    Ok(&target.bodies[0])
}

/// Returns the frame with this index.
fn frame_of(source: Source, number: usize) -> Result<pardalis::Frame> {
    let input = source.describe().input.clone();
    for (i, delivery) in source.enumerate() {
        match delivery? {
            Delivery::Frame { frame, .. } if i == number => return Ok(frame),
            Delivery::Broken(error) if i == number => return Err(error),
            _ => {}
        }
    }
    Err(user_error!("--frame {number}: {input} has fewer frames"))
}

/// Returns the projection of a position.
fn pixel_of(view: &View, position_m: [f64; 3]) -> Result<[f64; 2]> {
    let in_camera = view.camera_from_world() * Point3::from(position_m);
    view.camera().project(in_camera.into()).ok_or_else(|| {
        let [x, y, z] = position_m;
        user_error!("--at {x},{y},{z}: the camera cannot see this position")
    })
}

/// Draws the pixels that are compared for a target at this position.
fn write_pixels(
    folder: &Path,
    setup: &Setup<'_>,
    settings: &pardalis::likelihood::ContourSettings,
    position_m: [f64; 3],
) -> Result<Vec<PathBuf>> {
    let (view, (_, frame)) = (&setup.views[0], &setup.frames[0]);
    let sides = reference::boundary(view, &setup.shape, settings, position_m).map(|side| {
        let open = |pixel| reference::open_pixel(view, pixel);
        side.into_iter()
            .flatten()
            .filter_map(open)
            .collect::<Vec<_>>()
    });
    let outline = setup.shape.outline_px(
        view.camera(),
        view.camera_from_world(),
        position_m,
        Stance::default(),
        OUTLINE_POINTS,
    );
    let outline: Vec<[f64; 2]> = outline.into_iter().flatten().collect();
    let seen = sides.iter().flatten().map(|pixel| pixel.map(|v| v as f64));
    let corners = seen.chain(outline.iter().copied()).fold(None, |ends, p| {
        let [low, high] = ends.unwrap_or([p, p]);
        Some([
            [0, 1].map(|axis| p[axis].min(low[axis])),
            [0, 1].map(|axis| p[axis].max(high[axis])),
        ])
    });
    let Some([low, high]) = corners else {
        return Err(user_error!("--at: no pixel of the target is in the image"));
    };
    let size = [frame.width(), frame.height()];
    let first = [0, 1].map(|axis| (low[axis] - MARGIN_PX).max(0.0) as usize);
    let end = [0, 1].map(|axis| {
        let end = (high[axis] + MARGIN_PX + 1.0).max(0.0) as usize;
        end.min(size[axis]).min(first[axis] + MAX_SIDE_PX)
    });
    let rows = (first[1]..end[1])
        .map(|y| (first[0]..end[0]).map(|x| frame.rgb(x, y)).collect())
        .collect();
    write_sampled(
        folder,
        "sampled",
        &Sampled {
            origin_px: first,
            rows,
            sides: [&sides[0], &sides[1]],
            outline_px: &outline,
        },
    )
}

/// Parses `X,Y,Z`.
fn parse_position(text: &str) -> Result<[f64; 3], String> {
    let numbers: Option<Vec<f64>> = text.split(',').map(|n| n.trim().parse().ok()).collect();
    numbers
        .and_then(|numbers| <[f64; 3]>::try_from(numbers).ok())
        .filter(|position| position.iter().all(|v| v.is_finite()))
        .ok_or_else(|| "allowed: three numbers in metres, such as 1.35,-1.25,0.62".to_owned())
}
