//! `pardalis rectify`: maps of the ground, seen from above.

mod scene_text;

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use anyhow::Result;
use pardalis::rectify::{Area, Rectifier, default_step_m, visible_area_m};
use pardalis::view::View;
use pardalis_camera::CalibratedCamera;
use pardalis_camera::Camera;
use pardalis_scene::calibration::{self, CalibrationFormat};

use pardalis_images::{GrayImage, RgbImage, encode_png};
use pardalis_scene::{CameraConfig, Scene};
use rayon::prelude::*;

use crate::arguments::Threads;
use crate::folder::{Content, Folder};
use crate::numbers::{counted, fixed, plain};
use crate::output::{Shown, print, warn};
use crate::progress::Progress;
use crate::scene;
use crate::source::{Delivery, Source};
use crate::user_error::user_error;

/// Makes maps of the ground, seen from straight above
///
/// Rectifies the images of a scene's camera into maps of the plane z = 0: x to the right, y upwards, a
/// constant number of metres per pixel, black where the camera does not see the plane. Objects above the
/// plane appear where they occlude it. Writes into a folder: frames/NNNNNN.png with times.csv, camera.toml
/// (the camera of the maps, which accounts for the position of objects above the plane), mask.png if parts
/// are black, and scene.toml, which tracks on the maps.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  pardalis rectify floor.toml                          the part that the camera sees well
  pardalis rectify floor.toml --area -2,-1,2,3 --step 0.005 -o floor-map
  pardalis rectify floor.toml a.jpg b.jpg              these images, by the scene's camera
  pardalis track floor-rectified/scene.toml            tracks on the maps")]
pub(crate) struct Arguments {
    /// The scene file, with a camera whose relation to the plane is known
    #[arg(value_name = "SCENE.toml")]
    scene: PathBuf,
    /// Images to use instead of the camera's
    #[arg(value_name = "IMAGE")]
    images: Vec<PathBuf>,
    /// The camera to use, if the scene has several
    #[arg(long, value_name = "NAME")]
    camera: Option<String>,
    /// The part of the plane: minimum x and y, maximum x and y, in metres [default: the part that the camera
    /// sees well]
    #[arg(long, value_name = "X0,Y0,X1,Y1", value_parser = parse_area, allow_hyphen_values = true)]
    area: Option<Area>,
    /// Metres per pixel [default: as in the images, at the centre of the area]
    #[arg(long, value_name = "METRES")]
    step: Option<f64>,
    /// Uses only the first N of the camera's frames
    #[arg(long, value_name = "COUNT", value_parser = clap::value_parser!(u32).range(1..), conflicts_with = "images")]
    frames: Option<u32>,
    /// The folder for the results [default: the scene's name with -rectified]
    #[arg(short, long, value_name = "FOLDER")]
    output: Option<PathBuf>,
    #[command(flatten)]
    threads: Threads,
    /// Replaces an earlier result
    #[arg(long)]
    force: bool,
}

/// The contents of a folder of maps.
const CONTENT: Content = Content {
    mark: "rectified.txt",
    text: "Written by pardalis rectify, whose --force replaces this folder unless it contains other files.\n",
    what: "a folder of rectified images",
    entries: &["frames", "camera.toml", "mask.png", "scene.toml"],
};

fn parse_area(text: &str) -> Result<Area, String> {
    let numbers: Option<Vec<f64>> = text.split(',').map(|n| n.trim().parse().ok()).collect();
    numbers
        .and_then(|numbers| <[f64; 4]>::try_from(numbers).ok())
        .map(|[x0, y0, x1, y1]| [[x0, y0], [x1, y1]])
        .ok_or_else(|| "allowed: four numbers in metres, such as -2,-1,2,3.5".to_owned())
}

/// Runs the command. The folder appears when it is complete; an earlier failure leaves the previous one
/// intact.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let output = arguments.output.clone().unwrap_or_else(|| {
        let stem = arguments.scene.file_stem().unwrap_or_default();
        PathBuf::from(format!("{}-rectified", stem.to_string_lossy()))
    });
    let pool = arguments.threads.start()?;
    let report = pool.install(|| rectify(arguments, &output))?;
    print(report);
    Ok(())
}

/// Writes the folder and returns a report.
fn rectify(arguments: &Arguments, output: &Path) -> Result<String> {
    let path = &arguments.scene;
    let mut scene = scene::read(path)?;
    let number = selected_camera(path, &scene, arguments.camera.as_deref())?;
    let camera = &mut scene.cameras[number];
    if let Some(frames) = arguments.frames.map(|frames| frames as usize) {
        let limit = &mut camera.frames.limit;
        *limit = Some(limit.map_or(frames, |limit| limit.min(frames)));
    }
    let (source, view) = scene::open_camera(path, camera, &arguments.images)?;
    if source.is_live() {
        return Err(user_error!(
            "{}: cameras.{}: is a live camera, whose images never end; record it to a file first",
            path.shown(),
            camera.name
        ));
    }
    let rectifier = rectifier(arguments, camera, &view)?;
    let folder = Folder::begin(&CONTENT, output, arguments.force)?;
    let images = write_frames(source, camera, &rectifier, &folder)?;
    let is_masked = rectifier.shown().any(|shown| !shown);
    if is_masked {
        folder.write("mask.png", &png_of_mask(&rectifier)?)?;
    }
    let maps_camera = CalibratedCamera {
        name: camera.name.clone(),
        camera: Camera::Plane(*rectifier.camera()),
        size_px: Some(rectifier.size_px()),
        world_from_camera: None,
    };
    let calibration = calibration::write(CalibrationFormat::Pardalis, &[maps_camera])?;
    folder.write("camera.toml", calibration.as_bytes())?;
    let new_scene = scene_text::of(path, &camera.name, is_masked, &view, &rectifier)?;
    folder.write("scene.toml", new_scene.as_bytes())?;
    folder.finish()?;
    Ok(report(arguments, output, images, &rectifier))
}

/// Returns the index of the selected camera.
fn selected_camera(path: &Path, scene: &Scene, name: Option<&str>) -> Result<usize> {
    let names: Vec<&str> = scene.cameras.iter().map(|c| c.name.as_str()).collect();
    let found = match name {
        None if names.len() == 1 => Some(0),
        None => None,
        Some(name) => names.iter().position(|known| *known == name),
    };
    found.ok_or_else(|| {
        let given = name.map_or_else(|| "is needed".to_owned(), |name| format!("is {name}"));
        user_error!(
            "{}: --camera {given}; the scene's cameras are {}",
            path.shown(),
            names.join(", ")
        )
    })
}

fn rectifier(arguments: &Arguments, camera: &CameraConfig, view: &View) -> Result<Rectifier> {
    let area_m = arguments.area.map_or_else(|| visible_area_m(view), Ok);
    let made = area_m.and_then(|area_m| {
        let step_m = arguments
            .step
            .map_or_else(|| default_step_m(view, area_m), Ok)?;
        Rectifier::new(view, area_m, step_m)
    });
    made.map_err(|error| {
        user_error!(
            "{}: cameras.{}: {error} (--area, --step)",
            arguments.scene.shown(),
            camera.name
        )
    })
}

/// Exposure and arrival times of a frame, in seconds.
struct Times {
    frame: usize,
    time_s: f64,
    arrival_s: f64,
}

/// Writes the maps of all frames, numbered in the order of their arrival, and their times. Returns their
/// number.
fn write_frames(
    source: Source,
    camera: &CameraConfig,
    rectifier: &Rectifier,
    folder: &Folder,
) -> Result<usize> {
    let frames = Path::new("frames");
    folder.make(frames)?;
    let progress = Progress::new("rectifying", source.frame_count());
    let one = |(number, delivery): (usize, Result<Delivery>)| {
        progress.step()?;
        match delivery? {
            Delivery::Frame { frame, arrival_s } => {
                let (width, height) = rectifier.size_px();
                let picture =
                    RgbImage::from_raw(width as u32, height as u32, rectifier.rectify(&frame)?)
                        .expect("three bytes per pixel");
                let name = frames.join(format!("{number:06}.png"));
                folder.write(name, &encode_png(&picture)?)?;
                Ok(Some(Times {
                    frame: number,
                    time_s: frame.time_s(),
                    arrival_s,
                }))
            }
            Delivery::Broken(why) => {
                let name = &camera.name;
                progress
                    .aside(|| warn(format!("cameras.{name}: left out a broken image: {why:#}")));
                Ok(None)
            }
        }
    };
    let times = source.enumerate().par_bridge().map(one);
    let times: Vec<Option<Times>> = times.collect::<Result<_>>()?;
    let mut times: Vec<Times> = times.into_iter().flatten().collect();
    if times.is_empty() {
        return Err(user_error!(
            "no frame came from cameras.{}; nothing was written",
            camera.name
        ));
    }
    times.sort_by_key(|times| times.frame);
    folder.write(frames.join("times.csv"), table(&times).as_bytes())?;
    Ok(times.len())
}

/// Formats times.csv, with arrival times only if they differ from the exposure times.
fn table(times: &[Times]) -> String {
    let has_arrivals = times.iter().any(|t| t.arrival_s != t.time_s);
    let mut text = "frame,time_s".to_owned() + if has_arrivals { ",arrival_s\n" } else { "\n" };
    for t in times {
        // Writing to a String cannot fail.
        let _ = write!(text, "{},{}", t.frame, t.time_s);
        if has_arrivals {
            let _ = write!(text, ",{}", t.arrival_s);
        }
        text.push('\n');
    }
    text
}

fn png_of_mask(rectifier: &Rectifier) -> Result<Vec<u8>> {
    let (width, height) = rectifier.size_px();
    let grey = rectifier.shown().map(|shown| if shown { 255 } else { 0 });
    let mask = GrayImage::from_raw(width as u32, height as u32, grey.collect())
        .expect("one byte per pixel");
    Ok(encode_png(&mask)?)
}

/// Formats the report.
fn report(arguments: &Arguments, output: &Path, images: usize, rectifier: &Rectifier) -> String {
    let (width, height) = rectifier.size_px();
    let shown = rectifier.shown().filter(|shown| *shown).count();
    let [[x0, y0], [x1, y1]] = rectifier.area_m();
    let mut text = format!(
        "{} of {width} x {height} pixels, {} m per pixel: x {} to {} m, y {} to {} m; {:.0} % of the pixels show the plane\n",
        counted(images as u64, "image"),
        plain(rectifier.step_m()),
        fixed(x0, 3),
        fixed(x1, 3),
        fixed(y0, 3),
        fixed(y1, 3),
        100.0 * shown as f64 / (width * height) as f64
    );
    let place = match rectifier.camera().center_m() {
        Some(center_m) => {
            let [x, y, z] = center_m.map(|c| fixed(c, 3));
            format!("({x}, {y}, {z}) m")
        }
        None => "an unknown position, so heights above the plane cannot be determined".to_owned(),
    };
    let next = if arguments.images.is_empty() {
        "track"
    } else {
        "locate"
    };
    let scene = output.join("scene.toml");
    // Writing to a String cannot fail.
    let _ = write!(
        text,
        "  {}: seen from {place}\n  {scene}: {} with these images instead of the camera's\nnext: pardalis {next} {scene}",
        output.join("camera.toml").shown(),
        arguments.scene.shown(),
        scene = scene.shown()
    );
    text
}
